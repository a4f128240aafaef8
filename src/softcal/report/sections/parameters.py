"""The estimates with their uncertainty, and what decides which output."""

from __future__ import annotations

from collections.abc import Iterator

from softcal.analysis.importance_verdict import importance_sentences, index_text
from softcal.report.content import ReportContent
from softcal.report.section import Block, Gallery, Small, register_section
from softcal.report.sections.fits import fits_table_1
from softcal.report.tables import Cell, Column, Known, ReportTable, all_parameters_table


@register_section("Estimates and uncertainty", place=70)
def parameters(content: ReportContent) -> Iterator[Block]:
    """The estimates, and the study of importance."""
    yield Gallery()
    if fits_table_1(content):
        yield all_parameters_table(content)
    yield importance_table(content)
    if content.importance_note:
        yield Small(content.importance_note)
    if content.importance is not None:
        yield from importance_sentences(content.importance)
        for note in content.importance.notes:
            yield Small(note)


def importance_table(content: ReportContent) -> ReportTable:
    """Sobol indices of every output by parameter, beside fANOVA's importances; empty without a study."""
    study = content.importance
    rows: list[tuple[Cell, ...]] = []
    for name, output in {} if study is None else study.outputs.items():
        for label, first in output.first.items():
            total = output.total[label]
            indices = (Known(first.value, index_text(first)), Known(total.value, index_text(total)))
            by_trials = study.fanova.get(label) if study is not None and name == "loss" else None
            rows.append((name, label, *indices, by_trials))
    heads = ("Output", "Parameter", "Alone", "With others", "fANOVA")
    note = (
        "Shares of the variance with all parameters uniform within the bounds of the search, on its scale; ± is half "
        "the 95 % interval. Alone: the first-order Sobol index; with others: the total one. fANOVA, by the trials of "
        "tpe and grid, explains the loss only."
    )
    columns = tuple(Column(head) for head in heads)
    return ReportTable("importance", "What decides each output (Sobol indices)", columns, tuple(rows), note)
