"""95 % intervals: the values that the loss near its minimum does not exclude, among those that were allowed.

The minimum's noise is a normal distribution in the unit box of the search, where a logarithm that is searched is a
straight line. The interval of a parameter is that of the profile: the values at which the distance from the quadratic
model's minimum, in the metric of the covariance and least over all other parameters, has a square at most t^2 above the
least in the box, t being Student's. Every parameter stays within its bounds, the others too. Where no bound is near
this is the usual value -+ t standard errors. An end at a bound says that the data does not exclude the bound; and a
parameter that is at its bound may leave it, as far as the data lets it, and take the others with it.

The standard error is half the interval's length over t, were the parameter's own bounds away. A variable that has the
bounds at infinity (a logit) would not do: the answer of elements that do not lock is smooth up to nu = 0.5, and an
interval in logit(nu) leaves out what lies next to it, however little the data tells.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from softcal.checks import Floats

CONFIDENCE = 0.95
_NEAR = 1e-9  # standard errors
_DOUBLINGS = 60


def box_intervals(z: Floats, minimum: Floats, root: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """The 95 % intervals (size, 2) and standard errors (size,) in the unit box.

    Parameters
    ----------
    z, minimum
        What was found, within the box, and the minimum of the quadratic model where nothing bounds it, shape (size,).
    root
        `root.T @ root` is the covariance of the minimum.
    dof
        Degrees of freedom of each parameter's variance; infinite where the noise is known.
    """
    profile = _Profile(minimum, root)
    errors = np.linalg.norm(root, axis=0)
    t = student(dof)
    ends = np.empty((len(z), 2))
    stated = np.empty(len(z))
    for j in range(len(z)):
        low, high = (profile.end(j, side, t[j], errors[j]) for side in (-1.0, 1.0))
        stated[j] = (high - low) / (2.0 * t[j])
        ends[j] = min(max(low, 0.0), z[j]), max(min(high, 1.0), z[j])
    return ends, stated


def beyond_bounds(minimum: Floats, root: Floats) -> Floats:
    """How many standard errors each parameter's own bounds are from what fits best without them, shape (size,).

    The square is by how much the distance from the minimum would fall, the others staying within their bounds; zero
    where the parameter's bounds hold nothing. minimum, root: as for `box_intervals`.
    """
    profile = _Profile(minimum, root)
    return np.array([profile.held_by(j) for j in range(len(minimum))])


def student(dof: Floats) -> Floats:
    """The 97.5 % quantile of Student's t; the normal one where dof is infinite."""
    from scipy.special import ndtri, stdtrit

    tail = 0.5 * (1.0 + CONFIDENCE)
    return np.where(np.isfinite(dof), stdtrit(np.where(np.isfinite(dof), dof, 1.0), tail), ndtri(tail))


class _Profile:
    """The squared distance from the minimum in the metric of the covariance, least over the others within the box."""

    def __init__(self, minimum: Floats, root: Floats) -> None:
        # In units of standard errors, such that every column is of the size of one.
        self._errors = np.linalg.norm(root, axis=0)
        spread = root / self._errors
        self._rows = np.linalg.inv(np.linalg.qr(spread)[1]).T
        self._covariance = spread.T @ spread
        self._minimum = minimum
        self._low, self._high = -minimum / self._errors, (1.0 - minimum) / self._errors
        self._best = self._least(None, 0.0)
        self._base = self._distance(self._best)

    def end(self, j: int, side: float, t: float, error: float) -> float:
        """How far parameter j goes on one side, its own bounds away."""
        from scipy.optimize import brentq

        away = side * t * self._covariance[j]
        others = np.arange(len(away)) != j
        inside = np.all((self._low[others] <= away[others]) & (away[others] <= self._high[others]))
        if inside and self._base <= _NEAR:
            return float(self._minimum[j] + away[j] * error)

        def excess(step: float) -> float:
            return self._distance(self._least(j, step)) - self._base - t**2

        near, step = float(self._best[j]), t
        for _ in range(_DOUBLINGS):
            if excess(near + side * step) > 0.0:
                break
            step *= 2.0
        found = cast("float", brentq(excess, near, near + side * step))
        return float(self._minimum[j] + found * error)

    def held_by(self, j: int) -> float:
        """By how many standard errors parameter j's bounds hold it."""
        away = np.arange(len(self._minimum)) == j
        low, high = np.where(away, -np.inf, self._low), np.where(away, np.inf, self._high)
        free = self._nearest(self._rows, np.zeros(len(away)), low, high)
        return float(np.sqrt(max(self._base - self._distance(free), 0.0)))

    def _least(self, j: int | None, step: float) -> Floats:
        """The nearest point of the box to the minimum, where parameter j is a step away from it; all in steps."""
        size = len(self._minimum)
        others = np.array([i for i in range(size) if i != j])
        point = np.zeros(size)
        if j is not None:
            point[j] = step
        if len(others):
            push = self._rows @ point
            point[others] = self._nearest(self._rows[:, others], push, self._low[others], self._high[others])
        return point

    @staticmethod
    def _nearest(rows: Floats, push: Floats, low: Floats, high: Floats) -> Floats:
        from scipy.optimize import lsq_linear

        return lsq_linear(rows, -push, (low, high), method="bvls").x

    def _distance(self, point: Floats) -> float:
        return float(np.sum((self._rows @ point) ** 2))
