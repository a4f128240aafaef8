"""
An actuator of your own
=======================

An actuator has a coordinate of the shape and an effort that does work on it. It states how the coordinate depends on
points of the robot, with its gradient and the stiffness of its force; commands, channels, derivatives and calibration
follow. Here a push rod between a point in space and a plate.
"""

from dataclasses import dataclass, replace

import numpy as np

import softcal

extension = softcal.ChannelKind("extension", "m", "Extension", drives="coordinate")
thrust = softcal.ChannelKind("thrust", "N", "Thrust", drives="effort")


@softcal.register_sensor
@dataclass(frozen=True)
class PushRodSensor(softcal.ActuatorSensor):
    """Extension [m] and thrust [N] of a push rod."""

    name, kinds, of = "gallery-push-rod", (extension, thrust), "gallery-push-rod"


@dataclass(frozen=True)
class PushRodTerm(softcal.ActuatorTerm):
    """A force along the line from a place to a point of the robot; its coordinate is the line's length less `rest`."""

    name: str
    foot: np.ndarray
    point: int
    rest: float
    starts: object = None

    @property
    def actuators(self):
        return (softcal.ActuatorLimits(self.name, "extension", "thrust"),)

    def connectivity(self, layout):
        return softcal.Connectivity([np.array([[self.point]])])

    def plan(self, layout, pattern):
        return replace(self, starts=pattern.blocks(np.array([[self.point]]))[0, 0])

    def shape_coordinates(self, x):
        return np.array([np.linalg.norm(x[self.point] - self.foot) - self.rest])

    def shape_gradient(self, x, i, size):
        arm, out = x[self.point] - self.foot, np.zeros((size // 3, 3))
        out[self.point] = arm / np.linalg.norm(arm)
        return out.ravel()

    def add_forces(self, given, effort, into, transmission):
        into.full -= effort[0] * self.shape_gradient(given.state.x, 0, len(into.full))
        if into.data is not None:  # the upper triangle of the point's own block
            arm = given.state.x[self.point] - self.foot
            stiffness = np.eye(3) - np.outer(arm, arm) / (arm @ arm)
            block = -effort[0] * stiffness / np.linalg.norm(arm)
            for row, start in enumerate(self.starts):
                into.data[start + row : start + 3] += block[row, row:]


@softcal.register_actuator
@dataclass(frozen=True)
class PushRod(softcal.Actuator):
    """A linear motor between a place [m] and a plate's point [m]."""

    foot: tuple[float, float, float]
    head: tuple[float, float, float]
    on: str
    name, channels = "gallery-push-rod", (extension, thrust)
    ranges = softcal.quantity("length"), softcal.quantity("force")

    def term(self, name, places):
        ((point, _),) = places.support(np.array(self.head), self.on, name)
        return PushRodTerm(name, np.array(self.foot), point, np.linalg.norm(np.subtract(self.head, self.foot)))


# %%
# It pushes the end of a strip to the side; by the thrust that this takes it comes to the same extension.
strip = softcal.with_parameters(softcal.load("../strip/project.yaml").robot, {"strip.youngs_modulus": 4e6})
motor = softcal.NamedActuator("motor", PushRod((-0.06, 0.0, 0.1), (-0.01, 0.0, 0.15), "tip"))
robot, way = replace(strip, actuators=(motor,)), np.linspace(0.0, 0.03, 13)
response = softcal.simulate(robot, softcal.Protocol({"motor": softcal.Command("extension", way)}))
needed = softcal.Protocol({"motor": softcal.Command("thrust", response.channels["motor.thrust"][::4])})
again = softcal.simulate(robot, needed).channels["motor.extension"]
print(f"{1e3 * response.channels['motor.thrust'][-1]:.1f} mN for 30 mm; by thrust {1e3 * again[-1]:.4f} mm")
assert np.allclose(again, way[::4], atol=1e-6)

response.plot("motor.thrust", "motor.extension")
