"""The twins of a robot next to it: those with each length of a body a little less, and a little more."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from softcal.geometry.shape import LENGTHS
from softcal.mechanics.neighbours import STEP, Neighbours
from softcal.twin.parameters import robot_parameters, with_shape
from softcal.twin.robot import Robot

Build = Callable[[Robot], Any]


def neighbours_of(robot: Robot, theta: Mapping[str, float], build: Build) -> dict[str, Neighbours]:
    """By the name of each length, the twins next to that of a robot at theta; built when they are needed.

    What theta states of its shape stays as one length changes; other lengths follow it, as in the robot at theta.

    Parameters
    ----------
    robot
        The robot.
    theta
        Parameter values by dotted name [SI].
    build
        Robot -> its twin, or a part of it.
    """
    own = {name: info.value for name, info in robot_parameters(robot).items() if info.shapes}
    stated = {name: theta[name] for name, value in own.items() if theta.get(name, value) != value}
    shape = {name: info.value for name, info in robot_parameters(with_shape(robot, stated)).items() if info.shapes}
    neighbours: dict[str, Neighbours] = {}
    for body in robot.bodies:
        extent = float(np.ptp(body.mesh.points, axis=0).max())
        for key in body.shape.values if body.shape else ():
            name = f"{body.name}.{key}"
            step = STEP * (extent if LENGTHS[key].unit == "m" else 1.0)
            neighbours[name] = Neighbours(partial(_beside, robot, {**stated, name: shape[name]}, name, build), step)
    return neighbours


def _beside(robot: Robot, stated: Mapping[str, float], name: str, build: Build, offset: float) -> Any:
    return build(with_shape(robot, {**stated, name: stated[name] + offset}))
