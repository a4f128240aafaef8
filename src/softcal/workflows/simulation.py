"""Simulation of a project's experiments or of a pull: responses, their table, a picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, TypeVar

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import protocol_told
from softcal.calibration.problem.problem import Simulate
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, ParameterError, SimulationError, unknown
from softcal.limits import LIMITS
from softcal.mechanics.actuator import NO_EFFORT
from softcal.mechanics.path_watch import path_watch
from softcal.project.project import Project, ProjectSource, project_of
from softcal.twin.actuated import effort_shares
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol, let_go_faults
from softcal.twin.response import Response, Shown, Snapshot
from softcal.twin.robot import Control, Robot
from softcal.twin.simulate import simulate as simulate_robot
from softcal.units import format_quantity

if TYPE_CHECKING:
    from softcal.report.twin_view import TwinView

Of = TypeVar("Of")

# Samples of a pull that is given by its end alone; and how many it may have.
PULL_SAMPLES, FROM_TWO = 41, replace(LIMITS["samples"], least=2)


@checked_arguments
def simulate(
    twin: ProjectSource | Robot,
    protocol: Protocol | None = None,
    theta: Mapping[str, float] | None = None,
    *,
    experiment: str = "",
    sensitivities: str | Sequence[str] = (),
    snapshots: Shown = False,
    engine: Simulate | None = None,
) -> Response:
    """The twin's response to a protocol, or to the protocol of one of a project's experiments.

    Parameters
    ----------
    twin
        A project, the path of a project file, or a robot alone.
    protocol
        Tension [N] or shortening [m] of each cable, pressure [Pa] or volume [m^3] of each chamber, torque [N m] or
        angle [rad] of each drive, sample by sample; see `pull`.
    theta
        Values [SI] of robot parameters by dotted name, replacing the robot's own.
    experiment
        Instead of a protocol: the name of an experiment. Its actuators are driven as on the bench, less the slack, with
        its settings. Optional if the project has only one.
    sensitivities
        Parameters by which the derivative of every channel is computed.
    snapshots
        Whether shapes are kept: True keeps those of the solved load steps, "samples" solves and keeps every sample;
        another engine keeps those at rest.
    engine
        Engine, by default softcal itself; see `softcal.workflows.engines`.

    Returns
    -------
    Response
        With `succeeded` False and a sentence in `status` if a state could not be reached.

    Raises
    ------
    ParameterError
        For an unknown actuator, parameter or experiment, or a value out of range; for a protocol that releases a cable
        with friction.
    InputError
        For a twin that is none of these, and as `load`.
    """
    twin = twin if isinstance(twin, Robot) else project_of(twin)
    robot = twin.robot if isinstance(twin, Project) else twin
    if experiment and (protocol is not None or not isinstance(twin, Project)):
        what = (
            "an experiment has a protocol of its own"
            if protocol is not None
            else "a robot without a project has no experiments"
        )
        raise ParameterError(Fault(what, "experiment", f"'{experiment}'", "a project's, without a protocol"))
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
    sensitivities: str | Sequence[str] = (),
    snapshots: Shown = False,
    engine: Simulate | None = None,
) -> Response:
    """See `simulate`; for samples that are independent states in any order.

    Parameters
    ----------
    robot
        The robot.
    protocol
        Its commands, sample by sample.
    theta
        Parameter -> value [SI]; None: those of the robot.
    sensitivities
        Parameters by which the channels are differentiated.
    snapshots
        Samples of which the shape is kept.
    engine
        What simulates; None: softcal.
    """
    if engine is not None:
        return engine(robot, protocol, theta, sensitivities=sensitivities, snapshots=bool(snapshots))
    return simulate_robot(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)


def keep_silent(sentence: str) -> None:
    """Ignore progress messages."""


def simulate_each(
    cases: Mapping[str, Of],
    simulated: Callable[[Of], Response],
    *,
    partly: bool = False,
    stage: Callable[[str], None] = keep_silent,
    ready: Callable[[str, Response], None] = lambda name, response: None,
) -> dict[str, Response]:
    """Case name -> response.

    Where the watch of the load paths keeps what is ready, a stop ends them: the last response has `stopped_by`.

    Parameters
    ----------
    cases
        Name -> case.
    simulated
        Case -> its response.
    partly
        Accept a case of which only some samples were reached.
    stage
        Called at the start of each case.
    ready
        Called with each case's name and response.

    Raises
    ------
    SimulationError, unknown
        If one of them has no solution.
    KeyboardInterrupt
        Where it is stopped and nothing is ready, or to be kept.
    """
    responses: dict[str, Response] = {}
    failed: dict[str, Response] = {}
    stopped: KeyboardInterrupt | None = None
    for i, (name, case) in enumerate(cases.items(), start=1):
        stage(f"Simulating {name or 'the robot'} ({i} of {len(cases)})")
        try:
            response = simulated(case)
        except KeyboardInterrupt as stop:
            stopped = stop
            break
        stopped = response.stopped_by
        some = any(len(values) for values in response.channels.values())
        if response.succeeded or (some and (partly or stopped is not None)):
            responses[name] = response
            ready(name, response)
        else:
            failed[name] = response
        if stopped is not None:
            break
    if stopped is not None and not (path_watch().keeps and responses):
        raise stopped
    for name, response in failed.items():
        if stopped is None:
            raise SimulationError(f"{name}: {response.status}")
        ready(name, response)
    if stopped is not None:
        last = next(reversed(responses))
        responses[last] = replace(responses[last], stopped_by=stopped)
    return responses


def protocol_of(project: Project, experiment: str = "") -> Protocol:
    """Protocol of an experiment: its actuators driven as on the bench, through the nominal rig.

    Raises
    ------
    ParameterError
        Where the project has no such experiment, or several and none is named.
    """
    chosen = _chosen(project, experiment)
    return protocol_told(project.robot, chosen, chosen.rig_values())


def robot_in(project: Project, experiment: str = "") -> Robot:
    """The robot with an experiment's settings.

    Raises
    ------
    ParameterError
        See `protocol_of`.
    """
    chosen, of_robot = _chosen(project, experiment), robot_parameters(project.robot)
    return with_parameters(project.robot, {n: value for n, value in chosen.settings.items() if n in of_robot})


def _chosen(project: Project, experiment: str) -> Experiment:
    known = list(project.experiments)
    name = experiment or (known[0] if len(known) == 1 else "")
    if name not in project.experiments:
        raise ParameterError(
            unknown(
                "there is no such experiment" if experiment else "the experiment is not specified",
                str(project.path),
                experiment,
                known,
                got=None if experiment else "",
                none="none is defined in this project: give a pull instead",
            )
        )
    return project.experiments[name]


@checked_arguments
def pull(
    robot: Robot, actuator: str, control: Control, end: float, samples: Annotated[int, FROM_TWO] = PULL_SAMPLES
) -> Protocol:
    """One actuator driven evenly from zero, such as a cable that is pulled.

    Parameters
    ----------
    robot
        The robot.
    actuator
        Name of the cable or other actuator.
    control
        "tension" or "shortening" of a cable, "pressure" or "volume" of a chamber, "torque" or "angle" of a drive.
    end
        Last value [SI].
    samples
        Their number, with the one at zero.

    Raises
    ------
    ParameterError
        Where the robot has no such cable or actuator, or the end is out of range: that of a cable is above zero.
    """
    known = {part.name: part for part in robot.actuated}
    if actuator not in known:
        what = f"the robot has no such {robot.actuator_word}"
        raise ParameterError(unknown(what, "", actuator, known))
    controls = known[actuator].controls
    if control not in controls:
        raise ParameterError(unknown("the actuator cannot be commanded by this quantity", actuator, control, controls))
    controls[control].checked(end, where="end")
    if not end > 0 and known[actuator] in robot.cables:
        got = format_quantity(end, controls[control].unit)
        raise ParameterError(Fault("the end of a pull must be positive", f"{actuator}.{control}", got))
    return Protocol({actuator: Command(control, np.linspace(0.0, end, samples))})


def twin_view(robot: Robot, response: Response) -> TwinView | None:
    """The robot at rest and where it is bent most; None if there are not two shapes."""
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
    kinds = {part.name: part.kind for part in robot.commandable}
    titled: list[Snapshot] = []  # by the efforts of the actuators, of many of a kind the largest
    for shape in (rest, bent):
        shown, told = efforts_shown(robot, shape, shapes), list[str]()
        for kind in dict.fromkeys(kinds.values()):
            own = [name for name in shown if kinds[name] == kind]
            few = [f"{name}: {shown[name]}" for name in own]
            told += few if len(own) <= 2 else [f"{len(own)} {kind}s, up to {shown[own[0]]}"]
        titled.append(replace(shape, label=", ".join(told) or "At rest"))
    at_rest, furthest = titled
    sentences = (response.instabilities, response.crossings, response.drawn_out, response.remarks)
    return TwinView(robot, at_rest, furthest, response.tets, *sentences)


def efforts_shown(robot: Robot, shape: Snapshot, shapes: Sequence[Snapshot] = ()) -> dict[str, str]:
    """The efforts in a shape of what has commands, such as "20 kPa", largest first of each kind of actuator, without
    those that are none.

    Parameters
    ----------
    robot
        The robot.
    shape
        The shape.
    shapes
        Others, beside whose efforts one may be none.
    """
    shares = effort_shares(robot.commandable, shape.efforts, *(one.efforts for one in shapes))
    shown = [name for name in sorted(shares, key=lambda name: -shares[name]) if shares[name] > NO_EFFORT]
    units = {part.name: part.channels[1].unit for part in robot.commandable}
    return {name: format_quantity(shape.efforts[name], units[name]) for name in shown}


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
