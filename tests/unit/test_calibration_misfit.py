"""Residuals that are a curve and no noise, and what would explain them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_twin import NU, E
from interval_cases import TRUE, linear_problem
from scipy.signal import lfilter

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.run import calibrate
from softcal.calibration.statistics import estimator as estimator_module
from softcal.calibration.statistics.misfit import CONTACT, DELAY, DRIFT, FRICTION, GAIN, LAW, OFFSET, SLACK, misfits
from softcal.calibration.statistics.residuals import SHOWN, outliers, residual_record, step_of_readings

N = 120
D = np.linspace(0.0, 1.0, N)
UP_AND_DOWN = np.concatenate([D[::2], D[::-2]])


def block(residual: np.ndarray, jacobian: np.ndarray, d: np.ndarray = D) -> Block:
    predicted = d + 0.3 * d**2
    return Block("pull", "tension", predicted - residual, residual, np.full(N, 0.01), jacobian)


@pytest.mark.parametrize(
    ("cause", "shape", "d"),
    [
        (OFFSET, np.ones(N), D),
        (DRIFT, np.linspace(0.0, 1.0, N), UP_AND_DOWN),
        (LAW, D**3, D),
        (FRICTION, np.repeat([1.0, -1.0], N // 2) * UP_AND_DOWN, UP_AND_DOWN),
    ],
)
def test_the_cause_of_a_misfit_explains_most_of_it(cause: str, shape: np.ndarray, d: np.ndarray) -> None:
    """Of what a free modulus leaves of it, beside noise; a gain, which is the modulus, is no candidate."""
    jacobian = (d + 0.3 * d**2)[:, None]
    q = jacobian / np.linalg.norm(jacobian)
    noise = 0.002 * np.random.default_rng(1).standard_normal(N)
    error = 0.05 * shape + noise
    (found,) = misfits([block(error - q @ (q.T @ error), jacobian, d)])
    assert next(iter(found.explained)) == cause
    assert found.explained[cause] > 0.9
    assert found.significance > 20.0
    assert GAIN not in found.explained
    assert list(found.explained.values()) == sorted(found.explained.values(), reverse=True)


@pytest.mark.parametrize(("cause", "turns"), [(SLACK, False), (DELAY, True)])
def test_on_the_way_back_a_delay_has_the_other_sign_and_a_slack_has_not(cause: str, turns: bool) -> None:
    """Of a channel that first grows and then falls on each way, as a coordinate of a marker may."""
    predicted, slope = np.sin(5.0 * UP_AND_DOWN), 5.0 * np.cos(5.0 * UP_AND_DOWN)
    onwards = np.repeat([1.0, -1.0], N // 2) if turns else 1.0
    error = 0.05 * onwards * slope + 0.002 * np.random.default_rng(1).standard_normal(N)
    q = predicted[:, None] / np.linalg.norm(predicted)
    left = error - q @ (q.T @ error)
    seen = Block("pull", "pitch", predicted - left, left, np.full(N, 0.01), q, command=UP_AND_DOWN)
    (found,) = misfits([seen])
    assert next(iter(found.explained)) == cause
    assert found.explained[cause] > 0.8  # all but the sample where it turns


def test_a_cause_below_the_noise_is_found_beside_what_another_channel_knows() -> None:
    """A law's shape of a fifth of the noise, that a free offset would follow if the pitch did not fix it."""
    chance = np.random.default_rng(5)
    size = 600
    d = np.linspace(0.0, 1.0, size)
    noise = chance.standard_normal((2, size))
    J = np.column_stack([d, np.ones(size)])
    stacked = np.concatenate([J, 5.0 * J])
    error = np.concatenate([noise[0] + 1.5 * d**3, noise[1]])
    left = error - stacked @ np.linalg.lstsq(stacked, error, rcond=None)[0]
    blocks = [
        Block("pull", channel, d - part, part, np.full(size, 1.0), jacobian)
        for channel, part, jacobian in zip(("tension", "pitch"), np.split(left, 2), np.split(stacked, 2), strict=True)
    ]
    tension, _ = misfits(blocks)
    (alone,) = misfits(blocks[:1])
    assert LAW in list(tension.explained)[:2]
    assert tension.significance > SHOWN
    assert tension.significance > 2.0 * alone.significance


