"""Two clocks onto one: a known lag and rate come back, and a match that is none is refused."""

from __future__ import annotations

import re

import bench_record
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from softcal.errors import DatasetError, InputError
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.merge import merge_on_one_clock
from softcal.experiments.synchronise import CommonMotion, clock_warning, fit_clock, synchronise

MOVED = bench_record.motion(4)


def utm() -> Dataset:
    return Dataset("utm", {"time": Channel(MOVED.time, "s"), "shortening": Channel(MOVED.shortening, "m")})


def imu(
    lag: float, rate: float = 0.0, noise: float = 5e-4, step: float = 0.01, sign: float = 1.0, seed: int = 0
) -> Dataset:
    true_time = np.arange(-5.0, MOVED.time[-1] + 5.0, step)
    angle = bench_record.pitch(np.interp(true_time, MOVED.time, MOVED.shortening), true_time, noise, seed)
    clock = true_time + lag + rate * (true_time - 0.5 * MOVED.time[-1])
    return Dataset("imu", {"time": Channel(clock, "s"), "pitch": Channel(sign * angle, "rad")})


@settings(max_examples=25, deadline=None)
@given(
    lag=st.floats(-500.0, 500.0),
    rate=st.floats(-1e-3, 1e-3),
    step=st.floats(0.005, 0.04),
    sign=st.sampled_from([1.0, -1.0]),
    seed=st.integers(0, 99),
)
def test_recovers_a_known_clock(lag: float, rate: float, step: float, sign: float, seed: int) -> None:
    fit = fit_clock(utm(), imu(lag, rate, step=step, sign=sign, seed=seed), CommonMotion())
    assert_allclose(fit.to_imu(MOVED.time), MOVED.time + lag + rate * (MOVED.time - 0.5 * MOVED.time[-1]), atol=5e-3)
    assert_allclose(fit.rate, rate, atol=1.5e-4)
    assert sign * fit.correlation > 0.98


def test_nothing_is_made_up_where_a_record_has_a_gap() -> None:
    """Samples in a gap of the other record are left out, as those beyond its ends, and the step says so."""
    whole = imu(0.0, noise=0.0)
    clock = whole.values("time")
    seen = (clock < 8.0) | (clock > 11.0)
    gone = whole.take(np.flatnonzero(seen), Step("read_table", {}, ""))
    inside = (MOVED.time > 8.0) & (MOVED.time < 11.0)
    for merged in (merge_on_one_clock(utm(), gone), synchronise(utm(), gone, CommonMotion(estimate_rate=False))):
        time = merged.values("time")
        assert 0 < inside.sum() <= len(MOVED.time) - len(time) <= inside.sum() + 4
        assert not ((time > 8.1) & (time < 10.9)).any()
        assert f"{len(time)} of {len(MOVED.time)} samples" in merged.provenance[-1].outcome


def test_a_missing_value_of_the_motion_leaves_the_clocks_matched() -> None:
    whole = imu(3.0, noise=0.0)
    values = whole.values("pitch").copy()
    values[800:820] = np.nan
    seen = whole.with_channels(Step("read_table"), pitch=values)
    merged, complete = (synchronise(utm(), one, CommonMotion()) for one in (seen, whole))
    assert merged.provenance[-1].settings["lag"] == pytest.approx(complete.provenance[-1].settings["lag"], abs=1e-3)
    gone = np.isnan(merged.values("pitch"))
    assert 0 < gone.sum() < 20
    assert_allclose(merged.values("pitch")[~gone], complete.values("pitch")[~gone], atol=1e-3)


def test_lag_is_finer_than_a_sample() -> None:
    fit = fit_clock(utm(), imu(1.2345, noise=0.0, step=0.02), CommonMotion(estimate_rate=False))
    assert_allclose(fit.lag, 1.2345, atol=1.5e-3)


def test_merges_on_the_machines_clock() -> None:
    merged = synchronise(utm(), imu(3.0, noise=0.0))
    assert merged.n_samples == utm().n_samples
    assert_allclose(merged.values("time"), MOVED.time)
    assert_allclose(merged.values("pitch"), bench_record.pitch(MOVED.shortening, MOVED.time, 0.0), atol=2e-4)
    outcome = merged.provenance[-1].outcome
    assert "+3.00" in outcome
    assert "ppm" in outcome
    assert "correlation of shortening and pitch +0.99" in outcome


