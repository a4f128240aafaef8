"""The search for a law's constants from several starts, by least squares.

At given ratios and exponents the constants with the unit of a stress enter the stresses linearly, or nearly so: the
search is first in the ratios and exponents alone, with the best constants beside them (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973; derivatives after Kaufman, BIT 15, 1975). The best of these are then refined in
all constants within their bounds.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.errors import CalibrationError
from softcal.plugins.coupons.problem import CouponProblem

STARTS = 20
"""Number of starts of a law with ratios or exponents."""
FURTHER_STARTS = 6
"""Number of starts besides constants that are near."""
_REFINED = 3  # of them
_SPREAD = 8.0  # of the starts of a positive ratio, as a factor; of exponents, their largest magnitude
_TOLERANCE = 1e-12
_FAR = 1e6  # a residual over the scale that no search accepts


def fitted_values(problem: CouponProblem, start: Floats | None = None, starts: int = STARTS) -> Floats:
    """The constants (size,) [SI] of least loss.

    Parameters
    ----------
    problem, start, starts
        See `fitted_with_history`.

    Raises
    ------
    CalibrationError
        Where the law's energy does not exist at any start.
    """
    lower = np.array([p.lower for p in problem.space.parameters])
    upper = np.array([p.upper for p in problem.space.parameters])
    searched = _Projected(problem, lower, upper)
    candidates = [] if start is None else [start]
    candidates += searched.ends(starts)
    best: Any = None
    for x in candidates:
        inside = np.clip(x, lower + 1e-9 * (upper - lower), upper - 1e-9 * (upper - lower))
        if not (np.isfinite(problem.residuals(inside)).all() and np.isfinite(problem.jacobian(inside)).all()):
            continue
        found = least_squares(
            problem.residuals,
            inside,
            problem.jacobian,
            (lower, upper),
            x_scale="jac",
            ftol=_TOLERANCE,
            xtol=_TOLERANCE,
            gtol=1e-15,
            max_nfev=300,
        )
        if best is None or found.cost < best.cost:
            best = found
    if best is None:
        raise CalibrationError(f"{problem.law.name}: the energy does not exist at the measured strains.")
    return np.asarray(best.x, dtype=np.float64)


def least_squares(*given: Any, **options: Any) -> Any:
    """SciPy's, whose types do not allow an exact jacobian."""
    from scipy import optimize

    return optimize.least_squares(*given, **options)


class _Projected:
    """The residuals as functions of the ratios and exponents alone."""

    def __init__(self, problem: CouponProblem, lower: Floats, upper: Floats) -> None:
        self._problem, self._lower, self._upper = problem, lower, upper
        self._fitted = problem.constants.fitted
        self._linear = np.array([p.quantity.unit == "Pa" for p in self._fitted])
        self._last: tuple[bytes, tuple[Floats, Floats]] = (b"", (np.zeros(0), np.zeros((0, 0))))

    def ends(self, n: int) -> list[Floats]:
        """The best ends of searches from n starts, in all constants; of one where there is no ratio or exponent."""
        free = ~self._linear
        if not free.any():
            return [self._complete(np.zeros(0))[0]]
        rng, stretch = np.random.default_rng(1), max(coupon.largest_stretch for coupon in self._problem.coupons)
        found: list[tuple[float, Floats]] = []
        for k in range(n):
            drawn = np.array(
                [p.typical if not k else _drawn(p.typical, p.quantity.lower, stretch, rng) for p in self._fitted]
            )
            x = np.clip(drawn, self._lower, self._upper)[free]
            if np.abs(self._residuals(x)).max() >= _FAR:
                continue
            bounds = self._lower[free], self._upper[free]
            end = least_squares(self._residuals, x, self._jacobian, bounds, x_scale="jac", ftol=1e-6, max_nfev=60)
            found.append((float(end.cost), self._completed(end.x)[0]))
        return [values for _, values in sorted(found, key=lambda one: one[0])[:_REFINED]]

    def _residuals(self, x: Floats) -> Floats:
        residuals = self._problem.residuals(self._completed(x)[0])
        return np.clip(np.nan_to_num(residuals, nan=_FAR), -_FAR, _FAR)

    def _jacobian(self, x: Floats) -> Floats:
        values, basis = self._completed(x)
        J = np.nan_to_num(self._problem.jacobian(values)[:, ~self._linear])
        return J - basis @ (basis.T @ J)

    def _completed(self, x: Floats) -> tuple[Floats, Floats]:
        """All constants, those with the unit of a stress being the best beside x; and a basis of what those change."""
        if self._last[0] != x.tobytes():  # residuals and jacobian are asked for at the same place, one after the other
            self._last = (x.tobytes(), self._complete(x))
        return self._last[1]

    def _complete(self, x: Floats) -> tuple[Floats, Floats]:
        values = np.array([parameter.typical for parameter in self._fitted])
        values[self._linear] = [self._problem.space.start[p.name] for p in self._fitted if p.quantity.unit == "Pa"]
        values[~self._linear] = x
        J, residual = self._problem.jacobian(values)[:, self._linear], self._problem.residuals(values)
        if not (np.isfinite(J).all() and np.isfinite(residual).all()):
            return values, np.zeros((len(residual), 0))
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        left, sizes, right = np.linalg.svd(J / size, full_matrices=False)
        kept = sizes > 1e-10 * sizes[0]
        target = J @ values[self._linear] - residual
        best = right[kept].T @ (left[:, kept].T @ target / sizes[kept]) / size
        values[self._linear] = np.clip(best, self._lower[self._linear], self._upper[self._linear])
        return values, left[:, kept]


def _drawn(typical: float, lower: float, stretch: float, rng: np.random.Generator) -> float:
    """A start of a ratio or an exponent. Limits of chains grow with the largest stretch that was measured."""
    if lower < 0.0:
        return float(rng.uniform(-_SPREAD, _SPREAD))
    return float(typical * np.exp(rng.uniform(-1.0, 1.0) * math.log(_SPREAD * stretch)))