def test_what_another_channel_misses_is_not_said_of_noise() -> None:
    """Under `papers` the force may fit to its noise and an angle be off: the parameters have not followed the angle."""
    chance = np.random.default_rng(9)
    force, angle = 1e-3 * chance.standard_normal((2, N))
    J = np.column_stack([D, np.ones(N)])
    force -= J @ np.linalg.lstsq(J, force, rcond=None)[0]
    angle += D + 0.5
    jacobians = J, np.column_stack([0.3 * D, np.ones(N)])
    pairs = zip(("tension", "pitch"), (force, angle), jacobians, strict=True)
    tension, pitch = misfits([Block("pull", c, D - part, part, np.full(N, 1e-3), own) for c, part, own in pairs])
    assert tension.significance > SHOWN
    assert tension.in_residuals < SHOWN < pitch.in_residuals


def test_a_cause_explains_of_a_channel_what_its_own_squares_lose_by_it() -> None:
    """A drift of the pitch would let the parameters follow a curve of the force too: that is no share of the pitch."""
    n, chance = 100, np.random.default_rng(3)
    d = np.linspace(0.0, 1.0, n)
    one = np.ones(n)
    stacked = np.concatenate([np.column_stack([d, one, d**2]), np.column_stack([d**2, one, d**3])])
    error = 0.01 * chance.standard_normal(2 * n) + np.concatenate([0.1 * d**3, 0.0 * d])
    basis = np.linalg.qr(stacked)[0]
    left = error - basis @ (basis.T @ error)
    pairs = zip(("tension", "pitch"), np.split(left, 2), np.split(stacked, 2), strict=True)
    _, pitch = misfits([Block("pull", c, d - part, part, one, own) for c, part, own in pairs])
    drift = np.concatenate([0.0 * d, d])
    drift -= basis @ (basis.T @ drift)
    after = left - drift * (drift @ left) / (drift @ drift)
    assert pitch.significance > SHOWN
    assert pitch.explained[DRIFT] == pytest.approx(1.0 - np.sum(after[n:] ** 2) / np.sum(left[n:] ** 2), abs=0.05)


@pytest.mark.parametrize(("step", "found"), [(0.1, 0.1), (0.03, 0.0), (0.001, 0.0)])
def test_steps_of_readings_are_said_where_they_are_larger_than_the_residuals(step: float, found: float) -> None:
    noise = 0.04 * np.random.default_rng(6).standard_normal(N)
    measured = step * np.round((D + noise) / step)
    assert step_of_readings(measured, D - measured) == pytest.approx(found, rel=1e-6)
    assert step_of_readings(D + noise, noise) == 0.0
    assert step_of_readings(np.zeros(N), noise) == 0.0


def test_contact_is_one_of_the_two_clearest_causes_of_a_force_that_grows_more_from_a_place_on() -> None:
    y = D + 0.3 * D**2
    J = np.column_stack([y, np.ones(N)])
    for place in (0.2, 0.37, 0.6):
        error = 0.002 * np.random.default_rng(2).standard_normal(N) - np.maximum(y - place * y[-1], 0.0)
        (found,) = misfits([block(error - J @ np.linalg.lstsq(J, error, rcond=None)[0], J)])
        assert CONTACT in list(found.explained)[:2]
        assert next(iter(found.explained)) != CONTACT
        assert found.explained[CONTACT] > 0.7
        assert found.significance > 10.0


