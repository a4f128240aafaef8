"""Summary of a calibration printed at its end."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from softcal.cli.printing import echo, print_table

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.calibration.results.result import CalibrationResult, ExperimentFit
    from softcal.calibration.statistics.estimate import Estimate, Remark
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
    from rich.table import Table

    from softcal.limits import JOINT
    from softcal.report.content import first_label, judged
    from softcal.report.first_screen import FirstScreen, three_sentences
    from softcal.report.format import worst

    first, others = worst(results.items(), lambda pair: math.inf if pair[0] == JOINT else pair[1].loss)
    told = dict(first)
    table = Table("", *told)
    _add_parameters(table, [result.parameters for result in told.values()], verbose=verbose)
    meshes = [_includes_mesh(result) for result in told.values()]
    if any(meshes) and not all(meshes):
        table.add_row("error of the mesh", *("included" if one else "not included" for one in meshes))
    _add_errors(table, "", [result.experiments for result in told.values()], verbose=verbose)
    held_out = [{name: held.fit for name, held in result.held_out.items()} for result in told.values()]
    _add_errors(table, "held out: ", held_out, verbose=verbose)
    table.add_section()
    table.add_row("loss", *(f"{result.loss:.4g}" for result in told.values()))
    failed = {of: f", {result.n_failed_trials} failed" for of, result in told.items() if result.n_failed_trials}
    table.add_row("trials", *(f"{len(result.trials)}{failed.get(of, '')}" for of, result in told.items()))
    print_table(table)
    if others:
        echo(f"{len(others)} more calibrations, of smaller losses, are in the report.")
    label = first_label(results)
    shown = judged(results, label)
    more = 0
    for remark in _remarks(results, shown, data or {}, records, solved or {}):
        warns = remark.tone == "warning"
        if verbose or (warns and remark.about in shown):
            echo(f"{'Warning: ' * warns}{remark.text}", err=warns)
        else:
            more += 1
    if more:
        echo(f"{more} more remark{'s' * (more > 1)}: --verbose, or the report.")
    doubts = solved[label].doubts if solved and label in solved else ""
    lead = f"the solved shapes are in doubt ({doubts}); " if doubts else ""
    for text in three_sentences(FirstScreen(results, label, data or {}, records or {}, lead=lead)):
        echo(text)


def _warnings(shown: Container[str], texts: Iterable[tuple[str, str]]) -> Iterator[Remark]:
    """Warnings of one kind, (label of what it is about, text), first those on what is shown; of many the first."""
    from softcal.calibration.statistics.estimate import Remark
    from softcal.report.format import MANY

    every = list(texts)
    for is_shown in (True, False):
        remarks = [Remark(text, "warning", about) for about, text in every if (about in shown) == is_shown]
        yield from remarks[:MANY]
        if len(remarks) > MANY:
            yield replace(remarks[0], text=f"{len(remarks) - MANY} more such warnings are in the report.")


def _remarks(
    results: Mapping[str, CalibrationResult],
    shown: Mapping[str, CalibrationResult],
    data: Mapping[str, Dataset],
    records: Mapping[str, Dataset] | None,
    solved: Mapping[str, Response],
) -> Iterator[Remark]:
    """All remarks on the calibrations; shown: those of the answer."""
    from softcal.calibration.statistics.estimate import Remark
    from softcal.calibration.statistics.sensitivity import INCLUDED
    from softcal.report.agreement import agreement_sentences, residual_sentences, spread_sentences
    from softcal.report.closeness import closeness_by_experiment, misses_of
    from softcal.report.cycles import cycle_sentences
    from softcal.report.format import few
    from softcal.report.positions import prediction_sentence

    failed = [label for label, result in results.items() if result.converged is False]
    answer = next(iter(shown))  # which a search that did not converge concerns, whichever it is
    yield from _warnings(
        shown, ((answer, f"{label}: {results[label].status} No intervals are given.") for label in failed)
    )
    yield from _warnings(
        shown,
        (
            (label, _of(label, remark.text))
            for label, result in results.items()
            for remark in closeness_by_experiment(misses_of(data, result))
            if remark.tone == "warning"
        ),
    )
    yield from (replace(remark, tone="note") for remark in agreement_sentences(results))
    for label, result in shown.items():
        for remark in (*spread_sentences(result, records), *residual_sentences(result)):
            yield replace(remark, text=f"{label}: {remark.text}", about=label)
        if (predicted := prediction_sentence(result)) is not None and predicted.tone == "warning":
            yield replace(predicted, text=f"{label}: {predicted.text}", about=label)
        yield from (Remark(_of(label, text)) for text in cycle_sentences(result))
    notes: dict[Remark, list[str]] = {}
    for label, result in results.items():
        for note in result.notes:
            if note.tone == "warning" or label in shown:
                notes.setdefault(note, []).append(label)
    warnings = {note: labels for note, labels in notes.items() if note.tone == "warning"}
    yield from _warnings(
        shown,
        (
            (next((label for label in labels if label in shown), labels[0]), f"{', '.join(few(labels))}: {note}")
            for note, labels in warnings.items()
        ),
    )
    for label, response in solved.items():
        yield from (Remark(f"{label}: {text}", "warning", label) for text in response.warnings)
    yield from map(Remark, _statuses(results))
    coarse = [label for label, result in results.items() if label not in shown and not _includes_mesh(result)]
    warned = {note.text for note in warnings}
    for note, labels in notes.items():
        if note.text in warned:
            continue
        more = ""
        if note.text.startswith(INCLUDED) and coarse and any(_includes_mesh(results[label]) for label in labels):
            more = f" Those of {', '.join(few(coarse))} do not include the error of the mesh."
        yield Remark(f"Note ({', '.join(few(labels))}): {note}{more}")


def _of(label: str, text: str) -> str:
    """A sentence on an experiment, preceded by its calibration, which may have the same name."""
    return text if text.startswith(f"{label}: ") else f"{label}, {text}"


def _includes_mesh(result: CalibrationResult) -> bool:
    from softcal.report.statement import MESH

    return any(MESH in estimate.shares for estimate in result.parameters.values())


def _statuses(results: Mapping[str, CalibrationResult]) -> list[str]:
    """The statuses of the searches of which nothing warns: in one line where all converged."""
    if all(result.converged for result in results.values()) and len(results) > 1:
        n = [len(result.trials) for result in results.values()]
        span = f"{min(n)} to {max(n)}" if min(n) < max(n) else str(n[0])
        return [f"All {len(results)} searches converged, each in {span} trials."]
    from softcal.report.format import few

    return few(f"{label}: {result.status}" for label, result in results.items() if result.converged is not False)


def result_line(label: str, result: CalibrationResult) -> str:
    """The values of one calibration in a line, for printing while others still run."""
    from softcal.report.format import few

    values = few(f"{name} {value_text(estimate)}" for name, estimate in result.parameters.items())
    return f"{label}: {', '.join(values)}; loss {result.loss:.4g}"


def _add_parameters(table: Table, fits: Sequence[Mapping[str, Estimate]], *, verbose: bool) -> None:
    """A line for each parameter; for one of each test a single line, if verbose of the least certain value."""
    from softcal.calibration.results.digits import interval_text
    from softcal.report.format import worst

    by_base: dict[str, list[str]] = {}
    for name in dict.fromkeys(name for parameters in fits for name in parameters):
        by_base.setdefault(name.partition("[")[0], []).append(name)
    for base, names in by_base.items():
        is_whole = verbose or names == [base]
        alone, others = (
            worst(names, lambda name: max(_vagueness(one.get(name)) for one in fits)) if is_whole else ([], names)
        )
        for name in alone:
            found = [one.get(name) for one in fits]
            table.add_row(name, *("" if one is None else value_text(one) for one in found))
            if "[" not in name and any(one is not None and one.interval for one in found):
                table.add_row("  95 % interval", *("" if one is None else interval_text(one) for one in found))
        if others:
            title = f"{base}, {len(others)} more" if alone else base
            table.add_row(title, *(_range_text([one[name] for name in others if name in one]) for one in fits))


def _vagueness(estimate: Estimate | None) -> float:
    """A bound, or a large standard error, is what brings a parameter of a test to the front."""
    if estimate is None:
        return 0.0
    return math.inf if estimate.at_bound else estimate.standard_error or 0.0


def _range_text(estimates: Sequence[Estimate]) -> str:
    """The least and the largest of several values and their number, to the digits of the least certain."""
    from softcal.calibration.results.digits import shown, with_unit

    if len(estimates) < 2:
        return "".join(map(value_text, estimates))
    values = [estimate.value for estimate in estimates]
    vaguest = max(estimates, key=_vagueness)
    ends = dict.fromkeys(shown(vaguest, pick(values)) for pick in (min, max))
    return f"{with_unit(vaguest, ' to '.join(ends))} ({len(values)} values)"


def _add_errors(table: Table, lead: str, fits: Sequence[Mapping[str, ExperimentFit]], *, verbose: bool) -> None:
    """A section of errors: for each channel a line for all experiments, and if verbose for those of the largest."""
    from softcal.report.format import worst

    def size(line: tuple[str, str]) -> float:
        """The largest error [SI] of an experiment's channel."""
        name, channel = line
        own = [one[name] for one in fits if name in one]
        if channel:
            return max(fit.rmse.get(channel, 0.0) for fit in own)
        return max(fit.distance.mean if fit.distance else 0.0 for fit in own)

    lines: dict[tuple[str, str], None] = {}  # (experiment, channel); channel "" for the distance of all markers
    for name, fit in (pair for one in fits for pair in one.items()):
        if fit.distances:
            lines[name, ""] = None
        lines.update({(name, channel): None for channel in fit.alone})
    by_channel = {channel: [line for line in lines if line[1] == channel] for _, channel in lines}
    ranked = {channel: worst(own, size) if verbose else ([], own) for channel, own in by_channel.items()}
    alone = {line for first, _ in ranked.values() for line in first}
    table.add_section()
    for name, channel in (line for line in lines if line in alone):
        table.add_row(lead + _error_title(channel, name), *(_error([one.get(name)], channel) for one in fits))
    for channel, (first, others) in ranked.items():
        if others:
            title = lead + _error_title(channel, f"{len(others)} more" if first else "")
            table.add_row(title, *(_error([one.get(name) for name, _ in others], channel) for one in fits))


def _error_title(channel: str, experiment: str) -> str:
    title = f"RMSE of {channel}" if channel else "distance, mean and largest"
    return f"{title}, {experiment}" if experiment else title


def _error(fits: Sequence[ExperimentFit | None], channel: str) -> str:
    """The error of a channel: the largest of several tests, but for distances that of each test."""
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


def value_text(estimate: Estimate) -> str:
    """A value with its standard error and unit, and whether it is at a bound or not determined by the data."""
    from softcal.calibration.results.digits import estimate_text, is_determined

    doubt = ("at a bound" if estimate.at_bound else "") if is_determined(estimate) else "not determined"
    return estimate_text(estimate) + f" ({doubt})" * bool(doubt)
