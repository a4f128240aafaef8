"""Draws over the papers' bounds: every one is solved, or ends in a sentence; none in NaN.

The table is written by `python -m benchmarks.robustness`.
"""

import importlib.util

import pytest

from benchmarks.robustness import PROTOCOLS, outcomes, parameter_draws, table
from softcal.geometry.neck import Neck

N_SAMPLES = 20
BY_LENGTH, BY_TENSION = PROTOCOLS


@pytest.fixture(scope="module")
def mesh():
    if importlib.util.find_spec("gmsh") is None:
        pytest.skip("Gmsh is not installed: no neck to draw on")
    return Neck(tets=900, order=1).mesh()


def check(rows, drive):
    for o in rows:
        where = f"E {o.youngs_modulus:.4g} Pa, nu {o.poissons_ratio:.4f}: {o.status}"
        assert o.is_finite, where
        assert o.status.endswith("."), where
        assert o.succeeded == o.status.startswith("Solved"), where
        assert (o.n_samples == N_SAMPLES) == o.succeeded, where
    solved = sum(o.succeeded for o in rows)
    if drive == BY_LENGTH:
        assert solved >= 0.99 * len(rows), table({("", drive): rows})
    return solved / len(rows)


@pytest.mark.slow
@pytest.mark.parametrize(("element", "n"), [("P1", 12), ("P2P1", 5)])
@pytest.mark.parametrize("drive", PROTOCOLS)
def test_some_draws_are_solved(mesh, element, n, drive):
    rows = outcomes(mesh, element, PROTOCOLS[drive], parameter_draws(n, seed=7))
    assert check(rows, drive) >= 0.9
    if drive == BY_TENSION:  # the softest are folded until their cable is wound up
        assert any(o.is_wound_up for o in rows)
        assert not all(o.is_wound_up for o in rows)


@pytest.mark.long
@pytest.mark.parametrize(("element", "n"), [("P1", 200), ("P2P1", 60)])
@pytest.mark.parametrize("drive", PROTOCOLS)
def test_many_draws_are_solved(mesh, element, n, drive, capsys):
    rows = outcomes(mesh, element, PROTOCOLS[drive], parameter_draws(n))
    share = check(rows, drive)
    with capsys.disabled():
        print(f"\n{element}, {drive}: {100 * share:.1f} % of {len(rows)} draws solved")  # noqa: T201
