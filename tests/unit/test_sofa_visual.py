"""What people see of the exported SOFA scene: its surfaces, and the components that show them, by a recorder."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace

import meshio
import numpy as np
import pytest
from mechanics_cases import column_robot, pulled, tensed
from scipy.spatial.transform import Rotation
from sofa_case import many_parts, recorded, scene_modules, use_fake
from test_sofa_rods import hung

from softcal.geometry.primitives import box_mesh
from softcal.geometry.surface import boundary_triangles
from softcal.plugins.sofa.robot import linear_robot
from softcal.plugins.sofa.rods import SEGMENTS, finer
from softcal.plugins.sofa.scene import scene_parameters, write_scene
from softcal.plugins.sofa.visual import (
    MARKER,
    SEE_THROUGH,
    SIDES,
    skins,
    split_at_edges,
    visual_parameters,
    write_surfaces,
)
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.contacts import RIM, disc_skin
from softcal.twin.facing import plate_radius
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Disc

OPENGL = "Sofa.GL.Component.Rendering3D"
DRIVE = Protocol({"through": Command("tension", [1.0])})


def enclosed(points: np.ndarray, triangles: np.ndarray) -> float:
    """Volume within outward triangles."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def test_a_box_has_three_points_at_every_corner_and_smooth_faces():
    mesh = box_mesh((0.1, 0.2, 0.3), (2, 2, 2))
    triangles = boundary_triangles(mesh.tets)
    source, split = split_at_edges(mesh.points, triangles)
    np.testing.assert_array_equal(source[split], triangles)
    # 8 corners of 3, the middles of 12 edges of 2, and the middles of 6 faces.
    assert len(source) == 8 * 3 + 12 * 2 + 6
    a, b, c = (mesh.points[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for point in range(len(source)):
        assert np.ptp(normals[(split == point).any(axis=1)], axis=0).max() < 1e-12


def test_a_disc_is_smooth_around_and_sharp_at_its_rims():
    points, triangles = disc_skin(Disc(0.06, 0.01, centre=np.array([0, 0, 0.1])))
    source, split = split_at_edges(points, triangles)
    np.testing.assert_array_equal(source[split], triangles)
    assert len(source) == len(points) + 2 * RIM


def test_where_four_faces_meet_there_is_an_edge():
    one, two = box_mesh((1.0, 1.0, 1.0), (1, 1, 1)), box_mesh((1.0, 1.0, 1.0), (1, 1, 1), origin=(1.0, 1.0, 0.0))
    points, inverse = np.unique(np.vstack([one.points, two.points]), axis=0, return_inverse=True)
    tets = inverse.ravel()[np.vstack([one.tets, two.tets + one.n_points])]
    triangles = boundary_triangles(tets)
    source, split = split_at_edges(points, triangles)
    np.testing.assert_array_equal(source[split], triangles)
    assert len(points) == 14
    assert len(source) == 2 * 8 * 3


def test_skins_enclose_the_parts_from_outside():
    robot = many_parts()
    found = skins(linear_robot(robot))
    assert set(found) == {"low", "high", "head"}  # of the foot nothing is known, and nothing holds on to it
    assert enclosed(found["low"].points, found["low"].triangles) == pytest.approx(0.03 * 0.03 * 0.05)
    assert enclosed(found["high"].points, found["high"].triangles) == pytest.approx(0.02 * 0.02 * 0.05)
    disc = np.pi * 0.03**2 * 0.01 * np.sinc(2.0 / RIM)
    assert enclosed(found["head"].points, found["head"].triangles) == pytest.approx(disc)
    assert [skin.opacity for skin in found.values()] == [1.0, 1.0, 1.0]


def test_a_wire_is_a_tube_around_its_nodes_with_flat_ends():
    robot = hung()
    wire = skins(linear_robot(robot))["wire"]
    rod = finer(robot.rods[0], SEGMENTS)
    n, radius = len(rod.centreline.nodes), 0.5 * rod.section.constants.outer_diameter
    assert len(wire.points) == SIDES * (n + 2) + 2  # those of the ends twice, and their middles
    away = np.linalg.norm(wire.points - rod.centreline.nodes[wire.nodes], axis=1)
    np.testing.assert_allclose(np.sort(away)[2:], radius, rtol=1e-12)
    np.testing.assert_allclose(np.sort(away)[:2], 0.0, atol=1e-12)
    polygon = np.pi * radius**2 * np.sinc(2.0 / SIDES)
    assert enclosed(wire.points, wire.triangles) == pytest.approx(polygon * rod.centreline.stations[-1], rel=0.01)


def test_a_plate_of_unknown_shape_is_a_disc_to_see_through():
    robot = column_robot()
    plate = robot.plates[0]
    assert plate.disc is None
    skin = skins(linear_robot(robot))[plate.name]
    assert skin.opacity == SEE_THROUGH
    across = np.linalg.norm((skin.points - plate.reference)[:, :2], axis=1).max()
    assert across == pytest.approx(plate_radius(robot, plate))
    assert across >= np.linalg.norm(robot.cables[0].via_points[0].at[:2])


def test_surface_files_are_the_skins_to_the_last_digit(tmp_path):
    linear = linear_robot(many_parts())
    there = skins(linear)
    for path in write_surfaces(linear, tmp_path):
        read = meshio.read(path)
        np.testing.assert_array_equal(read.points, there[path.stem].points)
        np.testing.assert_array_equal(read.cells[0].data, there[path.stem].triangles)
    assert {path.stem for path in tmp_path.iterdir()} == set(there)


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (0.0, 0.0, -9.81), (0.5, 0.0, 9.81), (-9.81, 0.0, 0.0)])
def test_the_camera_has_the_robot_in_view_upright(gravity):
    robot = replace(many_parts(), gravity=gravity)
    camera = visual_parameters(linear_robot(robot))["camera"]
    turn = Rotation.from_quat(camera["orientation"])
    points = np.concatenate([body.mesh.points for body in robot.bodies])
    seen = turn.inv().apply(points - camera["position"])
    assert seen[:, 2].max() < 0.0  # SOFA's cameras look along -z
    off_axis = np.degrees(np.arctan2(np.linalg.norm(seen[:, :2], axis=1), -seen[:, 2]))
    assert 5.0 < off_axis.max() < 22.5
    up = -np.array(gravity) if any(gravity) else np.array([0.0, 0.0, 1.0])
    there = turn.inv().apply(up / np.linalg.norm(up))
    assert abs(there[0]) < 1e-12
    assert there[1] > 0.9
    looked_at = np.array(camera["position"]) + turn.apply([0.0, 0.0, -camera["distance"]])
    assert np.linalg.norm(looked_at - points.mean(axis=0)) < 0.05


