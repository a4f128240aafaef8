"""The twin of a project in time: pulls that grow evenly, then rest."""

from __future__ import annotations

import numpy as np

from softcal.project.project import Project
from softcal.twin.in_time import simulate_in_time
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.schedule import Schedule

SNAPSHOTS = 40


def simulate_pull_in_time(project: Project, protocol: Protocol) -> Response:
    """A protocol's samples, two or more, evenly over the ramp of the project's `dynamics`, the last one then held.

    Raises
    ------
    ParameterError
        For a command that the robot cannot follow, or a robot without mass.
    """
    dynamics, commands = project.dynamics, dict(protocol.commands)
    times = np.linspace(0.0, dynamics.ramp, protocol.n_samples)
    if dynamics.hold:
        times = np.append(times, dynamics.ramp + dynamics.hold)
        commands = {n: Command(c.control, np.append(c.values, c.values[-1])) for n, c in commands.items()}
    return simulate_in_time(project.robot, Schedule(times, commands), dynamics.settings, snapshots=SNAPSHOTS)
