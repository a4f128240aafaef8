"""Hierarchical model of a fleet: the population mean of a parameter, and the spread between its specimens.

A specimen's estimate is the mean of the population, a difference of the specimen's own, and the error of its
calibration (`calibration.statistics.mixed_effects`). A parameter that is searched by its logarithm is compared by its
logarithm: its mean is then the geometric one, and its spread a ratio. Each p-value is multiplied by the number of
comparisons (Bonferroni), so that equal specimens are called different in any comparison one time in twenty.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.calibration.problem.parameters import Scale
from softcal.calibration.statistics.intervals import student
from softcal.calibration.statistics.mixed_effects import mixed_effects
from softcal.calibration.statistics.random_effects import DIFFERS, welch_test
from softcal.checks import Floats
from softcal.display import displayed
from softcal.plugins.fleet.specimen import Factor, Specimen, own_error

Interval = tuple[float, float]
FEWEST = 2
"""Least number of specimens for a mean and a spread of the population."""
FEWEST_NEXT = 5
"""Least number of specimens for an interval of a further specimen with the stated coverage."""
FEWEST_OUTLIER = 5
FEWEST_RANKED = 8
OUTLYING = 0.01
"""Chance below which a specimen is not like the others."""
MOST_LEFT_OUT = 0.1
"""Share of the specimens that may be left out; beyond it, the others are a biased selection."""


@dataclass(frozen=True)
class Comparable:
    """The determined estimates of one parameter, on the scale of their comparison.

    Attributes
    ----------
    label, unit, scale
        The parameter, its SI unit, and the scale of its search.
    names
        Specimens (k,).
    values
        Their estimates (k,), logarithms on the log scale.
    raw
        The variances (k,) of their errors, estimated with `dof` (k,) degrees of freedom.
    left_out
        Specimen -> the reason why it is left out, in words.
    """

    label: str
    unit: str
    scale: Scale
    names: tuple[str, ...]
    values: Floats
    raw: Floats
    dof: Floats
    left_out: Mapping[str, str]

    @property
    def is_pooled(self) -> bool:
        """True if the errors depend on the value: weighted by errors, specimens on one side would count more."""
        from scipy.stats import spearmanr

        if len(self.names) < FEWEST_RANKED or np.ptp(self.raw) == 0.0 or np.ptp(self.values) == 0.0:
            return False
        found: Any = spearmanr(self.values, self.raw)
        return bool(found.pvalue < DIFFERS)

    @property
    def variances(self) -> Floats:
        """Variances (k,) whose inverses have no bias: larger with few degrees of freedom; the same mean for all if they
        depend on the value.
        """
        if self.is_pooled:
            return np.full_like(self.raw, self.raw.mean())
        lack = np.where(np.isfinite(self.dof), 2.0 / np.maximum(self.dof, 2.5), 0.0)
        return self.raw / (1.0 - lack)

    def only(self, kept: np.ndarray) -> Comparable:
        """Specimens of a mask (k,)."""
        names = tuple(name for name, keep in zip(self.names, kept, strict=True) if keep)
        return replace(self, names=names, values=self.values[kept], raw=self.raw[kept], dof=self.dof[kept])

    def shown(self, value: float) -> float:
        """A value on the scale of the comparison, converted to the parameter's [unit]."""
        return math.exp(value) if self.scale == "log" else value


@dataclass(frozen=True)
class Outlier:
    """A specimen unlike the others; value [unit], chance: probability of a specimen so far off among as many alike."""

    name: str
    value: float
    chance: float


@displayed
@dataclass(frozen=True)
class Population:
    """One parameter over the specimens.

    Attributes
    ----------
    label, unit, scale
        The parameter, its SI unit, and the scale of its search and of this comparison.
    n
        Specimens that count.
    left_out
        Specimen -> why it does not count.
    mean, interval
        Of the population [unit]; on the log scale the geometric mean.
    spread, spread_interval
        Standard deviation between the specimens, beyond their errors [unit]; on the log scale of the logarithm [-].
    q, chance
        Cochran's Q of the estimates, and the probability that specimens without any difference differ as much.
    further
        Interval [unit] in which a further specimen is expected at 95 %; None where the specimens are fewer than five
        or do not differ.
    is_pooled
        True if all specimens count alike, since their errors depend on the value.
    outliers
        The specimens that are not like the others, the farthest first.
    without
        The same without the outliers; None where there are none.
    """

    label: str
    unit: str
    scale: Scale
    n: int
    left_out: Mapping[str, str]
    mean: float
    interval: Interval
    spread: float
    spread_interval: Interval
    q: float
    chance: float
    further: Interval | None
    is_pooled: bool = False
    outliers: tuple[Outlier, ...] = ()
    without: Population | None = None

    @property
    def differs(self) -> bool:
        """True if the specimens differ by more than their errors."""
        return self.chance < DIFFERS


