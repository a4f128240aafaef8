"""Sections on the estimates: the error of the mesh, by a mesh study of one of the results; the estimates with their
uncertainty; the importance of each parameter for each output.
"""

from __future__ import annotations

from collections.abc import Iterator

from softcal.analysis.importance_verdict import importance_sentences, index_text
from softcal.analysis.mesh_changes import pooled
from softcal.analysis.mesh_verdict import mesh_verdicts, shift_text
from softcal.calibration.results.digits import estimate_text, shown, with_unit
from softcal.report.content import ReportContent
from softcal.report.format import number, scale_of
from softcal.report.section import Block, Gallery, Small, register_section
from softcal.report.sections.fits import fits_table_1
from softcal.report.tables import Cell, Column, Known, ReportTable, all_parameters_table


@register_section("What the mesh contributes", place=80)
def mesh(content: ReportContent) -> Iterator[Block]:
    """The changes on finer meshes, and the estimates expected there."""
    study = content.mesh_study
    if content.mesh_note:
        yield Small(content.mesh_note, alone=True)
    if study is not None:
        yield from mesh_verdicts(study)
    yield Gallery()
    rows: list[tuple[Cell, ...]] = []
    for label, estimate in study.parameters.items() if study is not None else ():
        for mesh in study.finer if study is not None else ():
            if mesh.failure:
                continue
            there = with_unit(estimate, shown(estimate, mesh.values[label]))
            unknowns = None if mesh.size is None else mesh.size.unknowns
            cells = [estimate_text(estimate), mesh.name, unknowns, there, shift_text(estimate, mesh.values[label])]
            rows.append((label, *cells, "yes" if label in mesh.at_bound else "no"))
    heads = ("Parameter", "Found", "Discretisation", "Unknowns", "Expected on it", "Shift", "At a bound there")
    note = (
        "h/2: every element halved, h/4: halved twice; limit: extrapolated from both to zero element size; s.e.: "
        "standard errors from noise. The shifts are first order, by the exact derivatives on the finer mesh."
    )
    yield ReportTable(
        "mesh-study", "Estimates expected on finer meshes", tuple(Column(h) for h in heads), tuple(rows), note
    )
    changes: list[tuple[Cell, ...]] = []
    for mesh in study.finer if study is not None else ():
        for name, change in pooled(mesh.changes).items():
            scale = scale_of(change.unit)
            size = f"{number(change.rms / scale.factor)} {scale.unit}".rstrip()
            share = None if change.share is None else 100 * change.share
            ratios = (change.rms / of if of else None for of in (change.residual, change.noise))
            changes.append((mesh.name, name, size, share, *ratios, change.order))
        if mesh.failure:
            changes.append((mesh.name, f"not simulated: {mesh.failure}", None, None, None, None, None))
    columns = [Column(head) for head in ("Discretisation", "Channel", "Change, RMS")]
    columns += [Column("of the channel", "%", 2), Column("over its RMSE"), Column("over its noise")]
    columns += [Column("Order", digits=2)]
    title = "Changes by finer meshes at the calibrated values"
    yield ReportTable("mesh-study-channels", title, tuple(columns), tuple(changes))
    for note in () if study is None else study.notes:
        yield Small(note)


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
