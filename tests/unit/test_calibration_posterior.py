"""Posteriors: against the closed form of a linear twin, and against a sum over a grid for a curved one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_twin import NU, E
from interval_cases import curved, linear_problem, values

from softcal.calibration.interval_studies.checked_interval import IntervalStudy
from softcal.calibration.interval_studies.posterior import ERROR, posterior
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.statistics.sensitivity import local_estimator
from softcal.errors import CalibrationError, ParameterError

# Percentiles of some 4000 effective draws scatter by 0.04 standard deviations; three of these.
WITHIN = 0.12


def by_grid(problem: Problem, ends: dict[str, tuple[float, float]], n: int = 91) -> dict[str, tuple[float, ...]]:
    """Mean, standard deviation and percentiles of each of two parameters in the unit box, by a sum over a grid."""
    space = problem.space
    axes = [np.linspace(*ends[label], n) for label in space.labels]
    grid = np.array([[problem.evaluate(space.to_model([a, b])).loss for b in axes[1]] for a in axes[0]])
    theta = values(problem)
    seen = problem.evaluate(theta, jacobian=True)
    beyond = local_estimator(space, problem.loss, np.clip(space.to_search(theta), 0.0, 1.0), seen.blocks).contradiction
    weights = np.exp(-0.5 * (grid - grid.min()) / beyond**2)  # what is beyond a bound multiplies all errors
    weights[:, [0, -1]] /= 2  # the trapezoidal rule: a bound cuts the second parameter
    found = {}
    for k, label in enumerate(space.labels):
        one = weights.sum(axis=1 - k) / weights.sum()
        mean = float(one @ axes[k])
        low, high = np.interp((0.025, 0.975), np.cumsum(one) - one / 2, axes[k])
        found[label] = (mean, float(np.sqrt(one @ (axes[k] - mean) ** 2)), float(low), float(high))
    return found


def by_draws(problem: Problem, found: IntervalStudy) -> dict[str, tuple[float, ...]]:
    space = problem.space
    columns = [found.points[label] for label in space.labels]
    z = np.array([space.to_search(dict(zip(space.labels, row, strict=True))) for row in zip(*columns, strict=True)])
    ends = np.percentile(z, (2.5, 97.5), axis=0)
    return {label: (z[:, k].mean(), z[:, k].std(), ends[0, k], ends[1, k]) for k, label in enumerate(space.labels)}


def two_free() -> Problem:
    problem = curved()
    loss = LikelihoodLoss({"tension": 5.0, "pitch": 0.1})
    return replace(problem, loss=loss, space=SearchSpace(problem.space.parameters[:2]))


CASES = {
    "linear": (linear_problem(LikelihoodLoss(), noise=0.9), {E: (0.38, 0.48), NU: (0.70, 0.87)}),
    "linear, cut by a bound": (
        linear_problem(LikelihoodLoss(), noise=0.5, ratios=(0.1, 0.398)),
        {E: (0.37, 0.49), NU: (0.9, 1.0)},
    ),
    "curved": (two_free(), {E: (0.3, 0.75), NU: (0.0, 1.0)}),
}


@pytest.mark.slow
def test_no_more_draws_are_effective_than_are_made():
    """The chain is longer than what is kept of it, and the percentiles are those of what is kept."""
    problem, _ = CASES["linear"]
    facts = posterior(problem, values(problem), samples=200).facts
    assert facts["draws"] == 200
    assert 50 < facts["effective draws"] < 200


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "samples"),
    [
        ("linear", 10_000),
        # The far end of a density that a bound cuts is at few draws: of 10,000 it errs by a tenth of the deviation.
        pytest.param("linear, cut by a bound", 40_000, marks=pytest.mark.long),
        pytest.param("curved", 10_000, marks=pytest.mark.long),
    ],
)
def test_the_draws_are_those_of_the_density(name: str, samples: int):
    problem, ends = CASES[name]
    found = posterior(problem, values(problem), samples=samples)
    expected, drawn = by_grid(problem, ends), by_draws(problem, found)
    assert found.facts["draws"] == samples
    assert found.facts["effective draws"] > 3000
    assert found.facts["error of the surrogate's log-posterior"] <= ERROR
    for label in problem.space.labels:
        sd = expected[label][1]
        assert np.array(drawn[label]) == pytest.approx(np.array(expected[label]), abs=WITHIN * sd), label


@pytest.mark.slow
def test_of_a_linear_twin_the_percentiles_are_the_quick_interval():
    problem = CASES["linear"][0]
    found = posterior(problem, values(problem))
    assert all(one.difference is not None and one.difference < 0.08 for one in found.intervals.values())
    assert found.sentences[0].startswith("No end differs")


@pytest.mark.slow  # with the other posteriors some ten seconds
def test_a_bound_that_cuts_the_posterior_is_said_to():
    problem = CASES["linear, cut by a bound"][0]
    sentences = posterior(problem, values(problem)).sentences
    assert any(one.startswith(NU) and "a bound cuts the posterior" in one for one in sentences)


@pytest.mark.slow  # with the other posteriors some ten seconds
def test_noise_of_few_samples_gives_the_tails_of_student():
    problem = linear_problem(LikelihoodLoss(), noise=3.0, n=6)
    found = posterior(problem, values(problem))
    for label, one in found.intervals.items():
        assert one.quick is not None
        half = (one.quick[1] - one.quick[0]) / 2
        assert half > 1.08 * 1.96 * np.std(found.points[label]) or one.difference < 0.15, label
        assert one.difference == pytest.approx(0.0, abs=0.2), label


@pytest.mark.slow
def test_the_same_seed_gives_the_same_draws():
    problem = CASES["linear"][0]
    theta = values(problem)
    first, again, other = (posterior(problem, theta, samples=200, seed=seed) for seed in (3, 3, 4))
    assert first.points == again.points
    assert first.points != other.points


def test_a_surrogate_that_is_not_accurate_is_refused():
    problem = curved()
    with pytest.raises(CalibrationError, match=r"its surrogate (still errs by|does not cover)"):
        posterior(problem, values(problem), simulations=25)


def test_too_few_of_anything_is_refused():
    problem = CASES["linear"][0]
    with pytest.raises(ParameterError, match="samples") as error:
        posterior(problem, values(problem), samples=10, seed=-1)
    assert len(error.value.faults) == 2
