"""Averaging a record to one sample: the mean over a window at its end, with the spread as noise."""

from __future__ import annotations

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.sensing.channel import channel_name
from softcal.units import format_quantity


@register_step(keeps_gaps=True, leaves_out="samples", last=Setting("time"))
def average(dataset: Dataset, *, last: float | None = None) -> Dataset:
    """One sample: the mean over the record or its last seconds; the spread becomes the noise of each channel.

    Missing values are omitted. The spread is the standard deviation of single samples, not of their mean, since motion
    within the window is no noise that averages out.

    Parameters
    ----------
    last
        The window [s] at the end; None takes the whole record.

    Raises
    ------
    DatasetError
        If the window is empty, or longer than the record, there is no time channel, or a channel has no value within
        the window.
    """
    rows = np.ones(dataset.n_samples, dtype=bool)
    if last is not None:
        if not last > 0:
            raise DatasetError(Fault("no sample within the window", dataset.name, f"the last {last:g} s", "above 0 s"))
        time = dataset.values("time")
        span, between = float(time[-1] - time[0]), float(np.diff(time).max(initial=0.0))
        if last > (span + between) * (1 + 1e-9) and len(time) > 1:
            what, got = "the window is longer than the record", format_quantity(last, "s")
            raise DatasetError(Fault(what, dataset.name, got, f"up to {format_quantity(span, 's')}", "average: {}"))
        # A sample at the edge of the window up to rounding is excluded.
        rows = time > time[-1] - last + 1e-9 * max(abs(float(time[-1])), last)
    unseen = [key for key, channel in dataset.channels.items() if np.isnan(channel.values[rows]).all()]
    if unseen:
        within = "" if last is None else f" in the last {format_quantity(last, 's')}"
        faults: list[Fault] = []
        for owner in dict.fromkeys(map(_owner, unseen)):
            name = next(key for key in dataset.channels if _owner(key) == owner)
            there = np.flatnonzero(np.isfinite(dataset.values(name)))
            got = "not once in the record"
            if len(there) and "time" in dataset.channels:
                time = dataset.values("time")
                got = f"last at {time[there[-1]]:.4g} s of {time[-1]:.4g} s"
            what = f"{owner} was not measured in the window"
            faults.append(Fault(what, dataset.name, got, f"at least one value{within}"))
        raise DatasetError(faults)
    channels: dict[str, Channel] = {}
    for key, channel in dataset.channels.items():
        values = channel.values[rows]
        seen = values[np.isfinite(values)]
        name = channel_name(key)
        known = dataset.channels.get(str(name.deviation))
        spread = float(np.std(seen, ddof=1)) if len(seen) > 1 else channel.sigma
        if known is not None:
            spread = float(np.hypot(spread, np.sqrt(np.nanmean(known.values[rows] ** 2))))
        if not name.is_deviation:
            channels[key] = Channel(seen.mean()[None], channel.unit, spread)
    what = "the record" if last is None else f"its last {format_quantity(last, 's')}"
    widest = max((key for key in channels if key != "time"), key=lambda key: channels[key].sigma, default="time")
    spread = format_quantity(channels[widest].sigma, channels[widest].unit)
    outcome = f"the mean of {int(rows.sum())} samples, {what}; the largest spread is {spread}, of {widest}"
    step = Step("average", {"last": last}, outcome)
    return Dataset(dataset.name, channels, (*dataset.provenance, step))


def _owner(channel: str) -> str:
    return channel_name(channel).carrier or channel
