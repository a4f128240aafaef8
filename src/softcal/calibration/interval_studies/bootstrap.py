"""Intervals by a bootstrap: estimates with random weights of groups of measurements, confirmed by simulations.

The weights are Dirichlet's with mean and variance one (Rubin, Annals of Statistics 9, 1981; Newton and Raftery, JRSS B
56, 1994). No group is lost, and the variance of a mean is s^2/n without bias. The draws are minima of the loss with
linear residuals (`statistics/reweighted.py`), which cost no simulation, widened by Student's t of the jackknife. Those
at the ends of the intervals are then fitted by simulations, and the ends move by what is between.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.interval_studies.checked_interval import IntervalStudy
from softcal.calibration.interval_studies.likelihood_points import Observer
from softcal.calibration.interval_studies.resampling import Resampled, model_values, resampled
from softcal.calibration.problem.problem import Evaluation, Problem
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.optimiser import Proposal
from softcal.calibration.statistics.intervals import CONFIDENCE, nearest_within, student
from softcal.checks import Floats
from softcal.executors.executor import Executor
from softcal.limits import require_at_least

DRAWS = 2000
_NEAR = 0.02  # of the distance from the minimum: a refit that moves by less has ended
_MOST = 5  # simulations of a refit


def bootstrap(
    problem: Problem,
    theta: Mapping[str, float],
    *,
    over: str = "",
    samples: int = DRAWS,
    seed: int = 1,
    workers: int | Executor = 1,
    progress: Observer | None = None,
) -> IntervalStudy:
    """95 % intervals as percentiles of estimates with random weights of the groups, near calibrated values theta.

    Parameters
    ----------
    problem
        The calibrated problem.
    theta
        Its minimum [SI by label].
    over
        The kind of group, see `groups.KINDS`; by default experiments, of three or more, else pieces of the records.
    samples
        Number of draws.
    seed
        Seed of the random numbers; the same seed gives the same draws.
    workers
        An executor, or a number of processes that simulate.
    progress
        Called after every evaluation of the twin with their number.

    Raises
    ------
    ParameterError
        For a number out of range.
    InputError, SimulationError
        See `resampled`.
    """
    began = time.perf_counter()
    require_at_least(samples=(samples, 100), seed=(seed, 0))
    found = resampled(problem, theta, over)
    parts, chance = found.parts, np.random.default_rng(seed)
    k = len(parts.names)
    weights = k * chance.dirichlet(np.full(k, 1 - 2 / k), samples)  # the concentration that gives a variance of one
    steps = parts.minima(weights) - parts.minimum
    wider: Floats = student(found.without.total_dof) / student(np.array([np.inf]))
    known = [row for source, held in zip(parts.known, parts.responses, strict=True) for row in source.rows(held)]
    rows = np.concatenate([np.zeros((0, steps.shape[1])), *(np.atleast_2d(row) for row in known)])
    more: Floats = chance.standard_normal((samples, len(rows))) @ rows
    z = parts.minimum + wider * (steps + more)
    for i in np.flatnonzero(np.any((z < 0.0) | (z > 1.0), axis=1)):
        z[i] = nearest_within(z[i], found.root)
    draws = _Draws(weights, steps, np.clip(z, 0.0, 1.0), wider)
    given = np.flatnonzero(found.without.determined)
    tail = 50 * (1 - CONFIDENCE)
    ends = {int(j): tuple(np.percentile(draws.z[:, j], [tail, 100 - tail])) for j in given}
    refits = [_Refit(found, draws, j, side, end) for j in ends for side, end in enumerate(ends[j])]
    with Evaluator(problem, workers=workers, jacobian=True) as evaluator:
        n = n_solves = 0
        while unfinished := [(one, one.next) for one in refits if one.next is not None]:
            proposals = [Proposal(n + i, problem.space.to_model(z)) for i, (_, z) in enumerate(unfinished)]
            for (one, _), (_, evaluation) in zip(unfinished, evaluator.evaluate(proposals), strict=True):
                one.tell(evaluation)
                n, n_solves = n + 1, n_solves + evaluation.n_solves
                if progress is not None:
                    progress(1 + n)
    notes = [one.note for one in refits if one.note]
    moved: dict[int, tuple[float, float]] = {}
    for j in ends:
        low, high = (one for one in refits if one.j == j)
        moved[j] = (low.end, high.end)
    facts = {
        "draws": float(samples),
        "refits": float(len(refits)),
        "trajectories": float(found.held.evaluation.n_solves + n_solves),
        "evaluations": float(1 + n),
    }
    return found.study("bootstrap", moved, notes, facts, began, model_values(problem, draws.z))


@dataclass(frozen=True)
class _Draws:
    """Random weights (m, k), the steps (m, size) that they make, and the draws (m, size) in the box.

    wider: the steps' factor (size,) in the draws.
    """

    weights: Floats
    steps: Floats
    z: Floats
    wider: Floats


@dataclass(eq=False)
class _Refit:
    """The draw at an end of parameter j's interval, fitted by simulations. next: the point to be simulated, or None."""

    found: Resampled
    draws: _Draws
    j: int
    side: int
    end: float
    note: str = ""
    n: int = 0
    next: Floats | None = field(init=False)

    def __post_init__(self) -> None:
        at = int(np.argmin(np.abs(self.draws.z[:, self.j] - self.end)))
        self.weights = self.draws.weights[at : at + 1]
        self.start = self._within(self.found.parts.minimum + self.draws.steps[at])
        self.next = self.start

    def tell(self, evaluation: Evaluation) -> None:
        """Take in the simulation of `next`."""
        here, self.next = self.next, None
        self.n += 1
        if here is None:
            raise RuntimeError("the refit has ended")
        label, which = self.found.labels[self.j], ("lower", "upper")[self.side]
        if evaluation.loss is None:
            self.note = f"{label}: the {which} end is not confirmed by a refit. {evaluation.failure}"
            return
        parts = self.found.at(here, evaluation.blocks)
        there = self._within(parts.minima(self.weights)[0])
        away = abs(float(here[self.j] - self.found.parts.minimum[self.j]))
        if abs(float(there[self.j] - here[self.j])) > _NEAR * away:
            if self.n < _MOST:
                self.next = there
            else:
                self.note = (
                    f"{label}: the {which} end is not confirmed by a refit, which takes more than {_MOST} steps."
                )
            return
        moved = float(self.draws.wider[self.j] * (there[self.j] - self.start[self.j]))
        self.end = float(np.clip(self.end + moved, 0.0, 1.0))

    def _within(self, z: Floats) -> Floats:
        return np.clip(nearest_within(z, self.found.root), 0.0, 1.0)
