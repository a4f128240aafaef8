"""The measurements of a case: samples, their split into fit and prediction, and channels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.sensing.channel import channel_name

Split = Literal["fit", "predict"]
FIT: Final = "fit"
PREDICT: Final = "predict"
SPLITS: tuple[Split, ...] = (FIT, PREDICT)


@dataclass(frozen=True)
class CaseRecord:
    """The samples of a case.

    Attributes
    ----------
    samples
        Their names (n,), in their order.
    is_fit
        Whether each may be fitted (n,); the others are to be predicted.
    channels
        Measured channels (n,) [SI] by name, NaN where nothing was measured; those of a point are `tip.x`, `.y`, `.z`.
    units
        The channels' units.
    """

    samples: tuple[str, ...]
    is_fit: NDArray[np.bool_]
    channels: Mapping[str, Floats]
    units: Mapping[str, str]

    def of(self, split: Split) -> NDArray[np.bool_]:
        """Mask (n,) of the samples that belong to a split."""
        return self.is_fit if split == FIT else ~self.is_fit

    @property
    def points(self) -> tuple[str, ...]:
        """The points whose position is measured."""
        return points_among(list(self.channels))

    @property
    def others(self) -> tuple[str, ...]:
        """The channels that are no coordinates, such as tensions."""
        coordinates = {f"{point}.{axis}" for point in self.points for axis in "xyz"}
        return tuple(name for name in self.channels if name not in coordinates)

    def positions(self, point: str) -> Floats:
        """Measured positions of a point (n, 3) [m]."""
        return np.stack([self.channels[f"{point}.{axis}"] for axis in "xyz"], axis=1)


def points_among(channels: Sequence[str]) -> tuple[str, ...]:
    """The names that have all three coordinates among channels."""
    found = dict.fromkeys(channel_name(name).carrier for name in channels)
    return tuple(one for one in found if all(f"{one}.{axis}" in channels for axis in "xyz"))


def joined(parts: Sequence[tuple[Split, CaseRecord]]) -> CaseRecord:
    """Records one after the other, each wholly of one split; a channel that one lacks was not measured there.

    Raises
    ------
    DatasetError
        Where several samples have one name.
    """
    counts = Counter(sample for _, part in parts for sample in part.samples)
    if twice := [sample for sample, count in counts.items() if count > 1]:
        raise DatasetError(Fault("several samples have one name", "samples", ", ".join(twice[:5]), "a name for each"))
    units = {name: unit for _, part in parts for name, unit in part.units.items()}
    return CaseRecord(
        tuple(sample for _, part in parts for sample in part.samples),
        np.concatenate([np.full(len(part.samples), split == FIT) for split, part in parts]),
        {name: stacked([part.channels for _, part in parts], name) for name in units},
        units,
    )


def stacked(tables: Sequence[Mapping[str, Floats]], name: str) -> Floats:
    """A column of several tables one after the other, NaN where one lacks it."""
    lengths = (len(next(iter(table.values()))) for table in tables)
    return np.concatenate([table.get(name, np.full(n, np.nan)) for table, n in zip(tables, lengths, strict=True)])
