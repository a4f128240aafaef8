"""Every table of a report."""

from __future__ import annotations

from softcal.report.comparison import improvement_table
from softcal.report.content import ReportContent
from softcal.report.cycles import cycles_table, loops_table
from softcal.report.importance_section import importance_table
from softcal.report.left_out import left_out_table
from softcal.report.mesh_section import mesh_tables
from softcal.report.positions import distances_table
from softcal.report.tables import (
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
