"""What holds a cable in a soft body: a ball of it, and not one point."""

from __future__ import annotations

import numpy as np
import pytest
from mechanics_cases import elastic
from project_case import write_project

from softcal.errors import InputError, ProjectFileError
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.mechanics.attachment import attach_ball, attach_point
from softcal.project.project import load
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Robot, ViaPoint
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


def sinks_in(radius: float, n: int) -> float:
    """How far a cable that ends in the middle of a block is pulled out [m]."""
    mesh = box_mesh(BLOCK, (n, n, n))
    body = Body("block", mesh, np.flatnonzero(mesh.points[:, 2] < 1e-9), elastic(1e5, 0.4))
    middle = np.array([0.0101, 0.0098, 0.0103])
    cable = Cable("front", (ViaPoint(middle, "block", radius), ViaPoint(middle + [0.0, 0.0, 0.03])))
    response = simulate(Robot((body,), cables=(cable,)), Protocol({"front": Command("tension", np.array([0.2]))}))
    assert response.succeeded, response.status
    return float(response.channels["front.shortening"][0])


def test_a_knot_sinks_in_as_far_in_any_mesh_and_a_point_does_not() -> None:
    knot, point = ([sinks_in(radius, n) for n in (4, 6)] for radius in (0.005, 0.0))
    assert knot[1] == pytest.approx(knot[0], rel=0.06)
    assert point[1] > 1.25 * point[0]


def test_a_radius_is_of_a_point_in_a_body(tmp_path) -> None:
    with pytest.raises(InputError, match="radius"):
        ViaPoint(np.zeros(3), "block", -1.0)
    inside = ("{on: plate, at: [30 mm, 0 mm, 100 mm]}", "{on: bar, at: [1 mm, 2 mm, 90 mm], radius: 2 mm}")
    assert load(write_project(tmp_path / "in", inside)).robot.cables[0].via_points[0].radius == 0.002
    with pytest.raises(ProjectFileError, match="only a via point in a body has a radius"):
        load(write_project(tmp_path / "on", ("at: [30 mm, 0 mm, 100 mm]}", "at: [30 mm, 0 mm, 100 mm], radius: 2 mm}")))
