"""Agreement of separate fits of one robot: do their estimates differ by more than their noise explains?

Cochran's Q (Biometrics 10, 1954) of the fits' values y (logarithms, where all are positive) with standard errors s by
noise is sum (y - mean)^2 / s^2, the mean weighted by 1 / s^2. If one value describes all fits, Q is distributed as
chi^2 with one degree of freedom less than the number of fits. What is uncertain in all fits alike (friction, a gain) is
not in s: it moves all values together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.experiment import rig_kind
from softcal.calibration.results.result import SearchResult
from softcal.calibration.statistics.estimate import Estimate

LIMIT = 0.05  # p-value below which fits count as different


@dataclass(frozen=True)
class Agreement:
    """One parameter of the robot in several separate fits.

    Attributes
    ----------
    name
        Name of the parameter.
    estimates
        Label of the fit -> estimate.
    q, dof, chance
        Cochran's Q, its degrees of freedom and p-value; Q and p are None if fewer than two fits have a standard error.
    """

    name: str
    estimates: Mapping[str, Estimate]
    q: float | None = None
    dof: int = 0
    chance: float | None = None

    @property
    def differs(self) -> bool:
        """True if the fits differ by more than their noise explains."""
        return self.chance is not None and self.chance < LIMIT

    @property
    def least(self) -> tuple[str, Estimate]:
        """The fit with the smallest value."""
        return min(self.estimates.items(), key=lambda pair: pair[1].value)

    @property
    def largest(self) -> tuple[str, Estimate]:
        """The fit with the largest value."""
        return max(self.estimates.items(), key=lambda pair: pair[1].value)

    @property
    def uncounted(self) -> tuple[str, ...]:
        """Labels of the fits without a standard error."""
        return tuple(label for label, e in self.estimates.items() if not e.noise_error)


def agreements(results: Mapping[str, SearchResult]) -> tuple[Agreement, ...]:
    """Agreement of each robot parameter that was estimated by several fits of one experiment each."""
    from scipy.special import chdtrc

    found: dict[str, dict[str, Estimate]] = {}
    for label, result in results.items():
        if len(result.experiments) == 1:
            for name, estimate in result.parameters.items():
                if "[" not in name and all(rig_kind(target) is None for target in estimate.of or (name,)):
                    found.setdefault(name, {})[label] = estimate
    agreed: list[Agreement] = []
    for name, estimates in found.items():
        pairs = [(e.value, error) for e in estimates.values() if (error := e.noise_error)]
        if len(estimates) > 1 and len(pairs) < 2:
            agreed.append(Agreement(name, estimates))
        elif len(pairs) > 1:
            values, errors = np.array(pairs, dtype=float).T
            if np.all(values > 0):
                values, errors = np.log(values), errors / values
            weights = errors**-2
            mean = float(weights @ values / weights.sum())
            q, dof = float(weights @ (values - mean) ** 2), len(pairs) - 1
            agreed.append(Agreement(name, estimates, q, dof, float(chdtrc(dof, q))))
    return tuple(agreed)
