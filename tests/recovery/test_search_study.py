"""Random problems: least squares ends at the least loss that an independent minimiser finds, in few trajectories."""

from __future__ import annotations

import pytest

from benchmarks import search

KINDS = {kind.name: kind for kind in search.KINDS}


@pytest.mark.long
@pytest.mark.parametrize("name", ["locking-papers", pytest.param("locking-likelihood", marks=pytest.mark.long)])
def test_the_default_starts_end_at_the_independent_minimum(name: str) -> None:
    for seed in range(3):
        posed = search.problem(KINDS[name], seed)
        found = search.searched(posed, search.least_loss(posed, starts=4), starts=3)
        assert found.converged, seed
        assert found.near, (seed, found.distance)


def test_a_row_counts_searches_that_converged_elsewhere() -> None:
    found = [search.Found(0.05, True, 4), search.Found(3.0, True, 6), search.Found(9.0, False, 40)]
    assert search.row(KINDS["manipulator"], 3, found)[1:] == ["3", "1 of 3", "1", "6", "40"]
