"""A chamber's volume and pressure, as its pump and a gauge measure them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softcal.quantities import QUANTITIES
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import ActuatorSensor, register_sensor

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
