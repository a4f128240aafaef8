"""Thinning of a record by travel, so that slow and fast cycles count equally.

The loss counts samples. In a record that is sampled in time a slow cycle has more samples than a fast one, and a rest
has many; and a robot with a memory is solved at every sample.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.driven import driven
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.noise import white_noise
from softcal.units import format_quantity

# Times the noise: rows that close to a turning point are a dwell there.
_DWELL = 3.0


@register_step(
    leaves_out="samples",
    step=Setting("of channel", channel_from="by"),
    by=Setting("channel", drives="coordinate"),
    longest=Setting("time"),
)
def thin(dataset: Dataset, step: float, *, by: str | None = None, longest: float | None = None) -> Dataset:
    """Thin a record to samples a `step` of a channel apart, up and down, and its turning points: as many at any speed.

    Samples are kept as they are, in their order: the first and the last, each that is a step [unit of `by`] or more
    from the one kept before it, begin and end of every dwell at a turning point, and, in a rest, one every `longest`
    [s].

    Parameters
    ----------
    dataset
        The dataset.
    step
        Distance [unit of `by`].
    by
        Channel whose travel is divided; None: the coordinate of the driven actuator, such as the shortening, or its
        effort where the record has only that.
    longest
        Largest time between samples in a rest [s]; None for no limit.

    Raises
    ------
    DatasetError
        If the step or the time is not above zero, or there is no time where it is needed.
    """
    by = by or driven(dataset).along(dataset.channels)
    values, unit = dataset.values(by), dataset.channels[by].unit
    asked = [(step, unit), *([] if longest is None else [(longest, "s")])]
    faults = [
        Fault("samples cannot be thinned by this step", dataset.name, format_quantity(one, its), f"above 0 {its}")
        for one, its in asked
        if not one > 0.0
    ]
    if faults:
        raise DatasetError(faults)
    time = None if longest is None else dataset.values("time")
    keep = _turns(values, step)
    last = 0
    for k in range(len(values)):
        rests = time is not None and longest is not None and time[k] - time[last] >= longest
        keep[k] |= bool(abs(values[k] - values[last]) >= step) or rests
        last = k if keep[k] else last
    outcome = f"{int(keep.sum())} of {len(values)} samples, {format_quantity(step, unit)} of {by} apart, and its turns"
    return dataset.take(keep, Step("thin", {"step": step, "by": by, "longest": longest}, outcome))


def _turns(values: Floats, band: float) -> np.ndarray:
    """Mask of the ends, and of begin and end of the dwell at each extreme from which the values return by the band."""
    turns = np.zeros(len(values), dtype=bool)
    turns[[0, -1]] = True
    dwell = _DWELL * white_noise(values)
    high = low = 0
    rises = falls = True

    def mark(at: int, until: int) -> None:
        near = np.abs(values[: until + 1] - values[at]) <= dwell
        away = np.flatnonzero(~near[:at])
        turns[[int(away[-1]) + 1 if away.size else 0, at, int(np.flatnonzero(near)[-1])]] = True

    for k in range(1, len(values)):
        high, low = (k if values[k] > values[high] else high), (k if values[k] < values[low] else low)
        if rises and values[high] - values[k] >= band:
            mark(high, k)
            rises, falls, low = False, True, k
        elif falls and values[k] - values[low] >= band:
            mark(low, k)
            rises, falls, high = True, False, k
    return turns
