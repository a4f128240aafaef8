"""The covariance of a loss's minimum against what brute force gives: thousands of draws of noise on a linear model."""

from __future__ import annotations

import math

import numpy as np
import pytest

import softcal.calibration.statistics.estimator as estimator_module
from softcal.calibration.problem.loss import Block, Loss, gradient
from softcal.calibration.problem.losses.distance import DistanceLoss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.statistics.estimator import estimator

DRAWS = 2000
# The sampling error of a standard deviation from that many draws is 1.6 %; three of these, and the sandwich's own.
WITHIN = 0.05
N = 40
PLACES = np.linspace(0.0, 1.0, N)
# Three parameters; tension feels all, pitch the last two.
TENSION = np.column_stack([1.0 + PLACES, PLACES**2, np.cos(5 * PLACES)])
PITCH = np.column_stack([np.zeros(N), 0.3 * PLACES, 0.2 * np.sin(3 * PLACES)])
SIGMA = {"tension": 0.5, "pitch": 0.01}
Z, ONES = np.full(3, 0.5), np.ones(3)


def blocks_of(
    step: np.ndarray, noise: dict[str, np.ndarray], sigma: dict[str, float], prior: tuple[float, float] | None = None
) -> list[Block]:
    """Tension and pitch at a step from the truth; prior: (error of its mean, sd) of the first parameter."""
    rows = {"tension": TENSION, "pitch": PITCH}
    left = {c: J @ step + noise[c] for c, J in rows.items()}
    blocks = [Block("pull", c, 10.0 - left[c], left[c], sigma.get(c, 0.0), J) for c, J in rows.items()]
    if prior is not None:
        mean, sd = prior
        blocks.append(Block("", "prior", np.zeros(1), np.array([step[0] - mean]), sd, np.eye(3)[:1]))
    return blocks


def minimum(loss: Loss, noise: dict[str, np.ndarray], sigma: dict[str, float], prior=None) -> np.ndarray:
    """Iterated weighted least squares down to where the loss's gradient vanishes."""
    step = np.zeros(3)
    for _ in range(200):
        blocks = blocks_of(step, noise, sigma, prior)
        weights = [loss.square_weights(block, block.residual) for block in blocks]
        A = sum(b.jacobian.T @ (w[:, None] * b.jacobian) for b, w in zip(blocks, weights, strict=True))
        g = sum(b.jacobian.T @ (w * b.residual) for b, w in zip(blocks, weights, strict=True))
        change = np.linalg.solve(A, g)
        step = step - change
        if np.abs(change).max() < 1e-10:
            break
    assert np.abs(gradient(loss, blocks_of(step, noise, sigma, prior))).max() < 1e-6
    return step


def drawn(chance: np.random.Generator, true: dict[str, float]) -> dict[str, np.ndarray]:
    return {c: s * chance.standard_normal(N) for c, s in true.items()}


