"""Resampling along a channel, and windows of a channel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.driven import driven
from softcal.experiments.step import Setting, register_step
from softcal.experiments.steps.branches import curve
from softcal.limits import LIMITS
from softcal.units import format_quantity

# Largest decrease [share of its range] of a channel that counts as increasing with noise.
_NOISY_RISE = 0.05


@register_step(
    leaves_out="samples",
    by=Setting("channel", drives="coordinate"),
    n=Setting("count"),
    step=Setting("of channel", channel_from="by"),
)
def resample(dataset: Dataset, by: str | None = None, *, n: int | None = None, step: float | None = None) -> Dataset:
    """The dataset at n samples, or at samples with spacing `step` [unit of `by`], evenly spaced along the channel `by`.

    Along a channel that strictly rises, or falls, the others are interpolated linearly; along one that does so up to
    noise (such as a measured tension) they are first averaged over n bins. The cycle is that of the nearest sample.

    Parameters
    ----------
    dataset
        The dataset.
    by
        Channel along which the samples are spaced evenly; None: the coordinate of the driven actuator, such as the
        shortening, or its effort where the record has only that.
    n
        Number of samples; either this or `step`.
    step
        Spacing [unit of `by`].

    Raises
    ------
    DatasetError
        If the channel rises and falls, as over complete cycles (take a branch first), or n or step are unsuitable.
    """
    by = by or driven(dataset).along(dataset.channels)
    # A branch into a vacuum falls all along: it is resampled with the other sign.
    values = dataset.values(by)
    way = -1.0 if values[-1] < values[0] else 1.0
    abscissa = way * values
    unit = dataset.channels[by].unit
    span = float(np.ptp(abscissa))
    if (n is None) == (step is None):
        raise DatasetError(
            Fault("resample needs either n or step", where=dataset.name, got="both" if n is not None else "neither")
        )
    n_asked = n
    if step is not None:
        if step > 0.0:
            LIMITS["samples"].check(1 + span / step, where=dataset.name)
        n_asked = int(np.floor(span / step * (1 + 1e-12))) + 1 if step > 0.0 else 0
    if n_asked is None or n_asked < 2:
        raise DatasetError(
            Fault(
                f"resampling by {by} would leave fewer than two samples",
                where=dataset.name,
                got=f"n {n}" if step is None else f"a step of {format_quantity(step, unit)}",
                allowed=f"n of 2 or more, or a step up to {format_quantity(span, unit)}",
            )
        )
    # Largest decrease from the running maximum: zero if strictly increasing.
    rises = bool(np.all(np.diff(abscissa) > 0.0))
    fall = float(np.max(np.maximum.accumulate(abscissa) - abscissa))
    ordinates = {key: channel.values for key, channel in dataset.channels.items() if key != by}
    cycle = dataset.cycle
    how = "interpolated"
    if not rises and fall <= _NOISY_RISE * span:
        abscissa, ordinates = curve(abscissa, ordinates, n_asked)
        cycle = None
        how = "averaged over bins"
    elif not rises:
        raise DatasetError(
            Fault(
                f"{by} does not rise or fall all along, so nothing can be resampled by it",
                where=dataset.name,
                got=f"a return by {format_quantity(fall, unit)}",
                allowed=f"returns up to {format_quantity(_NOISY_RISE * span, unit)}, as of noise",
                attempt="take_branch before, or resample by time",
            )
        )
    lower = float(abscissa[0])
    upper = float(abscissa[-1]) if step is None else lower + (n_asked - 1) * step
    grid = np.minimum(np.linspace(lower, upper, n_asked), abscissa[-1])
    channels = {by: replace(dataset.channels[by], values=way * grid)}
    for key, ordinate in ordinates.items():
        channels[key] = replace(dataset.channels[key], values=np.interp(grid, abscissa, ordinate))
    channels = {key: channels[key] for key in dataset.channels}
    right = np.clip(np.searchsorted(abscissa, grid), 1, len(abscissa) - 1)
    nearest_rows = right - (grid - abscissa[right - 1] < abscissa[right] - grid)
    new_cycle = None if cycle is None else cycle[nearest_rows]
    outcome = (
        f"{dataset.n_samples} samples {how} to {n_asked} along {by}, "
        f"{format_quantity(way * lower, unit)} to {format_quantity(way * float(grid[-1]), unit)}"
    )
    record = Step("resample", {"by": by, "n": n, "step": step}, outcome)
    return replace(dataset, channels=channels, cycle=new_cycle, provenance=(*dataset.provenance, record), labels=())


@register_step(
    keeps_gaps=True,
    leaves_out="samples",
    channel=Setting("channel"),
    lower=Setting("of channel"),
    upper=Setting("of channel"),
)
def window(dataset: Dataset, channel: str, *, lower: float | None = None, upper: float | None = None) -> Dataset:
    """Keep the samples with lower <= channel <= upper.

    Parameters
    ----------
    dataset
        The dataset.
    channel
        The channel.
    lower
        Lower limit [the channel's unit]; None for no limit.
    upper
        Upper limit [the channel's unit]; None for no limit.

    Raises
    ------
    DatasetError
        If the channel is missing, or the window has no sample.
    """
    values = dataset.values(channel)
    unit = dataset.channels[channel].unit
    mask = np.ones(len(values), dtype=bool)
    if lower is not None:
        mask &= values >= lower
    if upper is not None:
        mask &= values <= upper
    asked = (
        f"{'-inf' if lower is None else format_quantity(lower, unit)} to "
        f"{'inf' if upper is None else format_quantity(upper, unit)}"
    )
    if not mask.any():
        there = f"{format_quantity(float(values.min()), unit)} to {format_quantity(float(values.max()), unit)}"
        raise DatasetError(
            Fault(f"no sample within the window of {channel}", where=dataset.name, got=asked, allowed=there)
        )
    outcome = f"{int(mask.sum())} of {len(values)} samples with {channel} from {asked}"
    return dataset.take(mask, Step("window", {"channel": channel, "lower": lower, "upper": upper}, outcome))
