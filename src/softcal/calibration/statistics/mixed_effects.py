"""Estimates of one quantity by a linear model with a difference of each one's own (a meta-regression).

    y_i = x_i . beta + b_i + e_i,    b_i ~ N(0, tau^2),    e_i ~ N(0, v_i)

tau^2 is found by REML. Where one estimate is off and the others agree closely, REML may call it an error of that one,
with a tau of zero, although chance does not explain it. Where it is below its interval, tau^2 is that at which the
weighted sum of squares is its expectation (Paule and Mandel, Journal of Research of the NBS 87, 1982). The interval of
tau^2 is that of the Q profile (Viechtbauer, Statistics in Medicine 26, 2007): the values at which the weighted sum of
squares is no rare value of chi-square. Intervals and tests of beta are those of Knapp and Hartung (Statistics in
Medicine 22, 2003), by Student's t and by F, with as many degrees of freedom as there are estimates less coefficients.
With a design of ones, beta is a mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from softcal.calibration.statistics.intervals import CONFIDENCE, student
from softcal.checks import Floats


@dataclass(frozen=True)
class MixedEffects:
    """Estimates of a linear model from several estimates.

    Attributes
    ----------
    beta
        The coefficients (p,).
    covariance
        Theirs (p, p).
    dof
        Degrees of freedom of the covariance.
    spread
        tau, the standard deviation of what the model leaves between the estimates.
    spread_interval
        Ends of its 95 % interval.
    """

    beta: Floats
    covariance: Floats
    dof: int
    spread: float
    spread_interval: tuple[float, float]

    @property
    def errors(self) -> Floats:
        """Standard errors (p,) of the coefficients."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def intervals(self) -> Floats:
        """95 % intervals (p, 2) of the coefficients."""
        half = float(student(np.array(float(self.dof)))) * self.errors
        return np.column_stack([self.beta - half, self.beta + half])

    def at(self, row: Floats) -> tuple[float, float]:
        """The model's value at a row (p,) of a design, and its standard error."""
        return float(row @ self.beta), float(np.sqrt(row @ self.covariance @ row))

    def chance(self, contrasts: Floats) -> float:
        """Probability of contrasts (q, p) as large as those of the coefficients where all of them are zero."""
        from scipy.special import fdtrc

        found = contrasts @ self.beta
        size = len(contrasts)
        ratio = float(found @ np.linalg.solve(contrasts @ self.covariance @ contrasts.T, found)) / size
        return float(fdtrc(size, self.dof, ratio))


def mixed_effects(values: Floats, variances: Floats, design: Floats | None = None) -> MixedEffects:
    """The model of some estimates.

    Parameters
    ----------
    values, variances
        The estimates (k,), and the variances (k,) of their errors.
    design
        Shape (k, p), ones by default, k > p.
    """
    X = np.ones((len(values), 1)) if design is None else design
    k, p = X.shape
    from scipy.optimize import minimize_scalar

    largest = max(float(np.var(values)), float(variances.max())) * 10
    found: Any = minimize_scalar(
        lambda x: _restricted(np.exp(x), values, variances, X),
        bounds=np.log([1e-6 * variances.min(), largest]),
        method="bounded",
    )
    tau2 = float(np.exp(found.x)) if found.fun < _restricted(0.0, values, variances, X) else 0.0
    low, high = _profile(values, variances, X)
    if tau2 < low**2:
        tau2 = _at_squares(float(k - p), values, variances, X)
    beta, inverse, squares = _fitted(tau2, values, variances, X)
    # Never shorter than by the errors alone.
    covariance = max(1.0, squares / (k - p)) * inverse
    return MixedEffects(beta, covariance, k - p, float(np.sqrt(tau2)), (low, high))


def _restricted(tau2: float, values: Floats, variances: Floats, X: Floats) -> float:
    _, inverse, squares = _fitted(tau2, values, variances, X)
    return squares + float(np.log(variances + tau2).sum() - np.linalg.slogdet(inverse)[1])


def _fitted(tau2: float, values: Floats, variances: Floats, X: Floats) -> tuple[Floats, Floats, float]:
    """The coefficients (p,) at a tau^2, the inverse (p, p) of their information, and the weighted sum of squares."""
    weights = 1.0 / (variances + tau2)
    inverse: Floats = np.linalg.inv((weights[:, None] * X).T @ X).astype(float)
    beta = inverse @ (X.T @ (weights * values))
    return beta, inverse, float(weights @ (values - X @ beta) ** 2)


def _profile(values: Floats, variances: Floats, X: Floats) -> tuple[float, float]:
    """The 95 % interval of tau."""
    from scipy.special import chdtri

    tail, dof = 0.5 * (1.0 - CONFIDENCE), X.shape[0] - X.shape[1]
    squares = (float(chdtri(dof, chance)) for chance in (tail, 1.0 - tail))
    low, high = (float(np.sqrt(_at_squares(one, values, variances, X))) for one in squares)
    return low, high


def _at_squares(squares: float, values: Floats, variances: Floats, X: Floats) -> float:
    """The tau^2 at which the weighted sum of squares is this; zero where it is less without any."""
    from scipy.optimize import brentq

    def excess(tau2: float) -> float:
        return _fitted(tau2, values, variances, X)[2] - squares

    if excess(0.0) <= 0.0:
        return 0.0
    most = float(np.var(values)) + float(variances.max())
    while excess(most) > 0.0:
        most *= 4.0
    return cast("float", brentq(excess, 0.0, most, xtol=1e-9 * most))
