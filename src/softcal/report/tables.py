"""The numbers of a report as plain rows: Table I, Table II, run facts, failures, provenance. Nothing here draws."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.calibration.results.digits import difference, ends_text, estimate_text, shown, value_and_error
from softcal.calibration.results.result import ExperimentFit, SearchResult
from softcal.csv_text import csv_text
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.experiments.dataset import Dataset
from softcal.materials.catalogue import LAWS, constants_of
from softcal.report.content import ReportContent
from softcal.report.format import (
    Scale,
    channel_scale,
    duration,
    estimate_scale,
    find_parameter,
    material_kinds,
    method_label,
    number,
    ordered_parameters,
    parameter_label,
    result_label,
    scale_of,
)
from softcal.report.headline import headline
from softcal.sensing.channel import channel_name
from softcal.twin.parameter_name import parameter_name
from softcal.units import AS_WRITTEN, plain

Cell = str | float | int | None


# What an importance is, by `importance_kind` of the result.
_IMPORTANCES = {
    "fanova": "Importance of tpe and grid: the share of the loss's variation over the search that a parameter "
    "explains (fANOVA).",
    "sensitivity": "Importance of least squares: a parameter's share of the squared sensitivities of all channels at "
    "the estimate, scaled by the range of the parameter and by the noise or RMSE of the channel; a local measure, not "
    "fANOVA.",
}


class Known(float):
    """A number with the text that shows it to the digits of its interval."""

    def __new__(cls, value: float, text: str) -> Known:
        known = super().__new__(cls, value)
        known.text = text
        return known

    text: str


@displayed
@dataclass(frozen=True)
class Column(Checked):
    """A column: its heading, its unit ("" where it has none), and the significant digits of its numbers."""

    label: str
    unit: str = ""
    digits: int = 3

    @property
    def header(self) -> str:
        """Heading with unit, as in the CSV files: "E [MPa]"."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


@displayed
@dataclass(frozen=True)
class ReportTable:
    """A table in display units; None is an empty cell. key: its file's name.

    Raises
    ------
    InputError
        Where a row has not one cell for each column.
    """

    key: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""

    def __post_init__(self) -> None:
        for place, row in enumerate(self.rows, start=1):
            if len(row) != len(self.columns):
                got = f"{len(row)} cells in row {place}"
                raise InputError(Fault("a row has a cell for each column", self.key, got, str(len(self.columns))))

    def as_csv(self) -> str:
        """The table as CSV, numbers in full precision, unit in every heading."""
        return csv_text([column.header for column in self.columns], self.rows)

    def shown(self) -> list[list[str]]:
        """The cells as text: numbers to the column's digits, an en dash where there is nothing."""
        return [[_text(cell, column) for cell, column in zip(row, self.columns, strict=True)] for row in self.rows]


def _text(cell: Cell, column: Column) -> str:
    if cell is None or cell == "":
        return "–"
    if isinstance(cell, Known):
        return cell.text
    return cell if isinstance(cell, str) else str(cell) if isinstance(cell, int) else number(cell, column.digits)


def parameters_table(content: ReportContent) -> ReportTable:
    """Paper A's Table I: the law's constants, such as E and nu, with standard errors and importances, and the other
    fitted parameters, by calibration.
    """
    kinds = material_kinds(content.results.values())
    scales: list[Scale] = []
    for kind in kinds:  # each constant has one scale in all calibrations: that of the first that has it
        pairs = ((result.parameters, find_parameter(result.parameters, kind)) for result in content.results.values())
        scale = next((estimate_scale(estimates[name]) for estimates, name in pairs if name), None)
        scales.append(scale or scale_of(constants_of(LAWS)[kind].quantity.unit))
    rows: list[tuple[Cell, ...]] = []
    for label, result in content.results.items():
        row: list[Cell] = [result_label(label)]
        importances: list[Cell] = []
        for kind, scale in zip(kinds, scales, strict=True):
            name = find_parameter(result.parameters, kind)
            estimate = result.parameters[name] if name else None
            if estimate is None:
                row += [None, None]
            else:
                value, error, unit = estimate.value, estimate.standard_error, scale.unit or "1"
                row.append(Known(value / scale.factor, shown(estimate, value, unit)))
                row.append(None if error is None else Known(error / scale.factor, difference(estimate, error, unit)))
            importances.append(result.importance.get(name) if name else None)
        bound = [parameter_label(name) for name, estimate in result.parameters.items() if estimate.at_bound]
        others = [name for name in result.parameters if parameter_name(name).kind not in kinds]
        fitted = (f"{parameter_label(name, others)}: {estimate_text(result.parameters[name])}" for name in others)
        rows.append((*row, *importances, result.loss, ", ".join(bound) or "none", "; ".join(fitted) or None))
    columns = (
        Column(headline(content).kind.capitalize()),
        *(
            Column(f"{sign}{parameter_label(kind)}", scale.unit)
            for kind, scale in zip(kinds, scales, strict=True)
            for sign in ("", "± ")
        ),
        *(Column(f"Importance of {parameter_label(kind)}") for kind in kinds),
        Column("Loss"),
        Column("At a bound"),
        Column("Other fitted values"),
    )
    note = (
        "± is one standard error; an empty cell means that there is none or that the parameter was fixed."
        f"{importance_note(content)}"
    )
    return ReportTable("table-1-parameters", "Table I. Parameters and their importance", columns, tuple(rows), note)


