"""Cases to simulate: pulls given by the user, or experiments with the robot's settings in each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from softcal.project.project import Project
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Robot
from softcal.workflows.pulls import parse_pulls
from softcal.workflows.simulation import protocol_of, robot_in

PULL = "pull"


@dataclass(frozen=True)
class Case:
    """A robot and its protocol. experiment: name of the experiment, "" for a pull."""

    robot: Robot
    protocol: Protocol
    experiment: str = ""


def cases(project: Project, pulls: Sequence[str] = (), experiment: str = "") -> dict[str, Case]:
    """Name -> case: all pulls together, else the named experiment, else every experiment.

    Parameters
    ----------
    project
        The project.
    pulls
        Pulls as on the command line, `front=40mm`: one case of all.
    experiment
        Name of the only case; by default every experiment.

    Raises
    ------
    InputError
        For a text that is no pull, or an unknown experiment; if there is neither an experiment nor a pull.
    """
    if pulls:
        return {PULL: Case(project.robot, parse_pulls(project.robot, pulls))}
    names = [experiment] if experiment else list(project.experiments) or [""]
    return {name: Case(robot_in(project, name), protocol_of(project, name), name) for name in names}


def protocols_of(chosen: Mapping[str, Case]) -> dict[str, Protocol]:
    """Name -> protocol of each case."""
    return {name: case.protocol for name, case in chosen.items()}
