"""Sentences on the agreement of separate fits (Cochran's Q test), for the report and the command line."""

from __future__ import annotations

from collections.abc import Mapping

from softcal.analysis.agreement import Agreement, agreements
from softcal.calibration.result import Estimate, SearchResult
from softcal.report.format import estimate_scale, estimate_text, joined, number, parameter_label, result_label

_TINY = 1e-10  # smaller probabilities are shown as "p < 1e-10"


def agreement_sentences(results: Mapping[str, SearchResult]) -> list[tuple[str, Agreement]]:
    """One sentence per robot parameter that was estimated by several separate fits."""
    found = agreements(results)
    return [(agreement_text(one, parameter_label(one.name, [other.name for other in found])), one) for one in found]


def agreement_text(one: Agreement, name: str) -> str:
    """The spread of the fits, and whether it exceeds what their standard errors allow."""
    low, high = one.least[1], one.largest[1]
    if low.value == high.value:
        return f"{name} is the same in all {len(one.estimates)} separate fits, {_plain(low)}."
    lowest, highest = (f"{estimate_text(e)} ({result_label(label)})" for label, e in (one.least, one.largest))
    text = f"{name} differs between the separate fits by {size_text(one)}, from {lowest} to {highest}"
    if one.q is None or one.chance is None:
        return f"{text}; without standard errors this cannot be compared with noise."
    freedom = f"{one.dof} degree{'s' * (one.dof > 1)} of freedom"
    test = f"(Cochran's Q = {number(one.q)} with {freedom}, {chance_text(one)})"
    left = f" Excluded, having no standard error: {joined(map(result_label, one.uncounted))}."
    left = left if one.uncounted else ""
    if one.differs:
        return f"{text}: more than their standard errors allow {test}. One value does not describe all tests.{left}"
    return f"{text}: no more than their standard errors allow {test}.{left}"


def chance_text(one: Agreement) -> str:
    """The p-value: "p = 0.31", "p < 1e-10"."""
    if one.chance is None:
        return "p unknown"
    return f"p < {_TINY:.0e}" if one.chance < _TINY else f"p = {number(one.chance, 2)}"


def size_text(one: Agreement) -> str:
    """Largest minus smallest value: in per cent of their mean, or as a number."""
    low, high = one.least[1], one.largest[1]
    if low.unit == "1" or low.value <= 0:
        scale = estimate_scale(high)
        return f"{number((high.value - low.value) / scale.factor, 2)} {scale.unit}".rstrip()
    return f"{number(200 * (high.value - low.value) / (high.value + low.value), 2)} %"


def range_text(one: Agreement) -> str:
    """The smallest and the largest value: "3.197 to 3.513 MPa"."""
    low, high = one.least[1], one.largest[1]
    scale = estimate_scale(high)
    return f"{number(low.value / scale.factor, 4)} to {number(high.value / scale.factor, 4)} {scale.unit}".rstrip()


def _plain(estimate: Estimate) -> str:
    scale = estimate_scale(estimate)
    return f"{number(estimate.value / scale.factor, 4)} {scale.unit}".rstrip()
