"""The posterior of the parameters, sampled by emcee (Foreman-Mackey and others, PASP 125, 2013).

The prior is uniform in the search box, on the scale of the search (a modulus by its logarithm), times the priors that
the loss counts. The likelihood is the one of the profiles (`adjusted_likelihood.py`); where the noise is estimated from
few independent samples it has Student's tails, with the degrees of freedom of the quick intervals (averaged over the
parameters by how many standard errors each is away).

The twin is too slow for a hundred thousand evaluations, so a polynomial (`surrogate.py`) through the residuals and
their derivatives at some tens of simulated points takes its place. The points are drawn from the posterior itself,
round by round, the first ones from the quadratic model. Every round begins with points that the polynomial has not
seen: at these its log-posterior is compared with the twin's. It is used only when the error there is below `ERROR`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.interval_studies.adjusted_likelihood import Calibrated, calibrated
from softcal.calibration.interval_studies.checked_interval import IntervalStudy, checked
from softcal.calibration.interval_studies.likelihood_points import Observer, Seen, SimulatedPoint, likelihood_minimum
from softcal.calibration.interval_studies.surrogate import Surrogate, fewest_points, fitted_surrogate
from softcal.calibration.problem.problem import Problem
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.interrupts import interrupts_held
from softcal.calibration.statistics.intervals import CONFIDENCE
from softcal.checks import Floats
from softcal.errors import CalibrationError
from softcal.executors.executor import Executor
from softcal.limits import require_at_least

SAMPLES = 10_000
"""Draws that are kept."""
SIMULATIONS = 120
"""Evaluations of the twin, at most."""
ERROR = 0.1
"""Largest standard deviation of the surrogate's error in the log-posterior, at draws of it that it has not seen."""
_BOX = 12.0  # one over the variance of a parameter of which the data say nothing
_CHECKS = 10  # points of a round that are checked, at least
_WIDER = 1.7  # further points of a round: draws with their distance from the mean increased so much
_DRAFT = 2_000  # draws of a round
_NEGLIGIBLE = 10.0  # minus twice the logarithm of the density over its largest, at the end of the surrogate's range
_EDGE = 2000  # points at which that is checked
_OUT = 1.3  # by which points there are moved out where it does not
_WALKERS = 100
_BATCH = 250  # steps, at first: every further batch doubles the chain
_LONG = 50  # autocorrelation times: a shorter chain does not tell its own
_MOST_STEPS = 40_000
_NEAR = 0.1  # standard deviations from a bound
_CUT = 0.05  # of the peak of a normal density: with more at a bound, the 95 % interval ends elsewhere
_CORRELATED = 0.5  # from here on, what cuts one parameter's posterior is a reason for the other's
_SKEWED = 0.3  # moves a 2.5 % percentile by 0.14 standard deviations


@dataclass(frozen=True)
class Chain:
    """Draws z (n, size) of a density, with minus twice its logarithm (n,) up to a constant.

    time: autocorrelation time [steps]; effective: number of independent draws that would tell as much as z.
    """

    z: Floats
    values: Floats
    time: float
    effective: float


