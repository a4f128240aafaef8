"""Noise of a channel: estimated from its second differences, or given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.step import Setting, register_step
from softcal.sensing.channel import channel_name
from softcal.units import format_quantity

NOISE_STEPS = ("set_noise", "estimate_noise")
"""Steps that state the noise and change no sample."""


def white_noise(values: Floats) -> float:
    """Standard deviation of white noise on a smooth signal, from the median of its second differences.

    The second difference of white noise has the variance 6 sigma^2; the median excludes turning points.
    """
    if len(values) < 5:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(values, n=2))) / np.sqrt(6.0))


@register_step(keeps_gaps=True, channel=Setting("channel"), sigma=Setting("of channel"))
def set_noise(dataset: Dataset, channel: str, sigma: float) -> Dataset:
    """Set the standard deviation of a channel's noise at every sample.

    Parameters
    ----------
    dataset
        The dataset.
    channel
        The channel.
    sigma
        Standard deviation [the channel's unit].

    Raises
    ------
    DatasetError
        If the channel is missing, or sigma is not positive.
    """
    dataset.values(channel)
    if not sigma > 0.0:
        raise DatasetError(
            Fault("a noise must be above zero", where=f"{dataset.name}, {channel}", got=f"{sigma:g}", allowed="> 0")
        )
    unit = dataset.channels[channel].unit
    step = Step(
        "set_noise", {"channel": channel, "sigma": sigma}, f"sigma of {channel} is {format_quantity(sigma, unit)}"
    )
    return _with_sigma(dataset, channel, sigma, step)


@register_step(channel=Setting("channel"))
def estimate_noise(dataset: Dataset, channel: str) -> Dataset:
    """The dataset with a channel's sigma estimated from its sample-to-sample scatter (`white_noise`)."""
    sigma = white_noise(dataset.values(channel))
    unit = dataset.channels[channel].unit
    outcome = f"sigma of {channel} estimated at {format_quantity(sigma, unit)} from second differences"
    return _with_sigma(dataset, channel, sigma, Step("estimate_noise", {"channel": channel}, outcome))


def _with_sigma(dataset: Dataset, channel: str, sigma: float, step: Step) -> Dataset:
    channels = {**dataset.channels, channel: replace(dataset.channels[channel], sigma=float(sigma))}
    channels.pop(str(channel_name(channel).deviation), None)
    return replace(dataset, channels=channels, provenance=(*dataset.provenance, step))
