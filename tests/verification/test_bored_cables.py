"""A cable in a bore of a soft body: bent into an arc by T r, however few via points it is given by."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import elastic

import softcal
from softcal.geometry.primitives import box_mesh
from softcal.geometry.refine import refined_mesh
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Marker, Plate, Robot, ViaPoint
from softcal.twin.routing import bored
from softcal.twin.simulate import simulate

E, LENGTH, WIDTH, THICKNESS, ARM = 1e6, 0.06, 0.01, 0.004, 0.001
EI = E * WIDTH * THICKNESS**3 / 12.0
TO_RIGHT_ANGLE = 0.5 * np.pi * EI / (LENGTH * ARM)


def beam(route: str, n_via: int, divisions=(1, 2, 24)) -> Robot:
    """A beam along z that is clamped at z = 0, with a cable at ARM from its axis towards +y."""
    mesh = box_mesh((WIDTH, THICKNESS, LENGTH), divisions, origin=(-0.5 * WIDTH, -0.5 * THICKNESS, 0.0))
    body = Body("arm", mesh, np.flatnonzero(mesh.points[:, 2] < 1e-9), elastic(E, 0.3))
    inside = tuple(ViaPoint(np.array([0.0, ARM, z]), "arm") for z in np.linspace(LENGTH, 0.0, n_via))
    inside = bored(inside, {"arm": mesh}) if route == "bore" else inside
    cable = Cable("front", (*inside, ViaPoint(np.array([0.0, ARM, -0.01]))))
    ends = tuple(Marker(f"m{i}", "arm", np.array([0.0, y, LENGTH])) for i, y in enumerate((-0.0015, 0.0015)))
    return Robot((body,), cables=(cable,), markers=ends)


def turned(robot: Robot, T: float) -> float:
    """The angle [rad] by which the end face has turned."""
    response = simulate(robot, Protocol({"front": Command("tension", np.array([0.5 * T, T]))}))
    assert response.succeeded, response.status
    y, z = (response.channels[f"m1.{axis}"][-1] - response.channels[f"m0.{axis}"][-1] for axis in "yz")
    return float(np.arctan2(-z, y))


@pytest.mark.parametrize("n_via", [2, 3, 7])
def test_a_cable_in_a_bore_bends_a_beam_into_an_arc(n_via: int) -> None:
    """M = T r all along: a quarter of a circle."""
    assert turned(beam("bore", n_via), TO_RIGHT_ANGLE) == pytest.approx(0.5 * np.pi, rel=0.06)


def test_from_a_plate_through_the_bore_of_its_body_it_bends_the_beam_into_an_arc() -> None:
    """Straight from the plate to the foot it would pull on an arm that grows as the beam bends."""
    robot = beam("bore", 2)
    mesh = robot.bodies[0].mesh
    tip = Plate("tip", {"arm": np.flatnonzero(mesh.points[:, 2] > LENGTH - 1e-9)}, np.array([0.0, 0.0, LENGTH]))
    on_tip, *_, foot, end = robot.cables[0].via_points
    angles = {}
    for route, via in (("bore", bored((replace(on_tip, on="tip"), foot), {"arm": mesh})), ("straight", ())):
        cable = replace(robot.cables[0], via_points=(*(via or (replace(on_tip, on="tip"), foot)), end))
        angles[route] = turned(replace(robot, plates=(tip,), cables=(cable,)), 0.05 * TO_RIGHT_ANGLE)
    assert angles["bore"] == pytest.approx(0.025 * np.pi, rel=0.06)
    assert angles["straight"] > 1.2 * angles["bore"]


@pytest.mark.slow
def test_straight_from_point_to_point_it_pulls_on_a_longer_arm() -> None:
    """And the more so, the fewer the points: three of them fold the beam."""
    many, few = (turned(beam("straight", n), 0.5 * TO_RIGHT_ANGLE) for n in (49, 7))
    assert many == pytest.approx(0.25 * np.pi, rel=0.06)
    assert few > 1.05 * many


def tentacle(shared_data: Path, **changes: float) -> Robot:
    """A silicone tentacle with two tendons, given by via points 25 mm apart (SoRoMoX, MIT)."""
    project = softcal.load(shared_data / "bench" / "soromox-tentacle" / "does-not-solve" / "project.yaml")
    return with_parameters(project.robot, {f"arm.{name}": value for name, value in changes.items()})


@pytest.mark.slow
@pytest.mark.parametrize("cable", ["cable1", "cable2"])
def test_a_public_tentacle_is_pulled_as_far_as_the_real_one(shared_data: Path, cable: str) -> None:
    """It ended at 6.2 N, folded between its last two via points."""
    response = simulate(tentacle(shared_data), Protocol({cable: Command("tension", np.linspace(0.77, 7.7, 10))}))
    assert response.succeeded, response.status
    assert response.n_factorisations < 120
    assert "stable" not in response.status
    assert response.channels[f"{cable}.shortening"][-1] == pytest.approx(0.0294, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("E", "nu", "T"), [(1e6, 0.45, 7.7), (0.505e6, 0.4999, 7.7), (0.315e6, 0.45, 7.7)])
def test_so_are_tentacles_of_other_moduli(shared_data: Path, E: float, nu: float, T: float) -> None:
    robot = tentacle(shared_data, youngs_modulus=E, poissons_ratio=nu)
    response = simulate(robot, Protocol({"cable1": Command("tension", np.array([0.5 * T, T]))}))
    assert response.succeeded, response.status


@pytest.mark.long
def test_the_tentacle_converges_with_the_mesh(shared_data: Path) -> None:
    """Eight times the tets, the same cable; it ends in a knot: a point would sink in 5 % of the shortening further."""
    robot = tentacle(shared_data)
    *inside, end = robot.cables[0].via_points
    knotted = replace(robot.cables[0], via_points=(*inside, replace(end, radius=0.003)))
    robot = replace(robot, cables=(knotted, robot.cables[1]))
    mesh = refined_mesh(robot.bodies[0].mesh)
    fixed = np.flatnonzero(np.abs(mesh.points[:, 2]) < 1e-9)
    fine = replace(robot, bodies=(replace(robot.bodies[0], mesh=mesh, fixed=fixed),))
    protocol = Protocol({"cable1": Command("tension", np.array([3.08]))})
    coarse, exact = (simulate(one, protocol, curve_tolerance=1e-3) for one in (robot, fine))
    for channel in ("cable1.shortening", "marker4.x", "marker4.z"):
        assert coarse.channels[channel][-1] == pytest.approx(exact.channels[channel][-1], rel=0.01)
