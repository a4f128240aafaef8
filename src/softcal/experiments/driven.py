"""The actuator that a record drives: the channels of its coordinate and its effort, such as shortening and tension.

Cycles, branches, slack and loops are those of one actuator, whatever its kind. Both may act the other way, as the
pressure and the volume of a chamber that is sucked out: the steps then see both with the other sign.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset
from softcal.sensing.channel import ChannelName, channel_name, of_actuator
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import SHORTENING, TENSION
from softcal.units import format_quantity, readable_unit, unit_factor

_OTHER_WAY = 2.0  # times what it reaches one way, the effort must reach the other way: a motor may turn to and fro


@dataclass(frozen=True)
class DrivenChannels:
    """Names of the channels of an actuator's coordinate and of its effort; a record may lack one of the two."""

    coordinate: str
    effort: str

    @property
    def kinds(self) -> tuple[ChannelKind, ChannelKind]:
        """The kinds of both."""
        return channel_name(self.coordinate).kind, channel_name(self.effort).kind

    @property
    def units(self) -> tuple[str, str]:
        """The SI units of both."""
        coordinate, effort = self.kinds
        return coordinate.unit, effort.unit

    @property
    def names(self) -> tuple[str, str]:
        """The names of both."""
        return self.coordinate, self.effort

    @property
    def is_cable(self) -> bool:
        """True for a cable, whose tension is never below zero."""
        return self.kinds[1] == TENSION

    def along(self, channels: Collection[str]) -> str:
        """The channel along which a record runs: the coordinate, or the effort where the record has only that."""
        return self.effort if self.coordinate not in channels and self.effort in channels else self.coordinate

    def sign(self, dataset: Dataset) -> float:
        """-1 for a record in the negative direction, as with a vacuum; else 1."""
        if self.is_cable:
            return 1.0
        values = dataset.values(self.effort if self.effort in dataset.channels else self.coordinate)
        return -1.0 if -float(values.min()) > _OTHER_WAY * abs(float(values.max())) else 1.0

    def rising(self, dataset: Dataset, channel: str) -> Floats:
        """Values [SI] of one of its channels, with the sign with which they rise as the robot is loaded.

        Raises
        ------
        DatasetError
            If the record does not have it.
        """
        values = dataset.values(channel)
        return values if self.sign(dataset) > 0.0 else -values

    def slope_in_words(self, slope: float) -> str:
        """A slope of the effort over the coordinate [SI], such as "12 N/mm" or "4.5 kPa/ml"."""
        coordinate, effort = self.units
        # In the unit of the effort that suits its change over one readable unit of the coordinate.
        per = readable_unit(0.0, coordinate)
        change = slope * unit_factor(per, coordinate)
        return f"{format_quantity(change, effort)}/{per}"


CABLE = DrivenChannels(SHORTENING.name, TENSION.name)
"""The channels of the one cable that has short names."""


def actuator_of(channel: ChannelName) -> DrivenChannels:
    """The channels of the actuator that has a channel which drives."""
    coordinate, effort = of_actuator(channel.kind)
    return DrivenChannels(str(ChannelName(coordinate, channel.carrier)), str(ChannelName(effort, channel.carrier)))


def driven_among(channels: Collection[str], where: str = "") -> DrivenChannels:
    """The actuator that a record with these channels drives.

    It is the only one with coordinate and effort, or the cable with short names, or the only actuator.

    Parameters
    ----------
    channels
        Names of the channels.
    where
        Place for error messages.

    Raises
    ------
    DatasetError
        If there are several, of which none is meant.
    """
    names = [channel_name(channel) for channel in channels]
    there = list(dict.fromkeys(actuator_of(one) for one in names if one.kind.drives and not one.is_deviation))
    whole = [one for one in there if one.coordinate in channels and one.effort in channels]
    if len(whole) != 1 and CABLE in there:
        return CABLE
    if len(whole or there) > 1:
        got = ", ".join(one.along(channels) for one in there)
        attempt = f"'by: {there[0].along(channels)}' in the step"
        raise DatasetError(Fault("the record has several actuators", where, got, attempt=attempt))
    return next(iter(whole or there), CABLE)


def driven(dataset: Dataset, by: str | None = None) -> DrivenChannels:
    """The actuator of a step.

    Parameters
    ----------
    dataset
        The record.
    by
        A channel of the actuator; None for that by which the cycles were found, or the one that the record drives.

    Raises
    ------
    DatasetError
        If there is none with such a channel, or there are several.
    """
    found: dict[str, Any] = {}
    for step in dataset.provenance:
        found |= step.settings if step.name == "find_cycles" else {}
    channel = by or found.get("by")
    if channel is None:
        return driven_among(tuple(dataset.channels), dataset.name)
    name = channel_name(channel)
    if not name.kind.drives:
        there = [one for one in dataset.channels if channel_name(one).kind.drives]
        raise DatasetError(Fault("this channel is not of an actuator", dataset.name, channel, ", ".join(there)))
    return actuator_of(name)


def driven_whole(dataset: Dataset) -> DrivenChannels | None:
    """The actuator that a record drives, where it has its coordinate and its effort; None of any other."""
    try:
        of = driven(dataset)
    except DatasetError:  # several actuators
        return None
    return of if {of.coordinate, of.effort} <= dataset.channels.keys() else None
