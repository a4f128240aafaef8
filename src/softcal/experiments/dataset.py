"""Measured data: channels with unit and noise, and the provenance of their preparation. Frozen."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np

from softcal.arrays import Measured, Series
from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import DatasetError, Fault, unknown
from softcal.quantities import QUANTITIES
from softcal.sensing.channel import channel_name

SIGMA = replace(QUANTITIES["noise"], lower=0.0)


@displayed
@dataclass(frozen=True)
class Channel(Checked):
    """One measured quantity.

    Attributes
    ----------
    values
        Values [unit] (n_samples,); NaN if missing, such as the position of a hidden marker.
    unit
        SI unit.
    sigma
        Standard deviation of the noise [unit]; 0 if unknown.
    """

    values: Measured
    unit: str
    sigma: Annotated[float, SIGMA] = 0.0


@dataclass(frozen=True)
class Step:
    """One step of the provenance: its name, settings (SI) and outcome."""

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    outcome: str = ""


@displayed
@dataclass(frozen=True)
class Dataset(Checked):
    """Measured channels of equal length, and their provenance.

    With several actuators or markers the channels have the twin's names: `cable1.tension`, `m4.x`; `m4.x_sd` is the
    standard deviation of each value. `shortening` is the crosshead's travel (slack included), `tension` the cable's at
    the neck after the correction of pulley friction.

    Attributes
    ----------
    name
        Name of the record.
    channels
        Name (`time`, `shortening`, `tension`, `pitch`, `roll`, …) -> channel (n_samples,).
    provenance
        Steps that produced the data, in order.
    cycle
        Cycle number of each sample (n_samples,), from 0, -1 outside any; None if cycles were not searched.
    labels
        Names of the samples (n_samples,) given in the table; empty if there are none.
    """

    name: str
    channels: Mapping[str, Channel]
    provenance: tuple[Step, ...] = ()
    cycle: Series | None = None
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths = {key: len(channel.values) for key, channel in self.channels.items()}
        if self.cycle is not None:
            lengths["cycle"] = len(self.cycle)
        if self.labels:
            lengths["labels"] = len(self.labels)
        if len(set(lengths.values())) != 1 or min(lengths.values()) == 0:
            raise DatasetError(
                Fault("a dataset needs channels of one length, above zero", where=self.name, got=str(lengths))
            )
        faults = [
            Fault(
                "the channel is in another unit", f"{self.name}, {name}", f"'{channel.unit}'", own, "its values in SI"
            )
            for name, channel in self.channels.items()
            if channel.unit != (own := channel_name(name).kind.unit) and own
        ]
        if faults:
            raise DatasetError(faults)

    @property
    def n_samples(self) -> int:
        """Number of samples of every channel."""
        return len(next(iter(self.channels.values())).values)

    @property
    def incomplete(self) -> tuple[str, ...]:
        """Channels with missing values."""
        return tuple(name for name, channel in self.channels.items() if np.isnan(channel.values).any())

    def unit_read(self, channels: Collection[str]) -> str:
        """Units of some channels as text, with the columns that they were read from."""
        tables = [step.settings for step in self.provenance if "columns" in step.settings]
        columns = [
            f"'{column['name']}' in {column['unit']}"
            for table in tables
            for channel, column in table["columns"].items()
            if channel in channels
        ]
        named = f"the column {', '.join(dict.fromkeys(columns))}" if columns else ", ".join(channels)
        return f"the unit of {named}"

    def values(self, channel: str) -> Floats:
        """Values of a channel [SI].

        Raises
        ------
        DatasetError
            If the dataset has no such channel.
        """
        if channel not in self.channels:
            raise DatasetError(unknown(f"no channel '{channel}'", self.name, channel, self.channels, got=""))
        return self.channels[channel].values

    def with_channels(self, step: Step, **values: Floats) -> Dataset:
        """The dataset with replaced values of some channels, and the step added to the provenance."""
        channels = {**self.channels, **{k: replace(self.channels[k], values=v) for k, v in values.items()}}
        return replace(self, channels=channels, provenance=(*self.provenance, step))

    def take(self, rows: np.ndarray, step: Step) -> Dataset:
        """The dataset with only the given rows (indices or mask), and the step added to the provenance."""
        channels = {k: replace(c, values=c.values[rows]) for k, c in self.channels.items()}
        cycle = None if self.cycle is None else self.cycle[rows]
        labels = tuple(np.array(self.labels)[rows].tolist()) if self.labels else ()
        return replace(self, channels=channels, cycle=cycle, provenance=(*self.provenance, step), labels=labels)
