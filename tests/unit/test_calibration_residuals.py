"""Residuals along a record: correlation, runs, and what they are worth."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.calibration.statistics.residuals import residual_record


def test_independent_residuals_are_worth_their_number() -> None:
    found = residual_record(np.random.default_rng(1).standard_normal(4000))
    assert found is not None
    assert found.effective == pytest.approx(4000, rel=0.1)
    assert found.runs == pytest.approx(found.expected_runs, rel=0.05)
    assert not found.are_alike


def test_an_autoregressive_record_is_worth_as_many_as_the_formula_says() -> None:
    chance, r = np.random.default_rng(2), 0.9
    values = np.zeros(20000)
    for i in range(1, len(values)):
        values[i] = r * values[i - 1] + chance.standard_normal()
    found = residual_record(values)
    assert found is not None
    assert found.correlation == pytest.approx(r, abs=0.01)
    assert found.effective == pytest.approx(len(values) * (1 - r) / (1 + r), rel=0.1)
    assert found.are_alike


def test_a_drift_of_one_sign_is_one_run() -> None:
    found = residual_record(np.linspace(1.0, 2.0, 50))
    assert found is not None
    assert (found.runs, found.expected_runs) == (1, 1.0)
    assert found.effective < 2


@pytest.mark.parametrize("values", [np.zeros(5), np.ones(1), np.zeros(0)])
def test_where_nothing_is_left_there_is_nothing_to_say(values: np.ndarray) -> None:
    assert residual_record(values) is None
