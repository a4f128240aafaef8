"""Parameters that are not fitted and not exactly known: their share of the intervals, and what is refused of them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from fake_twin import NU, STEADY, TRUE, E, fake_experiment, fake_robot, fake_simulate

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.estimator import estimator
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.errors import InputError, ParameterError
from softcal.experiments.dataset import Channel

GAIN = "front.tension_gain"
SD = 0.03
NOISE = 1e-3
FREE = (FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=TRUE[E]), FreeParameter(NU, "1", 0.1, 0.499, start=TRUE[NU]))
UNCERTAIN = (UncertainParameter(GAIN, "1", SD),)
problem_of = partial(make_problem, simulate=fake_simulate)


def measured(name: str = "pull", *, seed: int = 0, gain: float = 1.0, noise: float = NOISE) -> Experiment:
    """A test whose load cell reads `gain` times the tension."""
    test = fake_experiment(name, noise=noise, sigma=NOISE, seed=seed, settings=STEADY)
    tension = test.dataset.channels["tension"]
    channels = {**test.dataset.channels, "tension": Channel(tension.values * gain, "N", tension.sigma)}
    return replace(test, dataset=replace(test.dataset, channels=channels))


def with_gain(problem: Problem, gain: float) -> Problem:
    """The problem as calibrated by one who believes in another gain of the load cell."""
    believed = [replace(test, settings={**test.settings, GAIN: gain}) for test in problem.experiments]
    return replace(problem, experiments=tuple(believed))


@pytest.mark.slow
@pytest.mark.parametrize("loss", [PapersLoss(), LikelihoodLoss()], ids=["papers", "likelihood"])
def test_its_share_is_the_change_of_the_estimate(loss: Loss) -> None:
    problem = problem_of(fake_robot(), [measured(), measured("again", seed=1)], FREE, loss, uncertain=UNCERTAIN)
    result = calibrate(problem)
    ends = [calibrate(with_gain(problem, 1.0 + side * SD)).parameters for side in (1, -1)]
    for name, estimate in result.parameters.items():
        assert estimate.standard_error is not None
        moved = abs(ends[0][name].value - ends[1][name].value) / 2
        stated = estimate.standard_error * np.sqrt(estimate.shares.get(GAIN, 0.0))
        assert stated == pytest.approx(moved, rel=0.02, abs=1e-3 * estimate.standard_error)
    assert result.parameters[E].shares[GAIN] > 0.9
    assert sum(result.parameters[E].shares.values()) == pytest.approx(1.0)


@pytest.mark.parametrize("loss", [PapersLoss(), LikelihoodLoss()], ids=["papers", "likelihood"])
def test_its_share_is_as_large_where_the_experiments_differ(loss: Loss) -> None:
    tests = [measured(f"t{i}", seed=i, gain=gain) for i, gain in enumerate((0.95, 1.0, 1.08))]
    problem = problem_of(fake_robot(), tests, FREE, loss, uncertain=UNCERTAIN)
    best = calibrate(problem)
    assert best.spreads[E].differs
    told = problem.evaluate({name: one.value for name, one in best.parameters.items()}, jacobian=True)
    z, space = problem.space.to_search(told.theta), problem.space
    serves = {test.name: np.ones(2, dtype=bool) for test in tests}
    found = estimator(loss, z, space.jacobian(z), told.blocks, serves, problem.uncertain)
    relative = np.sqrt(found.variances[GAIN]) * np.abs(space.jacobian(z)) / np.array(list(told.theta.values()))
    assert relative[0] == pytest.approx(SD, rel=0.02)
    assert relative[1] < 0.1 * SD


def held(uncertain: tuple[UncertainParameter, ...]) -> float:
    """How often E's interval holds the truth where the load cell's gain errs by 3 %."""
    chance = np.random.default_rng(4)
    n = 16
    hits = 0
    for seed in range(n):
        test = measured(seed=seed, gain=1.0 + SD * chance.standard_normal())
        problem = problem_of(fake_robot(), [test], FREE, LikelihoodLoss(), uncertain=uncertain)
        low, high = calibrate(problem).parameters[E].interval or (0.0, 0.0)
        hits += low <= TRUE[E] <= high
    return hits / n


@pytest.mark.long
def test_the_interval_holds_the_truth_only_if_the_gain_is_uncertain() -> None:
    assert held(UNCERTAIN) >= 14 / 16
    assert held(()) < 0.6


def alike(tests: list[Experiment], uncertain: tuple[UncertainParameter, ...]) -> bool:
    problem = problem_of(fake_robot(), tests, FREE[:1], LikelihoodLoss(), uncertain=uncertain)
    best = problem.evaluate({name: one.value for name, one in calibrate(problem).parameters.items()}, jacobian=True)
    told = local_statistics(problem.space, problem.loss, best.theta, best.blocks, problem.uncertain)
    return not told.spreads[E].differs


@pytest.mark.slow
def test_an_error_that_each_test_has_by_itself_can_be_why_they_differ() -> None:
    tests = [measured(f"t{i}", seed=i, gain=gain) for i, gain in enumerate((0.98, 1.03, 1.0, 1.01))]
    assert not alike(tests, ())
    assert not alike(tests, UNCERTAIN)  # one gain for all of them does not explain it
    assert alike(tests, (UncertainParameter(GAIN, "1", SD, per_experiment=True),))


def test_a_pattern_stands_for_independent_errors_and_of_ties_them() -> None:
    def uncertain(*given: UncertainParameter) -> list[tuple[str, str, tuple[str, ...]]]:
        problem = problem_of(fake_robot(), [measured()], FREE, uncertain=given)
        return [(p.name, p.source, p.targets) for p in problem.uncertain]

    angle = UncertainParameter("plate.*_offset", "rad", 0.01)
    assert uncertain(angle) == [("plate.pitch_offset", "plate.*_offset", ("plate.pitch_offset",))]
    forces = UncertainParameter("forces", "1", 0.01, of=("front.tension_g*", "front.friction*"))
    assert uncertain(forces) == [("forces", "forces", (GAIN, "front.friction_coefficient"))]


def test_a_standard_deviation_of_zero_is_refused() -> None:
    with pytest.raises(ParameterError, match="the standard deviation must be above zero"):
        UncertainParameter(GAIN, "1", 0.0)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (UncertainParameter("front.gain", "1", SD), "there is no such parameter"),
        (UncertainParameter(GAIN, "N", SD), "the parameter has another unit"),
        (UncertainParameter(E, "Pa", 1e5), "uncertain and free at once"),
        (UncertainParameter("noise", "1", SD, of=(GAIN,)), "the name is that of a source of error"),
    ],
)
def test_what_is_wrong_with_one_is_said(wrong: UncertainParameter, told: str) -> None:
    with pytest.raises(InputError, match=told):
        problem_of(fake_robot(), [measured()], FREE, uncertain=[wrong])


def test_one_that_is_given_twice_is_refused() -> None:
    twice = [UncertainParameter(GAIN, "1", SD), UncertainParameter("cell", "1", SD, of=("front.tension_g*",))]
    with pytest.raises(InputError, match="uncertain twice"):
        problem_of(fake_robot(), [measured()], FREE, uncertain=twice)


def test_the_notes_name_it() -> None:
    def notes(uncertain: tuple[UncertainParameter, ...]) -> str:
        problem = problem_of(fake_robot(), [measured()], FREE, uncertain=uncertain)
        return " ".join(map(str, calibrate(problem).notes))

    assert "the uncertainty of front.tension_gain. Not included" in notes(UNCERTAIN)
    assert "uncertainty of" not in notes(())


def best_of(trials: int, *bounds: tuple[float, float]) -> CalibrationResult:
    free = [replace(one, lower=low, upper=high) for one, (low, high) in zip(FREE, bounds, strict=True)]
    problem = problem_of(fake_robot(), [measured()], free, LikelihoodLoss())
    return calibrate(problem, method="grid", trials=trials)


@pytest.mark.slow
def test_the_best_trial_of_a_grid_has_the_intervals_of_the_minimum() -> None:
    problem = problem_of(fake_robot(), [measured()], FREE, LikelihoodLoss())
    exact = calibrate(problem)
    near = replace(FREE[0], lower=2.25e6, upper=2.35e6), replace(FREE[1], lower=0.40, upper=0.46)
    found = calibrate(problem_of(fake_robot(), [measured()], near, LikelihoodLoss()), method="grid", trials=400)
    for name in (E, NU):
        best, want = found.parameters[name], exact.parameters[name]
        assert best.standard_error == pytest.approx(want.standard_error, rel=0.1)
        assert best.interval is not None
        assert best.interval[0] <= best.value <= best.interval[1]
    assert not any("not at the minimum" in str(note) for note in exact.notes)


def test_a_best_trial_off_the_minimum_says_where_that_is() -> None:
    found = best_of(9, (2.2e6, 2.4e6), (0.41, 0.45))
    notes = " ".join(map(str, found.notes))
    assert "The best trial is not at the minimum of the loss" in notes
    assert "The method least-squares finds the minimum." in notes
    assert found.parameters[E].interval is not None


def test_a_best_trial_far_from_the_minimum_has_no_intervals() -> None:
    found = best_of(100, (0.1e6, 40e6), (0.1, 0.499))
    assert any(note.text.startswith("No standard errors and no intervals: the best trial") for note in found.notes)
    assert all(one.interval is None for one in found.parameters.values())
