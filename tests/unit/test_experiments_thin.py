"""Thinning a record by the travel: as many samples at any speed, turning points and holds kept."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.errors import DatasetError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.steps.cycles import find_cycles
from softcal.experiments.steps.thinning import thin


def record(*, noise: float = 0.0) -> Dataset:
    """Four cycles to 20 mm, two at 2 and two at 10 mm/s, the last with a hold of 5 s at the top; a row every 0.01 s."""
    corners, times = [0.0], [0.0]
    for k, speed in enumerate((2e-3, 2e-3, 10e-3, 10e-3)):
        corners += [20e-3, *([20e-3] if k == 3 else []), 0.0]
        way = 20e-3 / speed
        times += [times[-1] + way, *([times[-1] + way + 5.0] if k == 3 else [])]
        times.append(times[-1] + way)
    t = np.arange(0.0, times[-1] + 1e-9, 0.01)
    d = np.interp(t, times, corners) + noise * np.random.default_rng(1).standard_normal(len(t))
    units = {"time": (t, "s"), "shortening": (d, "m"), "tension": (500.0 * np.maximum(d, 0.0), "N")}
    return Dataset("pull", {name: Channel(values, unit) for name, (values, unit) in units.items()})


@pytest.mark.parametrize("noise", [0.0, 2e-6])
def test_a_slow_cycle_has_as_many_samples_as_a_fast_one(noise: float) -> None:
    whole = find_cycles(record(noise=noise))
    assert whole.cycle is not None
    by_time = [int((whole.cycle == k).sum()) for k in range(3)]
    assert by_time[0] > 4.5 * by_time[2]  # what the loss would count
    found = thin(whole, 1e-3)
    assert found.cycle is not None
    counts = [int((found.cycle == k).sum()) for k in range(3)]
    assert max(counts) - min(counts) <= 4
    assert 38 <= min(counts) <= max(counts) <= 48
    for name, channel in found.channels.items():  # as they were measured
        assert np.isin(channel.values, whole.values(name)).all()


def test_turning_points_and_both_ends_of_a_hold_are_kept() -> None:
    whole = record()
    found = thin(whole, 3e-3)
    t, d = found.values("time"), found.values("shortening")
    tops = t[d > 20e-3 - 1e-9]
    np.testing.assert_allclose(tops[[0, -2, -1]], [10.0, 46.0, 51.0], atol=0.02)
    assert (t[0], t[-1]) == (whole.values("time")[0], whole.values("time")[-1])
    rests = thin(whole, 3e-3, longest=1.0).values("time")
    assert np.diff(rests).max() <= 1.51
    assert len(rests) >= len(t) + 4


def test_nonsense_is_refused() -> None:
    with pytest.raises(
        DatasetError, match=r"pull: samples cannot be thinned by this step; got 0 mm; allowed: above 0 m"
    ):
        thin(record(), 0.0)