def posterior(
    problem: Problem,
    theta: Mapping[str, float],
    *,
    samples: int = SAMPLES,
    seed: int = 1,
    simulations: int = SIMULATIONS,
    workers: int | Executor = 1,
    progress: Observer | None = None,
) -> IntervalStudy:
    """95 % intervals of all parameters as percentiles of their posterior, near calibrated values theta [SI by label].

    Parameters
    ----------
    problem
        The calibrated problem.
    theta
        Its minimum [SI by label].
    samples
        Number of draws.
    seed
        Seed of the random numbers; the same seed gives the same draws.
    simulations
        Evaluations of the twin, at most.
    workers
        An executor, or a number of processes that simulate.
    progress
        Called after every evaluation of the twin with their number.

    Raises
    ------
    ParameterError
        For a number out of range.
    InputError
        Where theta is no minimum of the loss, or the noise cannot be estimated.
    SimulationError, CalibrationError
        Where the twin cannot be simulated, the surrogate does not become accurate, or the chain does not converge.
    """
    began = time.perf_counter()
    require_at_least(samples=(samples, 100), simulations=(simulations, 1), seed=(seed, 0))
    held = calibrated(problem, theta)
    chance = np.random.default_rng(seed)
    with Evaluator(problem, workers=workers, jacobian=True) as evaluator:
        simulated = SimulatedPoint(held, evaluator, progress)
        best = likelihood_minimum(simulated, simulated.seen[0])
        log_posterior, error = _accurate(held, simulated, best, chance, simulations)
    chain = sampled(log_posterior, samples, seed)
    thetas = [problem.space.to_model(z) for z in chain.z]
    points = {label: tuple(one[label] for one in thetas) for label in problem.space.labels}
    tail = 50 * (1 - CONFIDENCE)
    found: dict[str, tuple[float, float] | None] = {}
    for label, values in points.items():
        low, high = np.percentile(values, [tail, 100 - tail])
        found[label] = (float(low), float(high))
    why = reasons(problem.space.labels, chain.z)
    facts = {
        "trajectories": float(simulated.n_trajectories),
        "evaluations": float(simulated.n_evaluations),
        "draws": float(len(chain.z)),
        "effective draws": chain.effective,
        "steps of autocorrelation": chain.time,
        "error of the surrogate's log-posterior": error,
    }
    return IntervalStudy(
        "posterior",
        {label: replace(one, reason=why[label]) for label, one in checked(held.estimates, found, "").items()},
        (),
        facts,
        time.perf_counter() - began,
        points,
        tuple((chain.values - chain.values.min()).tolist()),
    )


@dataclass(frozen=True)
class LogPosterior:
    """Minus twice the log-posterior by a surrogate, within the box and the surrogate's range.

    surrogate: of the residuals; held: the calibrated problem; least: their least sum of squares; mean, covariance: of
    the draws of the round before.
    """

    held: Calibrated
    surrogate: Surrogate
    least: float
    mean: Floats
    covariance: Floats

    def function(self) -> Callable[[Floats], Floats]:
        """Minus twice the logarithm (n,) at points z (n, size); infinite outside."""
        turned = self.surrogate.turned()

        def value(z: Floats) -> Floats:
            inside = np.all((z >= 0.0) & (z <= 1.0), axis=1) & (self.range_at(z) <= 1.0)
            return np.where(inside, self.of_squares(z, np.sum(turned.predicted(z) ** 2, axis=1)), np.inf)

        return value

    def range_at(self, z: Floats) -> Floats:
        """Distance of points z (n, size) from the centre of the simulated points, over that of the furthest (n,)."""
        return np.linalg.norm(self.surrogate.coordinates(z), axis=1)

    def beyond(self, chance: np.random.Generator) -> Floats:
        """Points of the box (n, size) just beyond the surrogate's range, where the density is not negligible.

        In random directions, along the axis of each parameter, and along the principal directions of the draws.
        """
        size, turn = len(self.mean), self.surrogate.turn
        straight = np.concatenate([np.eye(size), np.linalg.eigh(self.covariance)[1].T]) @ turn
        turned = np.concatenate([chance.standard_normal((_EDGE, size)), straight, -straight])
        steps = turned / np.linalg.norm(turned, axis=1)[:, None] @ np.linalg.inv(turn)
        centre = self.surrogate.centre
        edge = centre + steps * (1 - 1e-9)
        inside = np.all((edge >= 0.0) & (edge <= 1.0), axis=1)
        steps, edge = steps[inside], edge[inside]
        return np.clip(centre + _OUT * steps[self.function()(edge) < _NEGLIGIBLE], 0.0, 1.0)

    def of_squares(self, z: Floats, squares: Floats) -> Floats:
        """Minus twice the logarithm at points z (n, size) with these sums of squares (n,)."""
        found = self.held.found
        away = ((z - found.minimum) / np.linalg.norm(found.root, axis=0)) ** 2
        lack = (away @ (1.0 / found.dof)) / np.maximum(away.sum(axis=1), 1e-300)  # one over the degrees of freedom
        excess = np.maximum(squares - self.least, 0.0)
        lack = np.maximum(lack, 1e-12)
        return (1.0 / lack + z.shape[1]) * np.log1p(excess * lack)