def compared(label: str, specimens: Sequence[Specimen]) -> Comparable | None:
    """The determined estimates of a parameter over the specimens; None if no specimen has an estimate."""
    held = {one.name: one.parameters[label] for one in specimens if label in one.parameters}
    if not held:
        return None
    first = next(iter(held.values()))
    scale: Scale = "log" if first.scale == "log" else "linear"
    left_out: dict[str, str] = {}
    for name, e in held.items():
        low, high = e.interval or (e.value, e.value)
        if e.at_bound:
            left_out[name] = "at a bound"
        elif not own_error(e):
            left_out[name] = "no standard error"
        elif low <= e.lower or high >= e.upper:
            left_out[name] = "its interval reaches a bound"
    names = tuple(name for name in held if name not in left_out)
    values = np.array([held[name].value for name in names])
    errors = np.array([own_error(held[name]) or math.nan for name in names])
    dof = np.array([held[name].dof or math.inf for name in names])
    if scale == "log":
        values, errors = np.log(values), errors / values
    return Comparable(
        label=label, unit=first.unit, scale=scale, names=names, values=values, raw=errors**2, dof=dof, left_out=left_out
    )


def comparisons(specimens: Sequence[Specimen]) -> tuple[list[Comparable], dict[str, str]]:
    """Parameters that can be compared, and reasons why others cannot, by label."""
    found: list[Comparable] = []
    unknown: dict[str, str] = {}
    for label in dict.fromkeys(label for one in specimens for label in one.parameters):
        one = compared(label, specimens)
        if one is None:
            continue
        k, n = len(one.names), len(one.names) + len(one.left_out)
        if len(one.left_out) > MOST_LEFT_OUT * n:
            reasons = dict.fromkeys(one.left_out.values())
            unknown[label] = f"{len(one.left_out)} of {n} specimens do not determine it ({'; '.join(reasons)})"
        elif k < FEWEST:
            unknown[label] = "there is one specimen"
        else:
            found.append(one)
    return found, unknown


def population(one: Comparable, n_compared: int = 1, covariate: Mapping[str, float] | None = None) -> Population:
    """Mean, spread and outliers of one parameter over the specimens.

    Parameters
    ----------
    one
        Estimates of the parameter over the specimens.
    n_compared
        Number of parameters that are compared.
    covariate
        Covariate [-] by specimen, such as the logarithm of the infill; None for no covariate.
    """
    far = outliers(one, n_compared, covariate)
    whole = _population(one, n_compared)
    names = {outlier.name for outlier in far}
    kept = np.array([name not in names for name in one.names])
    rest = _population(one.only(kept), n_compared) if far else None
    return replace(whole, outliers=far, without=rest)


def _population(one: Comparable, n_compared: int) -> Population:
    fit = mixed_effects(one.values, one.variances)
    q, chance = welch_test(one.values, one.raw, one.dof)
    chance = min(1.0, n_compared * chance)
    k = len(one.names)
    further = None
    if k >= FEWEST_NEXT and chance < DIFFERS:
        half = float(student(np.array(k - 2.0))) * math.hypot(fit.spread, float(fit.errors[0]))
        further = (one.shown(float(fit.beta[0]) - half), one.shown(float(fit.beta[0]) + half))
    low, high = fit.intervals[0].tolist()
    return Population(
        label=one.label,
        unit=one.unit,
        scale=one.scale,
        n=k,
        left_out=one.left_out,
        mean=one.shown(float(fit.beta[0])),
        interval=(one.shown(low), one.shown(high)),
        spread=fit.spread,
        spread_interval=fit.spread_interval,
        q=q,
        chance=chance,
        further=further,
        is_pooled=one.is_pooled,
    )


def outliers(one: Comparable, n_compared: int = 1, covariate: Mapping[str, float] | None = None) -> tuple[Outlier, ...]:
    """Specimens that are farther from all others than these are from each other, the farthest first.

    Parameters
    ----------
    one
        Estimates of the parameter over the specimens.
    n_compared
        Number of parameters that are compared.
    covariate
        Covariate [-] by specimen, such as the logarithm of the infill; None for no covariate.
    """
    from scipy.special import stdtr

    outlying: list[Outlier] = []
    left = one
    while len(left.names) > FEWEST_OUTLIER and len(outlying) < len(one.names) // 5:
        columns = [np.ones(len(left.names))]
        if covariate is not None and all(name in covariate for name in left.names):
            columns.append(np.array([covariate[name] for name in left.names]))
        X = np.column_stack(columns)
        fit = mixed_effects(left.values, left.variances, X)
        size = np.sqrt(fit.spread**2 + left.variances)
        worst = int(np.argmax(np.abs(left.values - X @ fit.beta) / size))
        kept = np.arange(len(left.names)) != worst
        # The probability that a further specimen is as far from the others as this one.
        others = left.only(kept)
        fit = mixed_effects(others.values, others.variances, X[kept])
        value, error = fit.at(X[worst])
        size = math.sqrt(fit.spread**2 + float(left.variances[worst]) + error**2)
        chance = 2.0 * float(stdtr(fit.dof, -abs(float(left.values[worst]) - value) / size))
        chance = chance * len(left.names) * n_compared
        if chance >= OUTLYING:
            break
        outlying.append(Outlier(left.names[worst], one.shown(float(left.values[worst])), chance))
        left = others
    return tuple(outlying)


def levels(specimens: Sequence[Specimen], factor: str) -> dict[Factor, int]:
    """Known values of a factor, with the number of specimens of each."""
    found: dict[Factor, int] = {}
    for one in specimens:
        if (value := one.factors.get(factor)) is not None:
            found[value] = found.get(value, 0) + 1
    return found
