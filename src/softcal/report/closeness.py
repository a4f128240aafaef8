"""Rating of the fit, channel by channel: good, fair or poor.

An error is compared with the noise stated in the data if there is any, otherwise with the range of the measurement:
largest minus smallest value, so that an offset common to all samples does not hide an error.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softcal.calibration.result import SearchResult
from softcal.experiments.dataset import Dataset
from softcal.report.format import joined, number, scale_of
from softcal.report.tables import share_of_range
from softcal.sensing.channel import channel_name

Tone = Literal["good", "note", "warning"]
# RMS error over the measurement's range: close below the first share, poor above the second.
CLOSE, POOR = 0.03, 0.10
# An RMS error up to this many times the stated noise counts as noise.
_NOISE = 1.2
# Channels with an error of their own: channel, word, SI unit.
KINDS = (("tension", "force", "N"), ("pitch", "pitch", "rad"), ("shortening", "travel", "m"))


@dataclass(frozen=True)
class Miss:
    """Error of a channel in an experiment: RMSE [SI], and its ratio to the range and to the stated noise if known."""

    experiment: str
    word: str
    error: float
    unit: str
    share: float | None
    in_noise: float | None

    @property
    def size(self) -> str:
        scale = scale_of(self.unit)
        return f"{number(self.error / scale.factor)} {scale.unit}"


def misses_of(data: Mapping[str, Dataset], result: SearchResult) -> Iterable[Miss]:
    """Errors of all channels in all experiments of a result; data: the samples by experiment."""
    for name, fit in result.experiments.items():
        for channel, word, unit in KINDS:
            error = fit.rmse.get(channel)
            if error is not None:
                share, sigma = share_of_range(fit, channel), _noise(data[name], channel) if name in data else None
                yield Miss(name, word, error, unit, share, error / sigma if sigma else None)


def _noise(data: Dataset, channel: str) -> float | None:
    """Stated noise of a channel [SI]: root mean square over its samples; None if not stated."""
    channels = data.channels
    own = channels.get(str(channel_name(channel).deviation))
    if own is not None:
        return float(np.sqrt(np.nanmean(own.values**2)))
    return channels[channel].sigma if channel in channels and channels[channel].sigma > 0 else None


def closeness_by_experiment(misses: Iterable[Miss]) -> Iterable[tuple[str, Tone]]:
    """One sentence per experiment: the errors of its channels, and their rating."""
    own: dict[str, list[Miss]] = {}
    for miss in misses:
        own.setdefault(miss.experiment, []).append(miss)
    for name, missed in own.items():
        word, tone = closeness(missed)
        yield f"{name}: the twin reproduces {joined(map(miss_text, missed))}; {word}.", tone


def worst_of(misses: Iterable[Miss], word: str) -> str:
    """The largest error of one channel over all experiments, and its experiment: "the measured force within 2 % …"."""
    found = [miss for miss in misses if miss.word == word]
    if not found:
        return ""
    where = "; worst in {}" if len(found) > 1 else ""
    if word == "force":
        shares = [miss for miss in found if miss.share is not None]
        if not shares:
            return ""
        worst = max(shares, key=lambda miss: miss.share or 0.0)
        size = f"the measured force within {number(100 * (worst.share or 0.0), 2)} % of its range"
    else:
        worst = max(found, key=lambda miss: miss.error)
        size = f"the pitch within {number(worst.error / scale_of('rad').factor, 2)} deg"
    return f"{size} (RMS{where.format(worst.experiment)})"


def miss_text(miss: Miss) -> str:
    """An error in words: "the force to 0.4 N RMS (5.0 % of its range)"."""
    parts = [] if miss.share is None else [f"{number(100 * miss.share, 2)} % of its range"]
    parts += [] if miss.in_noise is None else [f"{number(miss.in_noise, 2)} times its stated noise"]
    return f"the {miss.word} to {miss.size} RMS" + (f" ({', '.join(parts)})" if parts else "")


def closeness(misses: Iterable[Miss]) -> tuple[str, Tone]:
    """Rating of the channel with the largest error, and the measure that it is rated by."""
    beyond = [miss for miss in misses if not (miss.in_noise is not None and miss.in_noise <= _NOISE)]
    if not beyond:
        return "that is within the stated noise", "good"
    shares = [(miss.share, miss.word) for miss in beyond if miss.share is not None]
    if not shares:
        return "that is poor (the measurement is constant, and the twin is not)", "warning"
    share, word = max(shares)
    close, poor = number(100 * CLOSE, 1), number(100 * POOR, 2)
    if share <= CLOSE:
        return f"that is close (at most {close} % of the range)", "good"
    if share <= POOR:
        return f"that is fair (the {word} between {close} and {poor} % of its range)", "note"
    return f"that is poor (the {word} above {poor} % of its range)", "warning"
