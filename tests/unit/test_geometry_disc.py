"""Discs with holes; the meshes need Gmsh."""

import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest

from softcal.errors import InputError
from softcal.geometry.disc import GuideHoles, SolidDisc
from softcal.geometry.quality import require_sound

needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")
HOLES = GuideHoles(3, 0.003, 0.025, math.pi / 2)
GUIDED = SolidDisc(0.060, 0.008, centre_hole=0.010, holes=HOLES, size=0.006)


def area(points: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (points[faces[:, i]] for i in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_holes_are_where_they_are_told():
    centre, first, *_ = GUIDED.circles
    assert centre == (0.0, 0.0, 0.010)
    assert first == pytest.approx((0.0, 0.025, 0.003))
    assert GUIDED.volume == pytest.approx(0.25 * math.pi * (0.06**2 - 0.01**2 - 3 * 0.003**2) * 0.008)


@needs_gmsh
@pytest.mark.parametrize(("order", "error"), [(1, 0.01), (2, 2e-4)])
@pytest.mark.parametrize("shape", [SolidDisc(0.060, 0.008, size=0.006), GUIDED], ids=["plain", "guided"])
def test_discs_have_their_volume_and_sides(shape, order, error):
    mesh = replace(shape, order=order).mesh()
    report = require_sound(mesh)
    assert mesh.order == order
    assert report.volume == pytest.approx(shape.volume, rel=error)
    assert report.min_quality > 0.1
    assert mesh.n_tets < 2500
    z = mesh.points[:, 2]
    assert z[mesh.node_sets["bottom"]] == pytest.approx(0.0, abs=1e-12)
    assert z[mesh.node_sets["top"]] == pytest.approx(0.008)
    sets = {"bottom", "top", "rim"} | ({"centre", "holes", "h1", "h2", "h3"} if shape.holes else set())
    assert set(mesh.node_sets) == set(mesh.face_sets) == sets
    assert area(mesh.points, mesh.face_sets["rim"]) == pytest.approx(math.pi * 0.06 * 0.008, rel=0.02)
    if shape.holes:
        assert area(mesh.points, mesh.face_sets["h2"]) == pytest.approx(math.pi * 0.003 * 0.008, rel=0.1)
        assert len(mesh.face_sets["holes"]) == sum(len(mesh.face_sets[f"h{k}"]) for k in (1, 2, 3))
        around = mesh.points[mesh.node_sets["h1"], :2] - [0.0, 0.025]
        assert np.linalg.norm(around, axis=1) == pytest.approx(0.0015, rel=0.03)


def test_a_mesh_without_a_target_is_refused():
    with pytest.raises(InputError, match="needs a target"):
        replace(GUIDED, size=None).mesh()


@needs_gmsh
def test_a_target_count_is_met():
    assert replace(GUIDED, size=None, tets=3000, order=1).mesh().n_tets == pytest.approx(3000, rel=0.05)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"diameter": 0.0}, "^diameter: the size is out of range"),
        ({"thickness": -1.0}, "^thickness: the size is out of range"),
        ({"centre_hole": -1e-3}, "^centre_hole: the clearance is out of range"),
        ({"centre_hole": 0.06}, "do not fit"),
        ({"holes": GuideHoles(3, 0.003, 0.029)}, "do not fit"),
        ({"holes": GuideHoles(30, 0.006, 0.02)}, "do not fit"),
        ({"holes": GuideHoles(3, 0.003, 0.006), "centre_hole": 0.01}, "do not fit"),
    ],
)
def test_what_cannot_be_is_told(values, message):
    with pytest.raises(InputError, match=message):
        SolidDisc(**{"diameter": 0.06, "thickness": 0.008, "size": 0.006, **values})


def test_guide_holes_that_are_none_are_told():
    with pytest.raises(InputError, match="count: there are too few holes on a ring; got 0"):
        GuideHoles(0, 0.003, 0.025)
