"""The first screen of a report, and the end of a calibration on the terminal: what is known of each parameter, and
three sentences: the estimates and what they rest on, the largest source of their error, the quality of the fit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.analysis.agreement import agreements
from softcal.analysis.mesh_study import MeshStudy
from softcal.calibration.results.digits import half_width, interval_share, shown, value_text, with_unit
from softcal.calibration.results.result import SearchResult, SweepResult
from softcal.calibration.statistics.budget import BOUNDS
from softcal.calibration.statistics.random_effects import WORDS, Spread
from softcal.calibration.statistics.residuals import FEWEST, ResidualRecord
from softcal.calibration.statistics.sensitivity import INSEPARABLE, NO_EFFECT
from softcal.experiments.dataset import Dataset
from softcal.report.agreement import range_text, trend_sentences
from softcal.report.closeness import Miss, closeness, misses_of, poor_text, worst_of
from softcal.report.content import judged
from softcal.report.format import (
    joined,
    material_kinds,
    ordered_parameters,
    parameter_label,
    result_label,
)
from softcal.report.positions import fitted_distance
from softcal.report.statement import MESH, ErrorSource, Statement, source_of, statement
from softcal.sensing.channel import readings
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import kinds_of_quantity
from softcal.units import format_quantity, plain

_FEW = 4  # parameters that are all shown
_MOST = 5  # parameters that are shown of more
_ALL = 1.0 - 1e-9  # a larger share is the whole


@dataclass(frozen=True)
class FirstScreen:
    """The contents of the first screen.

    Attributes
    ----------
    results
        Label -> every result.
    first
        Label of the one that is shown first.
    samples, records
        Experiment -> its compared samples; its record with times.
    study
        Mesh study of one of the results.
    lead
        What comes before the estimates.
    """

    results: Mapping[str, SearchResult]
    first: str
    samples: Mapping[str, Dataset] = field(default_factory=dict[str, Dataset])
    records: Mapping[str, Dataset] = field(default_factory=dict[str, Dataset])
    study: MeshStudy | None = None
    lead: str = ""

    @property
    def judged(self) -> dict[str, SearchResult]:
        """The results that are judged."""
        return judged(self.results, self.first)

    @property
    def statements(self) -> list[Statement]:
        """Statements on every parameter of the judged results: of the material first, of single tests last."""
        results = self.judged
        names = sorted(ordered_parameters(results), key=lambda name: bool(parameter_name(name).experiment))
        several = len(results) > 1
        return [
            statement(
                name,
                parameter_label(name, result.parameters) + (f" in {result_label(label)}" if several else ""),
                result.parameters[name],
                self.study,
            )
            for name in names
            for label, result in results.items()
            if name in result.parameters
        ]

    @property
    def shown(self) -> tuple[list[Statement], list[Statement]]:
        """The statements that are shown, and the statements that are folded away."""
        statements = self.statements
        shared = [one for one in statements if not parameter_name(one.name).experiment] or statements
        n = len(statements) if len(statements) <= _FEW else len(shared[:_MOST])
        return statements[:n], statements[n:]

    @property
    def material(self) -> list[Statement]:
        """The statements on the material; on what all tests share, if no constant of the material was free."""
        kinds = material_kinds(self.judged.values())
        of_material = [one for one in self.statements if parameter_name(one.name).kind in kinds]
        return of_material or self.shown[0]


def three_sentences(of: FirstScreen) -> list[str]:
    """The estimates and what they rest on, the largest source of their error, and the quality of the fit."""
    results, misses = of.judged, _misses(of)
    parts = [text for word in dict.fromkeys(miss.word for miss in misses) if (text := worst_of(misses, word))]
    near = [(label, text) for label, one in results.items() if (text := fitted_distance(one))]
    if near:
        places = joined(f"{text}{f' in {label}' if len(results) > 1 else ''}" for label, text in near)
        parts.append(f"the markers to {places}")
    fit = f"The twin reproduces {joined(parts)}." if parts else ""
    return [text for text in (_estimates(of), _largest_source(of), fit) if text]


def is_poor(of: FirstScreen) -> bool:
    """Whether a channel is reproduced poorly."""
    return any(closeness([miss])[1] == "warning" for miss in _misses(of))


def budget_note(of: FirstScreen) -> str:
    """Sentence on the meaning of the budgets, and on the mesh in them and in the intervals; "" without a budget."""
    budgets = [one.budget for one in of.statements if one.budget]
    if not budgets:
        return ""
    bounds = f"{BOUNDS.capitalize()}: {source_of(BOUNDS).words}. " if any(BOUNDS in one for one in budgets) else ""
    if any(MESH in one.estimate.shares for one in of.statements):
        return f"{bounds}The intervals include the mesh's share."
    if any(MESH in budget for budget in budgets):
        return (
            f"{bounds}The mesh's share is the square of the shift that its study expects; the intervals do not include "
            "it."
        )
    return f"{bounds}The mesh's share is not included; softcal mesh-study estimates it."


def _estimates(of: FirstScreen) -> str:
    results, material = of.judged, of.material
    if not material:
        return ""
    if len(results) > 1:
        ranges = {one.name: range_text(one) for one in agreements(of.results)}
        names = list(dict.fromkeys(one.name for one in material))
        parts: list[str] = []
        for name in names:
            label, statements = parameter_label(name, names), [one for one in material if one.name == name]
            if any(one.is_determined for one in statements):
                value = ranges[name] if name in ranges else value_text(statements[0].estimate)
                parts.append(f"{label} = {value} test by test")
            else:
                parts.append(f"{label} not determined in any test")
        early = joined(result_label(label) for label, result in results.items() if result.missed_minimum)
        doubt = f"; not found yet: the minimum of {early}" if early else ""
        if not any(result.is_saturated for result in results.values()) and (poor := poor_text(_misses(of))):
            doubt += f"; the twin does not fit all measurements ({poor})"
        return f"{joined(parts)}, from {len(results)} separate fits{doubt}."
    parts = [one.sentence for one in material[:_FEW]]
    parts += [f"{len(material) - _FEW} more"] if len(material) > _FEW else []
    (result,) = results.values()
    names = [one.name for one in material]
    beyond = {name: one.beyond for name, one in result.parameters.items() if one.is_contradicted}
    doubts: list[str] = []
    if beyond:
        by = joined(f"{parameter_label(name, result.parameters)} by about {far:.0f}" for name, far in beyond.items())
        far = f"best fit beyond the bound of {by} standard errors"
        doubts.append(f"model and bounds contradict the data ({far})")
    if off := {name: one.off_prior for name, one in result.parameters.items() if one.contradicts_prior}:
        by = joined(f"of {parameter_label(name, result.parameters)} by about {far:.0f}" for name, far in off.items())
        doubts.append(f"prior and data contradict each other (that {by} standard errors)")
    if any(not one.has_interval for one in material) and (why := _inseparable(result)):
        doubts.append(why[:1].lower() + why.partition(":")[0][1:])
    apart = _contradictions(result, names)  # of which a poor fit follows
    if not apart and not result.is_saturated and (poor := poor_text(_misses(of))):
        doubts.append(f"the twin does not fit the measurements ({poor})")
    for name, spread in apart.items():
        estimate, values = result.parameters[name], spread.values.values()
        ends = with_unit(estimate, f"{shown(estimate, min(values))} to {shown(estimate, max(values))}")
        doubts.append(f"no single {parameter_label(name, result.parameters)} fits the {WORDS[spread.kind]} ({ends})")
    lead = of.lead + "".join(f"{doubt}; " for doubt in doubts)
    n = len(result.experiments)
    basis = f"{n} tests" if n > 1 else "one test"
    records = _records(result)
    if any(one.are_alike for one in records):
        total, worth = sum(one.n for one in records), sum(min(max(one.effective, 1.0), one.n) for one in records)
        basis += f" whose {total} measured values are correlated and worth {plain(round(worth), 2)} independent values"
    return f"{lead[:1].upper()}{lead[1:]}{joined(parts)}, from {basis}."


def _contradictions(result: SearchResult, names: Iterable[str]) -> dict[str, Spread]:
    """The parameters in which the tests differ by more than half the interval; less is a small share of the error."""
    differing = {name: spread for name in names if (spread := result.spreads.get(name)) and spread.differs}
    return {
        name: spread
        for name, spread in differing.items()
        if np.ptp(list(spread.values.values())) > (half_width(result.parameters[name]) or 0.0)
    }


def _largest_source(of: FirstScreen) -> str:
    differing = [one for one in agreements(of.results) if one.differs]
    if len(of.judged) > 1 and differing:
        names = [one.name for one in differing]
        which = joined(parameter_label(name, names) for name in names)
        return (
            f"The largest source of error is that the tests differ in {which} by more than their noise explains: "
            "more samples of the same tests will not reduce it; further tests, or the cause of the differences, will."
        )
    material = of.material
    vague = list(dict.fromkeys(one.label for one in material if not one.is_determined))
    cover = "their intervals cover" if len(vague) > 1 else "its interval covers"
    text = f"The data do not determine {joined(vague)}: {cover} nearly the whole allowed range." if vague else ""
    budgeted = [one for one in material if one.is_determined and one.budget]
    if not budgeted:
        return text or _unknown(of)
    widest = max(budgeted, key=lambda one: interval_share(one.estimate) or 0.0)
    names = [one.name for one in material]
    apart = [spread for result in of.judged.values() for spread in _contradictions(result, names).values()]
    first = f"First find why the {WORDS[apart[0].kind]} differ. " if apart else ""
    results = [result for result in of.judged.values() if result.parameters.get(widest.name) == widest.estimate]
    of_what = "squared error" if MESH in widest.budget and MESH not in widest.estimate.shares else "variance"
    _, share, words = max(widest.shares, key=lambda found: found[1])
    lead = f"All of the known {of_what}" if share > _ALL else f"{words.replace('> ', 'More than ')} of the {of_what}"
    lead = f"{lead} of {widest.label} comes"
    parts: list[str] = []
    vague = joined(dict.fromkeys(other.label for other in of.statements if not other.is_determined))
    for source in (source for source, _, as_much in widest.shares if as_much == words):  # several, if shown as equal
        remedy, cause = _remedy(source, of.study, [r for result in results for r in _records(result)]), source.words
        if source.kind == BOUNDS and vague:
            cause, remedy = cause.replace("other parameters", vague), remedy.replace("them", vague)
        parts.append(f"{'As much comes' if parts else lead} from {cause}{remedy and f': {remedy}'}.")
    said = " ".join(parts)
    for result in results[:1]:
        if len(result.experiments) == len(of.judged) == 1:
            said += " By how much tests differ is not known from one."
        said += trend_sentences(result, of.records).get(widest.name, "")
    kinds = {**kinds_of_quantity(), **readings()}
    # Errors of instruments without a statement that would shift the estimate by half its interval.
    errors = [
        f"{name} is off by {format_quantity(size, kind.unit, '%' if kind.unit == '1' else None, digits=2)}"
        for name, size in widest.estimate.moved_by.items()
        for kind in [kinds[parameter_name(name).kind]]
    ]
    if errors:
        lead = f"Not included: {widest.label} shifts by half the length of its interval where"
        said += f" {lead} {' or '.join(errors)}."
    return f"{text} {first}{said}".strip()


def _records(result: SearchResult) -> list[ResidualRecord]:
    return [record for channels in result.residuals.values() for record in channels.values()]


def _remedy(source: ErrorSource, study: MeshStudy | None, records: Sequence[ResidualRecord]) -> str:
    """Sentence on the remedy of an error; "" without one. records: of all channels in which the noise is."""
    if source.kind == MESH and study is not None:
        # A load on one point, or a sharp edge, has no limit: only channels with an order of convergence have.
        orders = [] if study.best is None else [change.order for change in study.best.changes]
        return "a finer mesh will reduce it" if orders and None not in orders else ""
    if source.kind != "noise" or not records:
        return source.remedy
    alike = [record.are_alike for record in records]
    if any(alike):
        along = "it is correlated along the records" if all(alike) else "it is correlated along some of the records"
        further = "further tests, which softcal next-test ranks, will, unless their residuals are the same"
        return f"{along}, where a higher sampling rate will not reduce it; {further}"
    # A few samples do not show whether they err alike, as all samples of a misplaced marker do.
    is_independent = all(record.n >= FEWEST for record in records)
    more = "more samples, or a better sensor, will reduce it; softcal next-test ranks further tests"
    return more if is_independent else source.remedy


def _unknown(of: FirstScreen) -> str:
    """Why the error of the estimates is not known; "" for a sweep, which asks for the best cell only."""
    result = next(iter(of.judged.values()))
    if isinstance(result, SweepResult) or any(one.has_interval for one in of.material):
        return ""
    if result.missed_minimum:
        why = "the search did not converge"
    elif result.is_saturated:
        why = "there are at least as many parameters as measured values"
    elif why := _inseparable(result):
        return why
    else:
        why = "no intervals could be computed"
    return f"Their error is not known: {why}."


def _inseparable(result: SearchResult) -> str:
    """The note on parameters that the data do not determine; "" without one."""
    return next((note.text for note in result.notes if note.text.startswith((INSEPARABLE, NO_EFFECT))), "")


def _misses(of: FirstScreen) -> list[Miss]:
    return [miss for result in of.judged.values() for miss in misses_of(of.samples, result)]