def test_files_in_the_other_order_are_told_the_right_one() -> None:
    with pytest.raises(DatasetError, match=r"first of the two files has no shortening.*Try: first the file with short"):
        synchronise(imu(3.0), utm())


@pytest.mark.parametrize(("rate", "told"), [(1e-4, r"runs \d+ ppm faster"), (-1e-4, r"runs \d+ ppm slower")])
def test_a_clock_that_loses_is_slower(rate: float, told: str) -> None:
    assert re.search(told, synchronise(utm(), imu(3.0, rate, noise=0.0)).provenance[-1].outcome)


@pytest.mark.parametrize("rate", [4e-4, -1.6e-3])
def test_a_rate_that_no_quartz_has_is_not_used(rate: float) -> None:
    records = utm(), imu(3.0, rate)
    step = synchronise(*records).provenance[-1]
    plain = synchronise(*records, CommonMotion(estimate_rate=False)).provenance[-1]
    assert (step.settings["rate"], step.settings["lag"]) == (0.0, plain.settings["lag"])
    assert_allclose(step.settings["estimate"], rate, atol=1.5e-4)
    pace = "faster" if rate > 0 else "slower"
    assert re.search(rf"taken to run as fast, since no quartz clock runs \d+ ppm {pace}; corr", step.outcome)
    assert "since" not in plain.outcome


def test_a_short_record_of_a_material_that_lags_says_nothing_of_the_clock() -> None:
    """31 s, three cycles, a pitch that follows the crosshead with a time constant of 1 s: its lag is not a clock's."""
    time, cycles = np.arange(0.0, 31.0, 0.02), 3.0
    moved = 0.02 * (1.0 - np.abs(2.0 * (cycles * time / 31.0 % 1.0) - 1.0))
    pitch = np.zeros_like(moved)
    for k in range(1, len(moved)):
        pitch[k] = pitch[k - 1] + 0.02 * (10.0 * moved[k] - pitch[k - 1])
    machine = Dataset("utm", {"time": Channel(time, "s"), "shortening": Channel(moved, "m")})
    sensor = Dataset("imu", {"time": Channel(time + 2.3, "s"), "pitch": Channel(pitch, "rad")})
    assert abs(fit_clock(machine, sensor, CommonMotion()).rate) > 5e-4
    both = synchronise(machine, sensor)
    assert both.provenance[-1].settings["rate"] == 0.0
    assert "is taken to run as fast" in clock_warning(both)


def test_only_samples_that_both_have_are_kept() -> None:
    late = imu(0.0, noise=0.0)
    late = late.take(late.values("time") > 6.0, Step("test"))
    merged = synchronise(utm(), late, CommonMotion(max_lag=2.0))
    assert_allclose(merged.values("time")[0], 6.0, atol=0.05)


def test_refuses_another_test_and_a_lag_at_the_edge() -> None:
    random = np.random.default_rng(0)
    noise = imu(0.0).with_channels(Step("test"), pitch=np.cumsum(random.standard_normal(imu(0.0).n_samples)))
    with pytest.raises(DatasetError, match=r"utm and imu: .*(hardly correlated|largest searched lag)"):
        synchronise(utm(), noise)
    with pytest.raises(DatasetError, match="peaks at the largest searched lag"):
        synchronise(utm(), imu(3.0), CommonMotion(max_lag=1.0))
    still = imu(0.0).with_channels(Step("test"), pitch=np.zeros(imu(0.0).n_samples))
    with pytest.raises(DatasetError, match="a constant signal"):
        synchronise(utm(), still)
    with pytest.raises(DatasetError, match="both records have the same channel; got shortening"):
        synchronise(utm(), utm(), CommonMotion(signal="shortening"))


def test_refuses_two_lags_that_match_as_well() -> None:
    time = np.arange(0.0, 400.0, 0.05)
    wave = Dataset("utm", {"time": Channel(time, "s"), "shortening": Channel(np.sin(time), "m")})
    same = Dataset("imu", {"time": Channel(time, "s"), "pitch": Channel(np.sin(time), "rad")})
    with pytest.raises(DatasetError, match="two lags match"):
        synchronise(wave, same)
    assert abs(fit_clock(wave, same, CommonMotion(max_lag=1.0)).lag) < 1e-6


def test_settings_out_of_range_are_refused_in_python_as_in_a_file() -> None:
    with pytest.raises(InputError) as caught:
        CommonMotion(max_lag=0.0, min_correlation=1.5)
    assert [fault.where for fault in caught.value.faults] == ["max_lag", "min_correlation"]
