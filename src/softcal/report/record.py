"""One sentence on the twin's error over the whole record, compared with the fitted samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.analysis.record import RecordFit
from softcal.calibration.results.result import ExperimentFit
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
    wholes = [
        whole
        for name, found in content.records.get(label, {}).items()
        if name in result.experiments and (whole := _whole(name, found, result.experiments[name])) is not None
    ]
    if not wholes:
        return ""
    worst = max(wholes, key=lambda whole: whole.share)
    scale, every = channel_scale(worst.unit), worst.found.every
    over = "Over the whole record" if every == 1 else f"Over one in {every} samples of the whole record"
    if _returns(worst.found):
        over += ", loading and unloading"
    text = f"{over}, the {worst.word} differs by {number(worst.error / scale.factor)} {scale.unit} RMS"
    where = f"; {worst.experiment} is the worst of {len(wholes)}" if len(wholes) > 1 else ""
    text += f" ({number(100 * worst.share, 2)} % of its peak{where})"
    if worst.fitted > 0:
        text += f", {number(worst.error / worst.fitted, 2)} times that of the fitted samples"
    return f"{text}."


def _whole(name: str, record: RecordFit, fitted: ExperimentFit) -> _Whole | None:
    """The force if it was compared, else the pitch, the travel or another channel; None if none was."""
    if record.fit is None:
        return None
    for of, word in in_words(fitted.rmse):
        channel = str(of)
        share = share_of_peak(record.fit, channel)
        if share is not None:
            said = of_carrier(word, of.carrier)
            return _Whole(name, said, of.kind.unit, record.fit.rmse[channel], share, fitted.rmse[channel], record)
    return None


def _returns(comparison: RecordFit) -> bool:
    """Whether a drive returns after its peak by more than half of its range."""
    for drive in comparison.drives:
        values = comparison.record.values(drive)
        after = values[int(np.argmax(values)) :]
        if values.max() - after.min() > 0.5 * (values.max() - values.min()) > 0:
            return True
    return False
