"""The shape of the neck and its modulus, and what the authors' mesh table says of the scale: writes the numbers of
docs/neck-shape.md.

python -m benchmarks.neck_shape [--out FOLDER]

Takes six minutes. No contact, but where a table says so: else the links may pass through each other, from some 15 mm
of shortening on.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.optimize import least_squares

from benchmarks.machine import machine
from benchmarks.mesh_table import AUTHORS
from benchmarks.neck_case import CABLE_RADIUS, PITCH, TENSION, YOUNGS_MODULUS, neck_robot, pull
from benchmarks.section import table
from benchmarks.written_page import written_page
from softcal.checks import Floats
from softcal.geometry.neck import Neck
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.simulate import simulate

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "neck-shape.md"
DOMES: tuple[Literal["cubic", "ellipse"], ...] = ("cubic", "ellipse")
BENCH_RATIO = 0.45  # Poisson's ratio of the fits of the bench tests
DIAMETERS = (0.032, 0.034, 0.036, 0.038, 0.040)  # [m]
LEVERS = (0.046, 0.050, 0.054)  # [m]
BENCH_DIAMETERS = DIAMETERS[2:]
DIAMETER = 0.038  # [m]
MESHES = ((2000, 10, 6), (3000, 16, 6), (5000, 12, 8), (12000, 12, 12))  # tets, refinement of the waists, sectors
MOST_RATIO = 0.4999  # Poisson's, at the bound of examples/neck
AT = (0.015, 0.03, 0.05)  # [m] of shortening
THEIR_PULL = 0.04  # [m], not stated; their pitch times the usual lever
FARTHEST = 0.062  # [m], where the curves end


@dataclass(frozen=True)
class Curve:
    """Tension [N] and pitch [deg] over shortening [m]."""

    shortening: Floats
    tension: Floats
    pitch: Floats

    def at_pitch(self, pitch: float) -> tuple[float, float]:
        """Shortening [m] and tension [N] where the plate has a pitch [deg]."""
        shortening = float(np.interp(pitch, self.pitch, self.shortening))
        return shortening, float(np.interp(shortening, self.shortening, self.tension))


@dataclass(frozen=True)
class Fit:
    """Young's modulus [Pa], slack [m] and RMSE of the tension [N] of a bench test."""

    E: float
    slack: float
    rmse: float


def curve(shape: Neck, lever: float, element: str, nu: float, end: float, *, contact: bool = False) -> Curve:
    mesh = shape.mesh()
    shortening = np.linspace(0.0, end, 125)
    robot = neck_robot(mesh, element, nu=nu, shape=shape, cable_radius=lever)
    robot = replace(robot, contact=Contact() if contact else None)
    found = simulate(robot, pull(shortening), curve_tolerance=1e-4)
    if not found.succeeded:
        raise RuntimeError(f"{shape}, lever {lever:g} m: {found.status}")
    return Curve(shortening, found.channels[TENSION], np.degrees(found.channels[PITCH]))


def bench_fits(
    diameter: float,
    lever: float = CABLE_RADIUS,
    dome: Literal["cubic", "ellipse"] = "cubic",
    *,
    contact: bool = False,
) -> list[Fit]:
    """Every test of examples/neck by modulus and slack, on its own kind of mesh."""
    shape = Neck(diameter, dome=dome, tets=2000, sectors=6, waist_refinement=10)
    fits = fitted(curve(shape, lever, "P2P1", BENCH_RATIO, FARTHEST, contact=contact))
    print(f"{dome}, {1e3 * diameter:.1f} mm, lever {1e3 * lever:.1f} mm: {_moduli(fits)} MPa", flush=True)
    return fits


def fitted(twin: Curve) -> list[Fit]:
    """Every test of examples/neck by modulus and slack: at a given slack and without weight, tension is linear in E."""
    fits: list[Fit] = []
    for experiment in load(ROOT / "examples" / "neck" / "project.yaml").experiments.values():
        channels = experiment.dataset.channels
        pulled, measured = channels["shortening"].values, channels["tension"].values

        def residuals(x: Floats, pulled: Floats = pulled, measured: Floats = measured) -> Floats:
            return x[0] * np.interp(pulled - 1e-3 * x[1], twin.shortening, twin.tension) - measured

        found = least_squares(residuals, [1.0, 2.0], bounds=([0.1, -3.0], [10.0, 12.0]))
        rmse = float(np.sqrt(np.mean(found.fun**2)))
        fits.append(Fit(found.x[0] * YOUNGS_MODULUS, 1e-3 * found.x[1], rmse))
    return fits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=PAGE.parent, help="folder of neck-shape.md")
    out = parser.parse_args().out
    (out / PAGE.name).write_text(written_page(PAGE, values()), encoding="utf-8")
    print(f"Written: {out / PAGE.name}")


def values() -> dict[str, str]:
    """What the page has, by the names of its marks."""
    tables = {"bench": _bench(), "meshes": _meshes(), "machine": table(["", ""], machine()), **_scale()}
    return {name: "\n".join(lines) for name, lines in tables.items()}


def _bench() -> list[str]:
    header = ["dome", "contact", "D", "E, 20 mm", "E, 40 mm", "E, 60 mm", "slack [mm]", "RMSE [N]"]
    rows = [
        [dome, "yes" if contact else "", *_bench_row(diameter, bench_fits(diameter, dome=dome, contact=contact))]
        for dome, contact in (*((dome, False) for dome in DOMES), (DOMES[0], True))
        for diameter in BENCH_DIAMETERS
    ]
    return table(header, rows)


