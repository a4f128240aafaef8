"""simulate(robot, protocol): what the bench would see."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.errors import ParameterError
from softcal.mechanics.statics import Statics
from softcal.twin.build import cached_twin
from softcal.twin.many import simulate_many
from softcal.twin.parameters import robot_parameters, unknown_name
from softcal.twin.protocol import Protocol, command_faults
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.sweep import Sweep

CURVE_TOLERANCE = 1e-4  # interpolation error over a channel's largest value


def simulate(
    robot: Robot,
    protocol: Protocol,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
    curve_tolerance: float = CURVE_TOLERANCE,
) -> Response:
    """The twin's quasi-static response to a protocol.

    With one driven cable the response is one curve: it is solved at a few well-placed nodes, with exact slopes, and
    read off between them by cubic Hermite pieces whose error stays below `curve_tolerance` times the channel's largest
    value; 0 solves every sample. With several driven cables every sample is solved. A cable driven by tension is
    followed in its shortening, so that folding necks and cables wound up to zero length are states, not failures.

    Parameters
    ----------
    sensitivities
        Dotted names of robot parameters; the response then holds exact derivatives of every channel by each.
    snapshots
        Whether shapes to draw are kept: at rest, and at every solved node.

    Returns
    -------
    Response
        With `succeeded` False and a sentence in `status` where a sample could not be reached; the channels then end
        before it. Never raises for a robot that has no equilibrium.

    Raises
    ------
    ParameterError
        For a parameter or a cable that the robot does not have, or a command that no cable can follow.
    MeshError
        For a robot that cannot be built.
    """
    known = robot_parameters(robot)
    faults = [unknown_name(name, known) for name in sensitivities if name not in known]
    faults += command_faults(robot, protocol)
    if faults:
        raise ParameterError(faults)
    twin = cached_twin(robot)
    statics = Statics(twin.system, {name: info.value for name, info in known.items()})
    try:
        driven = [
            name
            for name, command in protocol.commands.items()
            if command.control == "shortening" or np.any(command.values != 0.0)
        ]
        if len(driven) > 1:
            return simulate_many(twin, statics, protocol, tuple(sensitivities), snapshots=snapshots)
        sweep = Sweep(twin, statics, tuple(sensitivities), driven[0] if driven else None, curve_tolerance)
        return sweep.response(protocol, snapshots=snapshots)
    finally:
        statics.release()