def _accurate(
    held: Calibrated, simulated: SimulatedPoint, best: Seen, chance: np.random.Generator, simulations: int
) -> tuple[LogPosterior, float]:
    """The log-posterior by a surrogate that has shown to be accurate, and its error.

    Raises
    ------
    CalibrationError
        Where that takes more simulations than allowed, or the twin cannot be simulated at draws of the posterior.
    """
    size = len(held.z)
    jacobian = best.whitened.jacobian
    mean: Floats = best.z
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian + _BOX * np.eye(size)), dtype=np.float64)
    n_first = max(fewest_points(size), 2 * size)
    simulated.at(list(_drawn(mean, 2.0**2 * covariance, n_first, chance)))
    error = np.inf
    for number in range(1, simulations):
        seen = simulated.seen
        least = min(one.value for one in seen)
        surrogate = fitted_surrogate(
            np.array([one.z for one in seen]),
            np.array([one.whitened.residual for one in seen]),
            np.array([one.whitened.jacobian for one in seen]),
            covariance,
        )
        logarithm = LogPosterior(held, surrogate, least, mean, covariance)
        draft = sampled(logarithm, _DRAFT, number, converge=False).z
        mean = draft.mean(axis=0)
        covariance = np.asarray(np.cov(draft.T), dtype=np.float64).reshape(size, size) + 1e-12 * np.eye(size)
        logarithm = LogPosterior(held, surrogate, least, mean, covariance)
        if error <= ERROR:
            return logarithm, error
        n = max(_CHECKS, 2 * size)
        if simulated.n_evaluations + n > simulations:
            state = "its surrogate does not cover the posterior yet"
            if np.isfinite(error):
                state = f"its surrogate still errs by {error:.2g} in the log-posterior, and {ERROR:g} is allowed"
            raise CalibrationError(
                f"After {simulated.n_evaluations} evaluations of the twin {state}. Try: more simulations, fewer free "
                "parameters, narrower bounds, or profiles, which need no surrogate."
            )
        points = draft[chance.choice(len(draft), n, replace=False)]
        found = simulated.at(list(points))
        failed = [one for one in found if isinstance(one, str)]
        if failed:
            raise CalibrationError(
                f"The twin cannot be simulated at {len(failed)} of {len(found)} draws of the posterior, so that it has "
                f"no posterior there: {failed[0]} Try: narrower bounds."
            )
        exact = logarithm.of_squares(points, np.array([one.value for one in found if isinstance(one, Seen)]))
        error = float(np.std((logarithm.function()(points) - exact) / 2))
        beyond = logarithm.beyond(chance)
        if len(beyond):
            error = np.inf
            simulated.at(list(beyond[chance.choice(len(beyond), min(n, len(beyond)), replace=False)]))
        elif error > ERROR:
            wider = mean + _WIDER * (draft[chance.choice(len(draft), n, replace=False)] - mean)
            simulated.at(list(np.clip(wider, 0.0, 1.0)))
    raise CalibrationError("No surrogate of the twin became accurate.")


