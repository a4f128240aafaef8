"""One local search by exact sensitivities: a trust region around `LocalModel`, asked and told.

Why not `scipy.optimize.least_squares`: it cannot be told that a point has no equilibrium (here the trust region shrinks
and the search goes on from where it was), it minimises sums of squares while the papers' loss is a sum of RMSEs, it
calls the function itself so that starts cannot share workers nor a run resume, and it cannot use what is known of the
twin's scaling, which saves more than half of the trajectories.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.calibration.local_model import LocalModel, Point, ceiling_powers
from softcal.calibration.loss import Loss, PapersLoss, RelativeSquares, rms, total
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.problem import Evaluation
from softcal.checks import Floats

_SMALL_STEP = 3e-7  # of the search range: E over 0.1-40 MPa to 2e-6 relative
_SMALL_GAIN = 1e-8  # of the loss
_SHORT_STEP = 1e-4  # of the search range: one this short that does not keep its promise has met the twin's rounding
_APART = 1e-3  # of the search range
_EXACT = 1e-9  # RMSE over the root mean square of the measurement, in every channel
_SMALLEST_RADIUS = 1e-7
_EDGE = 1e-4  # of the search range: how near to what cannot be simulated a search goes before it stays there
_WARY = (
    3  # steps after a failed one in which the region does not grow: a quarter of it fits three times before the edge
)
_RETREATS = 8  # halvings of the way from a start that cannot be simulated to the middle of the box


@dataclass
class Descent:
    """A search from one start; `z` is the best point so far and `next` the point to be evaluated, None when over."""

    space: SearchSpace
    loss: Loss
    start: Floats
    budget: int

    def __post_init__(self) -> None:
        self.next: Floats | None = self.start
        self.z: Floats = self.start
        self.best: Evaluation | None = None
        self.status = "The search has not begun."
        self.evaluations = 0
        self.converged = False
        self._radius = 1.0
        # Along the valley in which E makes up for what nu does, one channel is met almost exactly. There a sum of RMSEs
        # has a kink, which lets only short steps lower it. So the way in goes by squares, the end by the loss itself.
        self._merit: Loss = RelativeSquares() if isinstance(self.loss, PapersLoss) else self.loss
        self._promised = 0.0
        self._retreats = 0
        self._since_failure = _WARY
        self._seen: list[tuple[Floats, Evaluation]] = []

    def tell(self, evaluation: Evaluation) -> None:
        """What came of `next`; decides the next `next`."""
        if self.next is None:
            raise RuntimeError("the descent is over")
        self.evaluations += 1
        tried = self.next
        if evaluation.loss is not None:
            self._seen.append((tried, evaluation))
        if self.best is None or self.best.loss is None:
            if evaluation.loss is None:
                self._retreat(tried, evaluation.failure)
                return
            self._move(tried, evaluation)
        else:
            self._judge_step(tried, evaluation, self._value(self.best))
        if self.evaluations >= self.budget and self.next is not None:
            self._end(f"Stopped after {self.evaluations} trajectories, before the search had converged.")

    def abandon(self, reason: str) -> None:
        """End the search because it would only repeat another."""
        self._end(reason, converged=True)

    def _judge_step(self, tried: Floats, evaluation: Evaluation, before: float) -> None:
        length = float(np.abs(tried - self.z).max())
        if evaluation.loss is None:
            self._since_failure = 0
            self._radius = 0.25 * length
            if self._radius < _EDGE:
                self._end(
                    f"Ended after {self.evaluations} trajectories at the edge of what can be simulated: the loss still "
                    f"falls towards where it is not. {evaluation.failure}",
                    converged=True,
                )
            else:
                self._propose()
            return
        self._since_failure += 1
        promised = before - self._promised
        value = self._value(evaluation)
        kept = (before - value) / promised if promised > 0 else 0.0
        if kept < 0.25:
            self._radius = 0.35 * length
        elif kept > 0.75 and length > 0.99 * self._radius and self._since_failure > _WARY:
            self._radius = min(1.0, 3.0 * self._radius)
        if value < before:
            self._move(tried, evaluation)
        if kept < 0.25 and length < _SHORT_STEP:
            self._arrive(
                f"Converged in {self.evaluations} trajectories: a step of {length:.1e} of the search range changes the "
                "loss by no more than the twin's rounding."
            )
        elif not value < before:
            self._propose()

    def _move(self, z: Floats, evaluation: Evaluation) -> None:
        self.z, self.best = z, evaluation
        if all(rms(b.residual) <= _EXACT * rms(b.measured) for b in evaluation.blocks):
            self._end("Converged: the measurements are met to nine digits by every channel.", converged=True)
            return
        self._propose()

    def _propose(self) -> None:
        if self.best is None or self.best.loss is None:
            raise RuntimeError("there is no point to step from")
        if self._radius < _SMALLEST_RADIUS:
            self._end("Stopped: no step, however small, lowers the loss or can be simulated.", converged=False)
            return
        lower, upper = np.maximum(self.z - self._radius, 0.0), np.minimum(self.z + self._radius, 1.0)
        here, other = Point(self.z, self.best.blocks), self._other()
        powers = None if other is None else ceiling_powers(self.space, here, other)
        model = LocalModel(self.space, self._merit, here, other, powers)
        candidate = model.minimise(lower, upper)
        self._promised = model.loss(candidate)
        step = float(np.abs(candidate - self.z).max())
        value = self._value(self.best)
        gain = (value - self._promised) / value
        if step <= _SMALL_STEP or gain <= _SMALL_GAIN:
            self._arrive(
                f"Converged in {self.evaluations} trajectories: the next step would be {step:.1e} of the search range "
                f"and lower the loss by {max(gain, 0.0):.1e} of itself."
            )
            return
        self.next = candidate

    def _value(self, evaluation: Evaluation) -> float:
        """What the search goes by."""
        return total(self._merit, evaluation.blocks)

    def _arrive(self, status: str) -> None:
        """End the search; or, where it went by squares, go on by the loss itself from the best point it has seen."""
        if self._merit is self.loss:
            self._end(status, converged=True)
            return
        self._merit, self._radius = self.loss, 1.0
        self.z, self.best = min(self._seen, key=lambda seen: total(self.loss, seen[1].blocks))
        self._propose()

    def _other(self) -> Point | None:
        """The last simulated point that is far enough from the best one to tell more than its own rounding."""
        for z, evaluation in reversed(self._seen):
            if float(np.abs(z - self.z).max()) > _APART:
                return Point(z, evaluation.blocks)
        return None

    def _retreat(self, tried: Floats, reason: str) -> None:
        if self._retreats >= _RETREATS or self.evaluations >= self.budget:
            self._end(f"No point near the start could be simulated. {reason}")
            return
        self._retreats += 1
        self.next = 0.5 * (tried + 0.5)

    def _end(self, status: str, *, converged: bool = False) -> None:
        self.next = None
        self.status = status
        self.converged = converged
