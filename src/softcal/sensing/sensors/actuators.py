"""The coordinate and the effort of an actuator, as the instruments of its machine measure them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softcal.quantities import QUANTITIES
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import ActuatorSensor, register_sensor

SHORTENING = ChannelKind(
    "shortening",
    "m",
    "Cable shortening",
    drives="coordinate",
    compared=2,
    offset=("slack", QUANTITIES["slack"]),
    most=1.0,
    mistake="mm read as m",
    paper_weight=300.0,  # alpha per millimetre, for an experiment driven by tension
    noise=2e-5,  # a testing machine's crosshead
)
TENSION = ChannelKind(
    "tension",
    "N",
    "Cable force",
    drives="effort",
    compared=1,
    offset=("tension_offset", QUANTITIES["tension offset"]),
    gain=("tension_gain", QUANTITIES["positive ratio"]),
    drift=("tension_drift", QUANTITIES["tension offset"]),
    slope=(10.0, 1e5),  # [N/m]
    most=5e3,
    mistake="N read as kN",
    paper_weight=0.3,  # alpha
    noise=0.05,  # a load cell of 50 N
)


@register_sensor
@dataclass(frozen=True)
class CableSensor(ActuatorSensor):
    """Shortening [m] and tension [N] of a cable."""

    name: ClassVar[str] = "cable"
    kinds: ClassVar[tuple[ChannelKind, ...]] = (SHORTENING, TENSION)
    of: ClassVar[str] = "cables"


VOLUME = ChannelKind(
    "volume",
    "m^3",
    "Pumped volume",
    drives="coordinate",
    offset=("volume_offset", QUANTITIES["pumped volume"]),
    gain=("volume_gain", QUANTITIES["positive ratio"]),
    most=1.0,
    mistake="ml read as l",
    noise=1e-8,  # a syringe pump of 10 ml
)
PRESSURE = ChannelKind(
    "pressure",
    "Pa",
    "Pressure",
    drives="effort",
    offset=("pressure_offset", QUANTITIES["pressure offset"]),
    gain=("pressure_gain", QUANTITIES["positive ratio"]),
    drift=("pressure_drift", QUANTITIES["pressure offset"]),
    slope=(1e5, 1e13),  # [Pa/m^3]: a weather balloon, and a stiff bellows of oil
    most=1e8,
    mistake="kPa read as MPa",
    noise=250.0,  # a gauge of 100 kPa, 0.25 % of its range
)
FLOW = ChannelKind("flow", "m^3/s", "Flow", most=0.01, mistake="ml/min read as l/s")
"""What a pump displaces in a time, of which a table may have the record in the place of the volume."""


@register_sensor
@dataclass(frozen=True)
class ChamberSensor(ActuatorSensor):
    """Volume [m^3] that a chamber's pump has displaced, and its pressure [Pa] above the atmosphere's."""

    name: ClassVar[str] = "chamber"
    kinds: ClassVar[tuple[ChannelKind, ...]] = (VOLUME, PRESSURE)
    columns: ClassVar[tuple[ChannelKind, ...]] = (FLOW,)
    of: ClassVar[str] = "chamber"


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
