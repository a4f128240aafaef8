"""Regions, mesh quality, point location."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.errors import InputError, MeshError
from softcal.geometry.locate import locate_points
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quality import check_quality, drop_unreferenced, require_sound
from softcal.geometry.regions import (
    Box,
    Cylinder,
    Named,
    Plane,
    Sphere,
    select_elements,
    select_faces,
    select_nodes,
)

INF = math.inf


@pytest.fixture(scope="module")
def cube() -> TetMesh:
    mesh = box_mesh((1.0, 1.0, 1.0), (4, 4, 4))
    return TetMesh(mesh.points, mesh.tets, mesh.node_sets, mesh.face_sets, {"corner": np.array([0, 1])})


@pytest.mark.parametrize(
    ("region", "condition"),
    [
        (Box((-INF, -INF, 0.5), (INF, INF, INF)), lambda x, y, z: z >= 0.5),
        (Plane((0, 0, 0.25), (0, 0, 2)), lambda x, y, z: z == 0.25),
        (Plane((0, 0, 0.25), (0, 0, 2), tolerance=0.25), lambda x, y, z: z <= 0.5),
        (Plane((0, 0, 0.25), (0, 0, 2), side="below"), lambda x, y, z: z <= 0.25),
        (Plane((0, 0, 0.25), (0, 0, 2), side="above"), lambda x, y, z: z >= 0.25),
        (
            Cylinder((0.5, 0.5, 0), (0.5, 0.5, 0.5), 0.3),
            lambda x, y, z: (abs(x - 0.5) + abs(y - 0.5) < 0.3) & (z <= 0.5),
        ),
        (Sphere((0, 0, 0), 0.5), lambda x, y, z: x**2 + y**2 + z**2 <= 0.25),
        (Named("x1"), lambda x, y, z: x == 1),
    ],
    ids=["box", "on", "near", "below", "above", "cylinder", "sphere", "named"],
)
def test_regions_select_the_nodes_inside(cube, region, condition):
    expected = np.flatnonzero(condition(*cube.points.T))
    assert len(expected) > 0
    assert np.array_equal(select_nodes(cube, region), expected)


def test_faces_and_elements_of_regions(cube):
    lid = select_faces(cube, Plane((0, 0, 1), (0, 0, 1)))
    assert {frozenset(face) for face in lid.tolist()} == {frozenset(face) for face in cube.face_sets["z1"].tolist()}
    assert np.array_equal(select_faces(cube, Named("z1")), cube.face_sets["z1"])
    half = select_elements(cube, Plane((0, 0, 0.5), (0, 0, 1), side="above"))
    assert len(half) == cube.n_tets // 2
    assert cube.points[cube.tets[half]][..., 2].min() == 0.5
    assert select_elements(cube, Named("corner")).tolist() == [0, 1]
    assert set(select_nodes(cube, Named("corner"))) == set(cube.tets[[0, 1]].ravel())
    by_node_set = TetMesh(cube.points, cube.tets, {"low": select_nodes(cube, Box((0, 0, 0), (1, 1, 0.25)))})
    assert len(select_elements(by_node_set, Named("low"))) == cube.n_tets // 4


def test_rounded_coordinates_still_lie_on_a_plane(cube):
    mesh = TetMesh(cube.points.astype(np.float32) * 0.1067, cube.tets)
    assert len(select_nodes(mesh, Plane((0, 0, 0.1067), (0, 0, 1)))) == 25


def test_a_region_that_selects_nothing_says_where_the_mesh_is(cube):
    with pytest.raises(MeshError) as caught:
        select_nodes(cube, Box((2, 2, 2), (3, 3, 3)), where="robot.plate.nodes")
    text = str(caught.value)
    assert text.startswith("robot.plate.nodes: the region selects no nodes")
    assert "spans x 0 to 1000 mm, y" in text
    assert "got box: {lower: [2000 mm, 2000 mm, 2000 mm], upper: [3000 mm, 3000 mm, 3000 mm]}" in text
    plane = Plane((1.061, 0.0, 2.5), (1.0, 0.0, 0.0), side="above")
    stated = r"plane: {point: \[1061 mm, 0 mm, 2500 mm\], normal: \[1, 0, 0\], side: above}"
    with pytest.raises(MeshError, match=stated):
        select_nodes(cube, plane)
    with pytest.raises(MeshError, match="no faces"):
        select_faces(cube, Sphere((0.5, 0.5, 0.5), 0.1))
    with pytest.raises(MeshError, match="no elements"):
        select_elements(cube, Sphere((0, 0, 0), 0.01))


def test_an_unknown_name_suggests_the_nearest(cube):
    with pytest.raises(MeshError, match=r"got 'cornr'; allowed: corner, x0.*Try: 'corner'"):
        select_nodes(cube, Named("cornr"), where="neck.fixed")
    with pytest.raises(MeshError, match="no named groups"):
        select_nodes(TetMesh(cube.points, cube.tets), Named("socket"))


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(lambda: Box((0, 0, 1), (1, 1, 0)), id="box"),
        pytest.param(lambda: Plane((0, 0, 0), (0, 0, 0)), id="plane-normal"),
        pytest.param(lambda: Plane((0, 0, 0), (0, 0, 1), tolerance=-1.0), id="plane-tolerance"),
        pytest.param(lambda: Plane((0, 0, 0), (0, 0, 1), side="left"), id="plane-side"),
        pytest.param(lambda: Cylinder((0, 0, 0), (0, 0, 0), 1.0), id="cylinder-length"),
        pytest.param(lambda: Cylinder((0, 0, 0), (0, 0, 1), 0.0), id="cylinder-radius"),
        pytest.param(lambda: Sphere((0, 0, 0), -1.0), id="sphere"),
    ],
)
def test_shapes_without_extent_are_refused(make):
    with pytest.raises(InputError):
        make()


def test_all_faults_of_a_mesh_are_told_at_once(cube):
    points = np.vstack([cube.points, cube.points[cube.tets[0]] + 5.0, [[9.0, 9.0, 9.0]]])
    tets = np.vstack([cube.tets, np.arange(4)[None, :] + cube.n_points])
    tets[7, [0, 1]] = tets[7, [1, 0]]
    with pytest.raises(MeshError) as caught:
        require_sound(TetMesh(points, tets), "neck.msh")
    inverted, parts, loose = caught.value.faults
    assert "1 of 385 tets" in inverted.what
    assert inverted.got == "tets 7"
    assert parts.got == "2 parts"
    assert loose.got == "nodes 129, the first at (9000, 9000, 9000) mm"


def test_unmerged_and_mirrored_meshes_get_a_hint(cube):
    mirrored = TetMesh(cube.points * [1, 1, -1], cube.tets)
    assert check_quality(mirrored).volume == pytest.approx(-1.0)
    with pytest.raises(MeshError, match="mirrored"):
        require_sound(mirrored)
    apart = TetMesh(np.vstack([cube.points, cube.points + [1, 0, 0]]), np.vstack([cube.tets, cube.tets + 125]))
    with pytest.raises(MeshError, match="2 parts; 25 pairs of nodes at the same place"):
        require_sound(apart)


def test_a_sliver_is_a_warning(cube):
    points = np.vstack([np.eye(3), np.zeros(3), [0.5, 0.5, 0.01]])
    mesh = TetMesh(points, [[3, 0, 1, 2], [3, 1, 0, 4]])
    report = check_quality(TetMesh(points, [[3, 0, 1, 4]]))
    assert report.slivers == (0,)
    assert "smallest dihedral angle" in report.warning
    assert report.min_dihedral == pytest.approx(math.atan2(0.01, 0.5), rel=1e-6)
    assert check_quality(mesh).inverted == (1,)
    assert require_sound(cube).warning == ""


def test_a_regular_tet_is_perfect():
    points = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    report = check_quality(TetMesh(points, [[0, 2, 1, 3]]))
    report = report if report.volume > 0 else check_quality(TetMesh(points, [[0, 1, 2, 3]]))
    assert report.min_quality == pytest.approx(1.0)
    assert report.min_dihedral == pytest.approx(math.acos(1 / 3))


def test_a_mid_node_pulled_through_its_tet_is_found():
    mesh = box_mesh((1.0, 1.0, 1.0), (1, 1, 1), order=2)
    points = np.array(mesh.points)
    points[mesh.tets[2, 4]] = mesh.points[mesh.tets[2, 3]]
    assert 2 in check_quality(TetMesh(points, mesh.tets)).inverted


def test_volume_of_curved_tets_is_exact():
    mesh = box_mesh((1.0, 1.0, 1.0), (2, 2, 2), order=2)
    x, y, z = mesh.points.T
    # Volume of the map (x, y, z + x^2 / 2) is that of the cube: its determinant is one.
    sheared = TetMesh(np.column_stack([x, y, z + 0.5 * x**2]), mesh.tets)
    assert check_quality(sheared).volume == pytest.approx(1.0, rel=1e-12)
    bulged = TetMesh(np.column_stack([x + 0.25 * x**2, y, z]), mesh.tets)
    assert check_quality(bulged).volume == pytest.approx(1.25, rel=1e-12)


def test_loose_nodes_can_be_dropped(cube):
    points = np.vstack([[[7.0, 7.0, 7.0]], cube.points])
    faces = {name: rows + 1 for name, rows in cube.face_sets.items()}
    mesh = drop_unreferenced(TetMesh(points, cube.tets + 1, {"x0": np.append(cube.node_sets["x0"] + 1, 0)}, faces))
    assert np.array_equal(mesh.points, cube.points)
    assert np.array_equal(mesh.node_sets["x0"], cube.node_sets["x0"])
    assert np.array_equal(mesh.face_sets["y1"], cube.face_sets["y1"])


@pytest.mark.parametrize("order", [1, 2])
def test_pieces_that_share_an_edge_but_no_face_are_warned_of(order):
    box = box_mesh((2.0, 2.0, 1.0), (2, 2, 1), order=order)
    x, y, _ = box.points[box.tets[:, :4]].mean(axis=1).T
    hinge = drop_unreferenced(TetMesh(box.points, box.tets[(x < 1.0) == (y < 1.0)]))
    assert "6 of 12 tets" in require_sound(hinge).warning
    assert "share edges or nodes with the others, but no face" in require_sound(hinge).warning
    assert require_sound(box).warning == ""


def test_the_fault_of_loose_nodes_states_where_the_first_is(cube):
    with pytest.raises(MeshError, match=r"got nodes \d+, the first at \(7000, 0, 0\) mm"):
        require_sound(TetMesh(np.vstack([cube.points, [[7.0, 0.0, 0.0]]]), cube.tets))


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(*[st.floats(0, 1)] * 3), min_size=1, max_size=5), st.sampled_from([1, 2]))
def test_located_points_come_back_from_their_coordinates(points, order):
    mesh = box_mesh((1.0, 1.0, 1.0), (3, 2, 2), order=order)
    tets, weights = locate_points(mesh, points)
    assert weights.min() >= -1e-8
    assert weights.sum(axis=1) == pytest.approx(1.0)
    corners = mesh.points[mesh.tets[tets, :4]]
    assert np.einsum("ki,kij->kj", weights, corners) == pytest.approx(np.array(points), abs=1e-12)


def test_a_point_just_outside_is_extrapolated(cube):
    point = (1.02, 0.4, 0.6)
    (tet,), (weights,) = locate_points(cube, [point])
    assert weights.min() < 0
    assert weights @ cube.points[cube.tets[tet]] == pytest.approx(point)
    assert 1.0 in cube.points[cube.tets[tet], 0]


@pytest.mark.parametrize(
    ("point", "distance"),
    [((1.5, 0.4, 0.6), "500 mm"), ((1.3, 1.4, 0.5), "500 mm"), ((1.2, 1.2, 1.1), "300 mm")],
)
def test_a_point_outside_is_refused_with_its_distance(cube, point, distance):
    with pytest.raises(MeshError, match=rf"front\.via\[0\]: the point lies outside its body by {distance}"):
        locate_points(cube, [point], where="front.via[0]")


def test_every_point_outside_is_told(cube):
    with pytest.raises(MeshError) as caught:
        locate_points(cube, [(0.5, 0.5, 0.5), (2, 2, 2), (0.5, 0.5, 1.01)], tolerance=1e-3)
    assert [fault.got for fault in caught.value.faults] == ["(2, 2, 2) m", "(0.5, 0.5, 1.01) m"]
