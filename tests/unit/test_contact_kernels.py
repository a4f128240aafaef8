"""Points pressed by simplices: distances, shares, forces and tangents."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.mechanics.contact_kernels import Meeting, distances, free_part, law, push, touching
from softcal.mechanics.moving_boxes import order_of
from softcal.mechanics.near_pairs import NearPairs

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
    """A point, and six triangles around a vertex, with these heights of the vertices around it."""
    turn = np.arange(6) * np.pi / 3
    around = np.column_stack([np.cos(turn), np.sin(turn), heights])
    V = np.concatenate([[[0.0, 0.0, 0.3], [0.0, 0.0, 0.0]], around])
    i = np.arange(6)
    return V, np.column_stack([np.ones(6, int), 2 + i, 2 + (i + 1) % 6])


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=60)
def test_on_flat_and_convex_surfaces_the_nearest_point_alone_counts(seed: int):
    chance = np.random.default_rng(seed)
    V, faces = fan(np.full(6, chance.choice([0.0, -0.3])))
    V[0] = np.append(chance.uniform(-0.5, 0.5, 2), 0.3)
    one = lambda p, s, share: push(V, p, s, share, np.full(len(p), 5.0), 0.7, 0.1, False)  # noqa: E731
    energy, gradient, _, _ = one(*touched(V, meeting(V, faces), np.array([5.0])))
    nearest = np.argmin(distances(V, np.zeros(6, dtype=int), faces))
    alone = one(np.zeros(1, dtype=int), faces[[nearest]], np.ones(1))
    assert energy == pytest.approx(alone[0], rel=1e-9)
    np.testing.assert_allclose(gradient[0], alone[1][0], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(gradient.sum(axis=0), 0.0, atol=1e-12)


def test_shares_add_up_to_one_for_every_point():
    V, faces = fan(np.zeros(6))
    for part in ([0], [0, 1], [0, 2], [0, 3], [0, 1, 2, 3], list(range(6))):
        _, _, shares = touched(V, meeting(V, faces[part]), np.array([5.0]))
        assert shares.sum() == pytest.approx(1.0)


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=60)
def test_the_triangles_that_touch_are_those_of_all_pairs(seed: int):
    """But those of three vertices that the point never touches, and of its own group."""
    chance = np.random.default_rng(seed)
    n, k = 30, int(chance.integers(1, 300))
    V = chance.uniform(-1.0, 1.0, (n + 3 * k, 3)) * [1.0, 3.0, chance.choice([0.0, 1.0])]
    faces = n + np.arange(3 * k).reshape(k, 3)
    V[faces[:, 1:]] = V[faces[:, :1]] + chance.uniform(-0.2, 0.2, (k, 2, 3))
    never = chance.random((n, len(V))) < 0.6
    group = chance.integers(-1, 2, len(V)) * np.repeat([1, 0], [n, 3 * k]) + np.repeat([0, 1], [n, 3 * k])
    reach = chance.uniform(0.0, 0.5, n)
    of = meeting(V, faces, n, never, group)
    point, face = (all_pairs.ravel() for all_pairs in np.indices((n, k)))
    near = distances(V, point, faces[face]) < reach[point]
    near &= ~never[point[:, None], faces[face]].all(axis=1) & (group[point] != 1)
    points, simplices, _ = touched(V, of, reach)
    whole = simplices[:, 2] >= 0
    assert sorted(zip(points[whole], simplices[whole, 0], strict=True)) == sorted(
        zip(point[near], faces[face[near], 0], strict=True)
    )


@pytest.mark.slow
@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=100)
def test_no_point_passes_through_a_triangle_on_the_free_part_of_its_way(seed: int):
    """Sampled: a point is on the other side of a triangle's plane, within its sides, only after that part."""
    chance = np.random.default_rng(seed)
    k = int(chance.integers(1, 12))
    V, to = (chance.uniform(-1.0, 1.0, (1 + 3 * k, 3)) + chance.uniform(-5.0, 5.0, 3) for _ in range(2))
    faces = 1 + np.arange(3 * k).reshape(k, 3)
    near = NearPairs(meeting(V, faces), np.zeros(1), 0.1)
    part = free_part(V, to, faces, *near.between(V, to))
    t = np.linspace(0.0, 1.0, 4001)[:, None, None]
    X = (1.0 - t) * V + t * to
    first = 1.0
    for a, b, c in faces:
        sides, off = np.stack([X[:, b] - X[:, a], X[:, c] - X[:, a]], axis=2), X[:, 0] - X[:, a]
        normal = np.cross(sides[:, :, 0], sides[:, :, 1])
        height = np.einsum("mi,mi->m", off, normal) / np.linalg.norm(normal, axis=1)
        u, v = np.einsum("mij,mj->mi", np.linalg.pinv(sides), off).T
        inside = (u > 0.0) & (v > 0.0) & (u + v < 1.0)
        through = inside[1:] & inside[:-1] & (height[1:] * height[:-1] < 0.0)
        first = min([first, *t[1:, 0, 0][through]])
    assert part <= first
    assert part == 1.0 if first == 1.0 and part > 1.0 - 1e-12 else part > 0.0
    # Until it is a tenth as far away.
    ends = (1.0 - part) * V + part * to
    far = [distances(x, np.zeros(k, dtype=int), faces) for x in (V, ends)]
    assert np.all(far[1] > 0.0)
    if part < 1.0:
        assert (far[1] / far[0]).min() < 0.1 + 1e-9


@given(st.integers(0, 10**6))
@settings(deadline=None, max_examples=100)
def test_what_touches_or_meets_does_not_depend_on_where_the_pairs_near_were_searched_for(seed: int):
    chance = np.random.default_rng(seed)
    n, k, slack = 20, int(chance.integers(1, 100)), 0.1
    at = chance.uniform(-1.0, 1.0, (n + 3 * k, 3))
    faces = n + np.arange(3 * k).reshape(k, 3)
    reach, of = chance.uniform(0.0, 0.3, n), meeting(at, faces, n)
    moves = chance.normal(size=(2, *at.shape))
    moves *= slack * chance.choice([0.5, 0.999, 3.0], (2, 1, 1)) / np.linalg.norm(moves, axis=2, keepdims=True)
    V, to = at + moves
    kept = NearPairs(of, reach, slack)
    kept.at(at)
    for one, other in zip(touching(V, faces, reach, *kept.at(V)), touched(V, of, reach), strict=True):
        np.testing.assert_array_equal(one, other)
    kept = NearPairs(of, reach, slack)
    kept.at(at)
    fresh = NearPairs(of, reach, slack)
    assert free_part(V, to, faces, *kept.between(V, to)) == free_part(V, to, faces, *fresh.between(V, to))


def meeting(
    V: np.ndarray, faces: np.ndarray, n: int = 1, never: np.ndarray | None = None, group: np.ndarray | None = None
) -> Meeting:
    """The first n vertices and triangles that touch all but where `never` (n, n_vertices) is true."""
    never = np.zeros((n, len(V)), dtype=bool) if never is None else never
    begin = np.append(0, np.cumsum(never.sum(axis=1)))
    group = np.full(len(V), -1) if group is None else group
    orders = order_of(V[:n]), order_of(V[faces].mean(axis=1))
    return Meeting(faces, *orders, begin, np.ascontiguousarray(np.nonzero(never)[1]), group)


def touched(V: np.ndarray, of: Meeting, reach: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What touches, searched for at V."""
    return touching(V, of.faces, reach, *NearPairs(of, reach, 0.1).at(V))
