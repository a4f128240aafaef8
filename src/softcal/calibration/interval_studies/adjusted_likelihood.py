"""The likelihood of the measurements that goes with the estimator's covariance, as a sum of squares of exact residuals.

Only the loss `likelihood`, with the right noise, is a likelihood. For any loss the estimator (`estimator.py`) knows the
covariance C of its minimum m, with noise that is correlated along the records and differences between experiments. With
the loss's square weights W and the derivatives J at the calibrated values, W^(1/2) J = Q R, minus twice the
log-likelihood is taken as

    s^T C^-1 s + k |(1 - Q Q^T) W^(1/2) r|^2,    s = z_0 - m + R^-1 Q^T W^(1/2) (r - r_0)

at the residuals r of the twin, exact at every z. s is what the linear estimator makes of them: for a linear twin
s = z - m, the second term is constant, and the likelihood is the quadratic model of the quick intervals. Where C is the
inverse of R^T R (the likelihood with the right noise), k is 1 and the sum is the loss itself, r^T W r. Else the second
term, which only curvature changes, counts by the geometric mean k of the ratio of C^-1 to R^T R. Chandler and Bate
(Biometrika 94, 2007) adjust the likelihood of independent noise to correlated noise in this sense, as a whole.

Priors count as they do in the loss.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.loss import Block, Loss, fitted_exactly
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.statistics.convergence import distance_to_minimum
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.estimator import Estimator, unseen_parameters
from softcal.calibration.statistics.local_model import LocalModel, Point, jacobian_of
from softcal.calibration.statistics.sensitivity import local_estimator, local_statistics
from softcal.checks import Floats
from softcal.errors import Fault, InputError, SimulationError

NO_MINIMUM = 0.5
"""Standard errors: values further than this from the minimum of the loss do not show the noise."""
_RUN = "softcal calibrate with the method least-squares, to its end"


@dataclass(frozen=True)
class Whitened:
    """Independent residuals of unit variance at one point.

    Attributes
    ----------
    residual
        Shape (m,): the sum of their squares is minus twice the log-likelihood.
    jacobian
        d residual / dz, shape (m, size).
    """

    residual: Floats
    jacobian: Floats

    @property
    def value(self) -> float:
        """Minus twice the log-likelihood, up to a constant."""
        return float(self.residual @ self.residual)


class AdjustedLikelihood:
    """Turns blocks of residuals into independent ones of unit variance.

    loss, blocks, slopes: at the calibrated point z of the unit box, with d theta / dz (size,); found: the estimator
    there, which identifies every parameter.
    """

    def __init__(self, loss: Loss, found: Estimator, z: Floats, blocks: Sequence[Block], slopes: Floats) -> None:
        self._roots = [np.sqrt(loss.square_weights(block, block.residual)) for block in blocks]
        rows = self._weighted([jacobian_of(block) * slopes for block in blocks])
        self._axes, upper = np.linalg.qr(rows)
        factor = np.linalg.inv(np.linalg.qr(found.root)[1]).T  # factor.T @ factor is the inverse of the covariance
        self._by_step = factor @ np.linalg.inv(upper)
        self._offset = factor @ (z - found.minimum) - self._by_step @ (self._axes.T @ self._residual(blocks))
        logs = np.linalg.slogdet(factor)[1] - np.linalg.slogdet(upper)[1]
        self._root_share = float(np.exp(logs / len(z)))

    def whitened(self, blocks: Sequence[Block], slopes: Floats) -> Whitened:
        """The residuals of all blocks, which have jacobians; slopes: d theta / dz (size,)."""
        residual = self._independent(self._residual(blocks))
        residual[: len(self._offset)] += self._offset
        return Whitened(residual, self._independent(self._weighted([jacobian_of(b) * slopes for b in blocks])))

    def _independent(self, rows: Floats) -> Floats:
        """Rows (m, ...) of the sum of squares, of weighted residuals or their derivatives (n, ...)."""
        inside = self._axes.T @ rows
        return np.concatenate([self._by_step @ inside, self._root_share * (rows - self._axes @ inside)])

    def _residual(self, blocks: Sequence[Block]) -> Floats:
        return self._weighted([block.residual for block in blocks])

    def _weighted(self, parts: Sequence[Floats]) -> Floats:
        return np.concatenate([(p.T * root).T for p, root in zip(parts, self._roots, strict=True)])


@dataclass(frozen=True)
class Calibrated:
    """A calibrated problem: its values, their quick intervals, and the likelihood of its measurements.

    Attributes
    ----------
    problem
        The problem.
    z
        The calibrated values in the unit box, shape (size,).
    evaluation
        The evaluation there, with jacobians.
    estimates
        Label -> value with its quick interval.
    found
        The linearised estimator there.
    likelihood
        The likelihood that goes with it.
    """

    problem: Problem
    z: Floats
    evaluation: Evaluation
    estimates: Mapping[str, Estimate]
    found: Estimator
    likelihood: AdjustedLikelihood

    def whitened(self, z: Floats, evaluation: Evaluation) -> Whitened:
        """The independent residuals of an evaluation at z."""
        return self.likelihood.whitened(evaluation.blocks, self.problem.space.jacobian(z))


def calibrated(problem: Problem, theta: Mapping[str, float]) -> Calibrated:
    """Evaluate the problem once at its calibrated values theta [SI by label], and find the noise there.

    Raises
    ------
    InputError
        Where theta is no minimum of the loss, the noise cannot be estimated there, or the data do not identify every
        parameter.
    SimulationError
        Where the twin cannot be simulated there.
    """
    space, loss = problem.space, problem.loss
    evaluation = problem.evaluate(theta, jacobian=True)
    if evaluation.loss is None:
        raise SimulationError(f"The twin cannot be simulated at the calibrated values. {evaluation.failure}")
    blocks = evaluation.blocks
    n, size = sum(len(block.residual) for block in blocks), space.size
    if n <= size:
        got = f"{n} measured value{'s' * (n > 1)} and {size} parameter{'s' * (size > 1)}"
        raise _refused("there are no more measured values than parameters, so the noise cannot be estimated", got)
    if exact := fitted_exactly(loss, blocks):
        got = f"{exact[0].channel} in {exact[0].experiment}"
        raise _refused("a channel is fitted exactly, so its noise cannot be estimated", got, "measured data")
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    here = Point(z, blocks)
    away = distance_to_minimum(space, loss, here, LocalModel(space, loss, here))
    if away > NO_MINIMUM:
        got = f"values {away:.2g} standard errors from it"
        raise _refused("the noise can be estimated only at a minimum of the loss", got, _RUN)
    slopes = space.jacobian(z)
    found = local_estimator(space, loss, z, blocks, problem.uncertain)
    if found.spent:
        got = " and ".join(found.spent)
        raise _refused("there are no more measured values than parameters, so the noise cannot be estimated", got)
    blind = unseen_parameters(found.unseen)
    if blind.any():
        got = ", ".join(label for label, is_blind in zip(space.labels, blind, strict=True) if is_blind)
        raise _refused("the data do not identify every parameter", got, "fix one of them, or state a prior")
    estimates = local_statistics(space, loss, theta, blocks, problem.uncertain, found).estimates(space, theta)
    return Calibrated(problem, z, evaluation, estimates, found, AdjustedLikelihood(loss, found, z, blocks, slopes))


def _refused(what: str, got: str, attempt: str = "more measurements, or fewer free parameters") -> InputError:
    return InputError(Fault(what, "intervals", got, attempt=attempt))
