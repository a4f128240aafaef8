"""Loss landscape over two parameters, the others fixed: along a flat valley the two cannot be distinguished.

With a hyperelastic law whose energy is proportional to Young's modulus, no dead load, no stiffness of contact of its
own, and every cable driven by its shortening, the shape does not depend on the modulus and every tension is
proportional to it. Then one trajectory for each value of the other parameter gives a whole row of the landscape.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.calibration.problem.fingerprint import fingerprint
from softcal.calibration.problem.problem import Problem, Simulate
from softcal.checks import Floats
from softcal.errors import Fault, ParameterError
from softcal.sensing.channel import ChannelName, channel_name
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.parameters import parameter_values
from softcal.twin.proportional import is_proportional
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate as simulate_robot

# Laws whose energy is proportional to Young's modulus at constant Poisson's ratio.
PROPORTIONAL_LAWS = ("neo-hooke",)
# Samples of the trajectory that is scaled.
SAMPLES = 81


@dataclass(frozen=True)
class LossGrid:
    """The loss over a grid: axes x and y [SI], loss (len(y), len(x)), NaN where the simulation failed."""

    x: Floats
    y: Floats
    loss: Floats


def scales_with_modulus(problem: Problem) -> bool:
    """True if tensions are proportional to the single Young's modulus and all other channels independent of it."""
    robot = problem.robot
    return (
        len(robot.bodies) == 1
        and not robot.rods
        and robot.bodies[0].law in PROPORTIONAL_LAWS
        and is_proportional(robot, parameter_values(robot))
        and all([test.twin_channel(c).kind for c in test.drives] == [SHORTENING] for test in problem.experiments)
    )


def loss_over(problem: Problem, theta: Mapping[str, float], x: str, y: str, shape: tuple[int, int]) -> LossGrid:
    """The loss over the bounds of two free parameters, the others as in theta [SI by label].

    Parameters
    ----------
    x, y
        Labels of the two parameters.
    shape
        Number of values of x and of y.

    Raises
    ------
    KeyError
        For a label that is no free parameter.
    """
    parameters = {p.label: p for p in problem.space.parameters}
    xs, ys = (
        (np.geomspace if p.scale == "log" else np.linspace)(p.lower, p.upper, n)
        for p, n in zip((parameters[x], parameters[y]), shape, strict=True)
    )
    loss = np.full((len(ys), len(xs)), np.nan)
    for i, value_y in enumerate(ys):
        for j, value_x in enumerate(xs):
            found = problem.evaluate({**theta, x: float(value_x), y: float(value_y)}).loss
            loss[i, j] = np.nan if found is None else found
    return LossGrid(xs, ys, loss)


@dataclass
class ProportionalTwin:
    """Replacement of `simulate` if `scales_with_modulus`: one trajectory per Poisson's ratio, scaled by the modulus.

    reach: the largest shortening [m] that will be requested. Each trajectory is solved once up to it, and interpolated
    by cubic Hermite polynomials with the exact slopes.
    """

    reach: float
    solve: Simulate = simulate_robot
    solved: dict[str, tuple[float, Response]] = field(default_factory=dict[str, tuple[float, Response]])

    def __call__(
        self,
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        """As `softcal.twin.simulate.simulate`, for one cable driven by shortening, without sensitivities.

        Raises
        ------
        ParameterError
            For a protocol or sensitivities that cannot be obtained by scaling.
        """
        from scipy.interpolate import CubicHermiteSpline

        values = parameter_values(robot, theta)
        modulus = values[f"{robot.bodies[0].name}.youngs_modulus"]
        if sensitivities or snapshots or [c.control for c in protocol.commands.values()] != ["shortening"]:
            raise ParameterError(Fault("only the channels of one cable driven by shortening can be scaled"))
        ((cable, command),) = protocol.commands.items()
        key = fingerprint([cable, {k: value for k, value in values.items() if not k.endswith("youngs_modulus")}])
        if key not in self.solved:
            pull = Command("shortening", np.linspace(0.0, self.reach, SAMPLES))
            self.solved[key] = modulus, self.solve(robot, Protocol({cable: pull}), values)
        solved_at, response = self.solved[key]
        if not response.succeeded:  # its samples are not those of the protocol
            return replace(response, channels={}, slopes={}, samples=())
        grid = response.channels[str(ChannelName(SHORTENING, cable))]
        channels: dict[str, Floats] = {}
        for name, values in response.channels.items():
            slopes = response.slopes.get(name)
            if slopes is None:
                at_command = np.interp(command.values, grid, values)
            else:
                spline = CubicHermiteSpline(grid, values, slopes)
                at_command = np.asarray(spline(command.values), dtype=np.float64)
            channels[name] = at_command * (modulus / solved_at) if channel_name(name).kind.is_force else at_command
        return replace(response, channels=channels, slopes={})
