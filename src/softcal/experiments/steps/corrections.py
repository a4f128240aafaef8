"""Corrections of single channels: zero, drift, smoothing."""

from __future__ import annotations

from typing import Literal

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.units import format_quantity


@register_step(
    channel=Setting("channel"), by=Setting("of channel", choices=("first", "min")), n_samples=Setting("count")
)
def zero(
    dataset: Dataset, channel: str, by: Literal["first", "min"] | float = "first", *, n_samples: int = 1
) -> Dataset:
    """Subtract from the channel its first value, its minimum, or a number.

    Parameters
    ----------
    dataset
        The dataset.
    channel
        The channel.
    by
        `first` (mean of the first n_samples), `min`, or a number [the channel's unit].
    n_samples
        Number of samples for `first`.

    Raises
    ------
    DatasetError
        If the channel is missing, or `by` is none of the three.
    """
    values = dataset.values(channel)
    if by == "first":
        offset = float(values[:n_samples].mean())
    elif by == "min":
        offset = float(values.min())
    elif isinstance(by, str):
        raise DatasetError(
            Fault("no such zero", where=f"{dataset.name}, {channel}", got=f"'{by}'", allowed="first, min, a quantity")
        )
    else:
        offset = float(by)
    shown = format_quantity(offset, dataset.channels[channel].unit)
    settings = {"channel": channel, "by": by, "n_samples": n_samples}
    return dataset.with_channels(
        Step("zero", settings, f"{shown} subtracted from {channel}"), **{channel: values - offset}
    )


@register_step(channel=Setting("channel"), at=Setting("choice", choices=("returns", "ends")))
def detrend(dataset: Dataset, channel: str, *, at: Literal["returns", "ends"] = "returns") -> Dataset:
    """Subtract a drift that is linear in time, as of an IMU or a load cell. The first sample keeps its value.

    Parameters
    ----------
    dataset
        The dataset.
    channel
        The channel.
    at
        `returns` fits the drift to the starts of the cycles, at which the crosshead is back at the lower force limit
        (if there are three or more others, without the first cycle, which starts with a virgin specimen); `ends` draws
        it through the first and the last sample.

    Raises
    ------
    DatasetError
        If there is no time, for the time itself, or for `returns` fewer than two cycles.
    """
    time, values = dataset.values("time"), dataset.values(channel)
    if channel == "time":
        raise DatasetError(Fault("the time has no drift over itself", dataset.name, "channel time", "another channel"))
    if at == "ends":
        anchors = np.array([0, dataset.n_samples - 1])
        levels = values[anchors]
    elif at == "returns":
        cycle = dataset.cycle
        numbers = [] if cycle is None else [int(number) for number in np.unique(cycle[cycle >= 0])]
        if cycle is None or len(numbers) < 2:
            raise DatasetError(
                Fault(
                    "the drift needs the returns between two or more cycles",
                    where=dataset.name,
                    got=f"{len(numbers)} cycle(s)",
                    attempt="find_cycles before detrend, or at: ends",
                )
            )
        if len(numbers) > 3:
            numbers = numbers[1:]
        starts: list[int] = []
        means: list[float] = []
        for number in numbers:
            rows = np.flatnonzero(cycle == number)
            start = rows[: max(1, len(rows) // 200)]
            starts.append(int(start[len(start) // 2]))
            means.append(float(values[start].mean()))
        anchors, levels = np.array(starts), np.array(means)
    else:
        raise DatasetError(Fault("no such drift", where=dataset.name, got=f"'{at}'", allowed="returns, ends"))
    if np.ptp(time[anchors]) <= 0.0:
        raise DatasetError(Fault("a drift needs samples at different times", where=f"{dataset.name}, {channel}"))
    slope = float(np.polyfit(time[anchors] - time[0], levels, 1)[0])
    drift = slope * (time - time[0])
    unit = dataset.channels[channel].unit
    outcome = (
        f"drift of {channel} {format_quantity(slope * 60.0, unit)} per minute from {len(anchors)} points, "
        f"{format_quantity(float(drift[-1]), unit)} over the record, subtracted"
    )
    return dataset.with_channels(Step("detrend", {"channel": channel, "at": at}, outcome), **{channel: values - drift})


@register_step(channel=Setting("channel"), n_samples=Setting("count"), order=Setting("count"))
def smooth(dataset: Dataset, channel: str, n_samples: int, *, order: int = 2) -> Dataset:
    """Smooth the channel by a Savitzky-Golay filter.

    Parameters
    ----------
    dataset
        The dataset.
    channel
        The channel.
    n_samples
        Length of the window, odd.
    order
        Order of the polynomial.

    Raises
    ------
    DatasetError
        If the window is even, longer than the data, or no longer than the order.
    """
    if n_samples % 2 == 0 or not order < n_samples <= dataset.n_samples:
        raise DatasetError(
            Fault(
                "the smoothing window does not fit",
                where=f"{dataset.name}, {channel}",
                got=f"{n_samples} samples",
                allowed=f"an odd number above {order}, at most {dataset.n_samples}",
            )
        )
    from scipy.signal import savgol_filter

    values = dataset.values(channel)
    smoothed = np.asarray(savgol_filter(values, n_samples, order), dtype=np.float64)
    moved = float(np.sqrt(np.mean((smoothed - values) ** 2)))
    outcome = f"{channel} moved by {format_quantity(moved, dataset.channels[channel].unit)} (root mean square)"
    settings = {"channel": channel, "n_samples": n_samples, "order": order}
    return dataset.with_channels(Step("smooth", settings, outcome), **{channel: smoothed})
