"""Conclusions of a report as sentences: bounds, failures, identifiability, residuals, agreement, plausibility."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from softcal.analysis.agreement import agreements
from softcal.calibration.results.digits import interval_share
from softcal.calibration.results.result import SearchResult
from softcal.calibration.search.outcome import beyond_text, bound_note, saturated_note
from softcal.calibration.statistics.estimate import Remark, Tone
from softcal.report.agreement import (
    agreement_sentences,
    chance_text,
    left_out_sentence,
    range_text,
    residual_sentences,
    size_text,
    spread_sentences,
)
from softcal.report.closeness import closeness_by_experiment, misses_of, record_sentence
from softcal.report.comparison import improvements
from softcal.report.content import ReportContent
from softcal.report.cycles import cycle_sentences
from softcal.report.first_screen import FirstScreen, is_poor, three_sentences
from softcal.report.format import (
    MANY,
    few,
    find_parameter,
    joined,
    number,
    parameter_label,
    result_label,
)
from softcal.report.headline import headline
from softcal.report.positions import fit_sentence, prediction_sentence
from softcal.report.tables import grouped_failures
from softcal.sensing.channel import channel_name, in_a_word, of_actuator
from softcal.twin.parameter_name import parameter_name
from softcal.units import AS_WRITTEN, format_quantity

# An estimate is identified if its 95 % interval covers less than this share of the allowed range.
_IDENTIFIED = 0.25
# From this share on the interval covers the whole allowed range.
_ALL = 0.999
_ENDED = "How the search ended: "
# Without a standard error: below this importance a parameter hardly affects the loss.
_UNIMPORTANT = 0.10


def first_screen(content: ReportContent) -> FirstScreen:
    """The contents of a report's first screen."""
    lead = headline(content).lead
    return FirstScreen(content.results, content.headline, content.samples, content.recorded, content.mesh_study, lead)


@dataclass(frozen=True)
class Verdict:
    """The summary of a report: what casts doubt on it, and its three sentences."""

    warnings: tuple[str, ...]
    sentences: tuple[str, ...]
    tone: Tone

    @property
    def text(self) -> str:
        """All in one."""
        return " ".join([*self.warnings, *self.sentences])


def verdict(content: ReportContent) -> Verdict:
    """Summary of the report: the most serious warnings, then the three sentences of the first screen."""
    results, of = content.judged, first_screen(content)
    grave = [
        *_unconverged(results),
        *_saturated(results),
        *_few(_bounds(results, held=True), "contradict a bound"),
        *_differences(content),
    ]
    others = [s for s in (*_bounds(results), *_identified(results)) if s.tone == "warning"]
    told = any(not one.is_determined for one in of.material)  # the second sentence says so
    doubts = [*(grave or ([] if told else others[:1])), *_stability(content)]
    off = any(one.contradicts_prior for result in results.values() for one in result.parameters.values())
    missed = any(one.tone == "warning" for result in results.values() for one in residual_sentences(result))
    tone: Tone = "warning" if doubts or others or off or is_poor(of) else "note" if missed else "good"
    return Verdict(tuple(doubt.text for doubt in doubts), tuple(three_sentences(of)), tone)


def conclusions(content: ReportContent) -> list[Remark]:
    """All conclusions on the judged results and on the agreement of separate fits; warnings first."""
    results = content.judged
    remarks = [
        *_unconverged(results),
        *_saturated(results),
        *agreement_sentences(content.results),
        *_each(results, lambda result: spread_sentences(result, content.recorded)),
        *(
            remark
            for result in results.values()
            if not result.is_saturated
            for remark in closeness_by_experiment(misses_of(content.samples, result))
        ),
        *_each(results, residual_sentences),
        *_each(results, lambda result: _said(left_out_sentence(result))),
        *(
            Remark(_of(label, content.judged, text), "note")
            for label in content.judged
            if (text := record_sentence(content, label))
        ),
        *_each(results, lambda result: map(Remark, cycle_sentences(result))),
        *_each(results, lambda result: (*_said(fit_sentence(result)), *filter(None, [prediction_sentence(result)]))),
        *_gain(content),
        *_few(_bounds(results), "parameters are at a bound"),
        *_few(_identified(results), "parameters are in the table"),
        *_plausible(content),
        *_stability(content),
        *_failures(content),
        *_unmeasured_pitch(results),
        *_notes(results),
        *_each(results, lambda result: _said("" if result.missed_minimum else f"{_ENDED}{_sentence(result.status)}")),
    ]
    return sorted(remarks, key=lambda sentence: ("warning", "good", "note").index(sentence.tone))


