"""Summary of a calibration printed at its end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
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
    *,
    verbose: bool = False,
) -> None:
    """Print the table of all calibrations, the warnings that concern the answer, and the three sentences of the
    report's first screen.

    Parameters
    ----------
    results
        Label -> its calibration.
    data
        Experiment -> its samples, for their noise.
    records
        Experiment -> its record with times, for the speeds.
    solved
        Label -> the twin's response where it is pulled furthest, for its warnings.
    verbose
        Print each test's values in a joint fit, every warning, how far the fits agree, their status and notes.
    """
    if not results:
        return
    from softcal.project.names import JOINT
    from softcal.report.first_screen import FirstScreen, three_sentences
    from softcal.report.format import worst
    from softcal.report.judged import first_label, judged

    first, others = worst(results.items(), lambda pair: math.inf if pair[0] == JOINT else pair[1].loss)
    print_table((_result_table if verbose else _short_table)(dict(first)))
    if others:
        typer.echo(f"{len(others)} more calibrations, of smaller losses, are in the report.")
    label = first_label(results)
    remarks = list(_remarks(results, judged(results, label), data or {}, records, solved or {}))
    for remark in remarks:
        if verbose or remark.decides:
            typer.echo(f"{'Warning: ' * remark.is_warning}{remark.text}", err=remark.is_warning)
    if more := 0 if verbose else sum(not remark.decides for remark in remarks):
        typer.echo(f"{more} more remark{'s' * (more > 1)}: --verbose, or the report.")
    doubts = solved[label].doubts if solved and label in solved else ""
    lead = f"the solved shapes are in doubt ({doubts}); " if doubts else ""
    for text in three_sentences(FirstScreen(results, label, data or {}, records or {}, lead=lead)):
        typer.echo(text)


@dataclass(frozen=True)
class _Remark:
    """A sentence on the calibrations; decides: it warns of the result that is the answer, and is always printed."""

    text: str
    is_warning: bool = False
    decides: bool = False


def _remarks(
    results: Mapping[str, CalibrationResult],
    shown: Mapping[str, CalibrationResult],
    data: Mapping[str, Dataset],
    records: Mapping[str, Dataset] | None,
    solved: Mapping[str, Response],
) -> Iterator[_Remark]:
    """All remarks on the calibrations; shown: those of the answer."""
    from softcal.calibration.sensitivity import INCLUDED
    from softcal.report.agreement import agreement_sentences, residual_sentences, spread_sentences
    from softcal.report.closeness import closeness_by_experiment, misses_of
    from softcal.report.cycles import cycle_sentences
    from softcal.report.format import few

    failed = [f"{label}: {r.status} No intervals are given." for label, r in results.items() if r.converged is False]
    yield from (_Remark(text, True, True) for text in _first(failed))
    far = [
        (label, text if text.startswith(f"{label}: ") else f"{label}, {text}")
        for label, result in results.items()
        for text, tone in closeness_by_experiment(misses_of(data, result))
        if tone == "warning"
    ]
    yield from (_Remark(text, True, True) for text in _first(text for label, text in far if label in shown))
    yield from (_Remark(text, True) for text in _first(text for label, text in far if label not in shown))
    yield from (_Remark(text) for text, _ in agreement_sentences(results))
    for label, result in shown.items():
        for text, warns in (*spread_sentences(result, records), *residual_sentences(result)):
            yield _Remark(f"{label}: {text}", warns, warns)
        for text in cycle_sentences(result):
            yield _Remark(text if text.startswith(f"{label}: ") else f"{label}, {text}")
    notes: dict[Note, list[str]] = {}
    for label, result in results.items():
        for note in result.notes:
            if note.level == "warning" or label in shown:
                notes.setdefault(note, []).append(label)
    warnings = {note: labels for note, labels in notes.items() if note.level == "warning"}
    for decides in (True, False):
        texts = [
            f"{', '.join(few(labels))}: {note}"
            for note, labels in warnings.items()
            if any(label in shown for label in labels) == decides
        ]
        yield from (_Remark(text, True, decides) for text in _first(texts))
    for label, response in solved.items():
        yield from (_Remark(f"{label}: {text}", True, True) for text in response.warnings)
    yield from map(_Remark, _statuses(results))
    coarse = [label for label, result in results.items() if label not in shown and not _includes_mesh(result)]
    for note, labels in notes.items():
        if note in warnings:
            continue
        more = ""
        if note.text.startswith(INCLUDED) and coarse and any(_includes_mesh(results[label]) for label in labels):
            more = f" Those of {', '.join(few(coarse))} do not include the error of the mesh."
        yield _Remark(f"Note ({', '.join(few(labels))}): {note}{more}")


def _first(texts: Iterable[str]) -> list[str]:
    """Warnings of one kind, of many the first."""
    from softcal.report.format import MANY

    every = list(texts)
    return [*every[:MANY], *[f"{len(every) - MANY} more such warnings are in the report."] * (len(every) > MANY)]


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


def _short_table(results: Mapping[str, CalibrationResult]) -> Table:
    """Table with a column per calibration and a line per parameter and channel, where several tests have their own with
    the least and the largest.
    """
    from rich.table import Table

    from softcal.calibration.digits import interval_text

    table = Table("", *results)
    every = [result.parameters for result in results.values()]
    for base in dict.fromkeys(name.partition("[")[0] for parameters in every for name in parameters):
        own = [[one for name, one in p.items() if name.partition("[")[0] == base] for p in every]
        table.add_row(base, *(_range_text(ones) if len(ones) > 1 else "".join(map(value_text, ones)) for ones in own))
        shared = [parameters.get(base) for parameters in every]
        if any(one is not None and one.interval for one in shared):
            table.add_row("  95 % interval", *("" if one is None else interval_text(one) for one in shared))
    held_out = [{name: held.fit for name, held in result.held_out.items()} for result in results.values()]
    for lead, fits in (("", [result.experiments for result in results.values()]), ("held out: ", held_out)):
        table.add_section()
        for channel in dict.fromkeys(
            channel for _, channel in _error_lines(pair for one in fits for pair in one.items())
        ):
            title = f"RMSE of {channel}" if channel else "distance, mean and largest"
            table.add_row(lead + title, *(_error(list(one.values()), channel) for one in fits))
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
    """The least and the largest of values, to the digits of the least certain."""
    from softcal.calibration.digits import shown, with_unit

    values = [estimate.value for estimate in estimates]
    vaguest = max(estimates, key=_vagueness)
    return with_unit(vaguest, f"{shown(vaguest, min(values))} to {shown(vaguest, max(values))}")


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
        table.add_row(lead + _error_title(name, channel), *(_error([one.get(name)], channel) for one in fits))
    for channel, (_, others) in ranked.items():
        if others:
            title = lead + _error_title(f"{len(others)} more", channel)
            table.add_row(title, *(_error([one.get(name) for name, _ in others], channel) for one in fits))


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


def _error(fits: Sequence[ExperimentFit | None], channel: str) -> str:
    """The error of a channel; of several tests the largest, of distances each its own."""
    from softcal.units import format_quantity

    fitted = [fit for fit in fits if fit is not None and (channel in fit.rmse if channel else fit.distance)]
    if not fitted:
        return ""
    lead = "at most " * (len(fitted) > 1)
    if channel:
        worst = max(fitted, key=lambda fit: fit.rmse[channel])
        return lead + format_quantity(worst.rmse[channel], worst.units[channel], digits=3)
    distances = [(fit.distance, fit.length) for fit in fitted if fit.distance]
    mean, largest = max(of.mean for of, _ in distances), max(of.max for of, _ in distances)
    text = f"{lead}{1e3 * mean:.3g} and {1e3 * largest:.3g} mm"
    shares = [(of.mean / length, of.max / length) for of, length in distances if length is not None]
    if len(shares) == len(distances):
        mean, largest = (100 * max(each) for each in zip(*shares, strict=True))
        text += f" ({mean:.2g} and {largest:.2g} %)"
    return text


def _count(result: CalibrationResult) -> str:
    failed = f", {result.n_failed_trials} failed" if result.n_failed_trials else ""
    return f"{len(result.trials)}{failed}"


def value_text(estimate: Estimate) -> str:
    """A value with its standard error and unit, and whether it is at a bound."""
    from softcal.calibration.digits import estimate_text

    return estimate_text(estimate) + (" (at a bound)" if estimate.at_bound else "")
