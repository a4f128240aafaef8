"""What each part of the neck's memory makes of the modulus that an elastic law finds at 20, 40 and 60 mm."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from benchmarks.neck_cycles_twin import CURVES_AT, FLOOR, SLACK, TARGETS, TENSION, curve, mean_curve, robot, way
from benchmarks.section import table
from softcal import Command, Protocol
from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.twin.simulate import simulate

PARTS = {
    "softening": "softening",
    "flow": "flow",
    "relaxation-2": "relax",
}  # how their constants begin
CASES = {
    "the twin": (),
    "without softening": ("softening",),
    "without flow": ("flow",),
    "without both": ("softening", "flow"),
}
GRID = np.linspace(0.0, 0.06, 121)  # [m]
UNIT = 1e6  # [Pa], the modulus of the elastic twin


def parts_table(values: Mapping[str, float]) -> list[str]:
    """Rows of the moduli of elastic fits to the mean curves, measured and of the twin with and without parts."""
    elastic = _tensions(values, tuple(PARTS), GRID, None)
    d, _ = way()
    time = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(d))) / CURVES_AT])
    curves = {"measured": [curve(target)[1] - FLOOR for target in TARGETS]}
    for name, without in CASES.items():
        tension = _tensions(values, without, d - values[SLACK], time)
        curves[name] = [mean_curve(target, tension) for target in TARGETS]
    rows: list[list[str]] = []
    for name, forces in curves.items():
        moduli = [_modulus(curve(t)[0], force, elastic) for t, force in zip(TARGETS, forces, strict=True)]
        fall = 100.0 * (1.0 - moduli[-1] / moduli[0])
        rows.append([name, *(f"{1e-6 * one:.2f} MPa" for one in moduli), f"{fall:.1f} %"])
    return table(["", *(f"E, {1e3 * target.pull:.0f} mm" for target in TARGETS), "fall"], rows)


def _modulus(at: Floats, force: Floats, elastic: Floats) -> float:
    """E [Pa] of the elastic twin, with a slack of its own, that meets a force [N] at travels [m] best."""
    found = least_squares(lambda x: x[0] * np.interp(at - 1e-3 * x[1], GRID, elastic) - force, [1.0, 2.0])
    return float(found.x[0]) * UNIT


def _tensions(values: Mapping[str, float], without: tuple[str, ...], d: Floats, time: Floats | None) -> Floats:
    """The cable's tension [N] at shortenings [m], at the constants found, without parts of the history; at
    `UNIT` where all are left out.
    """
    full = robot()
    (body,) = full.bodies

    def kept(name: str) -> bool:
        return not any(name.startswith(PARTS[part]) for part in without)

    body = replace(
        body,
        parameters={name: value for name, value in body.parameters.items() if kept(name)},
        history=tuple(part for part in body.history if part not in without),
    )
    constants = {f"neck.{name}": value for name, value in values.items() if name != SLACK and kept(name)}
    if not body.history:
        constants = {"neck.youngs_modulus": UNIT}
    protocol = Protocol({"front": Command("shortening", d)}, time)
    response = simulate(replace(full, bodies=(body,)), protocol, constants, crossings=False)
    if not response.succeeded:
        raise SimulationError(response.status)
    return response.channels[TENSION]
