"""The calibrated twin in the experiment with the largest drive: its response, with pictures and warnings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.calibration.results.result import SearchResult
from softcal.project.project import Project
from softcal.twin.parameters import parameter_values
from softcal.twin.response import Response
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import JOINT, calibrated
from softcal.workflows.engines import SOFTCAL, left_out_sentence
from softcal.workflows.simulation import protocol_of, robot_in


def furthest_response(project: Project, result: SearchResult) -> Response:
    """Response of the calibrated twin, with shapes, in the result's experiment with the largest drive.

    It is simulated with the project's own robot, whose twin keeps the load paths of the search; without contact where
    the engine of the search leaves it out.
    """
    at_values = calibrated(project, result)
    name = furthest_experiment(at_values, list(result.experiments))
    theta = parameter_values(robot_in(at_values, name))
    left_out = left_out_sentence(result.hashes.get("engine", SOFTCAL), project.robot)
    robot = replace(project.robot, contact=None) if left_out else project.robot
    return simulate(robot, protocol_of(at_values, name), theta, snapshots=True, shared=True)


def furthest_experiment(project: Project, experiments: Sequence[str]) -> str:
    """The experiment with the largest drive."""

    def reach(name: str) -> float:
        experiment = project.experiments[name]
        return max((float(np.max(experiment.dataset.values(drive))) for drive in experiment.drives), default=0.0)

    return max(experiments, key=reach)


def furthest_responses(project: Project, results: Mapping[str, SearchResult]) -> dict[str, Response]:
    """The furthest response of the joint calibration, or of each calibration if there is no joint one."""
    chosen = {JOINT: results[JOINT]} if JOINT in results else results
    return {label: furthest_response(project, result) for label, result in chosen.items()}
