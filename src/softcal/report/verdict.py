"""What the numbers mean, in sentences: bounds, failures, identifiability, residuals, plausibility."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from softcal.calibration.result import CalibrationResult, Estimate
from softcal.report.comparison import improvements
from softcal.report.content import ReportContent
from softcal.report.positions import fit_sentence, fitted_distance, prediction_sentence
from softcal.report.tables import grouped_failures, share_of_peak
from softcal.report.wording import (
    NORMAL_95,
    estimate_scale,
    estimate_text,
    find_parameter,
    joined,
    number,
    parameter_label,
    parameter_name,
    result_label,
    scale_of,
)

Tone = Literal["good", "note", "warning"]

# A residual below this share of the peak force is called close; above the second one, poor.
_CLOSE, _POOR = 0.03, 0.10
# An estimate is called identified while its 95 % interval covers less than this share of what was allowed.
_IDENTIFIED = 0.25
_DECADE = 10.0
_BOUND_NOTE = "the bounds of its range, not the data, decide it"  # told as a warning of its own
# Without a standard error: below this importance a parameter hardly moves the loss.
_UNIMPORTANT = 0.10


@dataclass(frozen=True)
class Sentence:
    """One finding; the tone says whether it is as hoped, worth knowing, or a warning."""

    text: str
    tone: Tone


def headline_sentence(content: ReportContent) -> Sentence:
    """The whole report in one sentence: the estimates, how close the fit is, and the gravest doubt."""
    result = content.headline_result
    material = _material(result)
    names = [name for name, _ in material]
    estimates = joined(f"{parameter_label(n, names)} = {estimate_text(e)}" for n, e in material)
    shares = [share for fit in result.experiments.values() if (share := share_of_peak(fit)) is not None]
    fit = (
        f"the twin follows the measured force within {number(100 * max(shares), 2)} % of its peak (RMS)"
        if shares
        else ""
    )
    pitch = [fit.rmse["pitch"] for fit in result.experiments.values() if "pitch" in fit.rmse]
    if pitch:
        error = f"the pitch within {number(max(pitch) / scale_of('rad').factor, 2)} deg (RMS)"
        fit = f"{fit} and {error}" if fit else f"the twin follows {error}"
    near = fitted_distance(result)
    if near:
        fit = f"{fit} and the markers to {near}" if fit else f"the twin meets the markers to {near}"
    doubts = [s for s in (*_bounds(result), *_identified(result)) if s.tone == "warning"]
    named = f"the best of {len(result.trials)} cells, {estimates}" if result.is_sweep else estimates
    lead = f"With {named}, {fit}." if estimates and fit else f"{(fit or estimates).capitalize()}."
    grave = bool(doubts) or bool(shares and max(shares) > _POOR)
    return Sentence(" ".join([lead, *(doubt.text for doubt in doubts[:1])]), "warning" if grave else "good")


def verdicts(content: ReportContent) -> list[Sentence]:
    """Every finding on the headline calibration and on how the calibrations agree; warnings first."""
    result = content.headline_result
    found = [
        *_residuals(result),
        *_positions(result),
        *_gain(content),
        *_bounds(result),
        *_identified(result),
        *_plausible(content),
        *_stability(content),
        *_agreement(content),
        *_failures(content),
        *_unmeasured_pitch(result),
        *(Sentence(_sentence(note), "note") for note in result.notes if _BOUND_NOTE not in note),
        Sentence(f"How the search ended: {_sentence(result.status)}", "note"),
    ]
    return sorted(found, key=lambda sentence: ("warning", "good", "note").index(sentence.tone))


def _material(result: CalibrationResult) -> list[tuple[str, Estimate]]:
    kinds = ("youngs_modulus", "poissons_ratio")
    return [(name, e) for name, e in result.parameters.items() if parameter_name(name).kind in kinds]


def _residuals(result: CalibrationResult) -> Iterable[Sentence]:
    kinds = (
        ("tension", "force", "N", "peak"),
        ("pitch", "pitch", "rad", "largest"),
        ("shortening", "travel", "m", "largest"),
    )
    for name, fit in result.experiments.items():
        parts: list[str] = []
        worst = 0.0
        for channel, word, si_unit, extreme in kinds:
            share, error = share_of_peak(fit, channel), fit.rmse.get(channel)
            if share is None or error is None:
                continue
            scale = scale_of(si_unit)
            shown = f"{number(error / scale.factor)} {scale.unit}"
            parts.append(f"the {word} to {shown} RMS ({number(100 * share, 2)} % of its {extreme})")
            worst = max(worst, share)
        if parts:
            word, tone = _closeness(worst)
            yield Sentence(f"{name}: the twin meets {joined(parts)}; {word}.", tone)


def _positions(result: CalibrationResult) -> Iterable[Sentence]:
    if text := fit_sentence(result):
        yield Sentence(text, "note")
    text, carries_over = prediction_sentence(result)
    if text:
        tone: Tone = "note" if carries_over is None else "good" if carries_over else "warning"
        yield Sentence(text, tone)


def _gain(content: ReportContent) -> Iterable[Sentence]:
    """What was gained on the nominal values, over all sections and at most and least."""
    gains = [gain for gain in improvements(content) if gain.reduction is not None]
    if not gains:
        return
    first, *others = gains
    fell = (first.reduction or 0.0) > 0
    text = f"The error of {first.name} {'fell' if fell else 'rose'}"
    text += f" from {first.told(first.nominal)} at the nominal values to {first.told(first.tuned)}"
    text += f", by {number(abs(first.reduction or 0.0), 2)} %"
    if len(others) > 1:
        low, high = (pick(gain.reduction or 0.0 for gain in others) for pick in (min, max))
        text += f"; the errors of single sections are reduced by {number(low, 2)} to {number(high, 2)} %"
    yield Sentence(f"{text}.", "good" if fell else "warning")


def _closeness(share: float) -> tuple[str, Tone]:
    if share <= _CLOSE:
        return "that is close", "good"
    return (
        ("that is fair", "note")
        if share <= _POOR
        else ("that is poor: the model misses part of the response", "warning")
    )


def _bounds(result: CalibrationResult) -> Iterable[Sentence]:
    at_bound = [(name, estimate) for name, estimate in result.parameters.items() if estimate.at_bound]
    for name, estimate in at_bound:
        upper = abs(estimate.value - estimate.upper) <= abs(estimate.value - estimate.lower)
        scale = estimate_scale(estimate)
        bound = number((estimate.upper if upper else estimate.lower) / scale.factor, 4)
        text = (
            f"{parameter_label(name, result.parameters)} stands at its {'upper' if upper else 'lower'} bound of "
            f"{f'{bound} {scale.unit}'.rstrip()}: the data would take it further, or do not determine it."
        )
        yield Sentence(text, "warning")
    if not at_bound:
        yield Sentence("No parameter stands at a bound.", "good")


def _identified(result: CalibrationResult) -> Iterable[Sentence]:
    sure: list[str] = []
    for name, estimate in result.parameters.items():
        if estimate.at_bound:
            continue
        label, share = parameter_label(name, result.parameters), interval_share(estimate)
        if share is not None and share < _IDENTIFIED:
            sure.append(f"{label}: {number(100 * share, 2)} %")
        elif share is not None:
            width = f"covers {number(100 * share, 2)} % of" if share <= 1 else "is wider than"
            text = f"{label} is not identified by these data: its 95 % interval {width} the range that was allowed."
            yield Sentence(text, "warning")
        elif (importance := result.importance.get(name)) is not None and importance < _UNIMPORTANT:
            percent = number(100 * importance, 2)
            text = f"{label} is weakly determined: it explains {percent} % of the loss's variation over the search."
            yield Sentence(text, "warning" if name in dict(_material(result)) else "note")
    if sure:
        yield Sentence(f"Identified, with the 95 % interval's share of the allowed range: {'; '.join(sure)}.", "good")


def interval_share(estimate: Estimate) -> float | None:
    """The 95 % interval over the allowed range, in logarithms where the range spans decades; None where unknown."""
    error = estimate.standard_error
    if error is None or estimate.upper <= estimate.lower:
        return None
    if not math.isfinite(error):
        return math.inf
    reach = NORMAL_95 * error
    low, high = estimate.interval or (estimate.value - reach, estimate.value + reach)
    if estimate.lower > 0 and estimate.upper / estimate.lower > _DECADE and low > 0:
        return math.log(high / low) / math.log(estimate.upper / estimate.lower)
    return (high - low) / (estimate.upper - estimate.lower)


def _failures(content: ReportContent) -> Iterable[Sentence]:
    n_trials = sum(len(result.trials) for result in content.results.values())
    n_failed = sum(result.n_failed_trials for result in content.results.values())
    if n_trials and not n_failed:
        yield Sentence(f"All {n_trials} trials were simulated; none failed.", "good")
    elif n_trials:
        groups = [group for result in content.results.values() for group in grouped_failures(result)]
        most = f" Most often: {_sentence(max(groups, key=lambda group: group[1])[0])}" if groups else ""
        tone: Tone = "note" if n_failed <= 0.05 * n_trials else "warning"
        yield Sentence(f"{n_failed} of {n_trials} trials could not be simulated.{most}", tone)


def _unmeasured_pitch(result: CalibrationResult) -> Iterable[Sentence]:
    silent = [name for name, fit in result.experiments.items() if "pitch" not in fit.measured and not fit.distances]
    if silent:
        text = f"Pitch was not measured in {joined(silent)}; there the cable's force and travel alone decide."
        yield Sentence(text, "note")


def _plausible(content: ReportContent) -> Iterable[Sentence]:
    result = content.headline_result
    name = find_parameter(result.parameters, "youngs_modulus")
    if content.print_infill is None or name is None:
        return
    estimate = result.parameters[name]
    low, high = (f"{number(bound / 1e6)}" for bound in content.print_infill.effective_modulus)
    inside = content.print_infill.effective_modulus[0] <= estimate.value <= content.print_infill.effective_modulus[1]
    text = (
        f"E lies {'inside' if inside else 'outside'} the {low} to {high} MPa that the print's infill makes plausible "
        f"(Eq. 5, {100 * content.print_infill.infill:.3g} % infill)."
    )
    yield Sentence(text, "good" if inside else "warning")


def _stability(content: ReportContent) -> Iterable[Sentence]:
    if content.twin is not None and content.twin.falls:
        text = f"In the test that drives the twin furthest: {content.twin.falls} The bench should have seen it too."
        yield Sentence(text, "warning")
    if content.twin is not None and content.twin.crossings:
        yield Sentence(f"In the test that drives the twin furthest, {content.twin.crossings}", "warning")


def _agreement(content: ReportContent) -> Iterable[Sentence]:
    single = {label: result for label, result in content.results.items() if len(result.experiments) == 1}
    found = [
        (label, result.parameters[name])
        for label, result in single.items()
        if (name := find_parameter(result.parameters, "youngs_modulus")) is not None
    ]
    if len(found) < 2:
        return
    low, high = (pick(found, key=lambda pair: pair[1].value) for pick in (min, max))
    ratio = high[1].value / low[1].value
    text = (
        f"Calibrated one by one, E runs from {estimate_text(low[1])} ({result_label(low[0])}) to "
        f"{estimate_text(high[1])} ({result_label(high[0])}), a factor of {number(ratio)}"
    )
    if ratio > 1.15:
        yield Sentence(f"{text}: one modulus does not describe all experiments equally well.", "warning")
    else:
        yield Sentence(f"{text}: the experiments agree.", "good")


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."
