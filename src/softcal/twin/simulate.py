"""simulate(robot, protocol): the quasi-static response."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.errors import Fault, ParameterError
from softcal.sensing.channel import kinds
from softcal.twin.build import Twin, twin_of
from softcal.twin.equilibrium_path import CURVE_TOLERANCE, EquilibriumPath, guide_of, statics_of
from softcal.twin.joints import loose_faults
from softcal.twin.many import simulate_many
from softcal.twin.parameters import robot_parameters, unknown_name, value_faults, with_shape
from softcal.twin.proportional import at_moduli, at_own_moduli, with_modulus
from softcal.twin.protocol import Protocol, command_faults
from softcal.twin.response import Derivatives, Response, Shown
from softcal.twin.robot import Robot
from softcal.twin.sweep import Sweep


def simulate(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: str | Sequence[str] = (),
    snapshots: Shown = False,
    curve_tolerance: float = CURVE_TOLERANCE,
    shared: bool = False,
    crossings: bool = True,
) -> Response:
    """The twin's quasi-static response to a protocol.

    With one driven actuator the response is one curve: it is solved at a few well-placed nodes, with exact slopes, and
    interpolated between them by cubic Hermite pieces whose error stays below `curve_tolerance` times the channel's
    largest value; 0 solves every sample. With several driven actuators every sample is solved. With a cable driven by
    tension the load path is followed in its shortening, so that folding necks and cables wound up to zero length are
    states, not failures.

    Parameters
    ----------
    theta
        Values [SI] of robot parameters by dotted name, in the place of the robot's own. One robot at many values is
        built once; what `with_parameters` returns is another robot.
    sensitivities
        Dotted names of robot parameters, commands of the protocol (`cable1.tension`), or parameters by which the
        commands have derivatives; the response then has exact derivatives of every channel by each.
    snapshots
        Whether shapes to draw are kept: at rest, and at every solved node. With "samples", only at every sample, in
        their order, and every sample is solved.
    shared
        Whether simulations of other samples are to follow, as in a search. The load path then ends at a round
        shortening a little beyond the last sample, which is interpolated like the others, and serves them too.
    crossings
        Whether to check every solved state for bodies that pass through themselves or each other.

    Returns
    -------
    Response
        With `succeeded` False and a sentence in `status` where a sample could not be reached. With one driven actuator
        the channels then end before it; with several the others are solved, and `samples` gives the numbers of the
        samples in the channels. Never raises for a robot that has no equilibrium.

    Raises
    ------
    ParameterError
        For a parameter or an actuator that the robot does not have, a value that no part can have, or a command that no
        actuator can follow.
    MeshError
        For a robot that cannot be built.
    """
    known, theta = robot_parameters(robot), theta or {}
    sensitivities = (sensitivities,) if isinstance(sensitivities, str) else sensitivities
    commands = protocol.drives
    named = {**known, **commands, **dict.fromkeys(protocol.parameters)}
    faults = [unknown_name(name, named) for name in sensitivities if name not in named]
    if snapshots not in (False, True, "samples"):
        faults.append(Fault("there are no such snapshots", "snapshots", repr(snapshots), "True, False or 'samples'"))
    values = {**{name: info.value for name, info in known.items()}, **theta}
    faults += statics_faults(robot, values)
    faults += command_faults(robot if faults else with_shape(robot, theta), protocol)
    if faults:
        raise ParameterError(faults)
    return respond(
        twin_of(robot, theta),
        values,
        protocol,
        sensitivities,
        snapshots=snapshots,
        curve_tolerance=curve_tolerance,
        shared=shared,
        guided=shared and with_shape(robot, theta) is robot,
        crossings=crossings,
    )


def statics_faults(robot: Robot, values: Mapping[str, float]) -> list[Fault]:
    """Why a robot has no statics at values [SI] of its parameters: a name or value that it cannot have, a part that is
    not attached, so that its cables would pull it along, or friction of contact.
    """
    faults = value_faults(robot_parameters(robot), values)
    faults += loose_faults(robot)
    if robot.contact is not None and robot.contact.friction_coefficient > 0.0:
        faults.append(
            Fault(
                "the state of a robot with friction depends on the load path",
                where="contact.friction_coefficient",
                got=f"{robot.contact.friction_coefficient:g}",
                allowed="0 without time",
                attempt="motion in time",
            )
        )
    return faults


def respond(  # noqa: PLR0913 (one keyword for each option)
    twin: Twin,
    theta: Mapping[str, float],
    protocol: Protocol,
    sensitivities: Sequence[str] = (),
    *,
    snapshots: Shown = False,
    curve_tolerance: float = CURVE_TOLERANCE,
    shared: bool = False,
    guided: bool = False,
    crossings: bool = True,
) -> Response:
    """The response of a twin that is built, at the values of all its parameters. See `simulate`.

    Where a term remembers, every sample is solved, in the order of the protocol.

    Parameters
    ----------
    twin
        The twin.
    theta
        Values of all parameters by dotted name [SI].
    protocol
        The protocol.
    sensitivities
        Parameters of the derivatives, and actuators' channels for those by their commands.
    snapshots, curve_tolerance, shared, crossings
        See `simulate`.
    guided
        Whether paths are guided by that at the robot's own parameters, see `guide_of`.

    Raises
    ------
    ParameterError
        For a derivative by a command where a term remembers.
    """
    commands = protocol.drives
    protocol = protocol.completed(twin.robot)
    names = tuple(name for name in sensitivities if name not in commands)
    commanded = {name: commands[name] for name in sensitivities if name in commands}
    if commanded and twin.system.remembers:
        got, why = ", ".join(sensitivities), "a state depends on the commands of all samples before it, too"
        raise ParameterError(Fault(why, "sensitivities", got, "parameters of the robot"))
    driven = protocol.driven
    # A command of zero throughout drives nothing, but a tension is slack to one side alone and has a derivative.
    is_curve = len(driven) <= 1 and {*commanded.values()} <= {*driven}
    if not is_curve or twin.system.remembers or not twin.system.followers.keys().isdisjoint(driven):
        with statics_of(twin, theta) as statics:
            return simulate_many(
                twin, statics, protocol, names, snapshots=snapshots, crossings=crossings, commanded=commanded
            )
    is_pulled_in = len(driven) == 1 and kinds()[protocol.commands[driven[0]].control].drives == "coordinate"
    own, s, modulus = at_own_moduli(twin, theta) if is_pulled_in else (theta, 1.0, None)
    solved = tuple(name for name in names if name != modulus)
    actuator = driven[0] if driven else None
    with (
        statics_of(twin, own, twin.kept.at(own)) as statics,
        guide_of(twin, own, actuator if guided else None) as guide,
    ):
        tolerance = 0.0 if snapshots == "samples" else curve_tolerance
        along = EquilibriumPath(
            twin=twin,
            statics=statics,
            names=solved,
            actuator=actuator,
            tolerance=tolerance,
            is_shared=shared,
            guide=guide,
        )
        response = Sweep(along, snapshots, crossings).response(protocol)
    response = at_moduli(twin, response, s)
    if modulus in names:
        response = with_modulus(response, modulus, theta[modulus], names)
    if not commanded:
        return response
    # Slopes are the derivatives by the driven actuator's command.
    channels, known = tuple(response.channels), response.sensitivities
    rates = [known.by(name, channels) for name in known.parameters]
    rates += [np.array([response.slopes[channel] for channel in channels]).T for _ in commanded]
    parameters = (*known.parameters, *commanded)
    return replace(response, sensitivities=Derivatives(channels, parameters, np.stack(rates, axis=-1)))
