"""Uniform refinement: it fills what was filled, fits together, and keeps every region."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import irregular_box

from softcal.geometry.cell import TET_EDGES
from softcal.geometry.centreline import helix, polyline, straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_linear, to_quadratic
from softcal.geometry.quality import check_quality
from softcal.geometry.refine import count, refined_centreline, refined_mesh, refined_nodes
from softcal.geometry.surface import boundary_faces

SIDES = (0.3, 0.2, 0.5)
small = st.tuples(*(st.integers(1, 3) for _ in range(3)))
orders = st.sampled_from((1, 2))
seeds = st.integers(0, 99)


def box(parts, order: int, seed: int = 0) -> TetMesh:
    return irregular_box(SIDES, parts, "P1" if order == 1 else "P2", seed=seed)


def bulging(mesh: TetMesh) -> TetMesh:
    """A quadratic mesh whose mid-edge nodes are off their chords, as on a curved surface."""
    points = np.array(to_quadratic(mesh).points)
    x, y, z = points.T
    return TetMesh(
        np.column_stack([x * (1 + 0.8 * z * y), y + 0.4 * x * z, z + 0.3 * y**2]),
        to_quadratic(mesh).tets,
        dict(to_quadratic(mesh).node_sets),
        dict(to_quadratic(mesh).face_sets),
    )


def area(mesh: TetMesh, faces: np.ndarray) -> float:
    a, b, c = (mesh.points[faces[:, k]] for k in range(3))
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


@given(parts=small, order=orders, seed=seeds)
@settings(max_examples=20)
def test_the_pieces_fill_the_body_the_right_way_round(parts, order, seed):
    mesh = box(parts, order, seed)
    fine = refined_mesh(mesh)
    before, after = check_quality(mesh), check_quality(fine)
    assert (fine.n_tets, fine.order) == (8 * mesh.n_tets, mesh.order)
    assert after.volume == pytest.approx(before.volume, rel=1e-12)
    assert after.inverted == after.unreferenced == ()
    assert (after.n_duplicate_nodes, after.n_parts) == (0, 1)
    own = mesh.points[mesh.tets[:, :4]]
    pieces = fine.points[fine.tets[:, :4]].reshape(-1, 8, 4, 3)
    sizes = np.linalg.det(pieces[:, :, 1:] - pieces[:, :, :1])
    assert sizes == pytest.approx(np.repeat(np.linalg.det(own[:, 1:] - own[:, :1])[:, None] / 8, 8, axis=1))


@given(parts=small, order=orders)
@settings(max_examples=10)
def test_the_pieces_meet_in_whole_faces(parts, order):
    fine = refined_mesh(box(parts, order))
    faces = np.sort(fine.tets[:, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]].reshape(-1, 3), axis=1)
    _, times = np.unique(faces, axis=0, return_counts=True)
    assert set(times) <= {1, 2}
    n_outer = 2 * 2 * (parts[0] * parts[1] + parts[1] * parts[2] + parts[2] * parts[0])
    assert int((times == 1).sum()) == 4 * n_outer
    assert area(fine, boundary_faces(fine)) == pytest.approx(2 * (0.3 * 0.2 + 0.2 * 0.5 + 0.5 * 0.3), rel=1e-12)


@given(parts=small, order=orders)
@settings(max_examples=10)
def test_regions_keep_their_measure(parts, order):
    mesh = box(parts, order)
    half = np.arange(mesh.n_tets // 2)
    mesh = TetMesh(mesh.points, mesh.tets, dict(mesh.node_sets), dict(mesh.face_sets), {"half": half})
    fine = refined_mesh(mesh)
    for name, (axis, side) in {"x0": (0, 0.0), "x1": (0, 0.3), "z0": (2, 0.0), "z1": (2, 0.5)}.items():
        on_side = np.flatnonzero(np.abs(fine.points[:, axis] - side) < 1e-12)
        assert np.array_equal(np.sort(fine.node_sets[name]), on_side), name
        faces = fine.face_sets[name]
        assert faces.shape[1] == (3 if order == 1 else 6)
        assert area(fine, faces) == pytest.approx(area(mesh, mesh.face_sets[name]), rel=1e-12)
        outwards = {tuple(face[:3]) for face in boundary_faces(fine).tolist()}
        turned = {tuple(np.roll(face, -int(np.argmin(face)))) for face in faces[:, :3].tolist()}
        assert turned <= {tuple(np.roll(face, -int(np.argmin(face)))) for face in outwards}
    part, fine_part = (TetMesh(m.points, m.tets[m.element_sets["half"]]) for m in (mesh, fine))
    assert check_quality(fine_part).volume == pytest.approx(check_quality(part).volume, rel=1e-12)


def test_nodes_keep_their_numbers_and_middles_stand_in_the_middle():
    mesh = box((2, 2, 3), 2)
    fine = refined_mesh(mesh)
    assert np.array_equal(fine.points[: mesh.n_points], mesh.points)
    for i, (a, b) in enumerate(TET_EDGES):
        middle = 0.5 * (fine.points[fine.tets[:, a]] + fine.points[fine.tets[:, b]])
        assert np.abs(fine.points[fine.tets[:, 4 + i]] - middle).max() < 1e-15


def test_curved_tets_are_cut_along_their_own_map():
    mesh = bulging(box_mesh((1.0, 1.0, 1.0), (2, 2, 2)))
    fine = refined_mesh(mesh)
    assert check_quality(fine).volume == pytest.approx(check_quality(mesh).volume, rel=1e-12)
    # With straight edges between the same corners something would be missing.
    straight_edges = to_quadratic(to_linear(fine))
    assert abs(check_quality(straight_edges).volume / check_quality(mesh).volume - 1) > 1e-4


def test_a_set_of_corners_on_a_quadratic_mesh_is_refined_too():
    mesh = box((2, 2, 2), 2)
    corners_alone = TetMesh(mesh.points, mesh.tets, face_sets={"z1": mesh.face_sets["z1"][:, :3]})
    fine = refined_mesh(corners_alone)
    assert fine.face_sets["z1"].shape == (4 * len(mesh.face_sets["z1"]), 6)


@given(parts=small, order=orders)
@settings(max_examples=10)
def test_what_a_refined_mesh_will_have_is_known_beforehand(parts, order):
    mesh = box(parts, order)
    assert count(mesh).refined == count(refined_mesh(mesh))
    assert count(mesh).corners + count(mesh).edges == to_quadratic(mesh).n_points
    assert count(mesh).corners - count(mesh).edges + count(mesh).faces - count(mesh).tets == 1  # Euler, for a ball


@pytest.mark.parametrize("twice", [False, True])
def test_quality_stays_when_refined_again(twice: bool):
    mesh = box((2, 2, 3), 1, seed=5)
    fine = refined_mesh(refined_mesh(mesh)) if twice else refined_mesh(mesh)
    assert check_quality(fine).min_quality > 0.6 * check_quality(mesh).min_quality


@pytest.mark.parametrize("elements", [8, 24])
def test_a_helix_gains_nodes_of_the_helix(elements: int):
    shape = {"diameter": 0.03, "pitch": 0.02, "turns": 2.0}
    fine = refined_centreline(helix((0, 0, 0), (0, 0, 1), at=elements, **shape))
    exact = helix((0, 0, 0), (0, 0, 1), at=2 * elements, **shape)
    assert np.abs(fine.nodes - exact.nodes).max() < 1e-15
    assert np.abs(fine.triads - exact.triads).max() < 1e-12
    assert fine.lengths == pytest.approx(exact.lengths, rel=1e-12)


def test_a_straight_rod_is_halved():
    rod = straight((0, 0, 0), (0.1, 0.2, 0.0), [0.0, 0.3, 1.0])
    fine = refined_centreline(rod)
    assert fine.nodes == pytest.approx(straight((0, 0, 0), (0.1, 0.2, 0.0), [0.0, 0.15, 0.3, 0.65, 1.0]).nodes)
    assert fine.stations[-1] == pytest.approx(rod.stations[-1], rel=1e-14)


def test_an_arc_gains_nodes_of_the_arc():
    angle = np.linspace(0.0, 2.0, 9)
    line = polyline(0.1 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]))
    assert np.linalg.norm(refined_centreline(line).nodes, axis=1) == pytest.approx(np.full(17, 0.1), rel=1e-12)


def test_a_stretch_of_a_rod_that_is_held_stays_held():
    assert refined_nodes(np.array([0])).tolist() == [0]
    assert refined_nodes(np.array([4, 3, 7])).tolist() == [6, 7, 8, 14]