def test_no_cause_is_larger_than_the_record() -> None:
    """What a stiffness and a slack leave of a drift is little: it would have to be three times the force."""
    predicted = D + 0.02 * D**2
    J = np.column_stack([predicted, np.ones(N)])
    error = 3.0 * D + 1e-4 * np.random.default_rng(4).standard_normal(N)
    left = error - J @ np.linalg.lstsq(J, error, rcond=None)[0]
    (found,) = misfits([Block("pull", "pitch", predicted - left, left, np.full(N, 0.01), J)])
    assert DRIFT not in found.explained
    assert LAW in found.explained
    assert found.significance > 10.0
    assert found.changes is not None
    assert np.abs(found.changes).max() <= 1.1


def test_a_force_that_grows_less_from_a_place_on_is_no_contact_and_an_angle_has_none() -> None:
    hinge, J = np.maximum(D - 0.7, 0.0), (D + 0.3 * D**2)[:, None]
    for channel, sign in (("tension", 1.0), ("pitch", -1.0), ("pitch", 1.0)):
        (found,) = misfits([Block("pull", channel, D - sign * hinge, sign * hinge, np.full(N, 0.01), J)])
        assert CONTACT not in list(found.explained)[:2]
        assert LAW in list(found.explained)[:2]
        assert found.explained.get(CONTACT, 0.0) < (0.05 if channel == "tension" else 1e-9)


def test_friction_needs_both_branches_and_a_jacobian_is_needed() -> None:
    def explained(*of: Block) -> list[str]:
        return [cause for one in misfits(of) for cause in one.explained]

    assert FRICTION not in explained(block(D**2, np.ones((N, 1))))
    assert explained(Block("pull", "tension", D, D, np.ones(N))) == []
    assert explained(block(np.zeros(N), np.ones((N, 1)))) == []
    assert explained(block(D[:19] ** 2, np.ones((19, 1)), D[:19])) == []
    assert explained() == []
    assert DRIFT in explained(block(D**2, np.ones((N, 1))))
    assert FRICTION not in explained(block(D**2, np.zeros((N, 0))))
    assert explained(block(np.zeros(N), np.zeros((N, 0)))) == []
    (unfitted,) = misfits([block(D**2, np.zeros((N, 0)))])
    assert OFFSET in unfitted.explained
    assert max(unfitted.explained.values()) <= 1.0


@pytest.mark.slow
def test_of_right_models_few_are_called_misfits() -> None:
    """Of 200 with white noise, and with noise that is correlated by 0.8, at most one in twenty."""
    for n in (40, 300):
        for correlation in (0.0, 0.8):
            alarms = 0
            for seed in range(200):
                white = np.random.default_rng([seed, n]).standard_normal((2, n))
                d = np.linspace(0.0, 1.0, n)
                J = np.column_stack([d, d**2])
                errors = lfilter([1.0], [1.0, -correlation], white)
                left = [one - J @ np.linalg.lstsq(J, one, rcond=None)[0] for one in errors]
                pairs = zip(("tension", "pitch"), left, strict=True)
                blocks = [Block("pull", channel, d - one, one, 1.0, J) for channel, one in pairs]
                alarms += any(one.significance > SHOWN for one in misfits(blocks)) or any(
                    len(outliers(one)) for one in left
                )
            assert alarms <= 10, (n, correlation)


def test_outliers_are_named_by_their_place() -> None:
    values = np.random.default_rng(7).standard_normal(300)
    values[[20, 150, 299]] += [15.0, -20.0, 25.0]
    assert outliers(values).tolist() == [20, 150, 299]
    curve = 100.0 * np.exp(-(((np.arange(300) - 100) / 8.0) ** 2)) + 0.1 * values
    assert set(outliers(curve)) <= {20, 150, 299}
    assert len(outliers(np.repeat([0.0, 1.0], 150))) == 0
    assert len(outliers(np.zeros(300))) == 0


