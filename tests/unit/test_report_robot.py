"""How robots of rods and discs are drawn: tubes, discs with holes, slack cables, markers, what is up."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from pyvista import PolyData

from softcal.geometry.centreline import straight
from softcal.geometry.pose import Pose
from softcal.geometry.section import RoundBar
from softcal.report.check_figures import robot_scenes
from softcal.report.robot_view import material_colours, plate_parts, robot_points, rod_colours, rod_tube
from softcal.report.scene import Arrow, Ball, FlatDisc, Part, Tube, Wire
from softcal.report.scene_twin import twin_scenes
from softcal.report.style import LOOP, ORANGE
from softcal.twin.facing import plate_normal, plate_radius, up_direction
from softcal.twin.manipulator import Manipulator, Springs, manipulator
from softcal.twin.material import Material
from softcal.twin.robot import Cable, Disc, Plate, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate
from softcal.workflows.simulation import pull, twin_view

SHAPE = Manipulator(springs=Springs(youngs_modulus=1.6e9, poissons_ratio=0.43, density=900.0))


def robot() -> Robot:
    return manipulator(SHAPE)


def closed(part: Part) -> PolyData:
    """The part's mesh, of triangles, once it is known to be closed."""
    mesh = part.mesh().triangulate().clean(tolerance=1e-6)
    assert mesh.n_open_edges == 0
    return mesh.compute_normals(auto_orient_normals=True)  # the volume wants all of them to point outwards


def test_a_straight_wire_is_a_closed_cylinder():
    path = np.linspace([0.0, 0.0, 0.0], [0.0, 0.03, 0.1], 7)
    mesh = closed(Tube(path, 0.005, colour=np.linspace([0, 0, 1.0], [1, 0, 0], 7)))
    around = 20 * math.sin(2 * math.pi / 20) / (2 * math.pi)  # of 20 corners instead of a circle
    length = float(np.linalg.norm(path[-1]))
    assert mesh.volume == pytest.approx(length * math.pi / 4 * 1e-4 * around, rel=1e-5)
    low, high = (mesh["colour"][int(end)] for end in (mesh.points[:, 2].argmin(), mesh.points[:, 2].argmax()))
    assert (low.tolist(), high.tolist()) == ([0, 0, 255], [255, 0, 0])


def test_a_spring_is_drawn_as_thick_as_its_wire():
    rod = robot().rods[0]
    mesh = closed(rod_tube(rod, rod.centreline.nodes, "red"))
    outer = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    assert outer.max() == pytest.approx(0.015 + 0.0045, rel=2e-3)
    assert outer.min() == pytest.approx(0.015 - 0.0045, rel=5e-3)
    assert mesh.volume == pytest.approx(rod.section.constants.area * rod.centreline.stations[-1], rel=0.02)


def test_a_rod_of_one_element_is_drawn():
    rod = Rod(
        "bar",
        straight((0, 0, 0), (0, 0, 0.1), 1),
        RoundBar(0.01),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        fixed=np.array([0]),
    )
    assert closed(rod_tube(rod, rod.centreline.nodes, np.ones((2, 3)))).volume > 0.0


def test_a_disc_has_its_holes():
    one = robot()
    plate = one.plates[1]
    ((part,), _) = plate_parts(one, plate, Pose(np.eye(3), plate.reference), "#0072b2", 0.4)
    mesh = closed(part)
    rim, hole = (n / 2 * math.sin(2 * math.pi / n) / 4 for n in (96, 16))
    area = rim * 0.06**2 - 6 * hole * 0.003**2
    assert mesh.volume == pytest.approx(area * 0.008, rel=1e-5)
    nearest = np.linalg.norm((mesh.points - plate.holes["h1"])[:, :2], axis=1).min()
    assert nearest == pytest.approx(0.0015, rel=1e-4), "the hole is open"


def test_a_disc_goes_with_its_plate():
    plate = Plate("top", {}, np.array([0.01, 0.0, 0.0]), disc=Disc(0.04, 0.01, centre=np.array([0.0, 0.0, 0.1])))
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    ((part,), _) = plate_parts(robot(), plate, Pose(turn, np.array([0.01, 0.0, 0.5])), "#0072b2", 0.4)
    np.testing.assert_allclose(part.mesh().center, [0.0, -0.1, 0.5], atol=2e-4)
    np.testing.assert_allclose(np.ptp(part.mesh().points, axis=0), [0.04, 0.01, 0.04], rtol=1e-2)


def test_arrows_and_balls_are_where_they_are_wanted():
    arrow = Arrow(np.array([0.0, 0, 0.1]), np.array([0.0, 0, 0.04]), 0.002, colour="red").mesh()
    assert (arrow.bounds.z_min, arrow.bounds.z_max) == pytest.approx((0.04, 0.1))
    assert arrow.bounds.x_max == pytest.approx(2.4 * 0.002, rel=0.02)
    np.testing.assert_allclose(Ball(np.array([1.0, 2, 3]), 0.1, colour="red").mesh().center, [1, 2, 3], atol=1e-6)


def test_plates_without_a_shape_face_along_the_rod_they_hold():
    one = robot()
    plain = replace(one, plates=tuple(replace(plate, disc=None) for plate in one.plates))
    normal = plate_normal(plain, plain.plates[2])
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert plate_radius(plain, plain.plates[2]) >= 0.025
    assert plate_radius(one, one.plates[2]) == 0.03
    np.testing.assert_allclose(plate_normal(one, one.plates[2]), [0, 0, -1])


