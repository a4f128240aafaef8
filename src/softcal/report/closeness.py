"""Rating of the fit, channel by channel: good, fair or poor; and the twin's error over the whole record.

An error is compared with the noise of the record if it is known, as stated, or as the scatter of its cycles or samples,
otherwise with the range of the measurement:
largest minus smallest value, so that an offset common to all samples does not hide an error.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from softcal.analysis.record import RecordFit
from softcal.calibration.results.result import ExperimentFit, SearchResult
from softcal.calibration.statistics.estimate import Remark, Tone
from softcal.experiments.dataset import Dataset
from softcal.report.content import ReportContent
from softcal.report.format import channel_scale, joined, number
from softcal.report.format import worst as worst_ones
from softcal.report.tables import share_of_peak, share_of_range
from softcal.sensing.channel import WORDS, ChannelName, channel_name, in_a_word

# RMS error over the measurement's range: close below the first share, poor above the second.
CLOSE, POOR = 0.03, 0.10
# An RMS error up to this many times the noise of the record counts as noise.
_NOISE = 1.2
# The measured values are a multiple of the twin's from this correlation on, and within a factor of so much near them.
_MULTIPLE, _NEAR = 0.8, 2.0
_STILL = 1e-6  # [SI]: changes of the twin by less are rounding


@dataclass(frozen=True)
class Miss:
    """Error of a channel in an experiment: RMSE [SI], and its ratio to the range and to the noise if known.

    word: for its kind; carrier: the actuator, plate or sensor, "" of a short name; multiple: by how much the measured
    values are a multiple of the twin's, but for an offset, 1 where none or near; is_still: of a test of one sample, or
    where neither the record nor the twin changes.
    """

    experiment: str
    word: str
    error: float
    unit: str
    share: float | None
    in_noise: float | None
    carrier: str = ""
    multiple: float = 1.0
    is_still: bool = False

    @property
    def is_poor(self) -> bool:
        """Whether the channel by itself is reproduced poorly."""
        return not self.is_still and closeness([self])[1] == "warning"

    @property
    def size(self) -> str:
        scale = channel_scale(self.unit)
        return f"{number(self.error / scale.factor)} {scale.unit}"

    @property
    def of(self) -> str:
        """Name of the quantity with the error: "force", or "force of front"."""
        return of_carrier(self.word, self.carrier)

    @property
    def place(self) -> str:
        """Place of the error: the experiment, with the carrier."""
        return f"{self.experiment}, {self.carrier}" if self.carrier else self.experiment


def misses_of(data: Mapping[str, Dataset], result: SearchResult) -> Iterable[Miss]:
    """Errors of all channels but positions in all experiments of a result; data: the samples by experiment."""
    for name, fit in result.experiments.items():
        for of, word in in_words(fit.rmse):
            channel = str(of)
            error, sigma = fit.rmse[channel], 0.0  # the noise, as root mean square over the samples, if it is known
            channels = data[name].channels if name in data else {}
            if (noise := channels.get(str(of.deviation))) is not None:
                sigma = float(np.sqrt(np.nanmean(noise.values**2)))
            elif channel in channels:
                sigma = channels[channel].sigma
            in_noise = error / sigma if sigma else None
            share, multiple = share_of_range(fit, channel), _multiple(fit, channel)
            simulated = fit.simulated.get(channel, np.zeros(1))
            still = len(simulated) == 1 or (share is None and np.nanmax(simulated) - np.nanmin(simulated) < _STILL)
            yield Miss(name, word, error, of.kind.unit, share, in_noise, of.carrier, multiple, bool(still))


def _multiple(fit: ExperimentFit, channel: str) -> float:
    if channel not in fit.measured or channel not in fit.simulated:
        return 1.0
    measured, simulated = fit.measured[channel], fit.simulated[channel]
    y, x = (one[np.isfinite(measured) & np.isfinite(simulated)] for one in (measured, simulated))
    if len(y) < 3 or np.ptp(y) == 0.0 or np.ptp(x) == 0.0:
        return 1.0
    y, x = y - y.mean(), x - x.mean()
    factor = float(x @ y) / float(x @ x)
    is_multiple = abs(float(x @ y)) > _MULTIPLE * float(np.linalg.norm(x) * np.linalg.norm(y))
    return factor if is_multiple and not 1.0 / _NEAR < factor < _NEAR else 1.0


def in_words(channels: Iterable[str]) -> list[tuple[ChannelName, str]]:
    """The channels but positions, each with the word for its kind; forces first."""
    found = [of for of in map(channel_name, channels) if not of.kind.is_position]
    order = [*WORDS, *(of.kind.name for of in found)]
    found.sort(key=lambda of: order.index(of.kind.name))
    return [(of, in_a_word(str(of))) for of in found]


def of_carrier(word: str, carrier: str) -> str:
    """The word for a channel, with what carries it unless its name is short."""
    return f"{word} of {carrier}" if carrier else word


def closeness_by_experiment(misses: Iterable[Miss]) -> Iterable[Remark]:
    """One sentence per experiment, of many for the worst: the errors of its channels, and their rating. Then one for
    all others.
    """
    own: dict[str, list[Miss]] = {}
    for miss in misses:
        own.setdefault(miss.experiment, []).append(miss)
    first, others = worst_ones(
        own.items(), lambda pair: max(m.share if m.share is not None else np.inf for m in pair[1])
    )
    for name, missed in first:
        word, tone = closeness(missed)
        asked = "".join(f" {text}" for miss in missed if miss.is_poor and (text := multiple_text(miss)))
        yield Remark(f"{name}: the twin reproduces {joined(map(miss_text, missed))}; {word}.{asked}", tone)
    if left := [miss for _, missed in others for miss in missed]:
        word, tone = closeness(left)
        texts = filter(None, (worst_of(left, word) for word in dict.fromkeys(miss.word for miss in left)))
        yield Remark(f"{len(others)} more: the twin reproduces {joined(texts)}; {word}.", tone)


def worst(misses: Iterable[Miss], word: str) -> Miss | None:
    """The largest error of one kind of channel over all experiments, by its share of the range; of angles by itself."""
    found = [miss for miss in misses if miss.word == word]
    if not any(miss.unit == "rad" for miss in found):
        found = [miss for miss in found if miss.share is not None]
        return max(found, key=lambda miss: miss.share or 0.0, default=None)
    return max(found, key=lambda miss: miss.error)


def worst_of(misses: Collection[Miss], word: str) -> str:
    """The same in words: "the force with an RMS error of 2 % of its range at most (pull_20mm)"; "" without one."""
    found = worst(misses, word)
    if found is None:
        return ""
    where = f" at most ({found.place})" if sum(miss.word == word for miss in misses) > 1 else ""
    scale = channel_scale(found.unit)
    size = f"{number(found.error / scale.factor, 2)} {scale.unit}"
    if found.unit != "rad":
        size = f"{number(100 * (found.share or 0.0), 2)} % of its range"
    return f"the {word} with an RMS error of {size}{where}"


def miss_text(miss: Miss) -> str:
    """An error in words: "the force to 0.4 N RMS (5.0 % of its range)"."""
    parts = [] if miss.share is None else [f"{number(100 * miss.share, 2)} % of its range"]
    parts += [] if miss.in_noise is None else [f"{number(miss.in_noise, 2)} times the noise of its record"]
    return f"the {miss.of} to {miss.size} RMS" + (f" ({', '.join(parts)})" if parts else "")


def multiple_text(miss: Miss) -> str:
    """Sentence on measured values that are a multiple of the twin's; "" where they are none."""
    if miss.multiple == 1.0:
        return ""
    by = number(miss.multiple, 2)
    return f"The measured {miss.of} changes {by} times as much as the twin's: is its sign, unit, axis or column wrong?"


