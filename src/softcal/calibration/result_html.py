"""A result as a small table for notebooks: what it says, with units and intervals."""

from __future__ import annotations

from softcal.calibration.result import Estimate, SearchResult
from softcal.display import MOST
from softcal.html_text import heading, html_table, paragraph, picture
from softcal.pictures import pictures_of
from softcal.units import digits_that_tell, format_quantity, format_range

ESTIMATE = ("value", "95 % interval", "bounds")


def result_html(result: SearchResult) -> str:
    """The parameters with their intervals, the loss, the sentence on its end, and the notes."""
    rows = [[name, *estimate_cells(one)] for name, one in result.parameters.items()]
    told = f"loss ({result.loss_name}) {result.loss:.5g}, {result.method}, {len(result.trials)} trials"
    failed = f", {result.n_failed_trials} of them failed" if result.n_failed_trials else ""
    parts = [heading(told + failed), html_table(["parameter", *ESTIMATE], rows)]
    parts += [paragraph(result.status), *(paragraph(f"{note.level.capitalize()}: {note}") for note in result.notes)]
    parts += [picture(png, "loss and fit") for png in pictures_of(result)]
    return "".join(parts)


def result_text(result: SearchResult) -> str:
    """The parameters with their intervals and the loss, in a line."""
    parts: list[str] = []
    for name, one in result.parameters.items():
        value, interval, _ = estimate_cells(one)
        parts.append(f"{name} = {value}" + (f" ({interval})" if one.interval is not None else ""))
    shown = parts if len(parts) <= MOST else [*parts[:MOST], f"{len(parts) - MOST} more"]
    return f"{type(result).__name__}({', '.join([*shown, f'loss = {result.loss:.5g}'])})"


def estimate_cells(one: Estimate) -> list[str]:
    """The cells of `ESTIMATE`."""
    return [_value(one), _interval(one), _bounds(one)]


def _value(one: Estimate) -> str:
    return format_quantity(one.value, one.unit) + (" (at a bound)" if one.at_bound else "")


def _interval(one: Estimate) -> str:
    if one.interval is None:
        return "–"
    return format_range(*one.interval, one.unit, digits=digits_that_tell(*one.interval))


def _bounds(one: Estimate) -> str:
    return format_range(one.lower, one.upper, one.unit)
