"""Points pressed by simplices: distances, shares, forces and tangents."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.mechanics.contact import simplices_near
from softcal.mechanics.contact_kernels import distances, law, push

NONE = -1
KINDS = {"vertex": [1, NONE, NONE], "edge": [1, 2, NONE], "triangle": [1, 2, 3]}


def pushed(V: np.ndarray, simplex: list[int], *, reach: float = 3.0, tangent: bool = True):
    points, simplices = np.array([0]), np.array([simplex])
    return push(V, points, simplices, np.array([2.0]), np.array([reach]), 0.7, 0.1, tangent)


@given(st.integers(0, 10**6), st.sampled_from([*KINDS]))
@settings(deadline=None, max_examples=60)
def test_the_gradient_and_the_tangent_are_the_energys_derivatives(seed: int, kind: str):
    chance = np.random.default_rng(seed)
    V, way = chance.uniform(-1.0, 1.0, (4, 3)), chance.uniform(-1.0, 1.0, (4, 3))
    h = 1e-5
    _, gradient, pressed, blocks = pushed(V, KINDS[kind])
    ahead, behind = (pushed(V + s * h * way, KINDS[kind]) for s in (1, -1))
    assert len(pressed) == 1
    assert (ahead[0] - behind[0]) / (2 * h) == pytest.approx(np.vdot(gradient, way), rel=1e-5, abs=1e-7)
    by = (ahead[1] - behind[1]) / (2 * h)
    # Where the nearest point passes from one part of the simplex to another the tangent jumps.
    place = lambda X: np.round(np.abs(pushed(X, KINDS[kind])[1][1:]).sum(axis=1) > 0.0)  # noqa: E731
    if np.array_equal(place(V + 2 * h * way), place(V - 2 * h * way)):
        np.testing.assert_allclose((blocks[0] @ way.ravel()).reshape(4, 3), by, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(blocks[0], blocks[0].T, atol=1e-12)


@pytest.mark.parametrize("kind", [*KINDS])
def test_distances_are_those_of_a_fine_sampling(kind: str):
    chance = np.random.default_rng(4)
    share = chance.dirichlet(np.full(3, 0.5), 40000)
    for _ in range(20):
        V = chance.uniform(-1.0, 1.0, (4, 3))
        corners = [k if k != NONE else KINDS[kind][0] for k in KINDS[kind]]
        sampled = np.linalg.norm(V[0] - share @ V[corners], axis=1).min()
        exact = distances(V, np.array([0]), np.array([KINDS[kind]]))[0]
        assert exact - 1e-12 < sampled < exact + 0.03


def test_the_law_is_smooth_where_contact_begins():
    overlaps = np.linspace(-0.05, 0.4, 4001)
    energy, pressure, slope = np.array([law(float(o), 0.7, 0.1) for o in overlaps]).T
    np.testing.assert_allclose(np.gradient(energy, overlaps)[1:-1], pressure[1:-1], atol=1e-4)
    np.testing.assert_allclose(np.gradient(pressure, overlaps)[1:-1], slope[1:-1], atol=1e-2)
    assert np.abs(np.diff(slope)).max() < 2e-3 / 0.7 * 1e1
    assert energy[0] == pressure[0] == slope[0] == 0.0


def fan(heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Six triangles around a vertex, with these heights of the vertices around it; and room for a point, the last."""
    turn = np.arange(6) * np.pi / 3
    around = np.column_stack([np.cos(turn), np.sin(turn), heights])
    V = np.concatenate([[[0.0, 0.0, 0.0]], around, [[0.0, 0.0, 0.3]]])
    i = np.arange(6)
    return V, np.column_stack([np.zeros(6, int), 1 + i, 1 + (i + 1) % 6])


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=60)
def test_on_flat_and_convex_surfaces_the_nearest_point_alone_counts(seed: int):
    chance = np.random.default_rng(seed)
    V, faces = fan(np.full(6, chance.choice([0.0, -0.3])))
    V[7] = np.append(chance.uniform(-0.5, 0.5, 2), 0.3)
    point = np.full(6, 7)
    near = simplices_near(point, faces, len(V))
    one = lambda p, s, share: push(V, p, s, share, np.full(len(p), 5.0), 0.7, 0.1, False)  # noqa: E731
    energy, gradient, _, _ = one(near.points, near.simplices, near.shares)
    nearest = np.argmin(distances(V, point, faces))
    alone = one(point[:1], faces[[nearest]], np.ones(1))
    assert energy == pytest.approx(alone[0], rel=1e-9)
    np.testing.assert_allclose(gradient[7], alone[1][7], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(gradient.sum(axis=0), 0.0, atol=1e-12)


def test_shares_add_up_to_one_for_every_point():
    V, faces = fan(np.zeros(6))
    for part in ([0], [0, 1], [0, 2], [0, 3], [0, 1, 2, 3], list(range(6))):
        near = simplices_near(np.full(len(part), 7), faces[part], len(V))
        assert near.shares.sum() == pytest.approx(1.0)
