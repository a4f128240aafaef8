"""Solid rods and springs, swept along their centrelines."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.errors import InputError
from softcal.geometry.cell import TET_EDGES
from softcal.geometry.centreline import helix, polyline, straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quality import check_quality, require_sound
from softcal.geometry.surface import boundary_faces
from softcal.geometry.wire import SolidRod, SolidSpring, wire_mesh


def areas(mesh: TetMesh, name: str) -> np.ndarray:
    """Area vectors of the flat triangles of a face set."""
    a, b, c = (mesh.points[mesh.face_sets[name][:, i]] for i in range(3))
    return 0.5 * np.cross(b - a, c - a)


def spring(coil: float, turns: float, pitch: float | None, **others: Any) -> SolidSpring:
    return SolidSpring(wire_diameter=1.0, coil_diameter=coil, turns=turns, pitch=pitch, **others)


@settings(max_examples=20, deadline=None)
@given(
    st.floats(2.5, 15.0),
    st.floats(1.3, 4.0),
    st.floats(0.3, 3.0),
    st.integers(1, 3),
    st.integers(6, 20),
    st.booleans(),
)
def test_springs_are_sound_and_of_the_wires_volume(index, pitch, turns, rings, per_turn, left_handed):
    d = 2e-3
    shape = SolidSpring(
        wire_diameter=d,
        coil_diameter=index * d,
        turns=turns,
        pitch=pitch * d,
        left_handed=left_handed,
        rings=rings,
        layers_per_turn=per_turn,
    )
    mesh = shape.mesh()
    report = require_sound(mesh)
    assert report.n_duplicate_nodes == 0
    assert mesh.n_tets == 18 * rings**2 * math.ceil(turns * per_turn - 1e-9)
    of_rings = {1: 4e-3, 2: 4e-4, 3: 1.5e-4}[rings]  # the circle in quadratic pieces
    of_layers = 8.0 / per_turn**4  # the axis in quadratic pieces
    volume = 0.25 * math.pi * d**2 * shape.wire_length
    assert 1.0 - of_rings - of_layers < report.volume / volume < 1.0 + 1e-9
    assert all(len(mesh.node_sets[name]) == 1 + 3 * 2 * rings * (2 * rings + 1) for name in ("start", "end"))


def test_the_error_of_the_volume_falls_with_the_fourth_power_of_the_tets():
    springs = [spring(5.0, 1.0, 2.0, rings=n, layers_per_turn=10 * n) for n in (1, 2)]
    errors = [1.0 - check_quality(one.mesh()).volume / (0.25 * math.pi * one.wire_length) for one in springs]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.1)


@pytest.mark.parametrize("order", [1, 2])
def test_the_skin_is_on_the_wires_surface_and_the_ends_are_plane(order):
    shape = SolidSpring(
        wire_diameter=2e-3, coil_diameter=12e-3, turns=1.5, height=7.5e-3, rings=2, layers_per_turn=8, order=order
    )
    mesh = shape.mesh()
    assert mesh.order == order
    line = shape.wire(24)
    skin = mesh.points[mesh.node_sets["skin"]]
    distance = np.linalg.norm(skin[:, None] - line.nodes, axis=2).min(axis=1)
    assert distance == pytest.approx(1e-3, rel=1e-9)
    for name, at, sign in (("start", 0, -1.0), ("end", -1, 1.0)):
        offset = mesh.points[mesh.node_sets[name]] - line.nodes[at]
        assert offset @ line.triads[at][:, 2] == pytest.approx(0.0, abs=1e-12)
        # Twelve corners of a circle, seen from outside.
        polygon = 12 * 0.5 * 1e-6 * math.sin(math.pi / 6)
        assert areas(mesh, name).sum(axis=0) == pytest.approx(sign * polygon * line.triads[at][:, 2], rel=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_faces_make_up_the_boundary(order):
    mesh = SolidRod(10.0, 3.0, rings=2, order=order).mesh()
    named = np.concatenate(list(mesh.face_sets.values()))
    boundary = boundary_faces(mesh)
    assert len(named) == len(boundary)
    assert {tuple(sorted(f)) for f in named.tolist()} == {tuple(sorted(f)) for f in boundary.tolist()}
    for name, faces in mesh.face_sets.items():
        assert set(np.unique(faces)) == set(mesh.node_sets[name].tolist())


def test_a_rod_is_straight_with_layers_as_thick_as_tets_are_wide():
    mesh = SolidRod(10.0, 3.0).mesh()
    assert mesh.n_tets == 18 * 7
    assert mesh.points[mesh.node_sets["end"], 2] == pytest.approx(10.0)
    assert SolidRod(10.0, 3.0, rings=2).mesh().n_tets == 72 * 14
    assert SolidRod(10.0, 3.0, layers=3).mesh().n_tets == 18 * 3


def test_edges_inside_are_straight():
    """A quadratic field is then a field of the mesh: see `_Section.between`."""
    mesh = SolidRod(4.0, 2.0, rings=3, layers=4).mesh()
    inside = np.linalg.norm(mesh.points[:, :2], axis=1) < 0.99
    for k, (a, b) in enumerate(TET_EDGES):
        middle, ends = mesh.tets[:, 4 + k], mesh.tets[:, [a, b]]
        chosen = inside[middle]
        off = mesh.points[middle[chosen]] - mesh.points[ends[chosen]].mean(axis=1)
        assert np.abs(off).max() < 1e-12


def test_sections_are_of_threefold_symmetry_and_layers_mirror_each_other():
    mesh = SolidRod(4.0, 2.0, rings=3, layers=4).mesh()
    centres = mesh.points[mesh.tets[:, :4]].mean(axis=1)
    c, s = math.cos(2 * math.pi / 3), math.sin(2 * math.pi / 3)
    for image in (centres @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]), [0, 0, 4.0] + centres * [1, 1, -1]):
        nearest = np.linalg.norm(image[:, None] - centres, axis=2).min(axis=1)
        assert nearest.max() < 1e-12


def test_any_centreline_will_do():
    points = np.column_stack([np.linspace(0, 1, 9), 0.2 * np.sin(3 * np.linspace(0, 1, 9)), np.zeros(9)])
    line = polyline(points)
    mesh = wire_mesh(line, 0.05, rings=2)
    assert check_quality(mesh).volume == pytest.approx(0.25 * math.pi * 0.05**2 * line.stations[-1], rel=2e-3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SolidRod(0.0, 1.0), "length: the size is out of range"),
        (lambda: SolidRod(1.0, math.nan), "diameter: the size is out of range"),
        (lambda: SolidRod(1.0, 1.0, layers=0), "too few layers"),
        (lambda: SolidRod(1.0, 1.0, rings=0), "too few rings"),
        (lambda: spring(1.0, 2.0, 5.0), "fills the coil"),
        (lambda: spring(8.0, 2.0, 0.9), "coils of the spring overlap"),
        (lambda: spring(8.0, 0.0, 2.0), "turns: the number of turns is out of range"),
        (lambda: spring(8.0, 2.0, None), "the height of the spring is not specified; got neither"),
        (lambda: spring(8.0, 2.0, 2.0, height=4.0), "the height of the spring is not specified; got pitch and height"),
        (lambda: spring(8.0, 2.0, 2.0, layers_per_turn=5), "too few layers in a turn; got 5; allowed: 6 to"),
        (lambda: wire_mesh(straight((0, 0, 0), (0, 0, 1), 3), 0.1), "3 elements; allowed: an even number"),
        (
            lambda: wire_mesh(helix((0, 0, 0), (0, 0, 1), diameter=1.0, pitch=0.3, turns=1.0, at=24), 1.4),
            "inverted",
        ),
    ],
)
def test_what_cannot_be_is_told(make, message):
    with pytest.raises(InputError, match=message):
        make()
