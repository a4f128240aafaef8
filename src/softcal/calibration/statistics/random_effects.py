"""Estimates of one quantity from several experiments: their mean, and whether they differ beyond their errors.

    y_i = mu + b_i + e_i,    b_i ~ N(0, tau^2),    e_i ~ N(0, v_i)

Whether tau is zero is tested by Cochran's Q, in Welch's form where the v_i are themselves estimated (Biometrika 38,
1951). tau^2 and mu are those of `mixed_effects`; the interval of mu is Hartung's and Knapp's (Statistics in Medicine
20, 2001), by Student's t with one degree of freedom less than there are experiments.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from softcal.calibration.statistics.mixed_effects import mixed_effects
from softcal.checks import Floats
from softcal.display import displayed

Kind = Literal["experiments", "set-ups"]
WORDS: Mapping[str, str] = {"experiments": "tests", "set-ups": "set-ups"}
"""Kind -> its word in sentences."""
DIFFERS = 0.05
"""Chance below which experiments count as different."""


@dataclass(frozen=True)
class RandomEffects:
    """Mean and spread of one quantity over several experiments.

    Attributes
    ----------
    q
        Cochran's Q of the estimates.
    chance
        Probability that experiments without any difference differ as much.
    spread
        tau, the standard deviation between the experiments.
    mean
        mu.
    error
        Standard error of mu.
    dof
        Its degrees of freedom.
    """

    q: float
    chance: float
    spread: float
    mean: float
    error: float
    dof: int

    @property
    def differs(self) -> bool:
        """Whether the experiments differ by more than their errors allow."""
        return self.chance < DIFFERS

    def among(self, n: int) -> RandomEffects:
        """The same, with the chance that one of n such comparisons shows as much."""
        return replace(self, chance=min(1.0, n * self.chance))


@displayed
@dataclass(frozen=True)
class Spread:
    """One parameter in several experiments.

    Attributes
    ----------
    values
        Experiment -> its own value [SI], the other shared parameters at their joint values.
    q, dof, chance
        Cochran's Q of these values, its degrees of freedom, and the probability that experiments which do not differ
        show as much (Welch's test).
    spread
        Standard deviation between experiments [SI].
    next_interval
        Ends [SI] of the interval in which a further experiment of this kind is expected at 95 %, within the bounds of
        the search; None for two experiments, which are too few to say.
    weights
        Experiment -> weight of its value in their mean [-], sum 1.
    kind
        "experiments" or "set-ups"; for set-ups, read "set-up" in the place of "experiment" everywhere here.
    """

    values: Mapping[str, float]
    q: float
    dof: int
    chance: float
    spread: float
    next_interval: tuple[float, float] | None
    weights: Mapping[str, float] = field(default_factory=dict[str, float])
    kind: Kind = "experiments"

    @property
    def differs(self) -> bool:
        """Whether the experiments differ by more than their noise explains."""
        return self.chance < DIFFERS


def random_effects(values: Floats, variances: Floats, dof: Floats) -> RandomEffects:
    """Mean and spread of some estimates.

    Parameters
    ----------
    values, variances
        The estimates (k,), k > 1, and the variances (k,) of their errors.
    dof
        Degrees of freedom (k,) of each variance, infinite where it is known.
    """
    q, chance = welch_test(values, variances, dof)
    found = mixed_effects(values, variances)
    return RandomEffects(q, chance, found.spread, float(found.beta[0]), float(found.errors[0]), found.dof)


def welch_test(values: Floats, variances: Floats, dof: Floats) -> tuple[float, float]:
    """Cochran's Q of some estimates, and the chance of it where none differ.

    Parameters
    ----------
    values, variances, dof
        See `random_effects`.
    """
    from scipy.special import chdtrc, fdtrc

    k = len(values)
    weights = 1.0 / variances
    total = weights.sum()
    q = float(weights @ (values - weights @ values / total) ** 2)
    lack = float(np.sum((1.0 - weights / total) ** 2 / dof)) / (k**2 - 1)
    if lack <= 0.0:
        return q, float(chdtrc(k - 1, q))
    return q, float(fdtrc(k - 1, 1.0 / (3.0 * lack), q / (k - 1) / (1.0 + 2.0 * (k - 2) * lack)))
