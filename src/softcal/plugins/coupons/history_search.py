"""The search for the constants of a law and its history, by least squares from several starts.

A search begins with the law that is nearest to all rows without a history, softer where the history adds stress, or
with the law's typical constants at that modulus, and with times spread over the length of the tests. It is in the unit
box of the bounds, where the positive constants are searched by their logarithms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import CalibrationError
from softcal.plugins.coupons.problem import CouponProblem, apparent_modulus
from softcal.plugins.coupons.search import FURTHER_STARTS, fitted_values, least_squares
from softcal.plugins.coupons.search import STARTS as STARTS_OF_LAW

STARTS = 4
"""Number of starts."""
_ROWS = 120  # of a test, at most, in the searches from the starts
_MARGIN = 1e-9  # of a start to the bounds
_SHARE = 0.5  # of the stiffness that the law keeps at the start
_SPREAD = 0.7  # of the starts, of the logarithms of the constants of the history


def best_values(problem: CouponProblem, start: Floats | None = None) -> Floats:
    """The constants (size,) [SI] of least loss, whether there is a history or not; start: those of nearly the same
    tests, so that few other starts are needed.

    Raises
    ------
    CalibrationError
        Where the material has no stress at the measured strains.
    """
    if problem.constants.parts:
        return fitted_with_history(problem, start, STARTS if start is None else 1)
    return fitted_values(problem, start, STARTS_OF_LAW if start is None else FURTHER_STARTS)


def fitted_with_history(problem: CouponProblem, start: Floats | None = None, starts: int = STARTS) -> Floats:
    """The constants (size,) [SI] of least loss.

    Parameters
    ----------
    problem
        Laws and coupons.
    start
        Constants (size,) [SI] to begin at besides the other starts; None for those alone.
    starts
        Number of the other starts.

    Raises
    ------
    CalibrationError
        Where the material has no stress at any start.
    """
    searched = _Searched(problem)
    # Fewer rows, where a way has many: the time of a search is that of its rows.
    coarse = _Searched(CouponProblem(problem.constants, [one.coarser(_ROWS) for one in problem.coupons], problem.loss))
    candidates = [] if start is None else [start]
    candidates += _drawn(problem, starts - len(candidates))
    ends: list[Any] = [end for values in candidates if (end := coarse.end(values, ftol=1e-5, xtol=None, max_nfev=40))]
    found: Any = None
    if ends:
        best = min(ends, key=lambda end: end.cost)
        found = searched.end(coarse.values(best.x), ftol=1e-10, xtol=1e-10, max_nfev=200)
    if found is None:
        raise CalibrationError(f"{problem.law.name}: there is no stress at the measured strains.")
    return searched.values(found.x)


class _Searched:
    """The residuals in the unit box."""

    def __init__(self, problem: CouponProblem) -> None:
        self._problem, self._space = problem, problem.space

    def values(self, z: Floats) -> Floats:
        """The constants (size,) at a point."""
        return np.array(list(self._space.to_model(z).values()))

    def end(self, values: Floats, **options: Any) -> Any:
        """The end of a search from these constants; None where the material has no stress there."""
        z = self._space.to_search(dict(zip(self._space.labels, values.tolist(), strict=True)))
        z = np.clip(z, _MARGIN, 1.0 - _MARGIN)
        if not np.isfinite(self._residuals(z)).all():
            return None
        return least_squares(self._residuals, z, self._jacobian, bounds=(0.0, 1.0), x_scale="jac", **options)

    def _residuals(self, z: Floats) -> Floats:
        return self._problem.residuals(self.values(z))

    def _jacobian(self, z: Floats) -> Floats:
        return self._problem.jacobian(self.values(z)) * self._space.jacobian(z)


def _drawn(problem: CouponProblem, n: int) -> list[Floats]:
    """n starts (size,)."""
    if n <= 0:
        return []
    law = problem.constants.elastic
    elastic = fitted_values(CouponProblem(law, problem.coupons, problem.loss), starts=FURTHER_STARTS)
    typical = np.array([p.typical for p in law.fitted])
    is_stress = np.array([p.quantity.unit == "Pa" for p in law.fitted])
    typical[is_stress] *= apparent_modulus(problem.coupons) / law.law.shear_modulus(law.theta(typical))
    stress = max(problem.loss.scales.values())
    rng, found = np.random.default_rng(1), list[Floats]()
    parameters = problem.constants.history.parameters
    # Constants of a history of the tests' size: stresses as those measured, times over their length.
    lengths = [float(c.time[-1]) for c in problem.coupons if c.time is not None and c.time[-1] > 0.0]
    times = [p for p in parameters if p.quantity.unit == "s"]
    within = np.geomspace(0.01, 0.3, len(times)) * (max(lengths) if lengths else 1.0)
    by_name = {p.name: float(t) for p, t in zip(times, within, strict=True)}
    of_history = np.array(
        [by_name.get(p.name, 0.3 * stress if p.quantity.unit == "Pa" else p.typical) for p in parameters]
    )
    softer = np.where(is_stress, _SHARE, 1.0)
    for k in range(n):
        spread = np.exp(_SPREAD * rng.normal(size=len(parameters))) if k else np.ones(len(parameters))
        of_law = softer * (typical if k % 2 else elastic)
        found.append(np.concatenate([of_law, of_history * spread]))
    return found
