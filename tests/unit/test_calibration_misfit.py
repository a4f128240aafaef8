"""Residuals that are a curve and no noise, and what would explain them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from softcal.calibration import misfit
from softcal.calibration.loss import Block
from softcal.calibration.misfit import DRIFT, FRICTION, GAIN, LAW, OFFSET, explained_by
from softcal.calibration.residuals import residual_record

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
    found = explained_by(block(error - q @ (q.T @ error), jacobian, d))
    assert next(iter(found)) == cause
    assert found[cause] > 0.9
    assert GAIN not in found
    assert list(found.values()) == sorted(found.values(), reverse=True)


def test_friction_needs_both_branches_and_a_jacobian_is_needed() -> None:
    assert FRICTION not in explained_by(block(D**2, np.zeros((N, 0))))
    assert explained_by(Block("pull", "tension", D, D, np.ones(N))) == {}
    assert explained_by(block(np.zeros(N), np.zeros((N, 0)))) == {}
    assert max(explained_by(block(D**2, np.zeros((N, 0)))).values()) <= 1.0
    assert misfit.OFFSET in explained_by(block(D**2, np.zeros((N, 0))))


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
