"""How experiments of a joint fit differ, on a linear model: which parameter, their own values, and the interval."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.statistics.band import half_width
from softcal.calibration.statistics.estimator import Estimator, estimator

N, K = 40, 4
PLACES = np.linspace(0.1, 1.0, N)
# Two shared parameters, and an offset of each experiment's own.
SHARED = np.column_stack([PLACES, PLACES**2])
SIGMA = 0.01
LOSS = LikelihoodLoss()
Z = np.full(2 + K, 0.5)
NAMES = [f"pull{i}" for i in range(K)]
SERVES = {name: np.array([True, True, *(j == i for j in range(K))]) for i, name in enumerate(NAMES)}


def found_with(own: np.ndarray, seed: int = 0, column: int = 0) -> tuple[Estimator, np.ndarray]:
    """The estimator at the joint minimum, and that minimum less the truth; own: each experiment's first parameter."""
    chance = np.random.default_rng([seed, 8])
    jacobians = [np.column_stack([SHARED, np.tile(np.eye(K)[i], (N, 1))]) for i in range(K)]
    noise = [SIGMA * chance.standard_normal(N) - SHARED[:, column] * own[i] for i in range(K)]
    step = np.linalg.lstsq(np.concatenate(jacobians), -np.concatenate(noise), rcond=None)[0]
    blocks = [
        Block(name, "tension", 5.0 - (e + J @ step), e + J @ step, SIGMA, J)
        for name, e, J in zip(NAMES, noise, jacobians, strict=True)
    ]
    return estimator(LOSS, Z, np.ones(2 + K), blocks, SERVES), step


OWN = np.array([-0.2, 0.05, 0.1, 0.3])


def test_each_experiments_own_value_is_found_without_another_fit() -> None:
    found, step = found_with(OWN)
    first = found.between[0]
    assert first.column == 0
    assert first.effects.differs
    values = step[0] + np.array([first.steps[name] for name in NAMES])
    np.testing.assert_allclose(values, OWN, atol=5 * SIGMA)
    assert first.effects.spread == pytest.approx(OWN.std(ddof=1), rel=0.1)
    assert found.minimum[0] == pytest.approx(Z[0] + first.effects.mean, abs=0.02)


def test_one_difference_is_not_counted_in_two_parameters() -> None:
    """E and nu trade off: a difference in one of them alone must not appear in the other."""
    found, _ = found_with(OWN)
    assert [one.effects.differs for one in found.between] == [True, False]
    found, _ = found_with(OWN, column=1)
    assert [(one.column, one.effects.differs) for one in found.between] == [(1, True), (0, False)]


def test_a_difference_of_which_another_one_would_leave_the_box_is_not_compared() -> None:
    """Two parameters that nearly trade off: as differences of both, the second would move by 1.2 of its search range,
    the first by a fiftieth of that, and every interval would be long.
    """
    bent, K0 = 0.02, np.eye(K)
    shared = np.column_stack([50.0 * PLACES, PLACES + bent * np.sin(6.0 * PLACES)])
    jacobians = [np.column_stack([shared, np.tile(K0[i], (N, 1))]) for i in range(K)]
    apart = 1.2 * np.array([1.0, -1.0, 1.0, -1.0])
    chance = np.random.default_rng(9)
    noise = [
        SIGMA * chance.standard_normal(N) - shared @ [-one / 50.0, one] - 0.1 * one * shared[:, 1] for one in apart
    ]
    step = np.linalg.lstsq(np.concatenate(jacobians), -np.concatenate(noise), rcond=None)[0]
    blocks = [
        Block(name, "tension", 5.0 - (e + J @ step), e + J @ step, SIGMA, J)
        for name, e, J in zip(NAMES, noise, jacobians, strict=True)
    ]
    found = estimator(LOSS, Z, np.ones(2 + K), blocks, SERVES)
    assert [(one.column, one.effects.differs) for one in found.between] == [(1, True)]


@pytest.mark.slow
def test_the_band_contains_a_further_experiment_and_is_no_longer_than_that_takes() -> None:
    """Student's t by the differences of four experiments alone, 3.2, would be for errors that are all theirs."""
    inside, lengths = [], []
    J = np.column_stack([SHARED, np.zeros((N, K))])
    for seed in range(40):
        chance = np.random.default_rng([seed, 3])
        *own, further = 5.0 * SIGMA * chance.standard_normal(K + 1)
        found, _ = found_with(np.array(own), seed)
        measured = SHARED[:, 0] * further + SIGMA * chance.standard_normal(N)
        residual = SHARED @ (found.minimum[:2] - Z[:2]) - measured
        half = half_width(
            LOSS, Block("further", "tension", measured, residual, SIGMA, J), J, found.within_bounds, found
        )
        variance = np.einsum("ni,ij,nj->n", J, found.within_bounds, J) + SIGMA**2
        for one in found.between:
            variance += (one.effects.differs * one.effects.spread * J[:, one.column]) ** 2
        inside.append(np.mean(np.abs(residual) <= half))
        lengths.append(np.mean(half / np.sqrt(variance)))
    assert 0.88 < np.mean(inside) < 0.99  # 94 % of 150 such sets
    assert 1.96 < np.mean(lengths) < 3.0


def test_alike_experiments_leave_the_estimator_as_it_is() -> None:
    found, _ = found_with(np.zeros(K))
    assert not any(one.effects.differs for one in found.between)
    assert set(found.variances) == {"noise", "bounds"}
    assert np.all(found.variances["bounds"] < 0.1 * found.variances["noise"])


def test_a_difference_beyond_the_bounds_is_no_explanation() -> None:
    found, _ = found_with(8.0 * OWN)
    assert all(one.column != 0 for one in found.between)


@pytest.mark.long
def test_the_interval_holds_the_mean_of_the_experiments() -> None:
    from scipy.stats import t

    held = {"first": 0, "second": 0, "own": 0}
    n = 150
    for seed in range(n):
        own = 0.1 * np.random.default_rng([seed, 9]).standard_normal(K)
        found, step = found_with(own, seed)
        reach = t.ppf(0.975, found.dof) * np.linalg.norm(found.root, axis=0)
        inside = np.abs(found.minimum - (Z - step)) <= reach  # of the truth: no difference in the mean
        held = {k: held[k] + int(inside[i]) for i, k in enumerate(held)}
    assert all(0.91 * n <= count for count in held.values()), held
    assert held["first"] <= 0.99 * n
