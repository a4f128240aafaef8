"""A drive's angle and torque, as its motor's encoder and current measure them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softcal.quantities import QUANTITIES
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import ActuatorSensor, register_sensor

ANGLE = ChannelKind(
    "angle",
    "rad",
    "Motor angle",
    drives="coordinate",
    offset=("angle_offset", QUANTITIES["angle"]),
    gain=("angle_gain", QUANTITIES["positive ratio"]),
    drift=("angle_drift", QUANTITIES["angle"]),
    most=1e3,
    mistake="degrees read as radians",
    noise=1.5e-3,  # an encoder of 4096 counts, one count
)
TORQUE = ChannelKind(
    "torque",
    "N*m",
    "Motor torque",
    drives="effort",
    offset=("torque_offset", QUANTITIES["moment"]),
    gain=("torque_gain", QUANTITIES["positive ratio"]),
    drift=("torque_drift", QUANTITIES["moment"]),
    slope=(1e-6, 1e4),  # [N m/rad]: a hair spring, and a steel shaft
    most=1e3,
    mistake="N mm read as N m",
    noise=2e-3,  # a servo's current, 1 % of 0.2 N m
)


@register_sensor
@dataclass(frozen=True)
class DriveSensor(ActuatorSensor):
    """Angle [rad] and torque [N m] of a drive's motor."""

    name: ClassVar[str] = "drive"
    kinds: ClassVar[tuple[ChannelKind, ...]] = (ANGLE, TORQUE)
    of: ClassVar[str] = "drive"
