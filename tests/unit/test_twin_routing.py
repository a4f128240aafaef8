"""Where a cable runs between two via points in one body."""

import numpy as np
import pytest
from bore_case import AT, LONG, drilled_bar

from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.twin.robot import ViaPoint
from softcal.twin.routing import SPACING, bored

BOX = box_mesh([0.01, 0.01, 0.08], [2, 2, 8])
EDGE = 0.0065  # of its tets, about


def through(mesh: TetMesh, start, end, *, on=("arm", "arm")):
    via = (ViaPoint(np.array(start), on[0]), ViaPoint(np.array(end), on[1]))
    return np.array([point.at for point in bored(via, {"arm": mesh, "foot": mesh})])


def test_points_follow_the_line_between_two_in_one_body() -> None:
    at = through(BOX, (0.003, 0.004, 0.07), (0.006, 0.005, 0.01))
    steps = np.diff(at, axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-12)
    np.testing.assert_allclose(at[[0, -1]], [(0.003, 0.004, 0.07), (0.006, 0.005, 0.01)])
    assert np.linalg.norm(steps[0]) == pytest.approx(SPACING * EDGE, rel=0.35)


def test_none_is_added_between_points_on_other_parts() -> None:
    start, end = (0.003, 0.004, 0.07), (0.006, 0.005, 0.01)
    for on in (("", ""), ("plate", "plate"), ("plate", "")):
        assert len(through(BOX, start, end, on=on)) == 2


def test_where_two_bodies_overlap_the_points_are_those_of_one() -> None:
    start, end = (0.003, 0.004, 0.07), (0.006, 0.005, 0.01)
    np.testing.assert_allclose(through(BOX, start, end, on=("arm", "foot")), through(BOX, start, end))


def test_a_cable_along_the_surface_runs_straight() -> None:
    assert len(through(BOX, (0.0, 0.005, 0.07), (0.0, 0.005, 0.01))) == 2
    assert len(through(BOX, (0.01, 0.01, 0.07), (0.01, 0.01, 0.01))) == 2


def test_it_runs_straight_across_a_gap() -> None:
    middle = BOX.points[BOX.tets].mean(axis=1)
    notched = TetMesh(BOX.points, BOX.tets[~((middle[:, 0] > 0.005) & (np.abs(middle[:, 2] - 0.045) < 0.005))])
    z = through(notched, (0.0075, 0.005, 0.07), (0.0075, 0.005, 0.01))[:, 2]
    gap = np.abs(np.diff(z)).max()
    assert 0.01 <= gap < 0.01 + 2.0 * SPACING * EDGE * 1.5
    assert not np.any(np.abs(z - 0.045) < 0.0049)
    assert len(z) > 20


def test_a_bore_of_the_mesh_is_followed_too() -> None:
    at = through(drilled_bar(), (AT, 0.0, 0.9 * LONG), (AT, 0.0, 0.1 * LONG))
    assert len(at) > 20
    assert np.linalg.norm(np.diff(at, axis=0), axis=1).max() < 0.002
