"""One local search by exact sensitivities: a trust-region method around a local model, driven by ask and tell.

Three rules make it fast and robust:

- points are compared by their loss after the moduli are rescaled (`LocalModel.rescaled`), as in variable projection
  (Golub and Pereyra, SIAM J. Numer. Anal. 10, 1973). Otherwise the search would take tiny steps along the narrow,
  curved valley in which E compensates Poisson's ratio. Where rescaling gives no progress, the loss alone decides; and
  a step that halves the loss, to the lowest so far, is taken in any case.
- it has converged where Gauss-Newton's step to the minimum is shorter than a tenth of a standard error at the lowest
  point simulated, and hardly any reduction of the loss is left (`distance_to_minimum`). A loss may have a kink at its
  minimum, where cables become taut or slack in many samples at once, and its derivative does not vanish: there it has
  converged where a step of a tenth of the standard errors gave nothing. The status reports any other end.
- it follows the model that predicts best the last points simulated (`trusted_model`); where that has no step left,
  Gauss-Newton's is tried.

Why not `scipy.optimize.least_squares`: it cannot handle a point without an equilibrium (here the trust region shrinks
and the search continues from the last point), it minimises sums of squares while the papers' loss is a sum of RMSEs,
and it calls the function itself, so that starts cannot share workers nor a run be resumed. Each step's subproblem is
solved by SciPy.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.loss import Loss, total
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Evaluation
from softcal.calibration.statistics.convergence import NEAR, distance_to_minimum, in_standard_errors, share_of_errors
from softcal.calibration.statistics.estimator import spent_groups
from softcal.calibration.statistics.local_model import LocalModel, Point
from softcal.checks import Floats
from softcal.round_number import roundest

_SETTLED = 0.01  # of the smooth surrogate: with less reduction left, the search continues with the loss itself
_RESCALED = 1e-6  # of the loss after rescaling: with less reduction left, the loss without it decides
_SHORTEST = 0.01 * NEAR  # standard errors: no shorter step is tried
_EDGE = 1e-4  # of the search range: smallest distance kept from points that cannot be simulated
# Steps after a failed one in which the region does not grow: a quarter of it fits three times before the edge.
_WARY = 3
_RETREATS = 8  # halvings of the distance from a start that cannot be simulated to the middle of the box
_FAR = 0.5  # of the loss: a step that promises less than that, or reaches less, begins far from the minimum
_SHORTER, _LONGER = 0.15, 0.025  # of such a step: how far from its end a round value may be
_AS_MUCH = 0.75  # of its gain must be promised there
_MEMORY = 4  # most recent points, by which models are compared
# Of the scaled models' error: Gauss-Newton's must be smaller to replace them, since they extrapolate better.
_CLEARLY = 0.5


@dataclass(eq=False)
class Descent:
    """A search from one start; `z`: its present point; `best`: its best point; `next`: the point to be evaluated.

    `of_paths`: numbers of the parameters by which load paths differ.

    `next` is None when the search is over; `converged` is whether it has reached a minimum.
    """

    space: SearchSpace
    loss: Loss
    start: Floats
    budget: int
    of_paths: Collection[int] = ()

    def __post_init__(self) -> None:
        self.next: Floats | None = self.start
        self.z: Floats = self.start
        self.best: Evaluation | None = None
        self.status = "The search has not begun."
        self.evaluations = 0
        self.converged = False
        self.left = False
        # Far from the minimum a smooth surrogate is minimised, near it the loss itself.
        self._merit: Loss = self.loss.surrogate
        self._rescaling = True
        self._radius = 1.0
        self._promised = 0.0
        self._retreats = 0
        self._since_failure = _WARY
        self._seen: list[tuple[Point, Evaluation]] = []

    def tell(self, evaluation: Evaluation) -> None:
        """Record the evaluation of `next` and decide on the following point."""
        if self.next is None:
            raise RuntimeError("the descent is over")
        self.evaluations += 1
        tried = Point(self.next, evaluation.blocks)
        if evaluation.loss is not None:
            self._seen.append((tried, evaluation))
        if self.best is not None:
            self._judge_step(tried, evaluation)
        elif evaluation.loss is None:
            if self._retreats >= _RETREATS or self.evaluations >= self.budget:
                self._end(f"No point near the start could be simulated. {evaluation.failure}")
            else:
                self._retreats += 1
                self.next = 0.5 * (tried.z + 0.5)
        else:
            self._move(tried, evaluation)
        if self.evaluations >= self.budget and self.next is not None:
            self._end(f"Not converged after {counted(self.evaluations)}, the largest number allowed{self._away()}")

    def leave(self, reason: str) -> None:
        """Abandon the search: no better minimum is expected of it."""
        self.left = True
        self._end(reason)

    def forecast(self) -> tuple[Floats, float]:
        """Predicted minimum (in the unit box) and loss of this search, by its local model."""
        model = self._model(self.loss)
        z = model.minimise(np.zeros(self.space.size), np.ones(self.space.size))
        return z, model.loss(z)

    def _judge_step(self, tried: Point, evaluation: Evaluation) -> None:
        if evaluation.loss is None:
            self._since_failure, self._centre = 0, self.z
            self._radius = 0.25 * float(np.abs(tried.z - self.z).max())
            if self._radius < _EDGE:
                self._end(
                    f"Not converged after {counted(self.evaluations)}: the loss still decreases towards values at "
                    f"which the twin cannot be simulated. {evaluation.failure}"
                )
            else:
                self._propose()
            return
        self._since_failure += 1
        (before, before_rescaled), (after, after_rescaled) = self._losses(self._here()), self._losses(tried)
        gain, promised = before_rescaled - after_rescaled, before_rescaled - self._promised
        if promised <= _RESCALED * before_rescaled:  # rescaling has done what it can
            gain, promised = before - after, before - self._promised
        # What rescaling made of a point far away, whose curve is rough, counts less than a loss that has fallen so far.
        before_that = (total(self._merit, point.blocks) for point, _ in self._seen[:-1])
        fell = after < _FAR * before and all(after < loss for loss in before_that)
        if gain <= 0.0 and after >= before:
            self._centre = self.z
        length = float(np.abs(tried.z - self._centre).max())
        is_poor = gain < 0.25 * promised and not fell
        if is_poor:
            self._radius = 0.35 * length
        elif gain > 0.75 * promised and length > 0.99 * self._radius and self._since_failure > _WARY:
            self._radius = min(1.0, 3.0 * self._radius)
        if (
            is_poor
            and self._merit is self.loss
            and self._has_errors()
            and share_of_errors(self.space, self.loss, self._here(), tried.z - self.z) <= NEAR
        ):
            short = f"a step of less than {NEAR:.1g} standard errors no longer lowers the loss as its slope promises"
            if gain > 0.0:
                self.z, self.best = tried.z, evaluation
            self._end(f"Converged in {counted(self.evaluations)}: {short}.", converged=True)
        elif gain > 0.0 or fell:
            self._move(tried, evaluation)
        else:
            self._propose()

    def _move(self, to: Point, evaluation: Evaluation) -> None:
        self.z, self.best = to.z, evaluation
        self._distance = distance_to_minimum(self.space, self.loss, to, self._model(self.loss))
        # The region is centred at the rescaled moduli: else one that is far off would bound the other parameters.
        self._centre = LocalModel(self.space, self._merit, to).rescaled() if self._rescaling else to.z
        self._propose()

    def _propose(self) -> None:
        """Decide on the next point, or end the search."""
        lowest, found = min(self._seen, key=lambda seen: total(self.loss, seen[0].blocks))
        if self._distance <= NEAR:
            if lowest.z is not self.z:
                self._by_the_loss_alone(lowest, found)
                return
            near = f"{self._distance:.1g}" if self._distance > 1e-3 else "less than 0.001"
            away = f", {near} standard errors away from the minimum" if self._has_errors() else ""
            self._end(f"Converged in {counted(self.evaluations)}{away}.", converged=True)
            return
        before, _ = self._losses(self._here())
        lower, upper = np.maximum(self._centre - self._radius, 0.0), np.minimum(self._centre + self._radius, 1.0)
        for model in (self._model(self._merit), LocalModel(self.space, self._merit, self._here(), plain=True)):
            step = model.minimise(lower, upper)
            self._promised = model.loss(step)
            if self._promised < before and self._length(step) > _SHORTEST:
                break
        by_squares = self._merit is not self.loss
        if by_squares and before - self._promised < _SETTLED * before:
            self._merit, self._radius = self.loss, 1.0
            self._propose()
        elif self._promised < before and self._length(step) > _SHORTEST:
            self.next = self._rounded(model, step, before, lower, upper)
        elif self._rescaling or by_squares:
            self._by_the_loss_alone(lowest, found)
        else:
            self._end(
                f"Not converged after {counted(self.evaluations)}: no further step lowers the loss or can be simulated"
                f"{self._away()}"
            )

    def _rounded(self, model: LocalModel, step: Floats, before: float, lower: Floats, upper: Floats) -> Floats:
        """A step far from the minimum, where it need not be exact, to round values of the parameters of load paths. The
        paths there serve other starts and other fits.
        """
        if self._promised > _FAR * before:
            return step
        for j in self.of_paths:
            low, high = (np.array(end) for end in (lower, upper))
            shorter, longer = (step[j] + part * (step[j] - self.z[j]) for part in (-_SHORTER, _LONGER))
            low[j] = high[j] = roundest(*np.clip(sorted((shorter, longer)), lower[j], upper[j]))
            rounded = model.minimise(low, high, begin=step)
            promised = model.loss(rounded)
            if before - promised >= _AS_MUCH * (before - self._promised):
                step, self._promised, lower, upper = rounded, promised, low, high
        return step

    def _by_the_loss_alone(self, lowest: Point, found: Evaluation) -> None:
        """Continue from the lowest point, without rescaling."""
        self._merit, self._rescaling, self._radius = self.loss, False, 1.0
        self._move(lowest, found)

    def _losses(self, point: Point) -> tuple[float, float]:
        """The losses that the search compares at a point: as it is, and after the moduli are rescaled."""
        plain = total(self._merit, point.blocks)
        if not self._rescaling:
            return plain, plain
        model = LocalModel(self.space, self._merit, point)
        return plain, model.loss(model.rescaled())

    def _model(self, merit: Loss) -> LocalModel:
        """The model that the search follows from here, by the last points."""
        others = [point for point, _ in self._seen[-_MEMORY:] if point.z is not self.z]
        others.sort(key=lambda point: self._length(point.z))
        return trusted_model(self.space, merit, self._here(), others)

    def _here(self) -> Point:
        if self.best is None:
            raise RuntimeError("no point has been simulated")
        return Point(self.z, self.best.blocks)

    def _length(self, to: Floats) -> float:
        return in_standard_errors(self.space, self.loss, self._here(), to - self.z)

    def _has_errors(self) -> bool:
        """Whether the noise can be estimated here, and standard errors exist."""
        blocks = self._here().blocks
        spare = sum(len(block.residual) for block in blocks) - self.space.size
        return spare > 0 and not spent_groups(self.loss, self.space.jacobian(self.z), blocks)

    def _away(self) -> str:
        if self.best is None:
            return "."
        return f"; the next Gauss-Newton step is {self._distance:.2g} standard errors long."

    def _end(self, status: str, *, converged: bool = False) -> None:
        self.next = None
        self.status = status
        self.converged = converged


def counted(n: int) -> str:
    """A number of trials in words."""
    return f"{n} trial{'s' * (n != 1)}"


def trusted_model(space: SearchSpace, loss: Loss, here: Point, others: Sequence[Point]) -> LocalModel:
    """The model around `here` with the smallest error at the other points, nearest first, bent to the nearest.

    The models scale forces with moduli, with Poisson's ratio as itself or as its reciprocal distance to the ceiling.
    Gauss-Newton's takes their place where it predicts clearly better, as in a valley of factors (modulus times
    friction), which is straight in their logarithms; and where they do not reproduce the twin at its own point.

    Parameters
    ----------
    space, loss
        The search space, and the loss.
    here, others
        The simulated points, with jacobians.
    """
    scaled = [LocalModel(space, loss, here, reciprocal=reciprocal) for reciprocal in (True, False)]
    plain = LocalModel(space, loss, here, plain=True)
    *errors, of_plain = (sum(model.missed(point) for point in others) for model in (*scaled, plain))
    model = plain if of_plain < _CLEARLY * min(errors) else scaled[int(np.argmin(errors))]
    if others:
        model.bend(others[0])
    return model if model.reproduces() else LocalModel(space, loss, here, plain=True)