def _bench_row(diameter: float, fits: Sequence[Fit]) -> list[str]:
    slacks = ", ".join(f"{1e3 * fit.slack:.2f}" for fit in fits)
    errors = ", ".join(f"{fit.rmse:.3f}" for fit in fits)
    return [f"{1e3 * diameter:.0f} mm", *(f"{1e-6 * fit.E:.2f}" for fit in fits), slacks, errors]


def _meshes() -> list[str]:
    twins: list[tuple[int, Curve]] = []
    for tets, refinement, sectors in MESHES:
        shape = Neck(DIAMETER, tets=tets, sectors=sectors, waist_refinement=refinement)
        twins.append((shape.mesh().n_tets, curve(shape, CABLE_RADIUS, "P2P1", MOST_RATIO, FARTHEST, contact=True)))
        print(f"{twins[-1][0]:,} tets: {_moduli(fitted(twins[-1][1]))} MPa", flush=True)
    header = ["tets", *(f"{1e3 * at:.0f} mm" for at in AT), "E [MPa]", "RMSE [N]"]
    forces = [np.interp(AT, twin.shortening, twin.tension) for _, twin in twins]
    rows = [
        [
            f"{n:,}",
            *(f"{force:.2f} N, {ratio:.3f}" for force, ratio in zip(of_mesh, of_mesh / forces[-1], strict=True)),
            _moduli(fits := fitted(twin)),
            ", ".join(f"{fit.rmse:.3f}" for fit in fits),
        ]
        for (n, twin), of_mesh in zip(twins, forces, strict=True)
    ]
    return table(header, rows)


def _scale() -> dict[str, list[str]]:
    linear = [_linear(n) for n, _, _ in AUTHORS[:2]]
    forces = [
        [
            f"{n:,}",
            f"{1e3 * D:.0f} mm",
            *(f"{force:.2f} N, {theirs / force:.2f}" for force in _forces(curves, D, pitch)),
        ]
        for curves, (n, theirs, pitch) in zip(linear, AUTHORS, strict=False)
        for D in DIAMETERS
    ]
    matches = [_match(curves, theirs, pitch) for curves, (_, theirs, pitch) in zip(linear, AUTHORS, strict=False)]
    changes = [
        [f"{n:,}", _mm(one.diameter), _mm(one.lever), f"{1e-6 * one.E:.2f} MPa", _mm(one.lever_of_pull),
         _mm(one.diameter_of_pull)]
        for one, (n, _, _) in zip(matches, AUTHORS, strict=False)
    ]  # fmt: skip
    finer = matches[-1]
    moduli = [
        [by, _mm(D), _mm(lever), *(f"{1e-6 * fit.E:.2f}" for fit in bench_fits(D, lever))]
        for by, D, lever in (
            ("as shipped", DIAMETER, CABLE_RADIUS),
            ("diameter alone", finer.diameter, CABLE_RADIUS),
            ("lever alone", DIAMETER, finer.lever),
            ("40 mm of pull", finer.diameter_of_pull, finer.lever_of_pull),
        )
    ]
    one, other = (match.diameter for match in matches)
    levers = [f"lever {1e3 * lever:.0f} mm" for lever in LEVERS]
    return {
        "forces": table(["tets", "D", *levers], forces),
        "changes": table(["tets", "D", "lever", "E", "lever for 40 mm", "D with it"], changes),
        "D of the coarse": [_mm(one)],
        "D of the fine": [_mm(other)],
        "moduli": table(["changed", "D", "lever", "E, 20 mm", "E, 40 mm", "E, 60 mm"], moduli),
    }


def _forces(curves: Mapping[tuple[float, float], Curve], diameter: float, pitch: float) -> list[float]:
    return [curves[diameter, lever].at_pitch(pitch)[1] for lever in LEVERS]


def _mm(length: float) -> str:
    return f"{1e3 * length:.1f} mm"


@dataclass(frozen=True)
class Match:
    """What meets a force of the authors: D [m], the lever [m] or E [Pa] alone; or the lever [m] that gives their pitch
    at a pull of 40 mm, with the D [m] that then meets the force.
    """

    diameter: float
    lever: float
    E: float
    lever_of_pull: float
    diameter_of_pull: float


def _linear(n: int) -> dict[tuple[float, float], Curve]:
    """P1 curves at the authors' modulus and ratio, by D and lever."""
    return {(D, a): curve(Neck(D, tets=n, order=1), a, "P1", 0.43, 0.055) for D in DIAMETERS for a in LEVERS}


def _match(curves: Mapping[tuple[float, float], Curve], force: float, pitch: float) -> Match:
    # Powers of lengths: log(force) and log(shortening) by least squares over the logarithms of D and lever.
    sizes = np.array([(1.0, np.log(D), np.log(a)) for D, a in curves])
    found = np.log([one.at_pitch(pitch) for one in curves.values()])
    (c, by_diameter, by_lever), (s, s_diameter, s_lever) = (
        np.linalg.lstsq(sizes, y, rcond=None)[0] for y in found.T[::-1]
    )
    goal, D, a = np.log(force) - c, np.log(DIAMETER), np.log(CABLE_RADIUS)
    both = np.linalg.solve([[by_diameter, by_lever], [s_diameter, s_lever]], [goal, np.log(THEIR_PULL) - s])
    return Match(
        float(np.exp((goal - by_lever * a) / by_diameter)),
        float(np.exp((goal - by_diameter * D) / by_lever)),
        YOUNGS_MODULUS * float(np.exp(goal - by_diameter * D - by_lever * a)),
        float(np.exp(both[1])),
        float(np.exp(both[0])),
    )


def _moduli(fits: Sequence[Fit]) -> str:
    return ", ".join(f"{1e-6 * fit.E:.2f}" for fit in fits)


if __name__ == "__main__":
    main()