def poor_text(misses: Iterable[Miss]) -> str:
    """The channel that is reproduced worst: "pitch of a off by 54 % of its range"; "" where none is poor."""
    poor = [miss for miss in misses if miss.is_poor]
    if not poor:
        return ""
    far = max(poor, key=lambda miss: np.inf if miss.share is None else miss.share)
    if far.share is None:
        return f"{far.of} of {far.experiment}, which is constant in the record"
    return f"{far.of} of {far.experiment} off by {number(100 * far.share, 2)} % of its range"


def closeness(misses: Iterable[Miss]) -> tuple[str, Tone]:
    """Rating of the channel with the largest error, and the measure that it is rated by."""
    beyond = [miss for miss in misses if not (miss.in_noise is not None and miss.in_noise <= _NOISE)]
    if not beyond:
        return "that is within the noise of the record", "good"
    if flat := [miss.of for miss in beyond if miss.share is None]:  # constant, or of one sample
        told = f"all measured values of the {joined(flat)} are the same, and the twin's differ from them"
        return f"that is poor ({told})", "warning"
    share, word = max((miss.share, miss.of) for miss in beyond if miss.share is not None)
    close, poor = number(100 * CLOSE, 1), number(100 * POOR, 2)
    if share <= CLOSE:
        return f"that is close (at most {close} % of the range)", "good"
    if share <= POOR:
        return f"that is fair (the {word} between {close} and {poor} % of its range)", "note"
    return f"that is poor (the {word} above {poor} % of its range)", "warning"


@dataclass(frozen=True)
class _Whole:
    """A channel over a record: display word and SI unit, RMSE [SI], RMSE over peak, RMSE of the fit [SI]."""

    experiment: str
    word: str
    unit: str
    error: float
    share: float
    fitted: float
    found: RecordFit


def record_sentence(content: ReportContent, label: str) -> str:
    """Error over the whole record, for the worst experiment of a calibration; "" if no record was compared."""
    result = content.results[label]
    wholes: list[_Whole] = []
    for name, found in content.records.get(label, {}).items():
        if name not in result.experiments or found.fit is None:
            continue
        fitted = result.experiments[name].rmse
        # The force if it was compared, else the pitch, the travel or another channel.
        for of, word in in_words(fitted):
            channel = str(of)
            if (share := share_of_peak(found.fit, channel)) is not None:
                said, error = of_carrier(word, of.carrier), found.fit.rmse[channel]
                wholes.append(_Whole(name, said, of.kind.unit, error, share, fitted[channel], found))
                break
    if not wholes:
        return ""
    worst = max(wholes, key=lambda whole: whole.share)
    scale, every = channel_scale(worst.unit), worst.found.every
    over = "Over the whole record" if every == 1 else f"Over one in {every} samples of the whole record"
    drives = [worst.found.record.values(drive) for drive in worst.found.drives]
    # A drive returns after its peak by more than half of its range.
    if any(of.max() - of[int(np.argmax(of)) :].min() > 0.5 * (of.max() - of.min()) > 0 for of in drives):
        over += ", loading and unloading"
    text = f"{over}, the {worst.word} differs by {number(worst.error / scale.factor)} {scale.unit} RMS"
    where = f"; {worst.experiment} is the worst of {len(wholes)}" if len(wholes) > 1 else ""
    text += f" ({number(100 * worst.share, 2)} % of its peak{where})"
    if worst.fitted > 0:
        text += f", {number(worst.error / worst.fitted, 2)} times that of the fitted samples"
    return f"{text}."
