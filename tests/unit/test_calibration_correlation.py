"""Residuals along a record: a process plus white noise where the likelihood asks for it."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.calibration.statistics.correlation import BINS, ErrorRecord, process, record

N = 60
LINE = np.column_stack([np.ones(N), np.linspace(-1, 1, N)])


def _noise(chance: np.random.Generator, n: int, share: float, length: float) -> np.ndarray:
    places = np.arange(n)
    S = share * np.exp(-np.abs(places[:, None] - places) / length) + (1 - share) * np.eye(n)
    return np.linalg.cholesky(S) @ chance.standard_normal(n)


def _records(seed: int, k: int, share: float, length: float) -> list[ErrorRecord]:
    chance = np.random.default_rng([seed, 11])
    return [ErrorRecord(_noise(chance, N, share, length), LINE, LINE) for _ in range(k)]


def test_the_process_that_made_the_residuals_is_found() -> None:
    found = process(_records(0, 40, 0.7, 6.0))
    assert found is not None
    assert found.share == pytest.approx(0.7, abs=0.1)
    assert found.length == pytest.approx(6.0, rel=0.25)
    assert found.variance == pytest.approx(1.0, rel=0.15)


def test_what_the_parameters_explain_changes_nothing() -> None:
    plain = _records(1, 3, 0.7, 6.0)
    shifted = [ErrorRecord(r.residual + LINE @ [5.0, -3.0 * i], LINE, LINE) for i, r in enumerate(plain)]
    a, b = process(plain), process(shifted)
    assert a is not None
    assert b is not None
    assert (b.variance, b.share, b.length) == pytest.approx((a.variance, a.share, a.length), rel=1e-6)


def test_white_noise_stays_white_but_for_one_time_in_twenty() -> None:
    alarms = sum(process(_records(seed, 1, 0.0, 1.0)) is not None for seed in range(300))
    assert 0 < alarms <= 300 * 0.08


@pytest.mark.slow
def test_the_scatter_of_the_variance_is_that_of_repeated_records() -> None:
    """Of the mean of a record, by the process of three records: found variances against their stated scatter."""
    answer = np.full((N, 1), 1.0 / N)
    found = [held for seed in range(150) if (held := process(_records(seed, 3, 0.8, 5.0))) is not None]
    assert len(found) > 140
    variances = np.array([(answer.T @ held.covariance(N) @ answer).item() for held in found])
    stated = np.array([held.scatter_of([answer])[0] for held in found])
    ratio = np.var(np.log(variances)) / np.median(stated / variances**2)
    assert 0.4 < ratio < 2.0


def test_long_records_are_averaged_and_sums_of_pulls_kept() -> None:
    n = 10 * BINS + 7
    chance = np.random.default_rng(3)
    residual, pull = chance.standard_normal(n), chance.standard_normal((n, 2))
    held = record(residual, pull, pull, "a")
    assert len(held.residual) == BINS
    np.testing.assert_allclose(held.pull.sum(axis=0), pull.sum(axis=0))


@pytest.mark.parametrize("values", [np.zeros(N), np.ones(4)])
def test_residuals_without_noise_and_short_records_have_no_process(values: np.ndarray) -> None:
    columns = LINE[: len(values)]
    assert process([ErrorRecord(values, columns, columns)]) is None
