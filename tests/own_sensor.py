"""A sensor in one file of the user's own: a string between two markers or plates."""

STRING = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from softcal import ChannelKind, Sensor, quantity, register_sensor

STRETCH = ChannelKind(
    "stretch", "m", "String length", offset=("stretch_offset", quantity("length")), most=5.0, mistake="mm read as m"
)


@register_sensor
@dataclass(frozen=True)
class StringPotentiometer(Sensor):
    """The length of a string between two points."""

    between: tuple[str, str]
    name: ClassVar[str] = "string"
    kinds: ClassVar[tuple[ChannelKind, ...]] = (STRETCH,)

    def sense(self, robot):
        return [np.linalg.norm(self._span(robot))]

    def rates(self, robot, moving):
        span = self._span(robot)
        return [span @ self._span(moving) / np.linalg.norm(span)]

    def _span(self, of):
        first, last = self.between
        return of.point(last) - of.point(first)
'''