def test_the_end_of_a_steep_curve_is_no_outlier() -> None:
    """As of an angle that is read in another unit: 41 samples that are off by up to 43 deg, with noise of 0.002 deg."""
    d = np.linspace(0.0, 1.0, 41)
    for seed in range(20):
        curve = -43.0 * d * (1.0 + 0.02 * d) + 2e-3 * np.random.default_rng([seed, 3]).standard_normal(41)
        assert len(outliers(curve)) == 0
        assert len(outliers(curve[::-1])) == 0


def test_noise_that_grows_along_a_record_has_no_outliers() -> None:
    """By thirteen times; of 200 records at most one in twenty is said to have some. A sample that is off stays one."""
    growing, said = 0.2 + 2.4 * np.linspace(0.0, 1.0, 300) ** 2, 0
    for seed in range(200):
        values = growing * np.random.default_rng([seed, 13]).standard_normal(300)
        said += len(outliers(values)) > 0
        values[[150, 290]] += [15.0, -60.0]
        assert {150, 290} <= {*outliers(values).tolist()}
    assert said <= 10


def test_white_noise_is_no_curve_and_a_wave_is_one() -> None:
    """Of 200 right models at most one in twenty is called a misfit; of records as short as 20 samples too."""
    for n in (20, 60, 300):
        alarms = 0
        for seed in range(200):
            found = residual_record(np.random.default_rng([seed, n]).standard_normal(n))
            assert found is not None
            alarms += found.is_curve
        assert alarms <= 10
    alarms = 0
    for seed in range(200):  # noise of an instrument that is correlated by 0.8
        white = np.random.default_rng([seed, 8]).standard_normal(300)
        found = residual_record(lfilter([1.0], [1.0, -0.8], white))
        assert found is not None
        alarms += found.is_curve
    assert alarms <= 10
    wave = residual_record(np.cos(5.0 * D) + 0.1 * np.random.default_rng(2).standard_normal(N))
    assert wave is not None
    assert wave.is_curve
    assert wave.size == pytest.approx(np.sqrt(np.mean(np.cos(5.0 * D) ** 2)), rel=0.05)


@pytest.mark.parametrize(("place", "where"), [(0, 0.0), (60, 0.5), (119, 1.0)])
def test_where_a_curve_is_largest(place: int, where: float) -> None:
    found = residual_record(np.exp(-(((np.arange(N) - place) / 8.0) ** 2)))
    assert found is not None
    assert found.largest == pytest.approx(where, abs=0.04)


@pytest.mark.parametrize("loss", [LikelihoodLoss(), PapersLoss()], ids=lambda loss: loss.name)
def test_what_the_model_misses_is_in_the_intervals(loss: Loss, monkeypatch: pytest.MonkeyPatch) -> None:
    """An IMU that is turned by 0.1 rad, ten times its noise; of a right model nothing is added."""
    right, wrong = (linear_problem(loss, n=200, seed=3) for _ in range(2))
    wrong = replace(wrong, experiments=tuple(turned(one) for one in wrong.experiments))
    assert "misfit" not in calibrate(right).parameters[E].shares
    found = calibrate(wrong)
    with monkeypatch.context() as without:
        without.setattr(estimator_module, "missed", lambda blocks: [None] * len(blocks))
        alone = calibrate(wrong)
    missing = 0
    for name in (E, NU):
        one, other = found.parameters[name].interval, alone.parameters[name].interval
        assert one is not None
        assert other is not None
        assert one[0] <= other[0] < other[1] <= one[1]
        assert one[0] <= TRUE[name] <= one[1]
        missing += not other[0] <= TRUE[name] <= other[1]
    assert missing
    assert "what the model misses in the residuals, or may miss" in " ".join(map(str, found.notes))


def turned(experiment: Experiment) -> Experiment:
    pitch = experiment.dataset.channels["pitch"]
    channels = {**experiment.dataset.channels, "pitch": replace(pitch, values=pitch.values - 0.1)}
    return replace(experiment, dataset=replace(experiment.dataset, channels=channels))
