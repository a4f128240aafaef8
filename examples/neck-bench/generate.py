"""Write the bench record of this example: four cyclic tests of a neck, from a finer twin than the one calibrated.

    python generate.py                 data/ from truth.yaml and truth-elastic.csv; NumPy alone, always the same
    python generate.py --twin          first truth-elastic.csv again, by the finer twin (needs Gmsh, takes some minutes)
    python generate.py --mesh          first neck.msh, the coarser mesh of the project (needs Gmsh)
    python generate.py --out DIR       somewhere else

Each test is pulled to its target and let go down to the lower force limit, eight times. What happens to the elastic
answer of the finer twin on its way into the files, in this order:

    slack        the cable hangs at first; a permanent set makes the slack grow, and lets the neck at rest lean
    overstress   pulled, the force stands above the elastic curve, let go below it, by the same share
    softening    the first cycle is stiffer than the later ones
    pulleys      the machine pulls exp(n mu theta) times the neck's tension
    instruments  noise, offsets, drifts, a sensor screwed on backwards and askew, two clocks
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from scipy.interpolate import CubicSpline

from softcal.checks import Floats
from softcal.geometry.neck import Neck
from softcal.geometry.write import write_mesh
from softcal.twin.barrier import Contact
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate
from softcal.units import parse_quantity

HERE = Path(__file__).parent
N_CYCLES = 8
CABLE_RADIUS = 0.05  # [m]
PROJECT_TETS = 2000


@dataclass(frozen=True)
class Elastic:
    """The elastic curve of the finer twin: shortening [m], tension at the neck [N], pitch [rad]."""

    shortening: Floats
    tension: Floats
    pitch: Floats


@dataclass(frozen=True)
class Record:
    """What happened at the bench over the machine's time [s], before any instrument looked at it.

    shortening: of the crosshead [m]; tension: at the machine [N]; pitch: of the plate [rad].
    """

    time: Floats
    shortening: Floats
    tension: Floats
    pitch: Floats


def read_truth(path: Path = HERE / "truth.yaml") -> dict[str, Any]:
    """The true values; quantities still as text with a unit."""
    with path.open(encoding="utf-8") as stream:
        return YAML(typ="safe").load(stream)


def si(section: Mapping[str, Any], key: str, unit: str) -> float:
    """A quantity of the truth in SI."""
    return parse_quantity(section[key], unit, where=key)


def solve_elastic(truth: Mapping[str, Any]) -> Elastic:
    """The curve of the finer twin, meshed by Gmsh."""
    twin = truth["twin"]
    shape = Neck(tets=twin["tets"], waist_refinement=twin["waist_refinement"], sectors=twin["sectors"])
    mesh = shape.mesh()
    parameters = {
        "youngs_modulus": si(truth["neck"], "youngs_modulus", "Pa"),
        "poissons_ratio": float(truth["neck"]["poissons_ratio"]),
    }
    body = Body("neck", mesh, mesh.node_sets["socket"], parameters, element=twin["element"])
    top = np.array([0.0, 0.0, shape.height])
    plate = Plate("plate", {"neck": mesh.node_sets["collar"]}, top)
    start, end = np.array([CABLE_RADIUS, 0.0, shape.height]), np.array([CABLE_RADIUS, 0.0, shape.clamp_depth])
    cable = Cable("front", (ViaPoint(start, "plate"), ViaPoint(end)))
    robot = Robot((body,), (plate,), (cable,), contact=Contact())
    shortening = np.linspace(0.0, si(truth["curve"], "reach", "m"), truth["curve"]["points"])
    response = simulate(robot, Protocol({"front": Command("shortening", shortening)}), curve_tolerance=1e-5)
    if not response.succeeded:
        raise SystemExit(response.status)
    return Elastic(shortening, response.channels["front.tension"], response.channels["plate.pitch"])


def write_elastic(curve: Elastic, path: Path) -> None:
    """Write the elastic curve as a table."""
    rows = [
        f"{1e3 * d:.2f},{t:.6f},{p:.8f}" for d, t, p in zip(curve.shortening, curve.tension, curve.pitch, strict=True)
    ]
    head = ["# The finer twin at the values of truth.yaml, by generate.py --twin", "shortening_mm,tension_N,pitch_rad"]
    path.write_text("\n".join([*head, *rows, ""]), encoding="utf-8")


def read_elastic(path: Path = HERE / "truth-elastic.csv") -> Elastic:
    """The elastic curve as it was written."""
    shortening, tension, pitch = np.loadtxt(path, delimiter=",", skiprows=2).T
    return Elastic(1e-3 * shortening, tension, pitch)


def perform(truth: Mapping[str, Any], test: Mapping[str, Any], curve: Elastic) -> Record:
    """One test of eight cycles, sample by sample."""
    machine, material = truth["machine"], truth["material"]
    step = si(machine, "interval", "s")
    travel, target = si(test, "speed", "m/s") * step, si(test, "target", "m")
    limit = si(machine, "lower_force_limit", "N") - si(machine, "load_cell_offset", "N")
    reversal, growth = si(material, "reversal", "m"), float(material["set_growth"])
    slack, final_set = si(test, "slack", "m"), si(test, "set", "m")
    tension_at = CubicSpline(curve.shortening, curve.tension)
    pitch_at = CubicSpline(curve.shortening, curve.pitch)
    pulleys = math.exp(
        truth["pulleys"]["count"] * truth["pulleys"]["friction_coefficient"] * si(truth["pulleys"], "wrap", "rad")
    )

    rest = round(si(machine, "rest", "s") / step)
    pulled, forces, pitches = [0.0] * rest, [0.0] * rest, [0.0] * rest
    position = over = loaded = let_go = lean = 0.0

    def move(sign: float) -> float:
        nonlocal position, over, loaded, let_go, lean
        position += sign * travel
        over += (sign * test["overstress"] - over) * travel / reversal
        loaded, let_go = loaded + max(sign, 0.0) * travel, let_go + max(-sign, 0.0) * travel
        grown = final_set * (1.0 - math.exp(-loaded / target / growth))
        lean = si(material, "set_tilt", "rad/m") * grown
        free = max(position - slack - grown, 0.0)
        soft = 1.0 + material["softening"] * material["softening_decay"] ** (let_go / target)
        force = pulleys * soft * (1.0 + over) * float(tension_at(free))
        pulled.append(position)
        forces.append(force)
        pitches.append(float(pitch_at(free)) + lean)
        return force

    for _ in range(N_CYCLES):
        while position < target - 0.5 * travel:
            move(1.0)
        while move(-1.0) > limit:
            pass
    for values in (pulled, forces, pitches):
        values += [values[-1]] * rest
    return Record(step * np.arange(len(pulled)), np.array(pulled), np.array(forces), np.array(pitches))


def write_machine(path: Path, truth: Mapping[str, Any], test: Mapping[str, Any], record: Record) -> None:
    """The machine's file: ';', decimal comma, free lines above the names, the units in a row under them."""
    machine = truth["machine"]
    random = np.random.Generator(np.random.PCG64(test["seed"]))
    noise = random.standard_normal((2, len(record.time)))
    shortening = record.shortening + si(machine, "displacement_noise", "m") * noise[0]
    force = record.tension + si(machine, "load_cell_offset", "N") + si(machine, "force_noise", "N") * noise[1]
    lines = [
        "Test method;Cyclic traction, 8 cycles",
        "Specimen label;Soft neck, TPU 82A, frontal cable",
        f"Target displacement;{_comma(1e3 * si(test, 'target', 'm'), 1)};mm",
        f"Speed;{_comma(1e3 * si(test, 'speed', 'm/s'), 1)};mm/s",
        f"Lower force limit;{_comma(si(machine, 'lower_force_limit', 'N'), 1)};N",
        "",
        "Time;Extension;Load",
        "(s);(mm);(N)",
    ]
    lines += [
        f"{_comma(t, 2)};{_comma(1e3 * d, 3)};{_comma(f, 3)}"
        for t, d, f in zip(record.time, shortening, force, strict=True)
    ]
    path.write_bytes("\r\n".join([*lines, ""]).encode("utf-8"))