def _few(sentences: Iterable[Remark], what: str) -> Iterable[Remark]:
    """The sentences by tone; of many sentences the first ones, and one on the number of the others."""
    by_tone: dict[Tone, list[Remark]] = {}
    for one in sentences:
        by_tone.setdefault(one.tone, []).append(one)
    for tone, held in by_tone.items():
        yield from held[:MANY]
        if len(held) > MANY:
            yield Remark(f"{len(held) - MANY} more {what}.", tone)


def _of(label: str, results: Mapping[str, SearchResult], text: str) -> str:
    """A sentence, preceded by the label of its calibration if there are several."""
    return f"{result_label(label)}: {text}" if len(results) > 1 else text


def _each(results: Mapping[str, SearchResult], make: Callable[[SearchResult], Iterable[Remark]]) -> Iterable[Remark]:
    """The remarks that `make` returns on each result, with the label of its calibration if there are several."""
    for label, result in results.items():
        for remark in make(result):
            yield replace(remark, text=_of(label, results, remark.text))


def _said(text: str) -> list[Remark]:
    return [Remark(text)] if text else []


def _unconverged(results: Mapping[str, SearchResult]) -> Iterable[Remark]:
    for label, result in results.items():
        if result.missed_minimum:
            text = f"The search did not converge, so the values do not minimise the loss: {_sentence(result.status)}"
            yield Remark(_of(label, results, text), "warning")


def _saturated(results: Mapping[str, SearchResult]) -> Iterable[Remark]:
    for label, result in results.items():
        if result.is_saturated:
            yield Remark(_of(label, results, saturated_note(result).text), "warning")


def _differences(content: ReportContent) -> Iterable[Remark]:
    """Significant differences between separate fits, short enough for the summary."""
    differing = [one for one in agreements(content.results) if one.differs]
    names = [one.name for one in differing]
    for one in differing:
        text = (
            f"{parameter_label(one.name, names)} differs between the separate fits by {size_text(one)} "
            f"({range_text(one)}), more than their noise explains ({chance_text(one)})."
        )
        yield Remark(text, "warning")


def _gain(content: ReportContent) -> Iterable[Remark]:
    """Improvement over the nominal values: over all sections, and the least and greatest of a section."""
    gains = [gain for gain in improvements(content) if gain.reduction is not None]
    if not gains or content.headline_result.is_saturated:
        return
    first, *others = gains
    fell = (first.reduction or 0.0) > 0
    text = f"The error of {first.name} {'fell' if fell else 'rose'}"
    text += f" from {first.error_text(first.nominal)} at the nominal values to {first.error_text(first.tuned)}"
    text += f", by {number(abs(first.reduction or 0.0), 2)} %"
    if len(others) > 1:
        low, high = (pick(gain.reduction or 0.0 for gain in others) for pick in (min, max))
        text += f"; the errors of single sections are reduced by {number(low, 2)} to {number(high, 2)} %"
    yield Remark(f"{text}.", "good" if fell else "warning")


def _bounds(results: Mapping[str, SearchResult], *, held: bool = False) -> Iterable[Remark]:
    """Parameters at a bound, and why; held: only parameters whose optimum lies beyond the bound."""
    at_bound = [(label, *pair) for label, one in results.items() for pair in one.parameters.items() if pair[1].at_bound]
    if held:
        at_bound = [one for one in at_bound if one[2].is_contradicted]
    for label, name, estimate in at_bound:
        upper = abs(estimate.value - estimate.upper) <= abs(estimate.value - estimate.lower)
        bound = format_quantity(estimate.upper if upper else estimate.lower, estimate.unit, digits=AS_WRITTEN)
        name = parameter_label(name, results[label].parameters)
        at = f"{'upper' if upper else 'lower'} bound of {bound}"
        share = interval_share(estimate)
        if estimate.is_contradicted:
            why = beyond_text(estimate)
        elif share is None:
            why = "the loss decreases beyond the bound, or the data do not determine the parameter."
        elif share < _IDENTIFIED:
            allowed = "within the noise, the data exclude neither this value nor values beyond the bound."
            why = "the loss decreases beyond the bound." if estimate.beyond is None else allowed
        else:
            why = f"the data hardly determine it; its 95 % interval covers {_percent(share)} of the allowed range."
        text = f"{name} is at its {at}: {why}"
        yield Remark(_of(label, results, text), "warning")
    if not at_bound and not held:
        yield Remark("No parameter is at a bound.", "good")


