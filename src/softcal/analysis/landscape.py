"""The loss over two parameters, the others held: where it is flat, two parameters cannot be told apart.

With a hyperelastic law whose energy is proportional to Young's modulus, no dead load, and every cable driven by its
shortening, the shape does not depend on the modulus and every tension is proportional to it. Then one trajectory for
each value of the other parameter gives a whole row of the landscape.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.calibration.fingerprint import fingerprint
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Problem, Simulate
from softcal.checks import Floats
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate as simulate_robot

# Laws whose energy is proportional to Young's modulus at constant Poisson's ratio.
PROPORTIONAL_LAWS = ("neo-hooke",)


@dataclass(frozen=True)
class LossGrid:
    """The loss over a grid: x and y are the axes [SI], loss (len(y), len(x)) is NaN where the twin failed."""

    x: Floats
    y: Floats
    loss: Floats


def scales_with_modulus(problem: Problem) -> bool:
    """Whether tensions are proportional to the one Young's modulus, and all else does not depend on it."""
    robot = problem.robot
    dead = bool(robot.loads) or (bool(np.any(robot.gravity)) and _has_weight(robot))
    return (
        len(robot.bodies) == 1
        and robot.bodies[0].law in PROPORTIONAL_LAWS
        and not dead
        and all(experiment.drive == "shortening" for experiment in problem.experiments)
    )


def loss_over(problem: Problem, theta: Mapping[str, float], x: str, y: str, shape: tuple[int, int]) -> LossGrid:
    """The loss over the bounds of two free parameters, the others as in theta [SI by label].

    Parameters
    ----------
    x, y
        Labels of the two.
    shape
        Number of values of x and of y.

    Raises
    ------
    KeyError
        For a label that is not free.
    """
    simulate = problem.simulate or simulate_robot
    if scales_with_modulus(problem):
        simulate = _Proportional(f"{problem.robot.bodies[0].name}.youngs_modulus", simulate)
    simulated = replace(problem, simulate=simulate)
    xs, ys = (_axis(problem.space, label, n) for label, n in ((x, shape[0]), (y, shape[1])))
    loss = np.full((len(ys), len(xs)), np.nan)
    for i, value_y in enumerate(ys):
        for j, value_x in enumerate(xs):
            found = simulated.evaluate({**theta, x: float(value_x), y: float(value_y)}).loss
            loss[i, j] = np.nan if found is None else found
    return LossGrid(xs, ys, loss)


@dataclass
class _Proportional:
    """A simulate that solves once for each shape and scales the tensions by the modulus."""

    name: str
    solve: Simulate
    solved: dict[str, tuple[float, Response]] = field(default_factory=dict[str, tuple[float, Response]])

    def __call__(
        self, robot: Robot, protocol: Protocol, *, sensitivities: Sequence[str] = (), snapshots: bool = False
    ) -> Response:
        modulus = robot.bodies[0].parameters["youngs_modulus"]
        key = fingerprint([with_parameters(robot, {self.name: 1.0}), protocol, list(sensitivities), snapshots])
        if key not in self.solved:
            self.solved[key] = modulus, self.solve(robot, protocol, sensitivities=sensitivities, snapshots=snapshots)
        solved_at, response = self.solved[key]
        channels = {
            name: values * (modulus / solved_at) if name.endswith(".tension") else values
            for name, values in response.channels.items()
        }
        return replace(response, channels=channels)


def _has_weight(robot: Robot) -> bool:
    return any(body.density for body in robot.bodies) or any(plate.mass for plate in robot.plates)


def _axis(space: SearchSpace, label: str, n: int) -> Floats:
    parameter = next((p for p in space.parameters if p.label == label), None)
    if parameter is None:
        raise KeyError(label)
    if parameter.scale == "log":
        return np.geomspace(parameter.lower, parameter.upper, n)
    return np.linspace(parameter.lower, parameter.upper, n)
