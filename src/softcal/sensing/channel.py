"""A channel: its kind, and the part of the robot that carries it. The one place that knows how channels are named."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

from softcal.quantities import Quantity
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import PARTS, SENSORS, Sensor

TIME = ChannelKind("time", "s", "Time")
_DEVIATION = "_sd"  # suffix of the channel with another's standard deviation, sample by sample: `m4.x_sd`


@dataclass(frozen=True)
class ChannelName:
    """The name of a measured or simulated channel, such as `front.tension`; `str` gives it as files have it.

    Attributes
    ----------
    kind
        Kind of quantity.
    carrier
        The actuator, plate, marker or sensor; "" in a short name, such as `tension`.
    is_deviation
        True for the standard deviation of the channel.
    """

    kind: ChannelKind
    carrier: str = ""
    is_deviation: bool = False

    def __str__(self) -> str:
        name = f"{self.carrier}.{self.kind.name}" if self.carrier else self.kind.name
        return name + (_DEVIATION if self.is_deviation else "")

    @property
    def is_known(self) -> bool:
        """True if a channel can have this name."""
        if self.kind == TIME:
            return not self.carrier and not self.is_deviation
        return self.kind.unit != "" and "." not in self.carrier

    @property
    def point(self) -> str:
        """The marker or plate whose position the channel is a part of; "" for other channels and for short names."""
        return self.carrier if self.kind.is_position else ""

    @property
    def offset(self) -> str:
        """Name of the rig's parameter that is added to the twin's reading, such as `front.slack`; "" without one."""
        return "" if self.kind.offset is None else f"{self.carrier}.{self.kind.offset[0]}"

    @property
    def gain(self) -> str:
        """Name of the rig's factor on the twin's reading, such as `front.tension_gain`; "" without one."""
        return "" if self.kind.gain is None else f"{self.carrier}.{self.kind.gain[0]}"

    @property
    def drift(self) -> str:
        """Name of the rig's parameter by which a reading has changed at the end of a record, such as
        `front.tension_drift`; "" without one.
        """
        return "" if self.kind.drift is None else f"{self.carrier}.{self.kind.drift[0]}"

    @property
    def deviation(self) -> ChannelName:
        """The channel with the standard deviations of this one."""
        return replace(self, is_deviation=True)

    @property
    def label(self) -> str:
        """Name in charts: "Cable force" for `tension`; with a carrier, the name in files."""
        return self.kind.label or self.kind.name if not self.carrier and not self.is_deviation else str(self)


def channel_name(name: str) -> ChannelName:
    """The channel of a name; an unknown name has a kind without a unit."""
    stem = name.removesuffix(_DEVIATION)
    carrier, dot, kind = stem.rpartition(".")
    known = kinds().get(kind) if carrier or not dot else None
    return ChannelName(known or ChannelKind(kind if carrier else stem, ""), carrier, stem != name)


def channel_unit(name: str) -> str | None:
    """SI unit of a channel by its name (`pitch`, `m4.x`, `m4.x_sd`); None for an invalid name."""
    found = channel_name(name)
    return found.kind.unit if found.is_known else None


def kinds() -> Mapping[str, ChannelKind]:
    """Every kind of channel by its name: time, and those of all sensors and of their columns, positions last."""
    return _kinds(tuple(SENSORS.values()))


@lru_cache(maxsize=8)
def _kinds(sensors: tuple[type[Sensor], ...]) -> Mapping[str, ChannelKind]:
    # Names are parsed for every residual of a search; the sensors change only when one is registered.
    each = (kind for sensor in sensors for kind in (*sensor.kinds, *sensor.columns))
    own = sorted(each, key=lambda kind: kind.is_position)
    return {kind.name: kind for kind in (TIME, *own)}


def other_of(kind: ChannelKind) -> ChannelKind:
    """The effort of an actuator's coordinate, and its coordinate for its effort."""
    coordinate, effort = of_actuator(kind)
    return coordinate if kind == effort else effort


def readings() -> Mapping[str, Quantity]:
    """Kinds of quantity of the rig's parameters between the twin and its channels, offsets, gains and drifts, by the
    last part of their names.
    """
    each = ((kind.offset, kind.gain, kind.drift) for kind in kinds().values())
    return dict(one for of_kind in each for one in of_kind if one is not None)


def carriers(kind: ChannelKind) -> tuple[str, ...]:
    """The robot's parts that carry channels of a kind: of "actuators", "cables", "markers", "plates" and "sensors"."""
    owners = [sensor.of or "sensors" for sensor in SENSORS.values() if kind in (*sensor.kinds, *sensor.columns)]
    return tuple(sorted({of if of in (*PARTS, "sensors") else "actuators" for of in owners}))


def of_actuator(kind: ChannelKind) -> tuple[ChannelKind, ChannelKind]:
    """The kinds of coordinate and effort of the actuators that a channel of this kind drives."""
    for sensor in SENSORS.values():
        if kind in sensor.kinds and sensor.of:
            by = {one.drives: one for one in sensor.kinds}
            return by["coordinate"], by["effort"]
    raise KeyError(kind.name)


def positions(point: str) -> tuple[ChannelName, ...]:
    """The three coordinates of a marker or plate."""
    axes = sorted((kind for kind in kinds().values() if kind.axis is not None), key=lambda kind: kind.axis or 0)
    return tuple(ChannelName(kind, point) for kind in axes)


# What kinds of channel are called in sentences, those of the most interest first; any other one by its name.
WORDS = {"tension": "force", "pitch": "pitch", "shortening": "travel"}


def in_a_word(channel: str) -> str:
    """Noun for a channel in sentences, without its carrier: "force", "travel", "pressure"."""
    kind = channel_name(channel).kind
    return WORDS.get(kind.name, kind.name)


def of_kind(kind: ChannelKind, names: Iterable[str]) -> list[str]:
    """Names of the channels of a kind, without standard deviations."""
    return [name for name in names if (channel := channel_name(name)).kind == kind and not channel.is_deviation]
