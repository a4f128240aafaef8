"""Summary of a calibration printed at its end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
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
    from softcal.project.names import JOINT
    from softcal.report.agreement import agreement_sentences, residual_sentences, spread_sentences
    from softcal.report.closeness import closeness_by_experiment, misses_of
    from softcal.report.cycles import cycle_sentences
    from softcal.report.first_screen import FirstScreen, three_sentences
    from softcal.report.format import few, worst
    from softcal.report.judged import first_label, judged

    _warn(f"{label}: {r.status} No intervals are given." for label, r in results.items() if r.converged is False)
    first, others = worst(results.items(), lambda pair: math.inf if pair[0] == JOINT else pair[1].loss)
    print_table(_result_table(dict(first)))
    if others:
        typer.echo(f"{len(others)} more calibrations, of smaller losses, are in the report.")
    _warn(
        text if text.startswith(f"{label}: ") else f"{label}, {text}"
        for label, result in results.items()
        for text, tone in closeness_by_experiment(misses_of(data or {}, result))
        if tone == "warning"
    )
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
    _warn(f"{', '.join(few(labels))}: {note}" for note, labels in warnings.items())
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
            more = f" Those of {', '.join(few(coarse))} do not include the error of the mesh."
        typer.echo(f"Note ({', '.join(few(labels))}): {note}{more}")
    doubts = solved[first].doubts if solved and first in solved else ""
    lead = f"the solved shapes are in doubt ({doubts}); " if doubts else ""
    for text in three_sentences(FirstScreen(results, first, data or {}, records or {}, lead=lead)):
        typer.echo(text)


def _warn(texts: Iterable[str]) -> None:
    """Warnings of one kind, of many the first."""
    from softcal.report.format import MANY

    every = list(texts)
    for text in every[:MANY]:
        typer.echo(f"Warning: {text}", err=True)
    if len(every) > MANY:
        typer.echo(f"Warning: {len(every) - MANY} more such warnings are in the report.", err=True)


def _includes_mesh(result: CalibrationResult) -> bool:
    from softcal.report.statement import MESH

    return any(MESH in estimate.shares for estimate in result.parameters.values())


def _statuses(results: Mapping[str, CalibrationResult]) -> list[str]:
    """How the searches ended: in one line where all converged."""
    if all(result.converged for result in results.values()) and len(results) > 1:
        n = [len(result.trials) for result in results.values()]
        span = f"{min(n)} to {max(n)}" if min(n) < max(n) else str(n[0])
        return [f"All {len(results)} searches converged, each in {span} trials."]
    from softcal.report.format import few

    return few(f"{label}: {result.status}" for label, result in results.items())


def result_line(label: str, result: CalibrationResult) -> str:
    """The values of one calibration in a line, for while others are still to come."""
    from softcal.report.format import few

    values = few(f"{name} {value_text(estimate)}" for name, estimate in result.parameters.items())
    return f"{label}: {', '.join(values)}; loss {result.loss:.4g}"


def _result_table(results: Mapping[str, CalibrationResult]) -> Table:
    """Table with a column per calibration, and a line per parameter and error of an experiment, of many for the
    largest, and one for all others.
    """
    from rich.table import Table

    from softcal.report.format import worst

    table = Table("", *results)
    found = [result.parameters for result in results.values()]
    own: dict[str, list[str]] = {}
    for name in dict.fromkeys(name for parameters in found for name in parameters):
        own.setdefault(name.partition("[")[0], []).append(name)
    for base, names in own.items():
        vague, others = worst(names, lambda name: max(_vagueness(one.get(name)) for one in found))
        for name in vague:
            _add_parameter(table, name, [one.get(name) for one in found])
        if others:
            cells = (_range_text([one[name] for name in others if name in one]) for one in found)
            table.add_row(f"{base}, {len(others)} more", *cells)
    _add_errors(table, "", [result.experiments for result in results.values()])
    held_out = [{name: held.fit for name, held in result.held_out.items()} for result in results.values()]
    _add_errors(table, "held out: ", held_out)
    table.add_section()
    table.add_row("loss", *(f"{result.loss:.4g}" for result in results.values()))
    table.add_row("trials", *(_count(result) for result in results.values()))
    return table


def _add_parameter(table: Table, name: str, found: Sequence[Estimate | None]) -> None:
    from softcal.calibration.digits import interval_text

    table.add_row(name, *("" if estimate is None else value_text(estimate) for estimate in found))
    if "[" not in name and any(estimate is not None and estimate.interval for estimate in found):
        table.add_row("  95 % interval", *("" if estimate is None else interval_text(estimate) for estimate in found))


def _vagueness(estimate: Estimate | None) -> float:
    """A bound, or a large standard error, is what brings a parameter of a test to the front."""
    if estimate is None:
        return 0.0
    return math.inf if estimate.at_bound else estimate.standard_error or 0.0


def _range_text(estimates: Sequence[Estimate]) -> str:
    """The least and the largest of values."""
    from softcal.units import format_quantity

    ordered = sorted(one.value for one in estimates)
    return " to ".join(format_quantity(end, estimates[0].unit, digits=3) for end in (ordered[0], ordered[-1]))


def _add_errors(table: Table, lead: str, fits: Sequence[Mapping[str, ExperimentFit]]) -> None:
    """A section of errors: a line for each experiment and channel, of many for the largest, and one for all others."""
    from softcal.report.format import worst

    def size(line: tuple[str, str]) -> float:
        return max(_size(one.get(line[0]), line[1]) for one in fits)

    lines = _error_lines(pair for one in fits for pair in one.items())
    ranked = {c: worst((line for line in lines if line[1] == c), size) for c in dict.fromkeys(c for _, c in lines)}
    shown = {line for first, _ in ranked.values() for line in first}
    table.add_section()
    for name, channel in (line for line in lines if line in shown):
        table.add_row(lead + _error_title(name, channel), *(_error(one.get(name), channel) for one in fits))
    for channel, (_, others) in ranked.items():
        if others:
            title = lead + _error_title(f"{len(others)} more", channel)
            table.add_row(title, *(_largest([one.get(name) for name, _ in others], channel) for one in fits))


def _largest(fits: Sequence[ExperimentFit | None], channel: str) -> str:
    text = _error(max(fits, key=lambda fit: _size(fit, channel)), channel)
    return f"at most {text}" if text else ""


def _size(fit: ExperimentFit | None, channel: str) -> float:
    """The error of a line [SI]."""
    if fit is None:
        return 0.0
    return fit.rmse.get(channel, 0.0) if channel else fit.distance.mean if fit.distance else 0.0


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
