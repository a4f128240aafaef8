"""A result as a small table for notebooks: what it says, with units and intervals."""

from __future__ import annotations

from softcal.calibration.result import Estimate, SearchResult
from softcal.html_text import heading, html_table, paragraph, picture
from softcal.pictures import pictures_of
from softcal.units import digits_that_tell, format_quantity, format_range


def result_html(result: SearchResult) -> str:
    """The parameters with their intervals, the loss, the sentence on its end, and the notes."""
    rows = [[name, _value(one), _interval(one), _bounds(one)] for name, one in result.parameters.items()]
    told = f"loss ({result.loss_name}) {result.loss:.5g}, {result.method}, {len(result.trials)} trials"
    failed = f", {result.n_failed_trials} of them failed" if result.n_failed_trials else ""
    parts = [heading(told + failed), html_table(["parameter", "value", "95 % interval", "bounds"], rows)]
    parts += [paragraph(result.status), *(paragraph(f"{note.level.capitalize()}: {note}") for note in result.notes)]
    parts += [picture(png, "loss and fit") for png in pictures_of(result)]
    return "".join(parts)


def _value(one: Estimate) -> str:
    return format_quantity(one.value, one.unit) + (" (at a bound)" if one.at_bound else "")


def _interval(one: Estimate) -> str:
    if one.interval is None:
        return "–"
    return format_range(*one.interval, one.unit, digits=digits_that_tell(*one.interval))


def _bounds(one: Estimate) -> str:
    return format_range(one.lower, one.upper, one.unit)
