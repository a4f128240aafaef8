"""Write the data of this example again, from a finer twin and the truth below; always the same.

python generate.py --out runs/again         a minute; needs Gmsh
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from softcal.geometry.generate import mesh_file
from softcal.geometry.regions import Cavity, Plane, select_faces, select_nodes
from softcal.project.project import load
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

HERE = Path(__file__).parent
TRUTH = {"finger.youngs_modulus": 262e3, "main.dead_volume": 7.4e-6}
SIZE = 4e-3  # [m], of the finer twin's elements; the project's are 6 mm
TESTS = {"pressure": (24e3, 1), "syringe": (6e-6, 2)}  # largest pressure [Pa] or volume [m^3], seed
NOISE_KPA, NOISE_MM, SAMPLES = 0.1, 0.15, 19
FOOT = Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def finer_robot() -> Robot:
    """The project's robot on a finer mesh, at the truth."""
    robot = load(HERE / "project.yaml").robot
    mesh = mesh_file(HERE / "pneunet.step", size=SIZE)
    body = replace(robot.bodies[0], mesh=mesh, fixed=select_nodes(mesh, FOOT))
    wall = select_faces(mesh, Cavity((0.01, 0.0, 0.012), (FOOT,)))
    (main,) = robot.actuators
    chamber = replace(main, actuator=main.actuator.on_surfaces({"finger": wall}))
    return with_parameters(replace(robot, bodies=(body,), actuators=(chamber,)), TRUTH)


def main() -> None:
    """Write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=HERE / "runs" / "again")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    robot = finer_robot()
    for name, (largest, seed) in TESTS.items():
        control = "pressure" if name == "pressure" else "volume"
        response = simulate(robot, Protocol({"main": Command(control, np.linspace(0.0, largest, SAMPLES))}))
        chance = np.random.default_rng(seed)
        columns = {"volume [ml]": 1e6 * response.channels["main.volume"]}
        columns["pressure [kPa]"] = 1e-3 * response.channels["main.pressure"]
        if control == "volume":
            columns["pressure [kPa]"] += NOISE_KPA * chance.standard_normal(SAMPLES)
        for marker in ("m1", "m2", "m3"):
            for axis in "xz":
                measured = 1e3 * response.channels[f"{marker}.{axis}"] + NOISE_MM * chance.standard_normal(SAMPLES)
                columns[f"{marker} {axis} [mm]"] = measured
        if control == "pressure":
            del columns["volume [ml]"]
        rows = zip(*columns.values(), strict=True)
        lines = [",".join(columns), *(",".join(f"{value:.3f}" for value in row) for row in rows)]
        (folder / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
