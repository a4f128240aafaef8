"""Random effects: Q, the spread between experiments, and the interval of their mean."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, t

from softcal.calibration.statistics.random_effects import random_effects

EXACT = np.inf


def test_with_equal_variances_the_spread_has_a_closed_form() -> None:
    values = np.array([1.0, 2.0, 4.0, 7.0])
    found = random_effects(values, np.full(4, 0.25), np.full(4, EXACT))
    assert found.mean == pytest.approx(values.mean())
    assert found.spread**2 == pytest.approx(values.var(ddof=1) - 0.25, rel=1e-4)
    assert found.error == pytest.approx(np.sqrt(values.var(ddof=1) / 4), rel=1e-4)
    assert found.q == pytest.approx(values.var(ddof=1) * 3 / 0.25)
    assert found.chance == pytest.approx(chi2.sf(found.q, 3))
    assert found.dof == 3
    assert found.among(3).chance == pytest.approx(3 * found.chance)


def test_experiments_that_agree_have_no_spread() -> None:
    found = random_effects(np.array([1.0, 1.1, 0.9]), np.full(3, 1.0), np.full(3, EXACT))
    assert found.spread == 0.0
    assert not found.differs
    assert found.error == pytest.approx(np.sqrt(1 / 3))  # no shorter than by the noise within


def test_one_that_is_off_is_a_spread_however_closely_the_others_agree() -> None:
    """As of four tests with moduli of 1.5, 1.5, 1.5 and 1.02, the last with a larger error by its misfit."""
    values, errors = np.array([1.5, 1.501, 1.02, 1.4995]), np.array([1e-3, 1e-3, 0.1, 1e-3])
    found = random_effects(values, errors**2, np.full(4, EXACT))
    assert found.differs
    assert found.spread == pytest.approx(np.std(values, ddof=1), rel=0.1)
    assert found.mean == pytest.approx(values.mean(), abs=0.03)
    assert found.error == pytest.approx(np.std(values, ddof=1) / 2, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(("k", "dof"), [(3, 3.0), (4, 10.0), (4, EXACT)])
def test_alike_experiments_are_called_different_one_time_in_twenty(k: int, dof: float) -> None:
    chance = np.random.default_rng(5)
    alarms, n = 0, 1000
    for _ in range(n):
        v = np.exp(0.7 * chance.standard_normal(k))
        found = v if np.isinf(dof) else v * chance.chisquare(dof, size=k) / dof
        alarms += random_effects(np.sqrt(v) * chance.standard_normal(k), found, np.full(k, dof)).differs
    assert 0.02 <= alarms / n <= 0.09


def test_the_interval_of_the_mean_holds_it() -> None:
    chance = np.random.default_rng(6)
    n, held = 600, 0
    for _ in range(n):
        v = np.exp(0.7 * chance.standard_normal(4))
        values = 2.0 * chance.standard_normal(4) + np.sqrt(v) * chance.standard_normal(4)
        found = random_effects(values, v, np.full(4, EXACT))
        held += abs(found.mean) <= t.ppf(0.975, found.dof) * found.error
    assert 0.93 <= held / n <= 0.99
