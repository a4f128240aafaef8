"""What a project's commands simulate: pulls, or the experiments with the robot as each of them sets it."""

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
    """A robot and what is done to it. experiment: whose samples these are; "" for a pull."""

    robot: Robot
    protocol: Protocol
    experiment: str = ""


def cases(project: Project, pulls: Sequence[str] = (), experiment: str = "") -> dict[str, Case]:
    """By name: the pulls, all at once; or the experiment that is named, or each one.

    Raises
    ------
    InputError
        For a text that is no pull, or an experiment that does not exist; where there is none and no pull.
    """
    if pulls:
        return {PULL: Case(project.robot, parse_pulls(project.robot, pulls))}
    names = [experiment] if experiment else list(project.experiments) or [""]
    return {name: Case(robot_in(project, name), protocol_of(project, name), name) for name in names}


def protocols_of(chosen: Mapping[str, Case]) -> dict[str, Protocol]:
    """What is done to the robot in each case, by name."""
    return {name: case.protocol for name, case in chosen.items()}
