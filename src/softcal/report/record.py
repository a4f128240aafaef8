"""One sentence on the twin's error over the whole record, compared with the fitted samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.analysis.record import RecordFit
from softcal.report.closeness import in_words, of_carrier
from softcal.report.content import ReportContent
from softcal.report.format import channel_scale, number
from softcal.report.tables import share_of_peak


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
