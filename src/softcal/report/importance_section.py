"""Table of the importance study."""

from __future__ import annotations

from softcal.analysis.importance_verdict import index_text
from softcal.report.content import ReportContent
from softcal.report.tables import Cell, Column, Known, ReportTable


def importance_table(content: ReportContent) -> ReportTable:
    """Sobol indices of every output by parameter, beside fANOVA's importances; empty without a study."""
    study = content.importance
    rows: list[tuple[Cell, ...]] = []
    for name, output in {} if study is None else study.outputs.items():
        for label, first in output.first.items():
            total = output.total[label]
            shown = (Known(first.value, index_text(first)), Known(total.value, index_text(total)))
            by_trials = study.fanova.get(label) if study is not None and name == "loss" else None
            rows.append((name, label, *shown, by_trials))
    heads = ("Output", "Parameter", "Alone", "With others", "fANOVA")
    note = (
        "Shares of the variance with all parameters uniform within the bounds of the search, on its scale; ± is half "
        "the 95 % interval. Alone: the first-order Sobol index; with others: the total one. fANOVA, by the trials of "
        "tpe and grid, explains the loss only."
    )
    columns = tuple(Column(head) for head in heads)
    return ReportTable("importance", "What decides each output (Sobol indices)", columns, tuple(rows), note)