def _identified(results: Mapping[str, SearchResult]) -> Iterable[Remark]:
    sure: list[str] = []
    for of, result in results.items():
        for name, estimate in result.parameters.items():
            if estimate.at_bound:
                continue
            label, share = parameter_label(name, result.parameters), interval_share(estimate)
            if result.is_saturated:
                continue
            if share is not None and share < _IDENTIFIED:
                if parameter_name(name).experiment:  # of one test or set-up: in the table
                    continue
                where = f" ({result_label(of)})" if len(results) > 1 else ""
                sure.append(f"{label}{where}: {_percent(share)}")
            elif share is not None:
                text = f"{label} is not identified by these data: its 95 % interval covers {_percent(share)} of the "
                yield Remark(_of(of, results, f"{text}allowed range."), "warning")
            elif (
                result.extra.get("importance_kind") == "fanova"
                and (part := result.importance.get(name)) is not None
                and part < _UNIMPORTANT
            ):
                text = (
                    f"{label} explains {number(100 * part, 2)} % of the loss's variation over the search; this does "
                    "not measure how well it is determined."
                )
                yield Remark(_of(of, results, text), "note")
    if sure:
        yield Remark(f"Identified, with the 95 % interval's share of the allowed range: {'; '.join(sure)}.", "good")


def _percent(share: float) -> str:
    return "all" if share >= _ALL else f"{number(100 * share, 2)} %"


def _failures(content: ReportContent) -> Iterable[Remark]:
    n_trials = sum(len(result.trials) for result in content.results.values())
    n_failed = sum(result.n_failed_trials for result in content.results.values())
    if n_trials and not n_failed:
        yield Remark(f"All {n_trials} trials were simulated; none failed.", "good")
    elif n_trials:
        groups = [group for result in content.results.values() for group in grouped_failures(result)]
        most = f" Most often: {_sentence(max(groups, key=lambda group: group[1])[0])}" if groups else ""
        tone: Tone = "note" if n_failed <= 0.05 * n_trials else "warning"
        yield Remark(f"{n_failed} of {n_trials} trials could not be simulated.{most}", tone)


def _unmeasured_pitch(results: Mapping[str, SearchResult]) -> Iterable[Remark]:
    fits = {name: fit for result in results.values() for name, fit in result.experiments.items()}
    silent = [name for name, fit in fits.items() if fit.rmse and all(channel_name(c).kind.drives for c in fit.rmse)]
    if silent:
        where = joined(silent)
        kinds = {c: of_actuator(channel_name(c).kind) for name in silent for c in fits[name].rmse}
        words = dict.fromkeys(in_a_word(kind.name) for pair in kinds.values() for kind in pair[::-1])
        text = f"Neither angles nor positions were compared in {where}; the fit uses {joined(words)} only."
        yield Remark(text, "note")


def _plausible(content: ReportContent) -> Iterable[Remark]:
    if content.print_infill is None:
        return
    least, most = content.print_infill.effective_modulus
    for label, result in content.judged.items():
        name = find_parameter(result.parameters, "youngs_modulus")
        if name is None:
            continue
        estimate = result.parameters[name]
        inside, (low, high) = least <= estimate.value <= most, estimate.interval or (estimate.value,) * 2
        where = "inside" if inside else "above" if estimate.value > most else "below"
        text = (
            f"E is {where} the range that is plausible for the print's infill, {number(least / 1e6)} to "
            f"{number(most / 1e6)} MPa ({100 * content.print_infill.infill:.3g} % infill)"
        )
        tone: Tone = "good" if inside else "note" if low <= most and least <= high else "warning"
        text += ", which the 95 % interval of E reaches." if tone == "note" else "."
        yield Remark(_of(label, content.judged, text), tone)


def _stability(content: ReportContent) -> Iterable[Remark]:
    if content.twin is not None and content.twin.instabilities:
        text = f"In the test with the largest drive: {content.twin.instabilities} Expect the same on the bench."
        yield Remark(text, "warning")
    if content.twin is not None and content.twin.crossings:
        yield Remark(f"In the test with the largest drive, {content.twin.crossings}", "warning")
    if content.twin is not None and content.twin.drawn_out:
        yield Remark(f"In the test with the largest drive: {content.twin.drawn_out}", "warning")
    if content.twin is not None and content.twin.remarks:
        yield Remark(f"In the test with the largest drive: {content.twin.remarks}", "warning")


def _notes(results: Mapping[str, SearchResult]) -> Iterable[Remark]:
    """The notes of the calibrations, each once; with their labels where not all calibrations have the note."""
    found: dict[tuple[str, Tone], list[str]] = {}
    for label, result in results.items():
        own = {bound_note(name, one).text for name, one in result.parameters.items() if one.at_bound}
        own |= {saturated_note(result).text} if result.is_saturated else set()
        for note in result.notes:
            if note.text not in own:  # these are sentences of their own
                found.setdefault((note.text, note.tone), []).append(result_label(label))
    for (note, tone), labels in found.items():
        of = "" if len(labels) == len(results) else f"{joined(few(labels))}: "
        yield Remark(f"{of}{_sentence(note)}", tone)


def _sentence(text: str) -> str:
    text = text.strip()
    return text if text.endswith((".", "!", "?")) else f"{text}."
