"""Both losses: their values by hand, their gradients, and what they refuse."""

from __future__ import annotations

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate

from softcal.calibration.problem.loss import Loss, rms, rms_detrended
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.errors import DatasetError, InputError

MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log")
RATIO = FreeParameter(NU, "1", 0.4, 0.4999)
SIGMAS = {"tension": 0.1, "pitch": 0.01, "shortening": 1e-3}
SLACK = FreeParameter("front.slack", "m", -0.001, 0.01, per_experiment=True)


def two(loss: Loss, *parameters: FreeParameter, drive: str = "shortening") -> Problem:
    experiments = [fake_experiment("a", drive=drive), fake_experiment("b", reach=0.02, noise=0.03, drive=drive)]
    return make_problem(fake_robot(), experiments, parameters or (MODULUS, RATIO), loss, fake_simulate)


@pytest.mark.parametrize("loss", [PapersLoss(), LikelihoodLoss(SIGMAS)])
@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_gradients_are_those_of_central_differences(loss: Loss, drive: str) -> None:
    problem = two(loss, MODULUS, RATIO, SLACK, drive=drive)
    theta = {E: 1.9e6, NU: 0.46, "front.slack[a]": 1.1e-3, "front.slack[b]": 2.2e-3}
    gradient = problem.evaluate(theta, jacobian=True).gradient
    assert gradient is not None
    for j, (label, value) in enumerate(theta.items()):
        step = 1e-6 * value
        above, below = (problem.evaluate({**theta, label: value + s}).loss for s in (step, -step))
        assert above is not None
        assert below is not None
        assert gradient[j] == pytest.approx((above - below) / (2 * step), rel=1e-5)


def test_the_papers_loss_is_the_mean_over_experiments_of_equation_4() -> None:
    problem = two(PapersLoss())
    evaluation = problem.evaluate({E: 1.9e6, NU: 0.46})
    errors = {(b.experiment, b.channel): rms(b.residual) for b in evaluation.blocks}
    alone = {name: 0.3 * errors[name, "tension"] + errors[name, "pitch"] for name in ("a", "b")}
    assert evaluation.experiment_losses == pytest.approx(alone)
    assert evaluation.loss == pytest.approx((alone["a"] + alone["b"]) / 2)


def test_driven_by_tension_the_papers_loss_counts_millimetres_as_it_counts_newtons() -> None:
    problem = make_problem(fake_robot(), [fake_experiment(drive="tension")], (MODULUS,), PapersLoss(), fake_simulate)
    evaluation = problem.evaluate({E: 1.9e6})
    errors = {b.channel: rms(b.residual) for b in evaluation.blocks}
    assert evaluation.loss == pytest.approx(0.3 * errors["shortening"] * 1e3 + errors["pitch"])


def test_the_likelihood_is_the_sum_of_squares_over_sigma_and_of_the_priors() -> None:
    modulus = FreeParameter(E, "Pa", 0.1e6, 40e6, prior_mean=2e6, prior_sd=0.5e6)
    problem = two(LikelihoodLoss(SIGMAS), modulus)
    evaluation = problem.evaluate({E: 1.5e6}, jacobian=True)
    expected = sum(float(((b.residual / SIGMAS[b.channel]) ** 2).sum()) for b in evaluation.blocks if b.experiment)
    assert evaluation.loss == pytest.approx(expected + 1.0)
    assert set(evaluation.experiment_losses) == {"a", "b"}


def test_the_datasets_own_sigma_is_used_and_one_that_is_unknown_is_refused() -> None:
    known = fake_experiment(sigma=0.01)
    problem = make_problem(fake_robot(), [known], (MODULUS,), LikelihoodLoss(), fake_simulate)
    blocks = problem.evaluate({E: 2e6}).blocks
    expected = sum(float(((b.residual / b.sigma) ** 2).sum()) for b in blocks)
    assert problem.evaluate({E: 2e6}).loss == pytest.approx(expected)
    with pytest.raises(DatasetError) as caught:
        make_problem(fake_robot(), [fake_experiment()], (MODULUS,), LikelihoodLoss(), fake_simulate)
    assert len(caught.value.faults) == 2
    assert "needs the noise of 'tension'" in str(caught.value)
    assert "under `noise` of the experiment" in str(caught.value)


def test_the_papers_loss_counts_no_prior_and_says_so() -> None:
    modulus = FreeParameter(E, "Pa", 0.1e6, 40e6, prior_mean=2e6, prior_sd=0.5e6)
    with pytest.raises(InputError, match="does not use priors"):
        two(PapersLoss(), modulus)


def test_a_channel_without_weight_is_refused() -> None:
    with pytest.raises(DatasetError, match="no weight for 'pitch'"):
        two(PapersLoss({"tension": 0.3}))


def test_a_perfect_fit_has_no_loss_and_a_finite_gradient() -> None:
    problem = make_problem(fake_robot(), [fake_experiment()], (MODULUS, RATIO), PapersLoss(), fake_simulate)
    evaluation = problem.evaluate(TRUE, jacobian=True)
    assert evaluation.loss == 0.0
    assert evaluation.gradient is not None
    assert np.all(np.isfinite(evaluation.gradient))


def test_detrending_takes_off_just_the_best_straight_line() -> None:
    x = np.arange(50.0)
    wave = np.sin(x)
    slope, offset = np.polyfit(x, wave, 1)
    assert rms_detrended(wave + 3.0 * x - 7.0) == pytest.approx(rms(wave - slope * x - offset))
    assert rms_detrended(3.0 * x - 7.0) == pytest.approx(0.0, abs=1e-10)
    assert rms_detrended(np.array([5.0])) == 0.0
