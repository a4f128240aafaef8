"""Equilibrium shapes of the calibrated twin, simulated for the report's pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from softcal.calibration.results.result import SearchResult
from softcal.project.project import Project
from softcal.report.equilibrium_shapes import EquilibriumShapes
from softcal.report.twin_view import TwinView
from softcal.twin.protocol import Protocol
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate as simulate_robot
from softcal.workflows.calibration import calibrated
from softcal.workflows.simulation import simulate

# Greatest number of experiments whose shapes are drawn over each other.
MANY = 6


def calibrated_shapes(project: Project, result: SearchResult) -> EquilibriumShapes | None:
    """The calibrated twin's shapes at the end of experiments with positions; None if there are none."""
    placed = [name for name, fit in result.experiments.items() if fit.distances]
    return equilibrium_shapes(calibrated(project, result), placed)


def equilibrium_shapes(at_values: Project, placed: Sequence[str]) -> EquilibriumShapes | None:
    """The twin's shapes at the end of these experiments, and without loads; None where there are none."""
    shapes: dict[str, Snapshot] = {}
    for name in placed[:MANY]:
        response = simulate(at_values, experiment=name, snapshots=True)
        if response.succeeded and response.snapshots:
            shapes[name] = response.snapshots[-1]
    if not shapes:
        return None
    rest = simulate_robot(_unloaded(at_values.robot), Protocol({}), snapshots=True)
    if not rest.succeeded:
        return None
    return EquilibriumShapes(at_values.robot, rest.snapshots[0], shapes, rest.tets)


def from_undeformed(equilibria: EquilibriumShapes | None) -> TwinView | None:
    """The twin undeformed and in its most displaced equilibrium, for a robot without cables."""
    if equilibria is None:
        return None
    moved = {name: _moved(equilibria.undeformed, shape) for name, shape in equilibria.shapes.items()}
    furthest = max(moved, key=lambda name: moved[name])
    rest, bent = (
        replace(equilibria.undeformed, label="Undeformed"),
        replace(equilibria.shapes[furthest], label=furthest),
    )
    return TwinView(equilibria.robot, rest, bent, equilibria.tets)


def _moved(rest: Snapshot, shape: Snapshot) -> float:
    """The largest displacement [m] of a body or rod."""
    parts = [(x, rest.points[name]) for name, x in shape.points.items()]
    parts += [(x, rest.rods[name]) for name, x in shape.rods.items()]
    return max(float(np.linalg.norm(now - then, axis=1).max()) for now, then in parts)


def _unloaded(robot: Robot) -> Robot:
    """The robot without gravity or loads, for its undeformed shape."""
    return replace(robot, gravity=np.zeros(3), loads=())
