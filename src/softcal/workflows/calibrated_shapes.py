"""The calibrated twin, simulated for the report: its equilibrium shapes, and its response to the largest drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.calibration.results.result import SearchResult
from softcal.project.project import Project
from softcal.report.twin_view import EquilibriumShapes, TwinView
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response, Snapshot
from softcal.twin.simulate import simulate as simulate_robot
from softcal.workflows.calibration import JOINT, calibrated
from softcal.workflows.engines import SOFTCAL, left_out_sentence
from softcal.workflows.simulation import protocol_of, robot_in, simulate
from softcal.workflows.start_states import ROUGH

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
    unloaded = replace(at_values.robot, gravity=np.zeros(3), loads=())
    rest = simulate_robot(unloaded, Protocol({}), snapshots=True)
    if not rest.succeeded:
        return None
    return EquilibriumShapes(at_values.robot, rest.snapshots[0], shapes, rest.tets)


def from_undeformed(equilibria: EquilibriumShapes | None) -> TwinView | None:
    """The twin undeformed and in its most displaced equilibrium, for a robot without cables."""
    if equilibria is None:
        return None
    moved: dict[str, float] = {}  # the largest displacement [m] of a body or rod
    for name, shape in equilibria.shapes.items():
        parts = [(x, equilibria.undeformed.points[body]) for body, x in shape.points.items()]
        parts += [(x, equilibria.undeformed.rods[rod]) for rod, x in shape.rods.items()]
        moved[name] = max(float(np.linalg.norm(now - then, axis=1).max()) for now, then in parts)
    furthest = max(moved, key=lambda name: moved[name])
    rest, bent = (
        replace(equilibria.undeformed, label="Undeformed"),
        replace(equilibria.shapes[furthest], label=furthest),
    )
    return TwinView(equilibria.robot, rest, bent, equilibria.tets)


def furthest_response(project: Project, result: SearchResult, *, after_search: bool = False) -> Response:
    """Response of the calibrated twin, with its shape in the end, in the experiment with the largest drive.

    It is simulated with the project's own robot; without contact where the engine of the search leaves it out.

    Parameters
    ----------
    project, result
        The project, and a result of its calibration.
    after_search
        Whether the search was in this process: its twin keeps load paths then, from which this one follows sooner.
    """
    at_values = calibrated(project, result)
    name = furthest_experiment(at_values, list(result.experiments))
    theta = parameter_values(robot_in(at_values, name))
    left_out = left_out_sentence(result.hashes.get("engine", SOFTCAL), project.robot)
    robot = replace(project.robot, contact=None) if left_out else project.robot
    return simulate_robot(
        robot, protocol_of(at_values, name), theta, snapshots=True, curve_tolerance=ROUGH, shared=after_search
    )


def furthest_experiment(project: Project, experiments: Sequence[str]) -> str:
    """The experiment with the largest drive, of either sign: a vacuum too."""
    return max(experiments, key=lambda name: abs(project.experiments[name].reach))


def furthest_responses(project: Project, results: Mapping[str, SearchResult]) -> dict[str, Response]:
    """The furthest response of the joint calibration, or of each calibration if there is no joint one, after their
    search.
    """
    chosen = {JOINT: results[JOINT]} if JOINT in results else results
    return {label: furthest_response(project, result, after_search=True) for label, result in chosen.items()}
