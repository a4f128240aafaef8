"""A cable's shortening and tension, as its machine measures them."""

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
