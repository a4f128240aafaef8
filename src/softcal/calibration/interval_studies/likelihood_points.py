"""SimulatedPoint points of a likelihood, each with the least squares around it, and the likelihood's minimum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.interval_studies.adjusted_likelihood import Calibrated, Whitened
from softcal.calibration.problem.problem import Evaluation
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.optimiser import Proposal
from softcal.checks import Floats
from softcal.errors import CalibrationError

MOST = 12
"""Trajectories for the minimum, or for the end of a profile."""
_FLAT = 1e-3  # of minus twice the log-likelihood: with less left to gain, the minimum is found

Observer = Callable[[int], None]
"""Called after every evaluation with their number."""


class Quadratic:
    """The sum of squares near a simulated point, by its derivatives there."""

    def __init__(self, z: Floats, whitened: Whitened) -> None:
        q, self._rows = np.linalg.qr(whitened.jacobian)
        self._right = q.T @ whitened.residual
        self._rest = max(whitened.value - float(self._right @ self._right), 0.0)
        self._z = z

    def least(self, j: int | None = None, value: float = 0.0) -> tuple[float, Floats]:
        """The least sum of squares in the box and where it is, shape (size,); with parameter j at a value, if given."""
        from scipy.optimize import lsq_linear

        size = len(self._z)
        others = np.array([i for i in range(size) if i != j], dtype=int)
        step = np.zeros(size)
        if j is not None:
            step[j] = value - self._z[j]
        if len(others):
            low, high = -self._z[others], 1.0 - self._z[others]
            target = -(self._right + self._rows @ step)
            # A parameter at its bound has no room on one side; equal bounds are not allowed.
            ends = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
            step[others] = np.clip(lsq_linear(self._rows[:, others], target, ends, method="bvls").x, low, high)
        return self._rest + float(np.sum((self._right + self._rows @ step) ** 2)), self._z + step

    def end(self, j: int, side: int, most: float) -> tuple[float, Floats]:
        """The value of parameter j up to which the least sum of squares is at most `most`, and the others there.

        Parameters
        ----------
        j, side
            Number of the parameter, and its side: -1 towards low values, 1 towards high ones.
        most
            The largest sum of squares.
        """
        from scipy.optimize import brentq

        start = float(self.least()[1][j])
        bound = 1.0 if side > 0 else 0.0
        if start == bound or self.least(j, bound)[0] <= most:
            return bound, self.least(j, bound)[1]
        if self.least(j, start)[0] >= most:
            return start, self.least(j, start)[1]
        found = float(brentq(lambda value: self.least(j, float(value))[0] - most, start, bound, xtol=1e-9))  # pyright: ignore[reportArgumentType]
        return found, self.least(j, found)[1]


@dataclass(frozen=True)
class Seen:
    """A point z (size,) that was simulated, with its residuals, and the least squares around it."""

    z: Floats
    whitened: Whitened
    model: Quadratic

    @property
    def value(self) -> float:
        """Minus twice the log-likelihood, up to a constant."""
        return self.whitened.value


class SimulatedPoint:
    """Simulates points, in parallel, and keeps those that could be: `seen`, the calibrated one first."""

    def __init__(self, held: Calibrated, evaluator: Evaluator, progress: Observer | None) -> None:
        self._held, self._evaluator, self._progress = held, evaluator, progress
        self.n_trajectories = held.evaluation.n_solves
        self.n_evaluations = 1
        self.seen: list[Seen] = []
        self._keep(held.z, held.evaluation)

    def _keep(self, z: Floats, evaluation: Evaluation) -> Seen:
        whitened = self._held.whitened(z, evaluation)
        self.seen.append(Seen(z, whitened, Quadratic(z, whitened)))
        return self.seen[-1]

    def at(self, points: Sequence[Floats]) -> list[Seen | str]:
        """Each point as simulated, or why it cannot be."""
        space = self._held.problem.space
        proposals = [Proposal(self.n_evaluations + i, space.to_model(z)) for i, z in enumerate(points)]
        found: list[Seen | str] = []
        for z, (_, evaluation) in zip(points, self._evaluator.evaluate(proposals), strict=True):
            self.n_evaluations += 1
            self.n_trajectories += evaluation.n_solves
            found.append(evaluation.failure if evaluation.loss is None else self._keep(z, evaluation))
            if self._progress is not None:
                self._progress(self.n_evaluations)
        return found


def likelihood_minimum(simulated: SimulatedPoint, start: Seen) -> Seen:
    """The minimum of the likelihood in the box, by Gauss-Newton steps from a simulated point.

    Raises
    ------
    CalibrationError
        Where it is not found.
    """
    best = start
    _, point = best.model.least()
    for _ in range(MOST):
        value, _ = best.model.least()
        if best.value - value <= _FLAT:
            return best
        tried = simulated.at([point])[0]
        if isinstance(tried, Seen) and tried.value < best.value:
            best, (_, point) = tried, tried.model.least()
        else:
            point = 0.5 * (best.z + point)
    raise CalibrationError(
        f"The minimum of the likelihood was not found in {MOST} trajectories: the calibrated values are no minimum "
        "near which the twin is smooth. Try: softcal calibrate with more starts."
    )
