"""The statement on one parameter, in words and as a budget: value, 95 % interval, and the sources of its error.

The budget is the variance of the estimate by source. The mesh is no random error: where a mesh study foretells the
shift of the estimate by refinement, its square counts beside the variance, as in a mean square error. The interval does
not include it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from softcal.analysis.mesh_study import MeshStudy
from softcal.calibration.problem.uncertain import EACH
from softcal.calibration.results.digits import (
    NORMAL_95,
    estimate_text,
    half_width,
    interval_text,
    is_determined,
    value_text,
)
from softcal.calibration.statistics.between_markers import MARKERS
from softcal.calibration.statistics.budget import BOUNDS
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.noise import DRIFT, MISFIT
from softcal.report.format import parameter_label
from softcal.twin.parameter_name import parameter_name
from softcal.units import format_range

MESH = "mesh"


@dataclass(frozen=True)
class ErrorSource:
    """A source of error: a noun phrase for sentences, a short name for bars and tables; what reduces it, a clause."""

    kind: str
    words: str
    short: str
    remedy: str


SOURCES = (
    ErrorSource(
        "noise",
        "the noise of the measurements",
        "noise",
        "more independent measurements, or better ones, will reduce it; softcal next-test ranks further tests",
    ),
    ErrorSource(
        DRIFT,
        "drifts of the instruments, too small to be seen in their noise",
        "drift",
        "a closer limit on them, such as the data sheet's under uncertain:, will reduce it",
    ),
    ErrorSource(
        MISFIT,
        "what the model misses in the residuals, or may miss",
        "misfit",
        "a model with its cause, where the notes name one, will reduce it",
    ),
    ErrorSource(
        "experiments",
        "differences between the tests",
        "tests",
        "more samples of the same tests will not reduce it; further tests, or the cause of the differences, will",
    ),
    ErrorSource(
        "set-ups",
        "differences between the set-ups",
        "set-ups",
        "more tests on the same ones will not reduce it; further ones, or the cause of the differences, will",
    ),
    ErrorSource(
        MARKERS,
        "differences between the markers",
        "markers",
        "more samples of the same markers will not reduce it; markers placed more exactly, or more of them, will",
    ),
    ErrorSource("prior", "the priors", "priors", "a better measurement of what they describe will reduce it"),
    ErrorSource(MESH, "the mesh", "mesh", "softcal mesh-study shows whether a finer mesh reduces it"),
    ErrorSource(
        BOUNDS,
        "other parameters, which the data leave open within the bounds",
        "bounds",
        "a measurement of them, or narrower bounds, will reduce it",
    ),
)


@dataclass(frozen=True)
class Statement:
    """The statement on one parameter.

    Attributes
    ----------
    name, label
        Its name, and its symbol or short label.
    estimate
        Its estimate.
    budget
        Kind of source -> share of the squared error [-], sum 1, in the order of `SOURCES`; empty where not known, and
        where the data do not determine the parameter, whose interval is then that of its own bounds.
    """

    name: str
    label: str
    estimate: Estimate
    budget: Mapping[str, float]

    @property
    def is_determined(self) -> bool:
        """Whether the 95 % interval excludes more than a tenth of the allowed range; True without a range."""
        return is_determined(self.estimate)

    @property
    def value(self) -> str:
        """The value with its unit, or the interval if the parameter may be anywhere in it."""
        return value_text(self.estimate) if self.is_determined else f"anywhere in {self._reach}"

    @property
    def _reach(self) -> str:
        one = self.estimate
        return interval_text(one) or format_range(one.lower, one.upper, one.unit)

    @property
    def interval(self) -> str:
        """The 95 % interval with its unit; "" if there is none, or if it is the value."""
        return interval_text(self.estimate) if self.is_determined else ""

    @property
    def has_interval(self) -> bool:
        """Whether a 95 % interval is known."""
        return self.estimate.interval is not None

    @property
    def remark(self) -> str:
        """Remarks on the parameter beside its interval."""
        one = self.estimate
        if not self.is_determined:
            return f"the data do not determine it; the twin uses {value_text(one)}"
        parts = ["at a bound"] * one.at_bound
        if one.interval is None:
            parts.append(f"no interval; searched {format_range(one.lower, one.upper, one.unit)}")
        return "; ".join(parts)

    @property
    def sentence(self) -> str:
        """For a list: "E = 3.30 MPa (95 %: 2.81 to 3.76 MPa)", "ν anywhere in 0.4 to 0.4999"."""
        if not self.is_determined:
            return f"{self.label} {self.value}"
        if not self.has_interval:
            return f"{self.label} = {estimate_text(self.estimate)}"
        return f"{self.label} = {self.value} (95 %: {self.interval})"

    @property
    def shares(self) -> list[tuple[ErrorSource, float, str]]:
        """Each source with its share [-] and the share in words."""
        return [(source_of(kind), share, percent(share)) for kind, share in self.budget.items()]

    @property
    def budget_text(self) -> str:
        """The budget in words, the largest share first: "tests 98 %, noise 2 %"."""
        found = sorted(self.shares, key=lambda one: -one[1])
        return ", ".join(f"{source.short} {words}" for source, _, words in found)


def source_of(kind: str) -> ErrorSource:
    """The source of this kind; any other name is that of uncertain parameters."""
    for source in SOURCES:
        if source.kind == kind:
            return source
    written = kind.removesuffix(EACH)
    name, each = parameter_name(written), kind.removeprefix(written)
    is_pattern = any(mark in written for mark in "*?") or not name.owner
    words = written if is_pattern else f"the {name.kind.replace('_', ' ')} ({name.owner})"
    label = written if is_pattern else parameter_label(written)
    return ErrorSource(kind, f"the uncertainty of {words}{each}", label, "measuring it more precisely will reduce it")


def statement(name: str, label: str, estimate: Estimate, study: MeshStudy | None = None) -> Statement:
    """A parameter's estimate with its budget of errors, empty where the data do not determine it.

    Parameters
    ----------
    name
        The parameter.
    label
        Its label, as distinct from the other parameters.
    estimate
        Of a calibration.
    study
        A mesh study; without it, or where it is of another value, the budget has no share of the mesh.
    """
    shares = {kind: share for kind, share in estimate.shares.items() if share > 0.0}
    shift, half, best = 0.0, half_width(estimate), None if study is None else study.best
    if study is not None and best is not None and name in study.of_robot and name in study.parameters:
        is_of_it = math.isclose(study.parameters[name].value, estimate.value, rel_tol=1e-9)
        shift = best.values[name] - estimate.value if is_of_it else 0.0
    if shares and shift and half and MESH not in shares:
        variance = (estimate.standard_error or half / NORMAL_95) ** 2
        total = variance + shift**2
        shares = {kind: share * variance / total for kind, share in shares.items()} | {MESH: shift**2 / total}
    order = [source.kind for source in SOURCES]
    budget = dict(sorted(shares.items(), key=lambda pair: order.index(pair[0]) if pair[0] in order else len(order)))
    stated = Statement(name, label, estimate, budget)
    return stated if stated.is_determined else replace(stated, budget={})


def percent(share: float) -> str:
    """A share in whole per cent; what is below one, or all but one, as such."""
    if 0.0 < share < 0.01:
        return "< 1 %"
    return "> 99 %" if 0.99 < share < 1.0 - 1e-9 else f"{100 * share:.0f} %"


def legend(statements: Iterable[Statement]) -> list[ErrorSource]:
    """The sources that occur in the budgets."""
    return list(dict.fromkeys(source for one in statements for source, *_ in one.shares))
