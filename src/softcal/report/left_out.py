"""Each experiment as the others predict it: a sentence, and a table."""

from __future__ import annotations

import numpy as np

from softcal.calibration.results.result import SearchResult
from softcal.report.content import ReportContent
from softcal.report.format import number, result_label, scale_of
from softcal.report.tables import Column, ReportTable
from softcal.sensing.channel import channel_unit


def left_out_sentence(result: SearchResult) -> str:
    """How well the experiments predict each other; "" where there are fewer than three."""
    shares: list[float] = []
    for name, prediction in result.left_out.items():
        measured = result.experiments[name].measured
        counts = [int(np.isfinite(measured[channel]).sum()) for channel in prediction.within]
        shares.append(float(np.average(list(prediction.within.values()), weights=counts)))
    if not shares:
        return ""
    low, high = (number(100 * share, 3) for share in (min(shares), max(shares)))
    range_text = f"{low} %" if low == high else f"{low} to {high} %"
    return (
        f"Predicted by the others, each of the {len(result.left_out)} tests has {range_text} of its measured values "
        "within the 95 % band of a further one."
    )


def left_out_table(content: ReportContent) -> ReportTable:
    """The errors of the predictions beside those of the fit; empty where there are fewer than three experiments."""
    rows: list[tuple[str | float | int | None, ...]] = []
    for label, result in content.judged.items():
        for name, prediction in result.left_out.items():
            for channel, error in prediction.rmse.items():
                scale = scale_of(channel_unit(channel) or "1")
                fitted = result.experiments[name].rmse.get(channel)
                shown = [
                    None if v is None else f"{number(v / scale.factor)} {scale.unit}".rstrip()
                    for v in (fitted, error, prediction.half_width[channel])
                ]
                rows.append((result_label(label), name, channel, *shown, 100 * prediction.within[channel]))
    columns = (
        Column("Calibration"),
        Column("Experiment"),
        Column("Channel"),
        Column("RMSE, fitted"),
        Column("RMSE, predicted"),
        Column("95 % band"),
        Column("Samples within it", "%", 3),
    )
    note = (
        "Predicted: with the shared parameters that the others give, by the exact derivatives at the joint minimum; a "
        "test's own parameters are fitted to it. The band is that of a further test: the errors of the "
        "parameters, the spread between the tests, and the noise (root mean square of its half-width)."
    )
    return ReportTable("left-out", "Experiments as the others predict them", columns, tuple(rows), note)