CASES = {
    "papers": (PapersLoss({"tension": 0.3, "pitch": 1.0}), {}, SIGMA, None),
    "likelihood": (LikelihoodLoss(), SIGMA, SIGMA, None),
    "prior": (LikelihoodLoss(), SIGMA, SIGMA, 0.05),
    # Noise three times what was stated, in one channel alone; the prior is right.
    "understated": (LikelihoodLoss(), SIGMA, {"tension": 1.5, "pitch": 0.01}, 0.05),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_it_is_the_scatter_of_the_minimum(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of its noise; what the model may miss makes the standard errors of these right models longer by 5 % at most."""
    loss, stated, true, prior_sd = CASES[name]
    chance = np.random.default_rng(0)
    found, variances, with_missed = [], [], []
    for i in range(DRAWS):
        noise = drawn(chance, true)
        prior = None if prior_sd is None else (prior_sd * chance.standard_normal(), prior_sd)
        step = minimum(loss, noise, stated, prior)
        found.append(step)
        if i < DRAWS // 10:
            blocks = blocks_of(step, noise, stated, prior)
            told = estimator(loss, Z, ONES, blocks)
            with_missed.append(np.diag(told.root.T @ told.root))
            with monkeypatch.context() as alone:
                alone.setattr(estimator_module, "missed", lambda blocks: [None] * len(blocks))
                told = estimator(loss, Z, ONES, blocks)
            variances.append(np.diag(told.root.T @ told.root))
            assert told.minimum == pytest.approx(Z, abs=1e-6)
    longer = np.mean(np.sqrt(with_missed), axis=0) / np.mean(np.sqrt(variances), axis=0)
    assert np.all((longer >= 1.0) & (longer < 1.05))
    scatter = np.std(found, axis=0)
    ratio = np.sqrt(np.mean(variances, axis=0)) / scatter
    assert ratio.min() > 1 - WITHIN
    # Stated noise is never taken for smaller, which with 40 samples makes it 5 % too large in the mean.
    assert ratio.max() < 1 + WITHIN + (0.05 if stated else 0.0)


def test_the_inverse_of_the_weighted_squares_would_be_wrong_for_a_sum_of_rmses() -> None:
    """What was stated before: that an RMSE's residuals are weighted by one over their variance."""
    rows = np.concatenate([TENSION / SIGMA["tension"], PITCH / SIGMA["pitch"]])
    by_variance = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    chance = np.random.default_rng(1)
    loss = CASES["papers"][0]
    scatter = np.std([minimum(loss, drawn(chance, SIGMA), {}) for _ in range(300)], axis=0)
    assert np.max(scatter / by_variance) > 1.5


@pytest.mark.slow
def test_the_noise_is_found_without_bias_and_a_prior_does_not_share_in_the_excess() -> None:
    loss, stated, true, prior_sd = CASES["understated"]
    chance = np.random.default_rng(2)
    sizes, pitches = [], []
    for _ in range(400):
        noise = drawn(chance, true)
        prior = (prior_sd * chance.standard_normal(), prior_sd)
        told = estimator(loss, Z, ONES, blocks_of(minimum(loss, noise, stated, prior), noise, stated, prior))
        sizes.append(told.noise["tension"].size ** 2)
        pitches.append(told.noise["pitch"].size)
        assert told.noise[""].size == 1.0
    assert np.mean(sizes) == pytest.approx(9.0, rel=0.03)
    assert min(pitches) == 1.0  # not below what was stated
    assert np.mean(pitches) < 1.1


def test_a_vague_measurement_cannot_widen_what_a_prior_says() -> None:
    # Only the prior knows the second parameter; residuals ten times the stated noise leave its sd as it is.
    chance = np.random.default_rng(3)
    noise = 10.0 * 0.1 * chance.standard_normal(N)
    rows = np.column_stack([np.ones(N), np.ones(N)])
    blocks = [
        Block("pull", "tension", np.full(N, 10.0), noise - noise.mean(), 0.1, rows),
        Block("", "prior", np.zeros(1), np.zeros(1), 0.05, np.array([[0.0, 1.0]])),
    ]
    told = estimator(LikelihoodLoss(), Z[:2], ONES[:2], blocks)
    assert math.sqrt((told.root.T @ told.root)[1, 1]) == pytest.approx(0.05, rel=1e-6)
    assert told.noise["tension"].size == pytest.approx(10.0, rel=0.2)
    assert told.dof[1] > 1e5  # not infinite: the bounds tie it to the first parameter, by a millionth
    assert told.dof[0] > 30


def test_every_axis_of_a_camera_has_noise_of_its_own() -> None:
    chance = np.random.default_rng(4)
    sizes = {"x": 1e-3, "y": 1e-3, "z": 5e-3}
    blocks = [
        Block("load", f"m{k}.{a}", 1.0 - noise, noise, 0.0, 0.1 * np.eye(3)[[i] * 20], f"m{k}")
        for k in range(6)
        for i, (a, s) in enumerate(sizes.items())
        for noise in [s * chance.standard_normal(20)]
    ]
    told = estimator(DistanceLoss(0.4), Z, ONES, blocks)
    assert {g: n.size for g, n in told.noise.items()} == pytest.approx(sizes, rel=0.15)
    covariance = told.root.T @ told.root
    assert math.sqrt(covariance[2, 2] / covariance[0, 0]) == pytest.approx(5.0, rel=0.3)
    assert told.dof == pytest.approx([119.0] * 3)


def test_as_many_parameters_as_measurements_tell_nothing_of_the_noise() -> None:
    blocks = [Block("pull", "tension", np.ones(2), np.zeros(2), 0.0, np.eye(2))]
    told = estimator(PapersLoss({"tension": 1.0}), Z[:2], ONES[:2], blocks)
    assert told.spent == ("tension in pull",)
    stated = estimator(LikelihoodLoss({"tension": 0.1}), Z[:2], ONES[:2], blocks)
    assert stated.spent == ()
    assert stated.noise["tension"].size == 1.0
    assert np.sqrt(np.diag(stated.root.T @ stated.root)) == pytest.approx([0.1, 0.1])
    assert np.all(np.isinf(stated.dof))