def write_imu(path: Path, truth: Mapping[str, Any], test: Mapping[str, Any], record: Record) -> None:
    """The IMU's file, on its own clock, begun before the machine and ended after it."""
    imu = truth["imu"]
    random = np.random.Generator(np.random.PCG64(test["seed"] + 1000))
    lag, faster = si(test, "lag", "s"), 1.0 + float(test["clock_rate"])
    step = si(imu, "interval", "s")
    planned = np.arange(0.0, lag + faster * record.time[-1] + 2.5, step)
    clock = planned + si(imu, "jitter", "s") * random.uniform(-1.0, 1.0, len(planned))
    clock = clock[random.uniform(size=len(clock)) >= imu["lost"]]
    clock = np.round(np.maximum(clock, 0.0), 4)
    pitch = np.interp((clock - lag) / faster, record.time, record.pitch)
    # Screwed on backwards: a neck that bows forwards raises the sensor's nose.
    askew = si(imu, "misalignment", "rad")
    true = {"roll": pitch * math.sin(askew), "pitch": -pitch * math.cos(askew), "yaw": np.zeros_like(pitch)}
    columns = {
        axis: np.degrees(
            values
            + si(imu["offsets"], axis, "rad")
            + si(imu["drifts"], axis, "rad/s") * clock
            + si(imu, "noise", "rad") * random.standard_normal(len(clock))
        )
        for axis, values in true.items()
    }
    rows = [
        f"{t:.4f},{r:.3f},{p:.3f},{y:.3f}"
        for t, r, p, y in zip(clock, columns["roll"], columns["pitch"], columns["yaw"], strict=True)
    ]
    head = ["# IMU on the back of the top plate", "Time [s],Roll [deg],Pitch [deg],Yaw [deg]"]
    path.write_text("\n".join([*head, *rows, ""]), encoding="utf-8")


def write_record(out: Path, truth: Mapping[str, Any], curve: Elastic) -> list[Path]:
    """All files of the record; says where they are."""
    out.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for name, test in truth["experiments"].items():
        record = perform(truth, test, curve)
        machine, imu = out / f"utm-{name.replace('_', '-')}.csv", out / f"imu-{name.replace('_', '-')}.csv"
        write_machine(machine, truth, test, record)
        write_imu(imu, truth, test, record)
        written += [machine, imu]
    return written


def main() -> None:
    """Read the arguments and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twin", action="store_true", help="solve the finer twin again")
    parser.add_argument("--mesh", action="store_true", help="mesh the project's neck again")
    parser.add_argument("--out", type=Path, default=HERE, metavar="DIR", help="where to write")
    told = parser.parse_args()
    truth = read_truth()
    told.out.mkdir(parents=True, exist_ok=True)
    if told.mesh:
        mesh = Neck(tets=PROJECT_TETS, waist_refinement=12, sectors=6).mesh()
        write_mesh(replace(mesh, points=np.round(1e3 * mesh.points, 6)), told.out / "neck.msh")  # in mm
    if told.twin:
        write_elastic(solve_elastic(truth), told.out / "truth-elastic.csv")
    curve = read_elastic(told.out / "truth-elastic.csv" if told.twin else HERE / "truth-elastic.csv")
    write_record(told.out / "data", truth, curve)


def _comma(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace(".", ",")


if __name__ == "__main__":
    main()