@pytest.mark.parametrize("version", ["23.12", "24.06", "25.12", "26.06"])
def test_the_scene_shows_bodies_discs_cables_and_markers(tmp_path, monkeypatch, version):
    use_fake(monkeypatch, version=version)
    robot = many_parts()
    root, parameters = recorded(robot, DRIVE, tmp_path, seen=True)
    shown = parameters["visual"]
    plugins = {plugin.name: plugin.pluginName.value for plugin in root.find("RequiredPlugin")}
    assert plugins["visual_plugins"] == ["Sofa.Component.Visual"]
    assert plugins["opengl"] == [OPENGL]
    flags = root.own("VisualStyle").displayFlags.value.split()
    assert flags == ["showVisualModels", "hideBehaviorModels", "hideForceFields", "showInteractionForceFields"]
    assert root.own("InteractiveCamera").given == shown["camera"]

    surfaces = root.find("OglModel")
    assert {surface.node.path for surface in surfaces} == {
        "/robot/low/visual", "/robot/high_free/high/visual", "/robot/head/visual",
    }  # fmt: skip
    for surface in surfaces:
        (part,) = surface.node.parents
        assert [one.kind for one in surface.node.objects[:2]] == ["MeshOBJLoader", "OglModel"]
        assert surface.node.own("MeshOBJLoader").filename.value == str(tmp_path / "robot" / f"{part.name}.obj")
        assert surface.src.value == "@loader"
        mapping = surface.node.objects[2]
        if part.name == "head":
            assert (mapping.kind, mapping.given) == ("RigidMapping", {"globalToLocalCoords": True})
        else:
            assert (mapping.kind, mapping.given) == ("BarycentricMapping", {})
        words = surface.material.value.split()
        colour = [0.65, 0.7, 0.78] if part.name == "head" else [0.95, 0.55, 0.25]
        assert words[1:3] == ["Diffuse", "1"]
        np.testing.assert_allclose([float(word) for word in words[3:7]], [*(0.8 * np.array(colour)), 1.0])
        assert words[7:9] == ["Ambient", "1"]
        np.testing.assert_allclose([float(word) for word in words[9:13]], [*(0.55 * np.array(colour)), 1.0])

    for cable in root.find("CableConstraint"):
        assert cable.color.value == [0.05, 0.2, 0.45, 1.0]
        assert (cable.drawPoints.value, cable.drawPullPoint.value) == (False, False)

    by_name = {node.name: node for node in root.all()}
    assert "still" not in by_name  # it does not move
    for name, on, mapping, at in (
        ("on_head", "head", "RigidMapping", [0.01, 0.01, 0.12]),
        ("on_low", "low", "BarycentricMapping", [0.016, 0.0, 0.02]),
    ):
        marker = by_name[name]
        assert [parent.name for parent in marker.parents] == [on]
        assert marker.own(mapping)
        given = marker.own("MechanicalObject").given
        assert (given["position"], given["showObject"], given["drawMode"]) == ([at], True, 1)
        assert given["showObjectScale"] == shown["marker_radius"]
    size = np.ptp(np.concatenate([body.mesh.points for body in robot.bodies]), axis=0).max() / 2.0
    assert shown["marker_radius"] == pytest.approx(MARKER * size, rel=0.6)


