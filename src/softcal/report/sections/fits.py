"""The results, what was compared, and how the run went."""

from __future__ import annotations

from collections.abc import Iterator

from softcal.report.agreement import left_out_table
from softcal.report.comparison import improvement_table
from softcal.report.content import ReportContent
from softcal.report.cycles import cycles_tables, loops_tables
from softcal.report.format import material_kinds
from softcal.report.headline import headline
from softcal.report.positions import distances_table
from softcal.report.section import Block, FoldedSteps, FoldedTable, Gallery, Heading, Small, register_section
from softcal.report.tables import (
    all_parameters_table,
    errors_table,
    failures_table,
    parameters_table,
    provenance_rows,
    run_table,
    stamps_table,
)
from softcal.twin.parameter_name import parameter_name


@register_section("Results", place=10)
def results(content: ReportContent) -> Iterator[Block]:
    """Table I and Table II of the two papers, and what was left out."""
    yield parameters_table(content) if fits_table_1(content) else all_parameters_table(content)
    yield errors_table(content)
    yield distances_table(content)
    yield left_out_table(content)
    yield Gallery()


def fits_table_1(content: ReportContent) -> bool:
    """Whether the results fit Table I of paper A, which shows each constant of a material once."""
    kinds = [[parameter_name(name).kind for name in result.parameters] for result in content.results.values()]
    constants = material_kinds(content.results.values())
    return all(of_result.count(kind) <= 1 for of_result in kinds for kind in constants)


@register_section("Nominal and calibrated", place=20)
def compared(content: ReportContent) -> Iterator[Block]:
    """Errors at the nominal values and after the calibration or sweep."""
    yield Heading(headline(content).comparison)
    yield improvement_table(content)
    yield Gallery(wide=True)


@register_section("The twin", place=30)
def twin(content: ReportContent) -> Iterator[Block]:
    """The robot."""
    yield Gallery(wide=True)
    if content.frame is not None:
        yield content.frame


@register_section("Measured and simulated", place=40)
def fit(content: ReportContent) -> Iterator[Block]:
    """The samples that were compared."""
    yield Gallery()
    yield from loops_tables(content)


@register_section("The whole record", place=50)
def record(content: ReportContent) -> Iterator[Block]:
    """The twin beside all samples of a record."""
    yield Small(
        "The fit compares chosen samples. Here the calibrated twin is driven through every sample of the corrected "
        "record, loading and unloading. Its errors are the rows “whole record” of "
        f"{errors_table(content).title}."
    )
    for records in content.records.values():
        for name, fitted in records.items():
            if fitted.failure:
                yield Small(f"{name}: comparison with the whole record failed: {fitted.failure}", alone=True)
    yield Gallery(wide=True)
    yield from cycles_tables(content)


@register_section("Measurements", place=60)
def bench(content: ReportContent) -> Iterator[Block]:
    """The records as measured, and how they were prepared."""
    yield Gallery()
    for name, experiment in content.experiments.items():
        if steps := provenance_rows(experiment.prepared):
            yield FoldedSteps(f"How {name} was prepared, {len(steps)} steps", steps)
    yield Small("Settings are in SI: m, N, rad, s.")


@register_section("The search", place=90)
def search(content: ReportContent) -> Iterator[Block]:
    """The trials."""
    yield Gallery()
    yield failures_table(content)


@register_section("The run", place=110)
def run(content: ReportContent) -> Iterator[Block]:
    """Duration of each search, and the versions and files of the run."""
    yield run_table(content)
    yield Gallery()
    yield FoldedTable(stamps_table(content))
    yield Small("Beside this page are all tables as CSV in tables/ and all figures as PNG and SVG in figures/.")
