"""Profile likelihoods: 95 % intervals by fits with one parameter fixed, where the quadratic model may not do.

The interval of a parameter contains the values at which minus twice the log-likelihood (`adjusted_likelihood.py`),
minimised over all other parameters within their bounds, exceeds its minimum by at most t^2: the rise that the quick
interval allows, t being Student's with the degrees of freedom of this parameter. An end at a bound of the search is the
bound's, not the data's.

Each end is found without a fit at every value (compare Venzon and Moolgavkar, Applied Statistics 37, 1988): the exact
derivatives at a simulated point give the least squares over the other parameters as a function of the fixed one, and
where that reaches the allowed rise the next point is simulated. It is warm-started by the point before, and converges
as Newton's method does, in two to four trajectories.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.interval_studies.adjusted_likelihood import calibrated
from softcal.calibration.interval_studies.checked_interval import IntervalStudy, checked
from softcal.calibration.interval_studies.likelihood_points import (
    MOST,
    Observer,
    Quadratic,
    SimulatedPoint,
    likelihood_minimum,
)
from softcal.calibration.problem.problem import Problem
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.statistics.intervals import student
from softcal.checks import Floats
from softcal.executors.executor import Executor

_NEAR = 0.01  # of the distance from the minimum: an end that moves by less is found
_LOWER = 0.02  # of minus twice the log-likelihood: a point lower than the minimum by more is a better one
_RESTARTS = 3
_REACH = 2.5  # of the distance from the minimum: an end moves out by no more in one step
_RETREATS = 5  # halvings of the way to a point that cannot be simulated

NOT_LINEAR = "the twin is not linear over it"


@dataclass(eq=False)
class _End:
    """The search for one end: `next` is the point to be simulated, None at the end of the search.

    quadratic: the model at the minimum z; most: the allowed sum of squares.
    """

    j: int
    side: int
    z: Floats
    quadratic: Quadratic
    most: float
    found: float | None = None
    failure: str = ""
    next: Floats | None = None
    evaluations: int = 0
    retreats: int = 0
    last: Floats = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        _, self.next = self.quadratic.end(self.j, self.side, self.most)
        self.last = self.z

    def tell(self, model: Quadratic | None, failure: str) -> None:
        """Take in the model at `next`, None where that could not be simulated."""
        if self.next is None:
            raise RuntimeError("the end is found")
        self.evaluations += 1
        here, self.next = self.next, None
        if model is None:
            self.retreats += 1
            if self.retreats > _RETREATS:
                self.failure = failure
            else:
                self.next = 0.5 * (self.last + here)
            return
        self.last = here
        at, point = model.end(self.j, self.side, self.most)
        away = abs(float(here[self.j] - self.z[self.j]))
        if abs(at - here[self.j]) <= _NEAR * away or at == here[self.j]:
            self.found = at
        elif self.evaluations >= MOST:
            self.failure = f"not found in {MOST} trajectories"
        else:
            furthest = float(self.z[self.j]) + self.side * _REACH * away
            if away > 0.0 and self.side * (at - furthest) > 0.0:
                at, point = furthest, model.least(self.j, furthest)[1]
            # After a failure the way out is taken in halves: beyond, nothing can be simulated.
            self.next = 0.5 * (here + point) if self.retreats and self.side * (at - here[self.j]) > 0 else point


def profile(
    problem: Problem, theta: Mapping[str, float], *, workers: int | Executor = 1, progress: Observer | None = None
) -> IntervalStudy:
    """95 % intervals of all parameters by profile likelihoods, from the calibrated values theta [SI by label].

    A loss such as `papers` is no likelihood: the profile is of the likelihood that goes with the covariance of its
    minimum (`adjusted_likelihood.py`), so that it differs from the quick interval by the twin's curvature alone. Noise
    that is correlated along the records and differences between experiments count as there, and priors too.

    Parameters
    ----------
    problem
        The calibrated problem.
    theta
        Its minimum [SI by label].
    workers
        An executor, or a number of processes; the two ends of all parameters are searched side by side.
    progress
        Called after every trajectory.

    Raises
    ------
    InputError
        Where theta is no minimum of the loss, or the noise cannot be estimated.
    SimulationError, CalibrationError
        Where the twin cannot be simulated at theta, there are no workers any more, or the likelihood has no minimum
        nearby.
    """
    began = time.perf_counter()
    held = calibrated(problem, dict(theta))
    t = student(held.found.dof)
    space = problem.space
    with Evaluator(problem, workers=workers, jacobian=True) as evaluator:
        simulated = SimulatedPoint(held, evaluator, progress)
        best, ends = simulated.seen[0], list[_End]()
        for _ in range(_RESTARTS):
            best = likelihood_minimum(simulated, best)
            ends = [_End(j, s, best.z, best.model, best.value + t[j] ** 2) for j in range(space.size) for s in (-1, 1)]
            while wanted := [end for end in ends if end.next is not None]:
                for end, told in zip(wanted, simulated.at([e.next for e in wanted if e.next is not None]), strict=True):
                    end.tell(*((None, told) if isinstance(told, str) else (told.model, "")))
            lowest = min(simulated.seen, key=lambda one: one.value)
            if lowest.value >= best.value - _LOWER:
                break
            best = lowest
    facts = {"trajectories": float(simulated.n_trajectories), "evaluations": float(simulated.n_evaluations)}
    least = min(one.value for one in simulated.seen)
    thetas = [space.to_model(one.z) for one in simulated.seen]
    found: dict[str, tuple[float, float] | None] = {}
    notes: list[str] = []
    for j, (label, estimate) in enumerate(held.estimates.items()):
        value_at = space.parameters[j].value_at
        low, high = (end for end in ends if end.j == j)
        for end, side in ((low, "lower"), (high, "upper")):
            if end.found is None:
                last = f"the profile is followed to {value_at(float(end.last[j])):.6g} {estimate.unit}"
                notes.append(f"{label}: the {side} end is unknown, {last}. {end.failure}")
        found[label] = None
        if low.found is not None and high.found is not None:
            value = estimate.value
            found[label] = (min(value_at(float(low.found)), value), max(value_at(float(high.found)), value))
    return IntervalStudy(
        "profile",
        checked(held.estimates, found, NOT_LINEAR),
        tuple(notes),
        facts,
        time.perf_counter() - began,
        {label: tuple(one[label] for one in thetas) for label in space.labels},
        tuple(one.value - least for one in simulated.seen),
    )