def importance_note(content: ReportContent) -> str:
    """Definition of the importances by their kind; "" if the kind is unknown."""
    kinds = dict.fromkeys(one.extra.get("importance_kind") for one in content.results.values() if one.importance)
    return "".join(f" {_IMPORTANCES[kind]}" for kind in kinds if kind in _IMPORTANCES)


def all_parameters_table(content: ReportContent) -> ReportTable:
    """Every parameter of every result, with its bounds."""
    rows: list[tuple[Cell, ...]] = []
    for label, result in content.results.items():
        for name in ordered_parameters({label: result}):
            estimate = result.parameters[name]
            scale = estimate_scale(estimate)
            low, high = (plain(bound / scale.factor, AS_WRITTEN) for bound in (estimate.lower, estimate.upper))
            at_bound = "yes" if estimate.at_bound else "no"
            rows.append(
                (
                    result_label(label),
                    name,
                    value_and_error(estimate),
                    ends_text(estimate) or None,
                    scale.unit,
                    low,
                    high,
                    at_bound,
                    result.importance.get(name),
                )
            )
    labels = (
        headline(content).kind.capitalize(),
        "Parameter",
        "Value",
        "95 % interval",
        "Unit",
        "Lower bound",
        "Upper bound",
        "At a bound",
        "Importance",
    )
    columns = tuple(Column(label) for label in labels)
    note = f"± is one standard error.{importance_note(content)}"
    return ReportTable("parameters", "Every parameter and its bounds", columns, tuple(rows), note)


def errors_table(content: ReportContent) -> ReportTable:
    """Table II of paper A: RMSE and detrended RMSE of force and pitch; of what else was compared, but positions."""
    every: list[tuple[str, str, str, ExperimentFit]] = []
    for label, result in content.results.items():
        records = content.records.get(label, {})
        for name, fit in result.experiments.items():
            every.append((label, name, "fitted samples", fit))
            if name in records and (whole := records[name].fit) is not None:
                every.append((label, name, "whole record", whole))
        every += [(label, name, "held out", held.fit) for name, held in result.held_out.items()]
    named = {c: channel_name(c) for *_, fit in every for c in fit.alone if not channel_name(c).kind.is_position}
    fits = [entry for entry in every if any("." not in c or c in named for c in entry[-1].rmse)]
    channels: list[tuple[str, str, Scale]] = [
        ("tension", "Force", Scale("N", 1.0)),
        ("pitch", "Pitch", Scale("rad", 1.0)),
        ("pitch", "Pitch", scale_of("rad")),
        ("shortening", "Shortening", scale_of("m")),
        *((str(one), one.label, channel_scale(one.kind.unit)) for one in named.values() if one.carrier),
    ]
    shown = [
        (channel, label, scale)
        for channel, label, scale in channels
        if any(channel in entry[-1].rmse for entry in fits)
    ]
    columns = [Column(headline(content).kind.capitalize()), Column("Experiment"), Column("Compared over")]
    for channel, label, scale in shown:
        columns += [Column(f"{label} RMSE", scale.unit), Column(f"{label} RMSE, detrended", scale.unit)]
        if channel == "tension":
            columns.append(Column("of peak force", "%", 2))
    rows: list[tuple[Cell, ...]] = []
    for label, name, samples, fit in fits:
        row: list[Cell] = [result_label(label), name, samples]
        for channel, _, scale in shown:
            errors = (fit.rmse.get(channel), fit.rmse_detrended.get(channel))
            row += [None if error is None else error / scale.factor for error in errors]
            if channel == "tension":
                share = share_of_peak(fit)
                row.append(None if share is None else 100 * share)
        rows.append(tuple(row))
    note = (
        "RMSE is the root mean square of simulated minus measured; detrended removes the straight line that fits that "
        "error best. An empty cell means that the channel was not measured or drove the twin."
    )
    if any(samples == "whole record" for _, _, samples, _ in fits):
        note += (
            " The whole record is every sample after the corrections, loading and unloading; the fit used the fitted "
            "samples only."
        )
    return ReportTable("table-2-errors", "Table II. Errors of the twin", tuple(columns), tuple(rows), note)


