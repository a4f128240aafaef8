"""Every table of a report, and the tables of its studies."""

from __future__ import annotations

from softcal.analysis.importance_verdict import index_text
from softcal.analysis.mesh_changes import pooled
from softcal.analysis.mesh_study import MeshStudy
from softcal.analysis.mesh_verdict import shift_text
from softcal.calibration.results.digits import estimate_text, shown, with_unit
from softcal.report.comparison import improvement_table
from softcal.report.content import ReportContent
from softcal.report.cycles import cycles_table, loops_table
from softcal.report.format import number, scale_of
from softcal.report.left_out import left_out_table
from softcal.report.positions import distances_table
from softcal.report.tables import (
    Cell,
    Column,
    Known,
    ReportTable,
    all_parameters_table,
    errors_table,
    failures_table,
    parameters_table,
    provenance_table,
    run_table,
    stamps_table,
)


def all_tables(content: ReportContent) -> dict[str, ReportTable]:
    """Every table of the report by key."""
    tables = (
        parameters_table(content),
        all_parameters_table(content),
        errors_table(content),
        distances_table(content),
        left_out_table(content),
        loops_table(content),
        cycles_table(content),
        improvement_table(content),
        importance_table(content),
        *mesh_tables(content),
        run_table(content),
        failures_table(content),
        provenance_table(content),
        stamps_table(content),
    )
    return {table.key: table for table in tables}


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


def mesh_tables(content: ReportContent) -> tuple[ReportTable, ReportTable]:
    """Expected estimates on each discretisation, and changes of each channel; empty without a study."""
    study = content.mesh_study
    return (_mesh_parameters(study), _mesh_changes(study))


def _mesh_parameters(study: MeshStudy | None) -> ReportTable:
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
    return ReportTable(
        "mesh-study", "Estimates expected on finer meshes", tuple(Column(h) for h in heads), tuple(rows), note
    )


def _mesh_changes(study: MeshStudy | None) -> ReportTable:
    rows: list[tuple[Cell, ...]] = []
    for mesh in study.finer if study is not None else ():
        for name, change in pooled(mesh.changes).items():
            scale = scale_of(change.unit)
            rows.append(
                (
                    mesh.name,
                    name,
                    f"{number(change.rms / scale.factor)} {scale.unit}".rstrip(),
                    None if change.share is None else 100 * change.share,
                    change.rms / change.residual if change.residual else None,
                    change.rms / change.noise if change.noise else None,
                    change.order,
                )
            )
        if mesh.failure:
            rows.append((mesh.name, f"not simulated: {mesh.failure}", None, None, None, None, None))
    columns = (
        Column("Discretisation"),
        Column("Channel"),
        Column("Change, RMS"),
        Column("of the channel", "%", 2),
        Column("over its RMSE"),
        Column("over its noise"),
        Column("Order", digits=2),
    )
    return ReportTable("mesh-study-channels", "Changes by finer meshes at the calibrated values", columns, tuple(rows))
