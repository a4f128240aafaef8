"""The position of a marker, as cameras measure it, and the pose of a plate with its angles, as an IMU measures them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from softcal.checks import Floats
from softcal.quantities import QUANTITIES
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import Posture, PostureRates, Sensor, register_sensor

POSITION = tuple(
    ChannelKind(name, "m", axis=axis, noise=5e-4, most=10.0, mistake="mm read as m")  # the noise: a camera and a print
    for axis, name in enumerate("xyz")
)


@register_sensor
@dataclass(frozen=True)
class MarkerSensor(Sensor):
    """Position [m] of a marker in the robot's frame."""

    marker: str
    name: ClassVar[str] = "marker"
    kinds: ClassVar[tuple[ChannelKind, ...]] = POSITION
    of: ClassVar[str] = "markers"

    def sense(self, robot: Posture) -> Floats:
        return robot.point(self.marker)

    def rates(self, robot: Posture, moving: PostureRates) -> Floats:
        return moving.point(self.marker)


def _angle(name: str, compared: int = 0) -> ChannelKind:
    return ChannelKind(
        name,
        "rad",
        name.capitalize(),
        compared=compared,
        offset=(f"{name}_offset", QUANTITIES["angle"]),
        drift=(f"{name}_drift", QUANTITIES["angle"]),
        most=np.pi,
        mistake="degrees read as rad",
        paper_weight=1.0,  # beta
        noise=np.deg2rad(0.1),  # an IMU
    )


PITCH, ROLL, YAW = ANGLES = (_angle("pitch", compared=3), _angle("roll"), _angle("yaw"))


@register_sensor
@dataclass(frozen=True)
class PlateSensor(Sensor):
    """Position [m] of a plate's reference in the robot's frame, and its pitch, roll and yaw [rad]."""

    plate: str
    name: ClassVar[str] = "plate"
    kinds: ClassVar[tuple[ChannelKind, ...]] = (*POSITION, *ANGLES)
    of: ClassVar[str] = "plates"

    def sense(self, robot: Posture) -> list[float]:
        return [*robot.point(self.plate), *angles(robot.rotation(self.plate))]

    def rates(self, robot: Posture, moving: PostureRates) -> Floats:
        R, turning = robot.rotation(self.plate), np.zeros((3, 3))  # d(pitch, roll, yaw)/d omega, R <- exp(omega) R
        for k in range(3):
            dR = _SPINS[k] @ R  # omega x each column
            turning[0, k] = (R[2, 2] * dR[0, 2] - R[0, 2] * dR[2, 2]) / (R[0, 2] ** 2 + R[2, 2] ** 2)
            turning[1, k] = -dR[1, 2] / np.sqrt(max(1.0 - R[1, 2] ** 2, 1e-300))
            turning[2, k] = (R[1, 1] * dR[1, 0] - R[1, 0] * dR[1, 1]) / (R[1, 0] ** 2 + R[1, 1] ** 2)
        return np.concatenate([moving.point(self.plate), turning @ moving.rotation(self.plate)])


def angles(R: Floats) -> tuple[float, float, float]:
    """pitch, roll, yaw [rad] of a rotation: pitch = atan2(R02, R22), roll = -asin R12, yaw = atan2(R10, R11).

    Pitch is the inclination towards +x, roll the one about x, yaw the rotation about z; each is the whole rotation
    angle when the others are zero (R = Ry(pitch) Rx(roll) Rz(yaw)).
    """
    return (
        float(np.arctan2(R[0, 2], R[2, 2])),
        float(-np.arcsin(np.clip(R[1, 2], -1.0, 1.0))),
        float(np.arctan2(R[1, 0], R[1, 1])),
    )


# omega x, for omega along each axis
_SPINS = np.cross(np.eye(3)[:, None, :], np.eye(3)[None, :, :]).swapaxes(1, 2)
