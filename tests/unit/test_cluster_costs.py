"""The simulated efficiency of a cluster against closed forms."""

from __future__ import annotations

import pytest

from benchmarks.cluster import Costs, simulated


@pytest.mark.parametrize("workers", [1, 2, 64])
def test_without_costs_nothing_is_lost(workers: int) -> None:
    assert simulated(workers, [0.5] * (20 * workers), Costs(0.0, 0.0, 0.0)) == pytest.approx(1.0)


def test_one_worker_loses_what_each_call_costs() -> None:
    assert simulated(1, [0.5] * 20, Costs(0.1, 0.2, 1.0)) == pytest.approx(20 * 0.5 / (20 * 0.8 + 1.0))


def test_many_workers_wait_for_the_scheduler() -> None:
    """It gives out ten calls in a second, each of half a second: five workers' worth."""
    assert simulated(100, [0.5] * 10_000, Costs(0.1, 0.0, 0.0)) == pytest.approx(0.05, rel=1e-2)


def test_the_last_call_is_waited_for() -> None:
    assert simulated(2, [1.0, 1.0, 3.0], Costs(0.0, 0.0, 0.0)) == pytest.approx(5.0 / 8.0)
