"""The position of a marker, as cameras measure it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from softcal.checks import Floats
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import Posture, PostureRates, Sensor, register_sensor

POSITION = tuple(
    ChannelKind(name, "m", axis=axis, noise=5e-4)  # a camera and a print
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
