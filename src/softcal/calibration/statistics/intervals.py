"""95 % intervals: the values within the bounds that the loss near its minimum does not exclude.

The minimum's noise is a normal distribution in the unit box of the search, where a parameter searched by its logarithm
is represented by that logarithm. The interval of a parameter is a profile interval: it contains the values at which the
squared distance from the quadratic model's minimum, in the metric of the covariance and minimised over all other
parameters, exceeds the least one in the box by at most t^2, t being Student's. Every parameter stays within its bounds,
the others too. Where no bound is near this is the usual value -+ t standard errors. An end at a bound means that the
data do not exclude the bound; a parameter at its bound may move off it, as far as the data allow, and the others with
it. Where the minimum lies beyond a bound by more than one standard error, model and bounds contradict the data by that
much, and all errors are multiplied by it (`contradiction`), as by Birge's ratio (Physical Review 40, 1932); so do a
prior and the data that are more than three standard errors from each other (`prior_distances`).

The standard error is half the interval's length over t, computed without the parameter's own bounds. A variable that
maps the bounds to infinity (a logit) would not do: the response of elements that do not lock is smooth up to nu = 0.5,
and an interval in logit(nu) excludes the values next to it, however uninformative the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from softcal.checks import Floats

CONFIDENCE = 0.95
OFF_PRIOR = 3.0  # standard errors
"""A prior contradicts the data where they are further from each other than this."""
_NEAR = 1e-9  # standard errors
_DOUBLINGS = 60
_ALONE = 1e-6  # of a prior's variance: with less the prior alone determines the parameter


def box_intervals(z: Floats, minimum: Floats, root: Floats, dof: Floats) -> tuple[Floats, Floats]:
    """The 95 % intervals (size, 2) and standard errors (size,) in the unit box.

    Parameters
    ----------
    z, minimum
        The estimate, within the box, and the minimum of the unbounded quadratic model, shape (size,).
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


def nearest_within(minimum: Floats, root: Floats) -> Floats:
    """The point (size,) of the unit box that is nearest to the minimum in the metric of the covariance."""
    return _Profile(minimum, root).best


def beyond_bounds(minimum: Floats, root: Floats) -> Floats:
    """Distance of each parameter's own bounds from the best value without them, in standard errors, shape (size,).

    Its square is the decrease of the squared distance from the minimum when these bounds are removed and the others
    stay; zero where the parameter's bounds are not active. minimum, root: as for `box_intervals`.
    """
    if np.all((minimum >= 0.0) & (minimum <= 1.0)):
        return np.zeros(len(minimum))
    profile = _Profile(minimum, root)
    return np.array([profile.held_by(j) for j in range(len(minimum))])


def contradiction(beyond: Floats, off_prior: Floats) -> float:
    """By how much model and bounds, or a prior, contradict the data, at least one: the largest of `beyond_bounds`, and
    of the `prior_distances` that chance does not explain.

    It is a residual of one degree of freedom, with the expectation of one where the model is right. Of what makes it
    larger, in the robot's law or the rig, the other parameters bear as much as this one.
    """
    return float(max(beyond.max(initial=1.0), off_prior.max(initial=0.0, where=off_prior > OFF_PRIOR)))


def prior_distances(priors: Sequence[tuple[Floats, Floats, float]], inverse: Floats, root: Floats) -> Floats:
    """Distance of each parameter (size,) from the mean of its prior, in standard errors of this distance; zero without
    a prior.

    With the weight w of the prior in the estimate, whose variance is V in units of the prior's, the variance of the
    distance is (1 - w)^2 by the prior and V - w^2 by the data.

    Parameters
    ----------
    priors
        Of each prior: derivative (size,) and pull (size,) of its residual in units of its standard deviation, and the
        residual at the minimum.
    inverse
        Of half the loss's Hessian (size, size).
    root
        As for `box_intervals`.
    """
    found = np.zeros(len(inverse))
    for answer, pull, residual in priors:
        weight = float(pull @ inverse @ answer)
        variance = max(float(np.sum((root @ answer) ** 2)) - weight**2, 0.0) + (1.0 - weight) ** 2
        if variance > _ALONE:
            found[int(np.argmax(np.abs(answer)))] = abs(residual) / np.sqrt(variance)
    return found


def student(dof: Floats) -> Floats:
    """The 97.5 % quantile of Student's t; the normal one where dof is infinite."""
    from scipy.special import ndtri, stdtrit

    tail = 0.5 * (1.0 + CONFIDENCE)
    return np.where(np.isfinite(dof), stdtrit(np.where(np.isfinite(dof), dof, 1.0), tail), ndtri(tail))


class _Profile:
    """The squared distance from the minimum in the metric of the covariance, least over the others within the box."""

    def __init__(self, minimum: Floats, root: Floats) -> None:
        # In units of standard errors, so that every column has norm about one.
        self._errors = np.linalg.norm(root, axis=0)
        spread = root / self._errors
        self._rows = np.linalg.inv(np.linalg.qr(spread)[1]).T
        self._covariance = spread.T @ spread
        self._minimum = minimum
        self._low, self._high = -minimum / self._errors, (1.0 - minimum) / self._errors
        self._best = self._least(None, 0.0)
        self._base = self._distance(self._best)

    @property
    def best(self) -> Floats:
        """The point of least distance within the box."""
        return self._minimum + self._best * self._errors

    def end(self, j: int, side: float, t: float, error: float) -> float:
        """Distance of the interval's end from parameter j on one side, without its own bounds."""
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
        """Distance from parameter j's active bound to its best value without the bound, in standard errors."""
        away = np.arange(len(self._minimum)) == j
        low, high = np.where(away, -np.inf, self._low), np.where(away, np.inf, self._high)
        free = self._nearest(self._rows, np.zeros(len(away)), low, high)
        return float(np.sqrt(max(self._base - self._distance(free), 0.0)))

    def _least(self, j: int | None, step: float) -> Floats:
        """The nearest point of the box to the minimum with parameter j displaced by a step; all as steps."""
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