def test_the_scene_shows_wires_and_discs_that_stand_still(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    robot = hung()
    foot = replace(robot.plates[0], disc=Disc(0.05, 0.002, centre=np.zeros(3)))
    robot = replace(robot, plates=(foot, robot.plates[1]))
    root, parameters = recorded(robot, tensed(0.1, cable="pull"), tmp_path, seen=True)
    by_part = {surface.node.parents[0].name: surface.node for surface in root.find("OglModel")}
    assert set(by_part) == {"wire", "head", "foot"}
    wire = skins(linear_robot(robot))["wire"]
    assert by_part["wire"].own("RigidMapping").given == {
        "globalToLocalCoords": True,
        "rigidIndexPerPoint": wire.nodes.tolist(),
    }
    assert len(by_part["foot"].objects) == 2  # nothing moves it
    assert by_part["foot"].parents[0].parents == [root.robot]
    assert root.robot.wire_free.wire is by_part["wire"].parents[0]
    assert parameters["visual"]["surfaces"]["foot"] == {"file": "foot.obj", "opacity": 1.0}


def test_a_plate_that_has_no_extent_shows_its_frame(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    robot = many_parts()
    bare = replace(robot.plates[1], disc=None, nodes={})
    loads = tuple(load for load in robot.loads if load.on != "head")
    robot = replace(robot, plates=(robot.plates[0], bare), cables=(), loads=loads)
    root, parameters = recorded(robot, Protocol({}), tmp_path, seen=True)
    assert "head" not in parameters["visual"]["surfaces"]
    frame = root.robot.head.own("MechanicalObject")
    assert frame.showObject.value is True
    assert frame.showObjectScale.value == 5.0 * parameters["visual"]["marker_radius"]


def test_without_opengl_there_are_no_surfaces_and_all_else(tmp_path, monkeypatch):
    use_fake(monkeypatch, fault="no-opengl")
    write_sofa(column_robot(), pulled(0.01), tmp_path, "robot")
    with scene_modules(tmp_path) as modules:
        root = modules.Sofa.Core.Node("root")
        modules.scene.createScene(root)
        assert modules.Sofa.messages == [f"This SOFA has no {OPENGL}, so there are no surfaces to see."]
        assert not any(OPENGL in plugin.pluginName.value for plugin in root.find("RequiredPlugin"))
        assert not root.find("OglModel")
        assert not root.find("MeshOBJLoader")
        assert root.find("VisualStyle")
        assert root.pulling
        modules.Sofa.Simulation.initRoot(root)
        modules.Sofa.Simulation.animate(root, 0.01)


def test_the_engines_run_has_nothing_to_see(tmp_path, monkeypatch):
    """As softcal writes and runs it: no surfaces, no cameras, no plugin for them, nor points for markers."""
    use_fake(monkeypatch)
    linear = linear_robot(many_parts())
    parameters = scene_parameters(linear, DRIVE)
    assert not [path for path in write_scene(linear, parameters, tmp_path) if path.suffix == ".obj"]
    roots = []
    with scene_modules(tmp_path) as modules:
        build = modules.scene.build

        def watched(root, parameters):
            roots.append(root)
            return build(root, parameters)

        run = importlib.import_module("run")
        modules.scene.build = watched
        run.SofaRun(parameters, parameters["rest"])
        plugins = [*modules.scene.PLUGINS, *run.PLUGINS]
        assert not any(word in plugin for plugin in plugins for word in ("GL", "Visual"))
        assert "robot.visuals" not in sys.modules
    assert roots
    root = roots[0]
    assert {plugin.name for plugin in root.find("RequiredPlugin")} == {"plugins"}
    for kind in ("InteractiveCamera", "MeshOBJLoader", "OglModel", "VisualStyle"):
        assert not root.find(kind)
    names = {node.name for node in root.all()}
    assert "head" in names
    assert not names & {"visual", "on_head", "on_low"}


def test_an_export_has_the_surfaces_that_its_parameters_name(tmp_path, monkeypatch):
    use_fake(monkeypatch)
    written = write_sofa(column_robot(), pulled(0.01), tmp_path, "robot")
    assert {path.name for path in written if path.suffix == ".obj"} == {"neck.obj", "plate.obj"}
    with scene_modules(tmp_path) as modules:
        root = modules.Sofa.Core.Node("root")
        modules.scene.createScene(root)
    loaders = root.find("MeshOBJLoader")
    assert sorted(loader.filename.value for loader in loaders) == [
        str(tmp_path / "robot" / "neck.obj"), str(tmp_path / "robot" / "plate.obj"),
    ]  # fmt: skip