def test_plates_without_a_shape_are_rings_around_their_rods():
    one = robot()
    plain = replace(one, plates=tuple(replace(plate, disc=None) for plate in one.plates))
    (scene, _), _ = robot_scenes(plain)
    wires = [part for part in scene.parts if isinstance(part, Wire)]
    assert len(wires) == len(plain.plates)
    assert not [part for part in scene.parts if isinstance(part, FlatDisc)]
    ring, *arms = wires[1].paths
    rod = plain.rods[0]
    np.testing.assert_allclose(ring[:, 2], plain.plates[1].reference[2], atol=0.01)
    assert np.linalg.norm(ring - rod.centreline.nodes[-1], axis=1).max() < 0.6 * rod.section.constants.outer_diameter
    assert len(arms) >= len(plain.plates[1].holes)


def test_the_materials_of_a_rod_meet_where_its_elements_do():
    inclusion = Material("tip", np.array([2, 3]), {"youngs_modulus": 2e9})
    rod = Rod(
        "bar",
        straight((0, 0, 0), (0, 0, 0.1), 4),
        RoundBar(0.01),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        fixed=np.array([0]),
        inclusions=(inclusion,),
    )
    colours = material_colours(Robot(rods=(rod,)))
    tube = rod_tube(rod, rod.centreline.nodes, rod_colours(rod, colours))
    assert not isinstance(tube.colour, str)
    changes = np.flatnonzero(np.any(np.diff(tube.colour, axis=0) != 0, axis=1))
    np.testing.assert_allclose(tube.path[changes + 1, 2], [0.05])
    assert [to_hex(tube.colour[end]) for end in (0, -1)] == [colours["bar"], colours["bar.tip"]]


def test_a_hanging_robot_hangs_in_the_picture():
    one = robot()
    np.testing.assert_allclose(up_direction(one), [0, 0, 1])
    _, cameras = robot_scenes(one)
    below = cameras[0].project(np.array([[0, 0, -0.4], [0, 0, 0.0]]))
    assert below[0, 1] < below[1, 1]


def test_the_check_shows_every_part_once_with_its_name():
    one = robot()
    scenes, _ = robot_scenes(one)
    words = [label.text for scene in scenes for label in scene.labels]
    for name in ("base", *SHAPE.disc_names, *SHAPE.cable_names, *SHAPE.marker_names):
        assert words.count(name) == 1, name
    parts = scenes[0].parts
    assert sum(isinstance(part, FlatDisc) for part in parts) == 5
    assert [isinstance(part, Tube) and part.bulky for part in parts].count(True) == 4, "springs"
    assert sum(isinstance(part, Tube) for part in parts) == 4 + 6
    # Markers, and where cables leave the base's far side; those in holes need no ball.
    assert sum(isinstance(part, Ball) for part in parts) == 4 + 6
    assert len(robot_points(one)) > 4 * 37


@pytest.mark.parametrize(("n", "shown"), [(8, 8), (9, 2)])
def test_many_via_points_do_not_hide_their_cable(n: int, shown: int):
    path = np.linspace([0.01, 0, 0], [0.01, 0, 0.1], n)
    cable = Cable("c", tuple(ViaPoint(at, "bar") for at in path))
    rod = Rod(
        "bar",
        straight((0, 0, 0), (0, 0, 0.1), 4),
        RoundBar(0.03),
        {"youngs_modulus": 1e9, "poissons_ratio": 0.4},
        fixed=np.array([0]),
    )
    (scene, _), _ = robot_scenes(Robot(rods=(rod,), cables=(cable,)))
    found = [part.at for part in scene.parts if isinstance(part, Ball)]
    np.testing.assert_allclose([found[0], found[-1]], path[[0, -1]])
    assert len(found) == shown
    assert [part.opacity < 1 for part in scene.parts if isinstance(part, Tube) and part.bulky] == [True]


def test_slack_cables_are_grey_and_the_colours_reach_the_displacement():
    one = robot()
    response = simulate(one, pull(one, "cable6", "tension", 8.0, 3), snapshots=True)
    view = twin_view(one, response)
    assert view is not None
    assert (view.rest.label, view.bent.label) == ("At rest", "cable6: 8 N")
    assert view.bent.efforts["cable6"] == pytest.approx(8.0, rel=1e-6), "drawn as far as was asked for"
    found = twin_scenes(view)
    moved = max(np.linalg.norm(view.bent.rods[rod] - view.rest.rods[rod], axis=1).max() for rod in SHAPE.spring_names)
    assert found.largest == pytest.approx(moved)
    rest, bent = found.scenes
    assert {part.colour for part in rest.parts if isinstance(part, Tube) and not part.bulky} == {ORANGE}
    colours = [part.colour for part in bent.parts if isinstance(part, Tube) and not part.bulky]
    assert (colours.count(ORANGE), colours.count(LOOP)) == (1, 5)
    assert [label.text for label in bent.labels if label.text.startswith("cable")] == ["cable6"]
    at = view.bent.markers["marker4"]
    assert any(isinstance(part, Ball) and np.allclose(part.at, at) for part in bent.parts)
    names = ("marker4.x", "marker4.y", "marker4.z")
    np.testing.assert_allclose(at, [response.channels[name][-1] for name in names], atol=1e-6)
