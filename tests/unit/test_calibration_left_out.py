"""Each experiment as the others predict it: against another fit on a linear model, and against calibrations."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate
from interval_cases import SIGMA as SIGMA_OF
from interval_cases import linear_problem

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.statistics import between_experiments, correlation
from softcal.calibration.statistics.estimator import estimator
from softcal.calibration.statistics.left_out import LeftOut, left_out

N, K, SIGMA = 40, 4, 0.01
PLACES = np.linspace(0.1, 1.0, N)
SHARED = np.column_stack([PLACES, PLACES**2])
Z, ONES = np.full(2 + K, 0.5), np.ones(2 + K)
NAMES = [f"pull{i}" for i in range(K)]
SERVES = {name: np.array([True, True, *(j == i for j in range(K))]) for i, name in enumerate(NAMES)}
JACOBIANS = [np.column_stack([SHARED, np.tile(np.eye(K)[i], (N, 1))]) for i in range(K)]
LOSS = LikelihoodLoss()


def errors(seed: int, own: np.ndarray) -> list[np.ndarray]:
    """Noise, and each experiment's own error of the first parameter."""
    chance = np.random.default_rng([seed, 8])
    return [SIGMA * chance.standard_normal(N) - SHARED[:, 0] * value for value in own]


def minimum(noise: list[np.ndarray], chosen: list[int]) -> np.ndarray:
    rows, values = np.concatenate([JACOBIANS[i] for i in chosen]), np.concatenate([noise[i] for i in chosen])
    return np.linalg.lstsq(rows, -values, rcond=None)[0]


def predicted(noise: list[np.ndarray]) -> dict[str, LeftOut]:
    step = minimum(noise, list(range(K)))
    blocks = [
        Block(name, "tension", np.full(N, 5.0), e + J @ step, SIGMA, J)
        for name, e, J in zip(NAMES, noise, JACOBIANS, strict=True)
    ]
    return left_out(LOSS, Z, ONES, blocks, SERVES, estimator(LOSS, Z, ONES, blocks, SERVES))


def test_it_is_what_a_fit_without_the_experiment_leaves() -> None:
    noise = errors(3, np.zeros(K))
    found = predicted(noise)
    assert list(found) == NAMES
    for i, name in enumerate(NAMES):
        others = minimum(noise, [j for j in range(K) if j != i])
        residual = noise[i] + SHARED @ others[:2]
        residual = residual - residual.mean()  # its own offset is fitted to it
        assert found[name].rmse["tension"] == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-6)


@pytest.mark.slow
def test_the_bands_hold_their_share_of_the_samples() -> None:
    shares = [one.within["tension"] for seed in range(30) for one in predicted(errors(seed, np.zeros(K))).values()]
    assert np.mean(shares) == pytest.approx(0.95, abs=0.02)
    chance = np.random.default_rng(1)
    held = [
        one.within["tension"]
        for seed in range(30)
        for one in predicted(errors(seed, 0.1 * chance.standard_normal(K))).values()
    ]
    assert np.mean(held) > 0.93
    widths = [one.half_width["tension"] for one in predicted(errors(0, np.array([-0.2, 0.05, 0.1, 0.3]))).values()]
    assert min(widths) > 5 * SIGMA


def neck_problem(n: int) -> Problem:
    tests = [fake_experiment(f"t{i}", noise=1e-3, sigma=1e-3, seed=i, reach=0.03 + 0.005 * i) for i in range(n)]
    free = (FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=TRUE[E]), FreeParameter(NU, "1", 0.1, 0.499))
    return make_problem(fake_robot(), tests, free, PapersLoss(), fake_simulate)


@pytest.mark.slow
def test_it_is_close_to_what_is_found_by_holding_out() -> None:
    problem = neck_problem(3)
    result = calibrate(problem)
    assert set(result.left_out) == {"t0", "t1", "t2"}
    for name, one in result.left_out.items():
        held: CalibrationResult = calibrate(problem, hold_out=(name,))
        for channel, error in held.held_out[name].fit.rmse.items():
            assert one.rmse[channel] == pytest.approx(error, rel=0.05)


def test_two_experiments_are_too_few() -> None:
    assert calibrate(neck_problem(2)).left_out == {}


def test_a_prior_of_its_own_parameter_counts() -> None:
    """A prior on an experiment's own offset keeps the fit to it from taking up the whole error."""
    noise = errors(3, np.zeros(K))
    step = minimum(noise, list(range(K)))
    blocks = [
        Block(name, "tension", np.full(N, 5.0), e + J @ step + (0.05 if name == "pull0" else 0.0), SIGMA, J)
        for name, e, J in zip(NAMES, noise, JACOBIANS, strict=True)
    ]
    prior = Block("", "prior", np.zeros(1), np.zeros(1), 1e-4, np.eye(2 + K)[2:3])
    free, tied = (
        left_out(LOSS, Z, ONES, held, SERVES, estimator(LOSS, Z, ONES, held, SERVES))["pull0"].rmse["tension"]
        for held in (blocks, [*blocks, prior])
    )
    assert tied > 2 * free


