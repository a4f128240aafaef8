"""Effect of a factor on a fleet's parameters: mean of each group, test of their difference, share of the variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.statistics.mixed_effects import mixed_effects
from softcal.calibration.statistics.random_effects import DIFFERS
from softcal.plugins.fleet.infill_law import INFILL
from softcal.plugins.fleet.population import Comparable, Interval
from softcal.plugins.fleet.specimen import Factor, Specimen

FEWEST_WITHIN = 2
"""Specimens more than groups, so that the spread within these can be told."""


@dataclass(frozen=True)
class Group:
    """The specimens with one value of a factor; mean and its interval [unit]."""

    level: str | float
    n: int
    mean: float
    interval: Interval


@dataclass(frozen=True)
class FactorEffect:
    """One parameter by one factor.

    Attributes
    ----------
    label, factor
        The parameter and the factor.
    groups
        Its values, with the mean of each.
    chance
        Probability that groups which do not differ show as much, of all the comparisons of the fleet.
    explained
        Share of the variance between specimens that is one between the groups [-]; None where specimens do not differ.
    spread
        Standard deviation between the specimens within the groups, on the scale of the comparison.
    at_infill
        The infill at which the means are, where the parameter is compared about its law against the infill; else None.
    """

    label: str
    factor: str
    groups: tuple[Group, ...]
    chance: float
    explained: float | None
    spread: float
    at_infill: float | None = None

    @property
    def differs(self) -> bool:
        """True if the groups differ by more than the specimens within them."""
        return self.chance < DIFFERS


def factor_effects(
    compared: Sequence[Comparable],
    specimens: Sequence[Specimen],
    factors: Sequence[str],
    about: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[tuple[FactorEffect, ...], dict[str, str]]:
    """Effect of every factor on every parameter, and reasons why some factors cannot be compared.

    Parameters
    ----------
    compared
        Estimates of each parameter.
    specimens
        The fleet's specimens.
    factors
        Columns of the table by which specimens are compared.
    about
        Parameter with a law against the infill -> specimen -> logarithm of its infill; effects of other factors on it
        are effects about the law.
    """
    values = {factor: {one.name: one.factors.get(factor) for one in specimens} for factor in factors}
    unknown: dict[str, str] = {}
    for factor, held in values.items():
        known = [value for value in held.values() if value is not None]
        groups = len(set(known))
        if groups < 2:
            unknown[factor] = "all specimens have the same" if known else "no specimen has one"
        elif len(known) < groups + FEWEST_WITHIN:
            unknown[factor] = "there are too few specimens of each"
    pairs = [(one, factor) for one in compared for factor in factors if factor not in unknown]
    logs = {(one.label, factor): (about or {}).get(one.label) if factor != INFILL else None for one, factor in pairs}
    made = [_effect(one, factor, values[factor], logs[one.label, factor]) for one, factor in pairs]
    found = [effect for effect in made if effect is not None]
    return tuple(replace(one, chance=min(1.0, len(found) * one.chance)) for one in found), unknown


def not_apart(specimens: Sequence[Specimen], factors: Sequence[str]) -> list[tuple[str, str]]:
    """Pairs of factors of which the second determines the first: their effects cannot be separated."""
    found: list[tuple[str, str]] = []
    for i, one in enumerate(factors):
        for other in factors[i + 1 :]:
            pairs = {(s.factors.get(one), s.factors.get(other)) for s in specimens}
            firsts, seconds = {a for a, _ in pairs}, {b for _, b in pairs}
            if min(len(firsts), len(seconds)) < 2:
                continue
            if len(pairs) == len(seconds):
                found.append((one, other))
            elif len(pairs) == len(firsts):
                found.append((other, one))
    return found


def _effect(
    one: Comparable, factor: str, held: Mapping[str, Factor], logs: Mapping[str, float] | None
) -> FactorEffect | None:
    logs = logs or None
    kept = [held.get(name) is not None and (logs is None or name in logs) for name in one.names]
    own = one.only(np.array(kept, dtype=bool))
    of = [held[name] for name in own.names]
    levels = sorted(
        dict.fromkeys(level for level in of if level is not None),
        key=lambda level: (1, 0.0, level) if isinstance(level, str) else (0, level, ""),
    )
    x = None if logs is None else np.array([logs[name] for name in own.names])
    size = len(levels) + (x is not None)
    if len(levels) < 2 or len(of) < size + FEWEST_WITHIN:
        return None
    beside = np.empty((len(of), 0)) if x is None else (x - x.mean())[:, None]
    X = np.hstack([[[float(level == other) for other in levels] for level in of], beside])
    ones = np.hstack([np.ones((len(of), 1)), beside])
    if np.linalg.matrix_rank(X) < size:
        return None
    fit, whole = mixed_effects(own.values, own.variances, X), mixed_effects(own.values, own.variances, ones)
    contrasts = np.column_stack(
        [-np.ones(len(levels) - 1), np.eye(len(levels) - 1), np.zeros((len(levels) - 1, size - len(levels)))]
    )
    explained = max(0.0, 1.0 - fit.spread**2 / whole.spread**2) if whole.spread > 0.0 else None
    groups = [
        Group(level, of.count(level), own.shown(float(mean)), (own.shown(float(low)), own.shown(float(high))))
        for level, mean, (low, high) in zip(levels, fit.beta[: len(levels)], fit.intervals[: len(levels)], strict=True)
    ]
    at = None if x is None else float(np.exp(x.mean()))
    return FactorEffect(
        label=one.label,
        factor=factor,
        groups=tuple(groups),
        chance=fit.chance(contrasts),
        explained=explained,
        spread=fit.spread,
        at_infill=at,
    )