def share_of_peak(fit: ExperimentFit, channel: str = "tension") -> float | None:
    """RMSE over the largest measured magnitude of a channel [-]; None if it was not compared."""
    error, measured = fit.rmse.get(channel), fit.measured.get(channel)
    if error is None or measured is None:
        return None
    peak = float(np.nanmax(np.abs(measured)))
    return error / peak if peak > 0 else None


def share_of_range(fit: ExperimentFit, channel: str = "tension") -> float | None:
    """RMSE over the measured range of a channel [-]; None if it was not compared or is constant."""
    error, measured = fit.rmse.get(channel), fit.measured.get(channel)
    if error is None or measured is None:
        return None
    span = float(np.nanmax(measured) - np.nanmin(measured))
    return error / span if span > 0 else None


def run_table(content: ReportContent) -> ReportTable:
    """Cost and status of each result."""
    kind = headline(content).kind
    columns = tuple(
        Column(label)
        for label in (
            kind.capitalize(), "Method", "Loss", "Seed", "Trials", "Failed", "Solves", "Factorisations",
            "Wall time", "Status",
        )
    )  # fmt: skip
    rows = tuple(
        (
            result_label(label), method_label(result.method), result.loss_name, result.seed, len(result.trials),
            result.n_failed_trials, result.n_solves, result.n_factorisations, duration(result.wall_s), result.status,
        )
        for label, result in content.results.items()
    )  # fmt: skip
    note = "A solve is one forward trajectory of the twin; a factorisation is one linear system factored within it."
    return ReportTable("run-facts", f"How each {kind} ran", columns, rows, note)


def stamps_table(content: ReportContent) -> ReportTable:
    """Versions and hashes that identify the run; those of the results are added to the content's."""
    versions: dict[str, str] = {}
    hashes: dict[str, str] = {}
    for result in content.results.values():
        versions.update(result.versions)
        hashes.update(result.hashes)
    versions.update(content.versions)
    hashes.update(content.hashes)
    rows = [("version", name, value) for name, value in versions.items()]
    rows += [("hash", name, value) for name, value in hashes.items()]
    columns = (Column("Kind"), Column("Of"), Column("Value"))
    return ReportTable("versions-and-hashes", "Versions and hashes", columns, tuple(rows))


def failures_table(content: ReportContent) -> ReportTable:
    """Failed trials grouped by reason; numbers in the reasons are ignored in the grouping."""
    rows: list[tuple[Cell, ...]] = []
    for label, result in content.results.items():
        rows += [
            (result_label(label), count, reason, number_of_first)
            for reason, count, number_of_first in grouped_failures(result)
        ]
    kind = headline(content).kind.capitalize()
    columns = (Column(kind), Column("Trials"), Column("Reason (first of its kind)"), Column("First trial"))
    return ReportTable("failed-trials", "Trials that could not be simulated", columns, tuple(rows))


def grouped_failures(result: SearchResult) -> list[tuple[str, int, int]]:
    """(reason of the first trial, count, number of the first trial), most frequent first."""
    failed = [trial for trial in result.trials if trial.state == "FAILED"]
    kinds = [re.sub(r"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?", "#", trial.reason) for trial in failed]
    first = {kind: trial for kind, trial in reversed(list(zip(kinds, failed, strict=True)))}
    return [(first[kind].reason, count, first[kind].number) for kind, count in Counter(kinds).most_common()]


def provenance_rows(dataset: Dataset) -> list[tuple[str, str, str]]:
    """(step, its settings in SI, its outcome), in order."""
    rows: list[tuple[str, str, str]] = []
    for step in dataset.provenance:
        settings = ", ".join(f"{key.replace('_', ' ')} = {_setting(value)}" for key, value in step.settings.items())
        rows.append((step.name, settings, step.outcome))
    return rows


def provenance_table(content: ReportContent) -> ReportTable:
    """All preparation steps of each dataset, in order."""
    rows: list[tuple[Cell, ...]] = [
        (name, index, *row)
        for name, experiment in content.experiments.items()
        for index, row in enumerate(provenance_rows(experiment.prepared), start=1)
    ]
    columns = tuple(Column(label) for label in ("Experiment", "Step", "What", "Settings (SI)", "Outcome"))
    return ReportTable("provenance", "From the bench file to the compared data", columns, tuple(rows))


def _setting(value: object) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_setting(item)}" for key, item in value.items()) + "}"
    if isinstance(value, (list, tuple, np.ndarray)):
        items = list(value)
        text = ", ".join(_setting(item) for item in items[:6])
        return f"[{text}, … {len(items)} in all]" if len(items) > 6 else f"[{text}]"
    return str(value)
