"""One local search by exact sensitivities: a trust region around what is predicted, asked and told.

Why not `scipy.optimize.least_squares`: it cannot be told that a point has no equilibrium (here the trust region shrinks
and the search goes on from where it was), it minimises sums of squares while the papers' loss is a sum of RMSEs, it
calls the function itself so that starts cannot share workers nor a run resume, and it cannot use what is known of the
twin's scaling, which saves more than half of the trajectories.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.calibration.local_model import Point
from softcal.calibration.loss import Loss, PapersLoss, RelativeSquares, rms, total
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.prediction import Prediction, predict, way_out
from softcal.calibration.problem import Evaluation
from softcal.checks import Floats

_SMALL_STEP = 3e-7  # of the search range: E over 0.1-40 MPa to 2e-6 relative
_SMALL_GAIN = 1e-5  # of the loss: a sixteenth of the standard error that the noise of 200 samples leaves
_NEAR = 0.01  # of the loss by squares: with no more to gain, the search goes on by the loss itself
# A step this short (of the search range) or of so small a promise (of the loss) that does not keep it has met the
# twin's rounding.
_SHORT_STEP, _SMALL_PROMISE = 1e-4, 1e-4
_EXACT = 1e-9  # RMSE over the root mean square of the measurement, in every channel
_SMALLEST_RADIUS = 1e-7
_MEMORY = 6  # points, the last ones, that shape what is predicted
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
        self.left = False
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

    def leave(self, reason: str) -> None:
        """End the search because nothing better is to be expected of it."""
        self.left = True
        self._end(reason)

    def spend(self, evaluations: int) -> None:
        """Count trajectories that another search has made of this one's budget."""
        self.budget -= evaluations
        if self.evaluations >= self.budget:
            self._end("Stopped: the budget was spent outside the layer in which the start lies.")

    def forecast(self, known: Point) -> Prediction:
        """Where the search would end and with what loss, as it and a point that another one has found make believe."""
        return predict(self.space, self.loss, self._here(), [*self._last(), known], *self._box(1.0))

    def way_out(self) -> Floats | None:
        """Where to begin instead when all that was seen lies in a layer that the search would have to creep through."""
        if len(self._seen) != 1 or self.next is None:
            return None
        return way_out(self.space, self._merit, self._here())

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
        if kept < 0.25 and (length < _SHORT_STEP or promised < _SMALL_PROMISE * before):
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
        predicted = predict(self.space, self._merit, self._here(), self._last(), *self._box(self._radius))
        self._promised = predicted.loss
        step = float(np.abs(predicted.z - self.z).max())
        value = self._value(self.best)
        gain = (value - predicted.loss) / value
        if step <= _SMALL_STEP or gain <= (_SMALL_GAIN if self._merit is self.loss else _NEAR):
            self._arrive(
                f"Converged in {self.evaluations} trajectories: the next step would be {step:.1e} of the search range "
                f"and lower the loss by {max(gain, 0.0):.1e} of itself."
            )
            return
        self.next = predicted.z

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

    def _here(self) -> Point:
        if self.best is None:
            raise RuntimeError("no point has been simulated")
        return Point(self.z, self.best.blocks)

    def _last(self) -> list[Point]:
        return [Point(z, evaluation.blocks) for z, evaluation in self._seen[-_MEMORY:]]

    def _box(self, radius: float) -> tuple[Floats, Floats]:
        return np.maximum(self.z - radius, 0.0), np.minimum(self.z + radius, 1.0)

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
