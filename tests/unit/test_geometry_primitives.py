"""Box meshes, quadratic meshes, boundary faces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.errors import InputError, MeshError
from softcal.geometry.cell import TET_EDGES, TET_FACE_EDGES, TET_FACES
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_linear, to_quadratic
from softcal.geometry.quality import require_sound
from softcal.geometry.regions import boundary_faces
from softcal.geometry.surface import boundary_owners, matching_faces

lengths = st.tuples(*[st.floats(0.01, 10.0)] * 3)
divisions = st.tuples(*[st.integers(1, 4)] * 3)


def area_vectors(mesh: TetMesh, faces: np.ndarray) -> np.ndarray:
    a, b, c = (mesh.points[faces[:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


@settings(max_examples=20, deadline=None)
@given(lengths, divisions, st.sampled_from([1, 2]))
def test_box_fills_its_volume_with_upright_tets(sides, parts, order):
    mesh = box_mesh(sides, parts, order=order)
    report = require_sound(mesh)
    assert mesh.n_tets == 6 * np.prod(parts)
    assert report.volume == pytest.approx(np.prod(sides), rel=1e-12)


def test_box_sides_look_outwards():
    mesh = box_mesh((2.0, 3.0, 5.0), (2, 1, 3), order=2, origin=(1.0, 0.0, -1.0))
    expected = {"x": (0, 15.0), "y": (1, 10.0), "z": (2, 6.0)}
    for name, faces in mesh.face_sets.items():
        axis, area = expected[name[0]]
        sign = 1.0 if name[1] == "1" else -1.0
        assert area_vectors(mesh, faces).sum(axis=0) == pytest.approx(sign * area * np.eye(3)[axis], abs=1e-12)
        assert set(np.unique(faces)) == set(mesh.node_sets[name].tolist())
        lower = (1.0, 0.0, -1.0)[axis]
        upper = lower + (2.0, 3.0, 5.0)[axis]
        assert np.all(mesh.points[mesh.node_sets[name], axis] == (upper if name[1] == "1" else lower))


@pytest.mark.parametrize(
    ("sides", "parts", "told"),
    [
        ((1, 0, 1), (1, 1, 1), r"lengths\[1\]: the extent of a mesh is out of range"),
        ((1, 1, 1), (1, 0, 1), "divisions: a box needs three"),
        ((1, 1), (1, 1), "lengths: .* 3 entries"),
        ((1, 1, 1), (10**5, 10**5, 10**5), "divisions: there are too many tets"),
    ],
)
def test_box_without_extent_or_with_too_many_bricks_is_refused(sides, parts, told):
    with pytest.raises(InputError, match=told):
        box_mesh(sides, parts)


@settings(max_examples=15, deadline=None)
@given(divisions, st.sampled_from([1, 2]))
def test_boundary_is_closed(parts, order):
    mesh = box_mesh((1.0, 2.0, 3.0), parts, order=order)
    faces = boundary_faces(mesh)
    vectors = area_vectors(mesh, faces)
    assert vectors.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    # The divergence theorem: outward faces enclose a positive volume.
    enclosed = np.einsum("ij,ij->", mesh.points[faces[:, :3]].mean(axis=1), vectors) / 3
    assert enclosed == pytest.approx(6.0)
    owners = boundary_owners(mesh)
    assert all(np.isin(face, mesh.tets[tet]).all() for face, tet in zip(faces, owners, strict=True))


def test_mid_nodes_lie_between_their_corners():
    mesh = box_mesh((1.0, 2.0, 3.0), (1, 2, 1), order=2)
    for k, (a, b) in enumerate(TET_EDGES):
        middle = 0.5 * (mesh.points[mesh.tets[:, a]] + mesh.points[mesh.tets[:, b]])
        assert np.array_equal(mesh.points[mesh.tets[:, 4 + k]], middle)
    faces = boundary_faces(mesh)
    for k, (a, b) in enumerate(((0, 1), (1, 2), (2, 0))):
        middle = 0.5 * (mesh.points[faces[:, a]] + mesh.points[faces[:, b]])
        assert np.allclose(mesh.points[faces[:, 3 + k]], middle)


def test_the_tables_of_faces_and_edges_agree():
    for face, edges in zip(TET_FACES, TET_FACE_EDGES, strict=True):
        for k, edge in enumerate(edges):
            assert set(TET_EDGES[edge]) == {face[k], face[(k + 1) % 3]}


@settings(max_examples=10, deadline=None)
@given(divisions)
def test_quadratic_and_back_is_the_same(parts):
    mesh = box_mesh((1.0, 2.0, 3.0), parts)
    mesh = TetMesh(mesh.points, mesh.tets, mesh.node_sets, mesh.face_sets, {"first": np.array([0])})
    there = to_quadratic(mesh)
    back = to_linear(there)
    assert to_quadratic(there) is there
    assert to_linear(mesh) is mesh
    assert np.array_equal(back.points, mesh.points)
    assert np.array_equal(back.tets, mesh.tets)
    for sets in ("node_sets", "face_sets", "element_sets"):
        assert getattr(back, sets).keys() == getattr(mesh, sets).keys()
        assert all(np.array_equal(getattr(back, sets)[name], rows) for name, rows in getattr(mesh, sets).items())


def test_inner_faces_keep_their_side_and_strangers_are_refused():
    mesh = box_mesh((1.0, 1.0, 1.0), (1, 1, 1))
    faces = mesh.tets[:, TET_FACES].reshape(-1, 3)
    keys = [tuple(sorted(face)) for face in faces.tolist()]
    inner = next(face for face, key in zip(faces, keys, strict=True) if keys.count(key) == 2)
    for given_face in (inner, inner[::-1]):
        found = matching_faces(mesh, given_face[None, :])
        assert area_vectors(mesh, found) == pytest.approx(area_vectors(mesh, given_face[None, :]))
    turned = mesh.face_sets["x0"][:, ::-1]
    assert area_vectors(mesh, matching_faces(mesh, turned)) == pytest.approx(area_vectors(mesh, mesh.face_sets["x0"]))
    with pytest.raises(MeshError, match=r"lid: 1 of 1 triangles are not faces"):
        matching_faces(mesh, np.array([[0, 3, 5]]), where="lid")
