"""What holds a cable in a soft body: a ball of it, and not one point."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bore_case import AT, LONG, drilled_bar
from mechanics_cases import column_robot, mirrored_box, moved_points, tensed
from project_case import write_project
from scipy.spatial.transform import Rotation

from softcal.errors import InputError, ProjectFileError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.mechanics.attachment import _ball_points, attach_ball, attach_point, attach_rate
from softcal.project.project import load
from softcal.twin.robot import Cable, Marker, ViaPoint
from softcal.twin.simulate import simulate

BLOCK = (0.02, 0.02, 0.02)


@pytest.mark.parametrize("centre", [(0.01, 0.01, 0.01), (0.002, 0.011, 0.0185), (0.0, 0.01, 0.01)])
@pytest.mark.parametrize("quadratic", [False, True])
def test_the_mean_of_a_ball_follows_constant_strain(centre, quadratic) -> None:
    mesh = box_mesh(BLOCK, (4, 4, 4))
    mesh = to_quadratic(mesh) if quadratic else mesh
    ball = attach_ball(mesh, np.array(centre), 0.006)
    assert ball.weights.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(ball.weights @ mesh.points[ball.nodes], centre, atol=1e-14)
    assert len(ball.nodes) > 3 * len(attach_point(mesh, np.array(centre)).nodes)
    if 0.004 < centre[0] and centre[2] < 0.014:  # far from the surface
        assert np.abs(ball.weights).max() < 0.5 * np.abs(attach_point(mesh, np.array(centre)).weights).max()


def test_the_extent_by_default_is_that_of_a_knot_or_of_the_bore() -> None:
    at = np.array([AT, 0.0, 0.5 * LONG])
    bar = drilled_bar(30)
    in_bore = attach_ball(bar, at)
    assert in_bore.radius == pytest.approx(1.25 * in_bore.bore)
    assert len(in_bore.nodes) > 2 * len(attach_point(bar, at).nodes)
    assert attach_ball(box_mesh(BLOCK, (4, 4, 4)), np.full(3, 0.011)).radius == 1e-3
    assert attach_ball(bar, at, 0.0).radius == 0.0


def test_a_ball_does_not_reach_over_a_groove() -> None:
    """A knot in a rib, 1 mm from the groove, 3 mm from the next rib; within its radius they are not connected."""
    whole = box_mesh((0.03, 0.01, 0.01), (30, 5, 10))
    centres = whole.points[whole.tets].mean(axis=1)
    grooved = TetMesh(whole.points, whole.tets[~((np.abs(centres[:, 0] - 0.015) < 0.001) & (centres[:, 2] > 0.002))])
    at = np.array([0.0132, 0.005, 0.008])
    ball = attach_ball(grooved, at, 0.004)
    assert grooved.points[ball.nodes, 0].max() < 0.0141
    np.testing.assert_allclose(ball.weights @ grooved.points[ball.nodes], at, atol=1e-14)
    assert whole.points[attach_ball(whole, at, 0.004).nodes, 0].max() > 0.016


@pytest.mark.parametrize("quadratic", [False, True])
@pytest.mark.parametrize("centre", [(0.0101, 0.0098, 0.0103), (0.0031, 0.0117, 0.0192)])
def test_the_rates_of_a_balls_weights_are_those_of_its_point(centre, quadratic) -> None:
    """By central differences, in the middle and where the surface cuts the ball off."""
    mesh = box_mesh(BLOCK, (4, 4, 4))
    mesh = to_quadratic(mesh) if quadratic else mesh
    at, way, step = np.array(centre), np.array([0.6, 0.0, -0.8]), 1e-8

    def weights(shift: float) -> np.ndarray:
        ball, out = attach_ball(mesh, at + shift * way, 0.002), np.zeros(mesh.n_points)
        out[ball.nodes] = ball.weights
        return out

    rates = np.zeros(mesh.n_points)
    nodes, own = attach_rate(mesh, at, way, 0.002)
    rates[nodes] = own
    np.testing.assert_allclose(rates, (weights(step) - weights(-step)) / (2.0 * step), atol=2e-4 * np.abs(rates).max())
    np.testing.assert_allclose(rates @ mesh.points, way, atol=1e-12)


def test_a_radius_is_of_a_point_in_a_body(tmp_path) -> None:
    with pytest.raises(InputError, match="radius"):
        ViaPoint(np.zeros(3), "block", -1.0)
    inside = ("{on: plate, at: [30 mm, 0 mm, 100 mm]}", "{on: bar, at: [1 mm, 2 mm, 90 mm], radius: 2 mm}")
    assert load(write_project(tmp_path / "in", inside)).robot.cables[0].via_points[0].radius == 0.002
    with pytest.raises(ProjectFileError, match="only a via point in a body has a radius"):
        load(write_project(tmp_path / "on", ("at: [30 mm, 0 mm, 100 mm]}", "at: [30 mm, 0 mm, 100 mm], radius: 2 mm}")))


def test_points_of_a_ball_fill_it_evenly_and_are_their_own_mirror_images() -> None:
    """The mean of max(0, n.x - c) over a ball of radius 1, where t = n.x has the density 3/4 (1 - t^2)."""
    points = _ball_points()
    n = Rotation.random(200, random_state=0).apply([0.0, 0.0, 1.0])
    for c in (-0.5, 0.0, 0.5):
        t = np.array([c, 1.0])
        lower, upper = 0.75 * (0.5 * t**2 - 0.25 * t**4 - c * (t - t**3 / 3.0))
        np.testing.assert_allclose(np.maximum(0.0, n @ points.T - c).mean(axis=1), upper - lower, atol=5e-3)
    for signs in ((-1, 1, 1), (1, -1, 1), (1, 1, -1)):
        assert {tuple(at) for at in points * signs} == {tuple(at) for at in points}


@pytest.mark.parametrize("radius", [None, 0.003])
def test_a_symmetric_arm_stays_in_its_plane_and_a_turned_one_bends_alike(radius) -> None:
    mesh = mirrored_box((0.012, 0.01, 0.06), (1, 2, 4))
    y, heights = 0.003, (0.0, 0.03, 0.055)
    via = (ViaPoint(np.array([0.0, y, -0.02])), *(ViaPoint(np.array([0.0, y, z]), "neck", radius) for z in heights))
    cable = Cable("front", via, pulled_end="first")
    robot = replace(column_robot("P2P1", mesh=mesh, cables=(cable,)), plates=())
    robot = replace(robot, markers=(Marker("tip", "neck", np.array([0.0, 0.0, 0.06])),))
    straight = simulate(robot, tensed(2.0), curve_tolerance=0.0).channels
    assert abs(straight["tip.x"]) < 1e-12
    assert abs(straight["tip.y"]) > 5e-4
    R = Rotation.from_rotvec([0.4, -1.2, 2.0]).as_matrix()
    turned = replace(moved_points(robot, lambda at: at @ R.T, R), markers=())
    there = simulate(turned, tensed(2.0), curve_tolerance=0.0).channels
    np.testing.assert_allclose(there["front.shortening"], straight["front.shortening"], rtol=1e-3)
