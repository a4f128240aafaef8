"""What is printed of a calibration at its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from softcal.calibration.result import CalibrationResult, Estimate


def print_results(results: Mapping[str, CalibrationResult]) -> None:
    """Print the table of all calibrations, their status and their notes."""
    from rich.console import Console

    if not results:
        return
    console = Console()
    if not console.is_terminal:
        console = Console(width=160)  # a log does not wrap
    console.print(_result_table(results))
    for label, result in results.items():
        typer.echo(f"{label}: {result.status}")
    notes: dict[str, list[str]] = {}
    for label, result in results.items():
        for note in result.notes:
            notes.setdefault(note, []).append(label)
    for note, labels in notes.items():
        typer.echo(f"Note ({', '.join(labels)}): {note}")


def _result_table(results: Mapping[str, CalibrationResult]) -> Table:
    """A column for each calibration; a line for each parameter, and for each experiment's errors."""
    from rich.table import Table

    table = Table("", *results)
    parameters = dict.fromkeys(name for result in results.values() for name in result.parameters)
    for name in parameters:
        found = [result.parameters.get(name) for result in results.values()]
        table.add_row(name.replace("[", r"\["), *("" if estimate is None else _value(estimate) for estimate in found))
    table.add_section()
    fits = [(name, channel) for r in results.values() for name, fit in r.experiments.items() for channel in fit.rmse]
    for name, channel in dict.fromkeys(fits):
        table.add_row(f"RMSE of {channel}, {name}", *(_error(result, name, channel) for result in results.values()))
    table.add_section()
    table.add_row("loss", *(f"{result.loss:.4g}" for result in results.values()))
    table.add_row("trials", *(_count(result) for result in results.values()))
    return table


def _error(result: CalibrationResult, experiment: str, channel: str) -> str:
    fit = result.experiments.get(experiment)
    return "" if fit is None or channel not in fit.rmse else f"{fit.rmse[channel]:.3g} {fit.units[channel]}"


def _count(result: CalibrationResult) -> str:
    failed = f", {result.n_failed_trials} failed" if result.n_failed_trials else ""
    return f"{len(result.trials)}{failed}"


def _value(estimate: Estimate) -> str:
    from softcal.units import format_quantity, readable_unit

    unit = readable_unit(estimate.value, estimate.unit)
    text = format_quantity(estimate.value, estimate.unit, unit)
    if estimate.standard_error is not None:
        text += f" ± {format_quantity(estimate.standard_error, estimate.unit, unit, digits=2)}"
    return text + (" (at a bound)" if estimate.at_bound else "")