def sampled(logarithm: LogPosterior, n: int, seed: int, *, converge: bool = True) -> Chain:
    """Draws of a posterior.

    Parameters
    ----------
    logarithm
        Its log-density.
    n, seed
        Number of draws, and the seed of the random numbers.
    converge
        Whether the chain must be long enough to tell its own autocorrelation.

    Raises
    ------
    CalibrationError
        Where it is still too short after the largest number of steps.
    """
    import emcee

    size = len(logarithm.mean)
    walkers = max(_WALKERS, 4 * size)
    function = logarithm.function()
    chance = np.random.default_rng(seed)
    # Points at which the density is above zero, around the mean.
    found = np.zeros((0, len(logarithm.mean)))
    shrink = 1.0
    while len(found) < walkers:
        points = _drawn(logarithm.mean, shrink**2 * logarithm.covariance, 4 * walkers, chance)
        found = np.concatenate([found, points[np.isfinite(function(points))]])
        shrink *= 0.8
    first = found[:walkers]
    # With differences of walkers two thirds of the steps do, in ten dimensions. Not DESnookerMove: emcee 3.1's draws
    # are too narrow, there by a third.
    moves = [(emcee.moves.StretchMove(), 0.5), (emcee.moves.DEMove(), 0.5)]
    sampler = emcee.EnsembleSampler(walkers, size, lambda z: -0.5 * function(z), vectorize=True, moves=moves)
    state = emcee.State(first, random_state=np.random.RandomState(seed).get_state())
    steps, lag = 0, 1.0
    while True:
        going = sampler.sample(state, iterations=max(steps, _BATCH))
        for _ in range(max(steps, _BATCH)):
            with interrupts_held():  # emcee prints whatever it is interrupted in
                state = next(going)
        steps = sampler.iteration
        lag = max(1.0, float(np.max(sampler.get_autocorr_time(tol=0))))
        burned = int(min(5 * lag, steps // 2))
        thin = max(1, int(lag / 2))
        kept = walkers * ((steps - burned) // thin)
        if kept >= n and (not converge or steps >= _LONG * lag):
            break
        if steps >= _MOST_STEPS:
            raise CalibrationError(
                f"The chain of the posterior has not converged in {steps} steps: its autocorrelation time is {lag:.0f}."
            )
    # The last draws of all walkers.
    z = np.array(sampler.get_chain(discard=burned, thin=thin))[-math.ceil(n / walkers) :].reshape(-1, size)[:n]
    return Chain(z, function(z), lag, len(z) * thin / max(lag, thin))


def _drawn(mean: Floats, covariance: Floats, n: int, chance: np.random.Generator) -> Floats:
    """Normal points (n, size), those outside the box moved to its walls."""
    return np.clip(mean + chance.standard_normal((n, len(mean))) @ np.linalg.cholesky(covariance).T, 0.0, 1.0)


def reasons(labels: Sequence[str], z: Floats) -> dict[str, str]:
    """Why the interval of each parameter may differ from the quick one; "" where the draws z (n, size) show nothing."""
    away = (z - z.mean(axis=0)) / np.maximum(z.std(axis=0), 1e-300)
    correlations = away.T @ away / len(z)
    near = _NEAR * z.std(axis=0)
    share = np.maximum(np.mean(z < near, axis=0), np.mean(z > 1 - near, axis=0))
    is_cut = [bool(one) for one in share > _CUT * _NEAR / np.sqrt(2 * np.pi)]
    found: dict[str, str] = {}
    for j, label in enumerate(labels):
        seen: list[str] = []
        if is_cut[j]:
            seen.append("a bound cuts the posterior")
        for k, other in enumerate(labels):
            if k != j and is_cut[k] and abs(correlations[j, k]) > _CORRELATED:
                r = correlations[j, k]
                seen.append(f"a bound cuts the posterior of {other}, with which it is correlated ({r:+.2f})")
        skewness = float(np.mean(away[:, j] ** 3))
        if abs(skewness) > _SKEWED:
            seen.append(f"the posterior is skewed towards {'high' if skewness > 0 else 'low'} values ({skewness:+.1f})")
        found[label] = ", and ".join(seen)
    return found