@pytest.mark.slow
def test_the_bands_of_the_fit_are_kept_with_it(tmp_path: Path) -> None:
    result = calibrate(neck_problem(3), store=tmp_path / "run")
    again = load_result(tmp_path / "run")
    held = []
    for name, fit in result.experiments.items():
        assert set(fit.bands) == {"tension", "pitch"}
        for channel, width in fit.bands.items():
            assert np.all(width > 0.0)
            np.testing.assert_array_equal(again.experiments[name].bands[channel], width)
            np.testing.assert_array_equal(again.experiments[name].repeats[channel], fit.repeats[channel])
            held.append(np.mean(np.abs(fit.simulated[channel] - fit.measured[channel]) <= width))
    assert np.mean(held) == pytest.approx(0.95, abs=0.04)
    # Noise of 1e-3 of the largest value: the band is little wider than 1.96 of these.
    top = np.abs(result.experiments["t0"].measured["tension"]).max()
    assert np.median(result.experiments["t0"].bands["tension"]) == pytest.approx(1.96e-3 * top, rel=0.25)


@pytest.mark.long
@pytest.mark.parametrize(
    "loss", [pytest.param(PapersLoss(), marks=pytest.mark.long), LikelihoodLoss()], ids=["papers", "likelihood"]
)
def test_of_two_bands_one_is_for_samples_of_the_same_set_up_and_one_for_a_new_one(loss: Loss) -> None:
    """Experiments that differ in E: new noise on the same ones, and further ones whose E is drawn anew."""
    names, spread, kinds = ("a", "b", "c", "d", "e", "f"), 1.5e5, ("tension", "pitch")
    same: list[float] = []
    new: list[float] = []
    shares: list[float] = []
    for seed in range(8):
        problem = linear_problem(loss, names=names, seed=seed, spread=spread)
        result = calibrate(problem, starts=1)  # of a linear twin, which has one minimum
        assert result.spreads[E].differs
        clean = linear_problem(loss, names=names, seed=seed, spread=spread, noise=0.0)
        further = linear_problem(loss, names=names, seed=100 + seed, spread=spread)
        chance = np.random.default_rng(seed)
        for before, other in zip(clean.experiments, further.experiments, strict=True):
            fit = result.experiments[before.name]
            for kind in kinds:
                again = before.dataset.values(kind) + SIGMA_OF[kind] * chance.standard_normal(before.dataset.n_samples)
                same.append(float(np.mean(np.abs(fit.simulated[kind] - again) <= fit.repeats[kind])))
                off = np.abs(fit.simulated[kind] - other.dataset.values(kind))
                new.append(float(np.mean(off <= fit.bands[kind])))
            shares.append(float(np.mean(fit.repeats["tension"]) / np.mean(fit.bands["tension"])))
    assert np.mean(shares) < 0.8
    assert 0.93 <= np.mean(same) <= 0.99
    assert 0.93 <= np.mean(new) <= 1.0


@pytest.mark.slow
def test_a_held_out_test_with_an_offset_of_its_own_has_the_band_that_its_fit_leaves() -> None:
    """Its own offset is fitted to it, and takes up errors of what is shared."""
    names = ("t0", "t1", "t2")
    problem = neck_problem(3)
    own = FreeParameter("plate.pitch_offset", "rad", -0.05, 0.05, start=0.0, per_experiment=True)
    free = make_problem(
        problem.robot, problem.experiments, (*problem.space.parameters, own), PapersLoss(), fake_simulate
    )
    every = calibrate(free)
    for name in names:
        held = calibrate(free, hold_out=(name,)).held_out[name]
        assert list(held.own) == [f"plate.pitch_offset[{name}]"]
        assert held.fit.bands.keys() == {"tension", "pitch"}
        for channel, width in held.fit.bands.items():
            measured = held.fit.measured[channel]
            assert width.shape == measured.shape
            # Its noise is not known; in these tests it grows with the pull, and the others' is 0.7 to 2 times it.
            ratio = np.sqrt(np.mean(width**2)) / every.left_out[name].half_width[channel]
            assert 0.7 < ratio < 2.0
            assert np.mean(np.abs(held.fit.simulated[channel] - measured) <= width) > 0.8


def pieces_of(n: int, monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """How often `left_out` of n tests computes what is of one test by itself."""
    counts = {"tests": 0, "bases": 0}

    def counted(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            counts[name] += 1
            return function(*arguments)

        return call

    chance = np.random.default_rng(4)
    blocks = [Block(f"t{i}", "tension", np.full(N, 5.0), chance.standard_normal(N), SIGMA, SHARED) for i in range(n)]
    serves = {f"t{i}": np.array([True, True]) for i in range(n)}
    found = estimator(LOSS, Z[:2], ONES[:2], blocks, serves)
    with monkeypatch.context() as patch:
        patch.setattr(between_experiments, "refitted", counted("tests", between_experiments.refitted))
        patch.setattr(correlation, "span", counted("bases", correlation.span))
        assert len(left_out(LOSS, Z[:2], ONES[:2], blocks, serves, found)) == n
    return counts


def test_what_is_of_one_test_is_computed_once_whichever_others_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    for n in (5, 10):
        counts = pieces_of(n, monkeypatch)
        assert counts["tests"] == n
        assert counts["bases"] <= 2 * n
