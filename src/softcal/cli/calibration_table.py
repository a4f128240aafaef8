"""Summary of a calibration printed at its end."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import typer

from softcal.cli.printing import print_table

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.calibration.result import CalibrationResult, Estimate, ExperimentFit, Note
    from softcal.experiments.dataset import Dataset
    from softcal.twin.response import Response


def print_results(
    results: Mapping[str, CalibrationResult],
    data: Mapping[str, Dataset] | None = None,
    records: Mapping[str, Dataset] | None = None,
    solved: Mapping[str, Response] | None = None,
) -> None:
    """Print the table of all calibrations, warnings, the agreement of separate fits, their status and notes, and the
    three sentences of the report's first screen.

    data: the samples by experiment, for their noise; records: their records with times, for the speeds;
    solved: label -> the twin's response where it is pulled furthest, for its warnings.
    """
    if not results:
        return
    from softcal.calibration.sensitivity import INCLUDED
    from softcal.report.agreement import agreement_sentences, residual_sentences, spread_sentences
    from softcal.report.closeness import closeness_by_experiment, misses_of
    from softcal.report.cycles import cycle_sentences
    from softcal.report.first_screen import FirstScreen, three_sentences
    from softcal.report.judged import first_label, judged

    for label, result in results.items():
        if result.converged is False:
            typer.echo(f"Warning: {label}: {result.status} No intervals are given.", err=True)
    print_table(_result_table(results))
    for label, result in results.items():
        for text, tone in closeness_by_experiment(misses_of(data or {}, result)):
            if tone == "warning":
                of = "" if text.startswith(f"{label}: ") else f"{label}, "
                typer.echo(f"Warning: {of}{text}", err=True)
    for text, _ in agreement_sentences(results):
        typer.echo(text)
    first = first_label(results)
    shown = judged(results, first)
    for label, result in shown.items():
        for text, differs in spread_sentences(result, records):
            typer.echo(f"{'Warning: ' * differs}{label}: {text}", err=differs)
        for text, misfits in residual_sentences(result):
            typer.echo(f"{'Warning: ' * misfits}{label}: {text}", err=misfits)
        for text in cycle_sentences(result):
            typer.echo(text if text.startswith(f"{label}: ") else f"{label}, {text}")
    notes: dict[Note, list[str]] = {}
    for label, result in results.items():
        for note in result.notes:
            if note.level == "warning" or label in shown:
                notes.setdefault(note, []).append(label)
    warnings = {note: labels for note, labels in notes.items() if note.level == "warning"}
    for note, labels in warnings.items():
        typer.echo(f"Warning: {', '.join(labels)}: {note}", err=True)
    for label, response in (solved or {}).items():
        for text in response.warnings:
            typer.echo(f"Warning: {label}: {text}", err=True)
    for text in _statuses(results):
        typer.echo(text)
    coarse = [label for label, result in results.items() if label not in shown and not _includes_mesh(result)]
    for note, labels in notes.items():
        if note in warnings:
            continue
        more = ""
        if note.text.startswith(INCLUDED) and coarse and any(_includes_mesh(results[label]) for label in labels):
            more = f" Those of {', '.join(coarse)} do not include the error of the mesh."
        typer.echo(f"Note ({', '.join(labels)}): {note}{more}")
    doubts = solved[first].doubts if solved and first in solved else ""
    lead = f"the solved shapes are in doubt ({doubts}); " if doubts else ""
    for text in three_sentences(FirstScreen(results, first, data or {}, records or {}, lead=lead)):
        typer.echo(text)


def _includes_mesh(result: CalibrationResult) -> bool:
    from softcal.report.statement import MESH

    return any(MESH in estimate.shares for estimate in result.parameters.values())


def _statuses(results: Mapping[str, CalibrationResult]) -> list[str]:
    """How the searches ended: in one line where all converged."""
    if all(result.converged for result in results.values()) and len(results) > 1:
        n = [len(result.trials) for result in results.values()]
        span = f"{min(n)} to {max(n)}" if min(n) < max(n) else str(n[0])
        return [f"All {len(results)} searches converged, each in {span} trials."]
    return [f"{label}: {result.status}" for label, result in results.items()]


def result_line(label: str, result: CalibrationResult) -> str:
    """The values of one calibration in a line, for while others are still to come."""
    values = [f"{name} {value_text(estimate)}" for name, estimate in result.parameters.items()]
    return f"{label}: {', '.join(values)}; loss {result.loss:.4g}"


def _result_table(results: Mapping[str, CalibrationResult]) -> Table:
    """Table with a column per calibration, and a line per parameter and error of an experiment."""
    from rich.table import Table

    from softcal.calibration.digits import interval_text

    table = Table("", *results)
    parameters = dict.fromkeys(name for result in results.values() for name in result.parameters)
    for name in parameters:
        found = [result.parameters.get(name) for result in results.values()]
        table.add_row(name, *("" if estimate is None else value_text(estimate) for estimate in found))
        if "[" not in name and any(estimate is not None and estimate.interval for estimate in found):
            table.add_row(
                "  95 % interval", *("" if estimate is None else interval_text(estimate) for estimate in found)
            )
    table.add_section()
    for name, channel in _error_lines(fit for r in results.values() for fit in r.experiments.items()):
        cells = (_error(result.experiments.get(name), channel) for result in results.values())
        table.add_row(_error_title(name, channel), *cells)
    predicted = _error_lines((name, held.fit) for r in results.values() for name, held in r.held_out.items())
    if predicted:
        table.add_section()
    for name, channel in predicted:
        held = (result.held_out.get(name) for result in results.values())
        cells = (_error(None if one is None else one.fit, channel) for one in held)
        table.add_row(f"held out: {_error_title(name, channel)}", *cells)
    table.add_section()
    table.add_row("loss", *(f"{result.loss:.4g}" for result in results.values()))
    table.add_row("trials", *(_count(result) for result in results.values()))
    return table


def _error_lines(fits: Iterable[tuple[str, ExperimentFit]]) -> list[tuple[str, str]]:
    """(experiment, channel) of every line of errors; channel "" for the distance of all markers."""
    lines: dict[tuple[str, str], None] = {}
    for name, fit in fits:
        if fit.distances:
            lines[name, ""] = None
        lines.update({(name, c): None for c in fit.alone})
    return list(lines)


def _error_title(experiment: str, channel: str) -> str:
    return f"RMSE of {channel}, {experiment}" if channel else f"distance, mean and largest, {experiment}"


def _error(fit: ExperimentFit | None, channel: str) -> str:
    from softcal.units import format_quantity

    if fit is None or (channel and channel not in fit.rmse):
        return ""
    if channel:
        return format_quantity(fit.rmse[channel], fit.units[channel], digits=3)
    distance = fit.distance
    if distance is None:
        return ""
    text = f"{1e3 * distance.mean:.3g} and {1e3 * distance.max:.3g} mm"
    if fit.length is not None:
        text += f" ({100 * distance.mean / fit.length:.2g} and {100 * distance.max / fit.length:.2g} %)"
    return text


def _count(result: CalibrationResult) -> str:
    failed = f", {result.n_failed_trials} failed" if result.n_failed_trials else ""
    return f"{len(result.trials)}{failed}"


def value_text(estimate: Estimate) -> str:
    """A value with its standard error and unit, and whether it is at a bound."""
    from softcal.calibration.digits import estimate_text

    return estimate_text(estimate) + (" (at a bound)" if estimate.at_bound else "")
