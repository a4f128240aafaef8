"""Sentences on the agreement of separate fits, and of the experiments of a joint fit, for the report and the command
line; and how well the experiments predict each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from softcal.analysis.agreement import Agreement, agreements
from softcal.analysis.trend import ENOUGH, Trend, trends
from softcal.calibration.results.digits import (
    display_unit,
    half_width,
    interval_text,
    is_determined,
    shown,
    value_text,
    with_unit,
)
from softcal.calibration.results.result import ExperimentFit, SearchResult
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.random_effects import DIFFERS, WORDS, Spread
from softcal.calibration.statistics.residuals import SHOWN, ResidualRecord
from softcal.experiments.dataset import Dataset
from softcal.report.content import ReportContent
from softcal.report.format import (
    channel_scale,
    estimate_scale,
    few,
    joined,
    number,
    parameter_label,
    result_label,
    worst,
)
from softcal.report.tables import Column, ReportTable
from softcal.sensing.channel import channel_unit
from softcal.units import format_quantity, rounded

MISFIT = "The residuals are a curve that the model misses, not noise"
MORE_THAN_NOISE = "The residuals are more than noise"
OUTLIERS = "Single samples are far off their neighbours"
STEPS = "Instruments are read in steps larger than the residuals"
ALIKE = "Neighbouring residuals are alike"
_OFF = 0.25  # of an interval's half-length: a value so far from the mean whose interval it is shown with is explained
_CAUSE = 0.2  # share of a curve's squares from which a cause is named
_LEAST = 0.005  # a smaller share would be shown as 0 %
_NAMED = 20  # outliers of a channel at most
_TINY = 1e-10  # smaller probabilities are shown as "p < 1e-10"


def agreement_sentences(results: Mapping[str, SearchResult]) -> list[Remark]:
    """One sentence per robot parameter that was estimated by several separate fits; a warning where they differ."""
    every = agreements(results)
    names = [one.name for one in every]
    return [
        Remark(
            agreement_text(one, parameter_label(one.name, names)) + _jointly(one, names, results),
            "warning" if one.differs else "note" if one.chance is None else "good",
        )
        for one in every
    ]


def _jointly(one: Agreement, names: Sequence[str], results: Mapping[str, SearchResult]) -> str:
    """Why a joint fit finds otherwise, where it does: it compares the tests with the other parameters at one value."""
    for result in results.values():
        spread = result.spreads.get(one.name)
        if spread is None or one.chance is None:
            continue
        if spread.differs == one.differs:
            # The values of the tests where other parameters, which are at a bound in separate fits, have one value.
            fits, joint = [results[label].parameters for label in one.estimates], result.parameters
            bound = [n for n in names if n != one.name and n in joint and any(f[n].at_bound for f in fits if n in f)]
            if not bound or not spread.differs:
                continue
            estimate = joint[one.name]
            at = joined(f"{parameter_label(n, names)} = {value_text(joint[n])}" for n in bound)
            values, others = _own_values(spread, estimate.value, partial(shown, estimate))
            at_bound = f" With {at} in all, it is {with_unit(estimate, values)}{others}"
            return f"{at_bound}, estimated from the derivatives at the joint fit."
        others = [parameter_label(name, names) for name in names if name != one.name and name in result.parameters]
        at = f"with {joined(others)} at {'their' if len(others) > 1 else 'its'} joint value{'s' * (len(others) > 1)}"
        verb = "differ" if spread.differs else "do not differ"
        differ = f"the tests {verb} ({chance_text(spread)}{_holm(result)})"
        if not others:
            return f" In the joint fit {differ}."
        return f" Here each test has its own {joined(others)} too; {at}, in the joint fit, {differ}."
    return ""


def agreement_text(one: Agreement, name: str) -> str:
    """The spread of the fits, and whether it exceeds what the noise within them explains."""
    low, high = one.least[1], one.largest[1]
    if low.value == high.value:
        text = f"{name} is the same in all {len(one.estimates)} separate fits, {value_text(low)}"
        return f"{text}: a bound, which does not show that they agree." if low.at_bound else f"{text}."
    lowest, highest = (f"{value_text(e)} ({result_label(label)})" for label, e in (one.least, one.largest))
    if all(not is_determined(estimate) for estimate in one.estimates.values()):
        return f"No separate fit determines {name}."
    if one.q is None or one.chance is None:
        text = f"The separate fits give {name} from {lowest} to {highest}"
        ends = [e.interval for e in one.estimates.values() if e.interval is not None]
        if len(ends) < len(one.estimates):
            return f"{text}."
        least, most = max(least for least, _ in ends), min(most for _, most in ends)
        common = with_unit(high, f"{shown(high, least)} to {shown(high, most)}") if least <= most else "no value"
        return f"{text}; {common} lies in the 95 % intervals of all."
    text = f"{name} differs between the separate fits by {size_text(one)}, from {lowest} to {highest}"
    freedom = f"{one.dof} degree{'s' * (one.dof > 1)} of freedom"
    test = f"(Cochran's Q = {number(one.q)} without the errors that all fits share, {freedom}, {chance_text(one)})"
    left = f" Excluded, having no standard error: {joined(few(map(result_label, one.uncounted)))}."
    left = left if one.uncounted else ""
    if one.differs:
        return f"{text}: more than their noise explains {test}. One value does not describe all tests.{left}"
    return f"{text}: no more than their noise explains {test}.{left}"


def spread_sentences(result: SearchResult, records: Mapping[str, Dataset] | None = None) -> list[Remark]:
    """Remarks on the differences between the experiments of a joint fit: a warning per parameter in which they differ,
    with its trend, and a sentence on all other parameters.

    records: experiment -> its record with times, for the speeds.
    """
    names = list(result.spreads)
    with_what = trend_sentences(result, records)
    found = [
        Remark(_spread_text(result, name, parameter_label(name, names)) + with_what.get(name, ""), "warning")
        for name, one in result.spreads.items()
        if one.differs
    ]
    for kind in dict.fromkeys(one.kind for one in result.spreads.values()):
        alike = [name for name, one in result.spreads.items() if one.kind == kind and not one.differs]
        if not alike:
            continue
        spreads = sorted((result.spreads[name] for name in alike), key=lambda one: one.chance)
        least = chance_text(spreads[0])
        more = " or more" if chance_text(spreads[-1]) != least else ""
        labels = joined(parameter_label(name, names) for name in alike)
        verb = "do not differ" if len(alike) > 1 else "does not differ"
        what = f"{labels} {verb} between the {WORDS[kind]} by more than their noise explains"
        found.append(Remark(f"{what} ({least}{more}{_holm(result)}).", "good"))
    return found


def _holm(result: SearchResult) -> str:
    """The note behind the p-value of one of several comparisons, each of which is corrected for the others."""
    n = len(result.spreads)
    return f", Holm's correction for {n} comparisons" if n > 1 else ""


def trend_sentences(result: SearchResult, records: Mapping[str, Dataset] | None = None) -> dict[str, str]:
    """Label of a parameter that rises or falls with a condition of the experiments -> " E falls with …"."""
    names = list(result.spreads)
    return {
        one.name: f" {parameter_label(one.name, names)} {_trend_text(one, result.parameters[one.name])}"
        for one in trends(result, records)
    }


def _trend_text(one: Trend, estimate: Estimate) -> str:
    corrected = f", corrected for {one.tested} conditions" if one.tested > 1 else ""
    chance = f"({_chance_text(one.chance)}{corrected})" if one.n_tests >= ENOUGH else f"({one.n_tests} tests: a hint)"
    text = f"{'rises' if one.power > 0 else 'falls'} with the {one.condition} of the tests {chance}"
    if one.along:
        return (
            f"{text}. Their {joined(one.along)} varies with it, so these tests do not show which of them is the cause."
        )
    if estimate.unit != "Pa":
        return f"{text}: the model lacks an effect of the {one.condition}."
    if one.condition == "amplitude":
        material = "stiffening" if one.power > 0 else "softening"
        return f"{text}: {material} of the material, or an error of the slack or the mesh."
    if one.power > 0:
        return f"{text}: rate dependence of the material, or an error of the clocks or of the friction."
    return f"{text}, which rate dependence does not explain: compare the order of the tests, clocks and friction."


def _spread_text(result: SearchResult, name: str, label: str) -> str:
    one, estimate = result.spreads[name], result.parameters[name]
    fixed = ", with the other shared parameters at their joint values" if len(result.spreads) > 1 else ""
    chance, scale, who = f"{chance_text(one)}{_holm(result)}", estimate_scale(estimate), WORDS[one.kind]
    values, others = _own_values(one, estimate.value, lambda v: rounded(v / scale.factor, one.spread / scale.factor))
    text = (
        f"{label} differs between the {who} by more than their noise explains ({chance}): "
        + f"{values} {scale.unit}".rstrip()
        + others
        + ", estimated from the derivatives at the joint fit"
        + fixed
    )
    if one.next_interval is None:
        return f"{text}. Two {who} are too few for a reliable interval of their mean."
    further = interval_text(replace(estimate, interval=one.next_interval))
    mean, half = sum(weight * one.values[test] for test, weight in one.weights.items()), half_width(estimate)
    if one.weights and half and abs(mean - estimate.value) > _OFF * half:
        text += (
            f". {with_unit(estimate, shown(estimate, estimate.value))} minimises the joint loss, but the mean of the "
            f"{who} is {with_unit(estimate, shown(estimate, mean))}"
        )
    text += f". The 95 % interval is for the mean of many such {who}"
    if further == interval_text(estimate):
        return f"{text}, and also holds for a single further {who.removesuffix('s')}."
    return f"{text}; that of a single further {who.removesuffix('s')} is {further}."


def _own_values(one: Spread, mean: float, text: Callable[[float], str]) -> tuple[str, str]:
    """The own values of the tests, or of many tests those furthest from a mean, and the number of the others."""
    far, others = worst(one.values.items(), lambda pair: abs(pair[1] - mean))
    values = joined(f"{text(value)} ({test})" for test, value in far)
    return values, f" ({len(others)} others lie nearer to the mean)" if others else ""


def residual_sentences(result: SearchResult) -> list[Remark]:
    """Warnings on residuals that are a curve and no noise, on a usual cause in them beyond chance, on outliers and on
    steps of readings; a note on neighbouring residuals that are alike, so that samples are worth less than their
    number. Of many records, the worst are named.
    """
    each = [(e, c, one) for e, held in result.residuals.items() for c, one in held.items()]

    def named(
        which: Callable[[ResidualRecord], object],
        size: Callable[[ResidualRecord], float],
        text: Callable[[str, str, ResidualRecord], str],
    ) -> str:
        """The records of one kind, the worst of many."""
        first, others = worst((pair for pair in each if which(pair[2])), lambda pair: size(pair[2]))
        return "; ".join([*(text(*pair) for pair in first), *([f"{len(others)} more"] if others else [])])

    def step_text(e: str, c: str, one: ResidualRecord) -> str:
        return f"{c} of {e}, by {format_quantity(one.step, result.experiments[e].units[c], digits=2)}"

    curves = named(
        lambda one: one.is_curve,
        lambda one: one.significance,
        lambda e, c, o: _curve_text(result.experiments[e], e, c, o),
    )
    causes = named(
        lambda one: one.significance > SHOWN and not one.is_curve,
        lambda one: one.significance,
        lambda e, c, o: _cause_text(result.experiments[e], e, c, o),
    )
    far = named(lambda one: one.outliers, lambda one: len(one.outliers), _outliers_text)
    steps = named(lambda one: one.step, lambda one: one.step / one.size, step_text)
    alike = named(
        lambda one: one.are_alike and not one.is_curve,
        lambda one: -one.effective / one.n,
        lambda e, c, o: f"{e}, {c}: {o.n} samples are worth about {number(max(o.effective, 1.0), 2)}",
    )
    sentences = {MISFIT: curves, MORE_THAN_NOISE: causes, OUTLIERS: far, STEPS: steps, ALIKE: alike}
    return [
        Remark(f"{lead}: {text}.", "note" if lead == ALIKE else "warning") for lead, text in sentences.items() if text
    ]


def _curve_text(fit: ExperimentFit, experiment: str, channel: str, one: ResidualRecord) -> str:
    """Size of a curve of residuals, and the place where it is largest."""
    size = format_quantity(one.size, fit.units[channel], digits=2)
    where = "at the start" if one.largest < 0.1 else "at the end" if one.largest > 0.9 else ""
    where = where or f"{100 * one.largest:.0f} % along the record"
    # The two clearest ones; the less clear one may explain more of this channel.
    causes = [(cause, share) for cause, share in one.explained.items() if share > _CAUSE][:2]
    causes.sort(key=lambda pair: -pair[1])
    by = _shares_text(causes)
    return f"{channel} of {experiment} by {size} (RMS), most {where}{by and f' ({by})'}"


def _shares_text(causes: Iterable[tuple[str, float]]) -> str:
    return ", ".join(f"{cause} alone would explain {100 * share:.0f} %" for cause, share in causes)


def _cause_text(fit: ExperimentFit, experiment: str, channel: str, one: ResidualRecord) -> str:
    """The cause in residuals beside noise, its significance, and the share that it explains."""
    size = format_quantity(one.size, fit.units[channel], digits=2)
    causes = _shares_text(pair for pair in list(one.explained.items())[:2] if pair[1] > _LEAST)
    by = (
        f"of the squares relative to the noise {causes}" if causes else "no cause that explains it is within the record"
    )
    where, sure = f"in {channel} of {experiment} ({size} RMS)", number(one.significance, 2)
    return f"{where} the shape of a usual cause is {sure} standard errors from zero; {by}"


def _outliers_text(experiment: str, channel: str, one: ResidualRecord) -> str:
    rows, more = [str(row) for row in one.outliers[:_NAMED]], len(one.outliers) - _NAMED
    return f"{joined([*rows, f'{more} more'] if more > 0 else rows)} of {channel} of {experiment}"


def chance_text(one: Agreement | Spread) -> str:
    """Text such as "p = 0.31" or "p < 1e-10"; for few tests, whose errors have unknown tails, the level of the test."""
    if one.chance is not None and one.dof + 1 < ENOUGH:
        return f"at the {100 * DIFFERS:.0f} % level"
    return "p unknown" if one.chance is None else _chance_text(one.chance)


def _chance_text(chance: float) -> str:
    return f"p < {_TINY:.0e}" if chance < _TINY else f"p = {number(chance, 2)}"


def size_text(one: Agreement) -> str:
    """Largest minus smallest value: in per cent of their mean, or as a number."""
    low, high = one.least[1], one.largest[1]
    apart, halves = high.value - low.value, [half_width(end) for end in (low, high)]
    sure = math.hypot(*(half or 0.0 for half in halves)) if all(halves) else 0.0
    if low.unit == "1" or low.value <= 0:
        scale = estimate_scale(high)
        return with_unit(high, rounded(apart / scale.factor, max(apart, sure) / scale.factor))
    mean = 0.5 * (low.value + high.value)
    return f"{rounded(100 * apart / mean, 100 * max(apart, sure) / mean)} %"


def range_text(one: Agreement) -> str:
    """The smallest and the largest value: "3.197 to 3.513 MPa"."""
    low, high = one.least[1], one.largest[1]
    unit, vaguest = display_unit(high), max((low, high), key=lambda end: half_width(end) or 0.0)
    return with_unit(high, " to ".join(shown(vaguest, end.value, unit) for end in (low, high)))


def left_out_sentence(result: SearchResult) -> str:
    """Sentence on how well the experiments predict each other; "" for fewer than three."""
    shares: list[float] = []
    for name, prediction in result.left_out.items():
        measured = result.experiments[name].measured
        counts = [int(np.isfinite(measured[channel]).sum()) for channel in prediction.within]
        shares.append(float(np.average(list(prediction.within.values()), weights=counts)))
    if not shares:
        return ""
    low, high = (number(100 * share, 3) for share in (min(shares), max(shares)))
    range_text = f"{low} %" if low == high else f"{low} to {high} %"
    return (
        f"Predicted by the others, each of the {len(result.left_out)} tests has {range_text} of its measured values "
        "within the 95 % band of a further one."
    )


def left_out_table(content: ReportContent) -> ReportTable:
    """The errors of the predictions beside those of the fit; empty where there are fewer than three experiments."""
    rows: list[tuple[str | float | int | None, ...]] = []
    for label, result in content.judged.items():
        for name, prediction in result.left_out.items():
            for channel, error in prediction.rmse.items():
                scale = channel_scale(channel_unit(channel) or "1")
                fitted = result.experiments[name].rmse.get(channel)
                shown = [
                    None if v is None else f"{number(v / scale.factor)} {scale.unit}".rstrip()
                    for v in (fitted, error, prediction.half_width[channel])
                ]
                rows.append((result_label(label), name, channel, *shown, 100 * prediction.within[channel]))
    columns = (
        Column("Calibration"),
        Column("Experiment"),
        Column("Channel"),
        Column("RMSE, fitted"),
        Column("RMSE, predicted"),
        Column("95 % band"),
        Column("Samples within it", "%", 3),
    )
    note = (
        "Predicted: with the shared parameters that the others give, by the exact derivatives at the joint minimum; a "
        "test's own parameters are fitted to it. The band is that of a further test: the errors of the "
        "parameters, the spread between the tests, and the noise (root mean square of its half-width)."
    )
    return ReportTable("left-out", "Experiments as the others predict them", columns, tuple(rows), note)
