"""The twin of a project put through its experiments or a plain pull: responses, a table of them, a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from softcal.calibration.experiment import Experiment
from softcal.calibration.observation import commands
from softcal.calibration.problem import Simulate
from softcal.csv_text import csv_text
from softcal.errors import Fault, ParameterError, SimulationError
from softcal.project.project import Project
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol, let_go_faults
from softcal.twin.response import Response, Shown, Snapshot
from softcal.twin.robot import Control, Robot
from softcal.twin.simulate import simulate as simulate_robot
from softcal.units import format_quantity

if TYPE_CHECKING:
    from softcal.report.twin_view import TwinView

Of = TypeVar("Of")

# Samples of a pull that is asked for by its end alone.
PULL_SAMPLES = 41


def simulate(
    twin: Project | Robot,
    protocol: Protocol | None = None,
    theta: Mapping[str, float] | None = None,
    *,
    experiment: str = "",
    sensitivities: Sequence[str] = (),
    snapshots: Shown = False,
    engine: Simulate | None = None,
) -> Response:
    """The twin's response to a protocol, or to what one of a project's experiments did to the robot.

    Parameters
    ----------
    twin
        A project, or a robot alone.
    protocol
        Tension [N] or shortening [m] of each cable, sample by sample; see `pull`.
    theta
        Values [SI] of robot parameters by dotted name, in the place of the robot's own.
    experiment
        In the place of a protocol: the name of an experiment of the project. Its cables are driven as on the bench,
        less the slack, and its settings hold. Where the project has only one, it need not be named.
    sensitivities
        Parameters by which every channel is derived too.
    snapshots
        Whether shapes to draw are kept: those that were solved, or with "samples" those of the samples, every one of
        which is then solved; of another engine, those at which it came to rest.
    engine
        What computes it, softcal itself by default; see `softcal.workflows.engines`.

    Returns
    -------
    Response
        With `succeeded` False and a sentence in `status` where a state could not be reached.

    Raises
    ------
    ParameterError
        For a cable, parameter or experiment that does not exist, or a value that no part can have; for a protocol that
        lets a cable with friction go.
    """
    robot = twin.robot if isinstance(twin, Project) else twin
    if protocol is not None and (faults := let_go_faults(with_parameters(robot, theta or {}), protocol)):
        raise ParameterError(faults)
    if protocol is None:
        protocol = protocol_of(twin, experiment) if isinstance(twin, Project) else Protocol({})
        robot = robot_in(twin, experiment) if isinstance(twin, Project) else robot
    return response_to(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots, engine=engine)


def response_to(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: Shown = False,
    engine: Simulate | None = None,
) -> Response:
    """As `simulate`, of samples that are states by themselves, whatever their order."""
    if engine is not None:
        return engine(robot, protocol, theta, sensitivities=sensitivities, snapshots=bool(snapshots))
    return simulate_robot(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)


def keep_silent(sentence: str) -> None:
    """Nobody is told."""


def simulate_each(
    cases: Mapping[str, Of],
    simulated: Callable[[Of], Response],
    *,
    partly: bool = False,
    stage: Callable[[str], None] = keep_silent,
) -> dict[str, Response]:
    """The response to each of several cases, by name. partly: also where only some samples of a case were reached;
    stage: is told of each case that begins.

    Raises
    ------
    SimulationError
        Where the twin could not follow one of them.
    """
    responses: dict[str, Response] = {}
    for i, (name, case) in enumerate(cases.items(), start=1):
        stage(f"Simulating {name or 'the robot'} ({i} of {len(cases)})")
        responses[name] = simulated(case)
    for name, response in responses.items():
        some = partly and any(len(values) for values in response.channels.values())
        if not response.succeeded and not some:
            raise SimulationError(f"{name}: {response.status}")
    return responses


def protocol_of(project: Project, experiment: str = "") -> Protocol:
    """What an experiment does to the robot: its cables driven as on the bench, read through the nominal rig.

    Raises
    ------
    ParameterError
        Where the project has no such experiment, or several and none is named.
    """
    chosen = _chosen(project, experiment)
    return Protocol(commands(chosen, chosen.rig_values()))


def robot_in(project: Project, experiment: str = "") -> Robot:
    """The robot as an experiment sets it.

    Raises
    ------
    ParameterError
        As `protocol_of`.
    """
    chosen, of_robot = _chosen(project, experiment), robot_parameters(project.robot)
    return with_parameters(project.robot, {n: value for n, value in chosen.settings.items() if n in of_robot})


def _chosen(project: Project, experiment: str) -> Experiment:
    known = list(project.experiments)
    name = experiment or (known[0] if len(known) == 1 else "")
    if name not in project.experiments:
        raise ParameterError(
            Fault(
                "there is no such experiment" if experiment else "it is not said which experiment",
                where=str(project.path),
                got=f"'{experiment}'" if experiment else "",
                allowed=", ".join(known) or "none is defined in this project: give a pull instead",
            )
        )
    return project.experiments[name]


def pull(robot: Robot, cable: str, control: Control, end: float, samples: int = PULL_SAMPLES) -> Protocol:
    """One cable pulled evenly from zero to `end`, a tension [N] or shortening [m].

    Raises
    ------
    ParameterError
        Where the robot has no such cable, or the end is not above zero.
    """
    known = [part.name for part in robot.cables]
    if cable not in known:
        raise ParameterError(Fault("the robot has no such cable", got=f"'{cable}'", allowed=", ".join(known)))
    if not end > 0 or samples < 2:
        got = format_quantity(end, "m" if control == "shortening" else "N") if samples >= 2 else f"{samples} samples"
        raise ParameterError(Fault("a pull goes from zero to a number above zero", f"{cable}.{control}", got))
    return Protocol({cable: Command(control, np.linspace(0.0, end, samples))})


def twin_view(robot: Robot, response: Response) -> TwinView | None:
    """The robot at rest and at its largest pitch, to draw; None where there are no two shapes."""
    from softcal.report.twin_view import TwinView

    if len(response.snapshots) < 2:
        return None
    rest = response.snapshots[0]

    def bending(index: int) -> float:
        now = shapes[index]
        turns = [turning_angle(rotation) for _, rotation in now.plates.values()]
        moved = [np.linalg.norm(x - rest.points[body], axis=1).max() for body, x in now.points.items()]
        moved += [np.linalg.norm(x - rest.rods[rod], axis=1).max() for rod, x in now.rods.items()]
        return float(max(turns or moved))

    shapes = response.snapshots
    bent = shapes[max(range(1, len(shapes)), key=bending)]
    at_rest, furthest = (replace(shape, label=_title(shape)) for shape in (rest, bent))
    told = (response.falls, response.crossings, response.drawn_out)
    return TwinView(robot, at_rest, furthest, response.tets, *told)


def _title(shape: Snapshot) -> str:
    """What is done to the robot in a shape: the cables that pull, with their tensions."""
    largest = max(shape.tensions.values(), default=0.0)
    pulled = [name for name, tension in shape.tensions.items() if tension > 1e-6 * largest]
    if largest <= 0.0:
        return "At rest"
    if len(pulled) > 2:
        return f"{len(pulled)} cables pulled, by up to {format_quantity(largest, 'N')}"
    return ", ".join(f"{name}: {format_quantity(shape.tensions[name], 'N')}" for name in pulled)


def turning_angle(rotation: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    """The angle [rad] of a rotation matrix (3, 3)."""
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1.0, 1.0)))


def response_csv(response: Response) -> str:
    """The channels as CSV text, with the unit in every header: `front.tension [N]`."""
    return channels_csv(response.channels, response.units)


def channels_csv(channels: Mapping[str, np.ndarray], units: Mapping[str, str]) -> str:
    """Channels of one length as CSV text in SI, with the unit in every header; an angle is in rad, a flag in 1."""
    rows = ([f"{value:.10g}" for value in row] for row in zip(*channels.values(), strict=True))
    return csv_text([f"{name} [{units[name]}]" for name in channels], rows)
