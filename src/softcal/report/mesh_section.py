"""Tables of the mesh study."""

from __future__ import annotations

from softcal.analysis.mesh_changes import pooled
from softcal.analysis.mesh_study import MeshStudy
from softcal.analysis.mesh_verdict import shift_text
from softcal.calibration.results.digits import estimate_text, shown, with_unit
from softcal.report.content import ReportContent
from softcal.report.format import number, scale_of
from softcal.report.tables import Cell, Column, ReportTable


def mesh_tables(content: ReportContent) -> tuple[ReportTable, ReportTable]:
    """Expected estimates on each discretisation, and changes of each channel; empty without a study."""
    study = content.mesh_study
    return (_parameters(study), _changes(study))


def _parameters(study: MeshStudy | None) -> ReportTable:
    rows: list[tuple[Cell, ...]] = []
    for label, estimate in study.parameters.items() if study is not None else ():
        for one in study.finer if study is not None else ():
            if one.failure:
                continue
            there = with_unit(estimate, shown(estimate, one.values[label]))
            unknowns = None if one.size is None else one.size.unknowns
            cells = [estimate_text(estimate), one.name, unknowns, there, shift_text(estimate, one.values[label])]
            rows.append((label, *cells, "yes" if label in one.at_bound else "no"))
    heads = ("Parameter", "Found", "Discretisation", "Unknowns", "Expected on it", "Shift", "At a bound there")
    note = (
        "h/2: every element halved, h/4: halved twice; limit: extrapolated from both to zero element size; s.e.: "
        "standard errors from noise. The shifts are first order, by the exact derivatives on the finer mesh."
    )
    return ReportTable(
        "mesh-study", "Estimates expected on finer meshes", tuple(Column(h) for h in heads), tuple(rows), note
    )


def _changes(study: MeshStudy | None) -> ReportTable:
    rows: list[tuple[Cell, ...]] = []
    for one in study.finer if study is not None else ():
        for name, change in pooled(one.changes).items():
            scale = scale_of(change.unit)
            rows.append(
                (
                    one.name,
                    name,
                    f"{number(change.rms / scale.factor)} {scale.unit}".rstrip(),
                    None if change.share is None else 100 * change.share,
                    change.rms / change.residual if change.residual else None,
                    change.rms / change.noise if change.noise else None,
                    change.order,
                )
            )
        if one.failure:
            rows.append((one.name, f"not simulated: {one.failure}", None, None, None, None, None))
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
