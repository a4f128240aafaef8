"""Lengths of a body as parameters: derivatives against other meshes, what moves along, and what is refused."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grid_neck import grid_neck
from mechanics_cases import column_robot, elastic, pulled, require_derivatives, tensed
from scipy.spatial import KDTree

from softcal.errors import MeshError, ParameterError
from softcal.geometry.bellows import Bellows
from softcal.geometry.disc import SolidDisc
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import Neck
from softcal.geometry.placement import Placement, Turn, placed_mesh
from softcal.geometry.primitives import Primitive, box_mesh
from softcal.geometry.quality import check_quality
from softcal.geometry.read import read_mesh
from softcal.geometry.shape import DrawnShape, PrimitiveShape
from softcal.geometry.surface import boundary_faces
from softcal.geometry.wire import SolidRod
from softcal.project.project import load
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.barrier import Contact
from softcal.twin.cables import CableLine
from softcal.twin.cores import body_skin
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Disc, Marker, Plate, PointLoad, Robot, Tie, ViaPoint
from softcal.twin.simulate import simulate

needs_gmsh = pytest.mark.skipif(importlib.util.find_spec("gmsh") is None, reason="Gmsh is not installed")
ROD = SolidRod(length=0.1, diameter=0.03, layers=4)
BELLOWS = Bellows(0.030, 0.020, 0.012, 0.0015, 0.003, folds=2, layers=4, sectors=6)
EXAMPLES = Path(__file__).parents[2] / "examples"
NECK_MESH = EXAMPLES / "neck-bench" / "neck.msh"


def neck_robot(mesh: TetMesh, neck: Neck, **others) -> Robot:
    """A neck in its socket, with the plate on its collar and one cable in front."""
    z = mesh.points[:, 2]
    body = Body(
        "neck",
        mesh,
        np.flatnonzero(z < neck.clamp_depth + 1e-9),
        elastic(2.3e6, 0.43),
        shape=PrimitiveShape(neck),
        **others,
    )
    collar = np.flatnonzero(z > neck.collar_start - 1e-9)
    return Robot(
        (body,),
        (Plate("plate", {"neck": collar}, np.array([0.0, 0.0, neck.height])),),
        (Cable("front", (ViaPoint([0.05, 0.0, neck.height], "plate"), ViaPoint([0.05, 0.0, 0.01406]))),),
    )


def bellows_robot(bellows: Bellows) -> Robot:
    """A bellows on its foot, under its weight, with a plate on its cap whose mass is off the axis."""
    mesh = bellows.mesh()
    body = Body(
        "neck", mesh, mesh.node_sets["foot"], elastic(0.3e6, 0.45), density=1100.0, shape=PrimitiveShape(bellows)
    )
    at = np.array([0.0, 0.0, bellows.height])
    plate = Plate("plate", {"neck": mesh.node_sets["top"]}, at, 0.01, at + [0.004, 0.002, 0.0])
    main = NamedActuator("main", Chamber({"neck": "cavity"}, dead_volume=2e-6))
    return Robot((body,), (plate,), actuators=(main,), gravity=[0.0, 0.0, -9.81])


def require_slopes(robot_of, primitive: Primitive, key: str, protocol: Protocol, channels: tuple[str, ...]) -> None:
    """The derivatives by a length are the central differences of robots with bodies that are meshed anew."""
    value, share = getattr(primitive, key), 0.003
    less, more = (
        simulate(robot_of(primitive.with_lengths({key: (1.0 + s) * value})), protocol).channels for s in (-share, share)
    )
    found = simulate(robot_of(primitive), protocol, sensitivities=(f"neck.{key}",))
    assert found.succeeded
    for channel in channels:
        slope = (more[channel] - less[channel]) / (2.0 * share * value)
        got = found.sensitivities[channel][f"neck.{key}"]
        np.testing.assert_allclose(got, slope, rtol=1e-3, atol=1e-9, err_msg=channel)


def drawn(robot: Robot) -> Robot:
    """The robot with the shape of its first body as drawn."""
    body, *others = robot.bodies
    return replace(robot, bodies=(replace(body, shape=DrawnShape()), *others))


def rod_robot(element: str = "P2P1", drive: str = "shortening") -> Robot:
    """A heavy rod with a plate, a marker and via points on it, a load, and a cable that begins in it."""
    mesh = ROD.mesh()
    cables = (
        Cable(
            "front",
            (
                ViaPoint([0.04, 0.0, 0.1], "plate"),
                ViaPoint([0.004, 0.002, 0.06], "neck", radius=0.004),
                ViaPoint([0.05, 0.0, 0.0]),
            ),
            friction_coefficient=0.1,
        ),
    )
    top = mesh.node_sets["end"]
    body = Body(
        "neck", mesh, mesh.node_sets["start"], elastic(0.4e6, 0.43), element=element, density=1100.0,
        shape=PrimitiveShape(ROD),
    )  # fmt: skip
    plate = Plate("plate", {"neck": top}, np.array([0.0, 0.0, 0.1]), 0.05, np.array([0.0, 0.004, 0.12]))
    loads = (
        PointLoad("push", "neck", [0.0, 0.01, 0.05], [0.02, 0.0, 0.0]),
        PointLoad("tip", "plate", [0.01, 0.0, 0.12], [0.0, 0.05, 0.0]),
    )
    markers = (
        Marker("low", "neck", [0.005, 0.004, 0.03], [1e-3, 0.0, 2e-3]),
        Marker("high", "plate", [0.0, 0.02, 0.1]),
    )
    return Robot((body,), (plate,), cables, loads, gravity=[0.0, 0.3, -9.81], markers=markers)


@pytest.mark.parametrize("element", ["P1", "P2P1"])
@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize("key", ["length", "diameter", "scale", "wall_offset"])
def test_all_channels_follow_a_length_as_their_differences_say(element, drive, key, monkeypatch):
    """Under weight, loads, friction and a cable in the body: whatever depends on the undeformed shape."""
    robot = rod_robot(element) if key in ROD.lengths else drawn(rod_robot(element))
    protocol = pulled(0.002, 0.006) if drive == "shortening" else tensed(0.2, 0.5)
    h = 1e-5 if key == "scale" else 1e-6
    require_derivatives(robot, protocol, {f"neck.{key}": h}, monkeypatch)


@pytest.mark.parametrize("key", ["outer_diameter", "waist_diameter", "dome_height", "link_pitch"])
def test_the_channels_of_the_neck_follow_its_lengths(key, monkeypatch):
    """With small elements at the waists, where the difference of two systems loses digits."""
    robot = neck_robot(read_mesh(NECK_MESH, unit="mm"), Neck(), element="P1")
    require_derivatives(robot, pulled(0.01), {f"neck.{key}": 5e-6}, monkeypatch, error=5e-6)


@pytest.mark.parametrize("key", ["outer_diameter", "waist_diameter"])
@pytest.mark.parametrize("stated", ["outer_diameter", "waist_diameter", "both"])
def test_the_channels_follow_a_length_at_other_lengths(key, stated, monkeypatch):
    """What is stated stays as another length changes, what is not follows it, there as at the robot's own lengths."""
    robot = neck_robot(read_mesh(NECK_MESH, unit="mm"), Neck(), element="P1")
    own = {name: robot_parameters(robot)[f"neck.{name}"].value for name in ("outer_diameter", "waist_diameter")}
    at = {f"neck.{name}": 0.97 * value for name, value in own.items() if stated in (name, "both")}
    require_derivatives(robot, pulled(0.01), {f"neck.{key}": 5e-6}, monkeypatch, error=5e-6, at=at)


@pytest.mark.parametrize("key", ["scale", "wall_offset"])
def test_the_channels_follow_a_length_in_contact(key, monkeypatch):
    """A column that is pulled against a block, without which the tension would be smaller by a quarter.

    The pressure curves where contact begins, so that both differences lose digits. Between 7.8 and 8.05 mm a point
    passes over a ridge between two triangles: the step of the difference by which the mesh moves is wider than that.
    """
    block = box_mesh((0.02, 0.03, 0.03), (2, 2, 2), origin=(0.018, -0.015, 0.07))
    beside = Body("block", block, block.node_sets["x1"], elastic(1e6, 0.4), element="P1")
    free = drawn(column_robot("P1", parameters=elastic(1e6, 0.4), divisions=(2, 2, 8)))
    robot = replace(free, bodies=(*free.bodies, beside), contact=Contact())
    protocol = pulled(0.005, 0.0075)
    alone, touching = (simulate(one, protocol).channels["front.tension"] for one in (free, robot))
    assert np.all(touching > 1.25 * alone)
    require_derivatives(robot, protocol, {f"neck.{key}": 1e-6 if key == "scale" else 1e-7}, monkeypatch, error=2e-5)


@pytest.mark.slow
def test_the_shipped_neck_follows_its_diameter_in_contact(monkeypatch):
    """Its mesh is symmetric, so that choices between alike tets are rounding's: they must not change with the shape."""
    robot = load(EXAMPLES / "neck" / "project.yaml").robot
    protocol = pulled(0.022, 0.03)
    free, touching = (
        simulate(one, protocol).channels["front.tension"] for one in (replace(robot, contact=None), robot)
    )
    assert touching[1] > 1.04 * free[1]
    require_derivatives(robot, protocol, {"neck.outer_diameter": 2e-6}, monkeypatch, error=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("command", [Command("pressure", [1e3, 4e3]), Command("volume", [1e-6, 4e-6])])
@pytest.mark.parametrize("key", Bellows.lengths)
def test_the_channels_of_a_bellows_follow_its_lengths(key, command, monkeypatch):
    """With gas, whose amount is that of the cavity at rest, so that the pump's volume depends on the shape too."""
    protocol = Protocol({"main": command})
    require_derivatives(bellows_robot(BELLOWS), protocol, {f"neck.{key}": 2e-6}, monkeypatch, error=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("key", Bellows.lengths)
def test_the_slopes_of_a_bellows_are_those_of_other_bellows(key):
    for command in (Command("pressure", [4e3]), Command("volume", [4e-6])):
        channels = ("main.pressure", "main.volume", "plate.z")
        require_slopes(bellows_robot, BELLOWS, key, Protocol({"main": command}), channels)


@pytest.mark.slow
@pytest.mark.parametrize("key", Neck.lengths)
def test_the_slopes_of_a_neck_are_those_of_other_necks(key):
    """By the same tets, since two meshes of Gmsh differ by more than two necks of nearly the same length do."""

    def robot_of(neck: Neck) -> Robot:
        return neck_robot(grid_neck(neck), neck)

    require_slopes(robot_of, Neck(n_bells=2), key, pulled(0.008), ("front.tension", "plate.pitch", "plate.z"))


@pytest.mark.parametrize("key", Neck.lengths)
@pytest.mark.parametrize("dome", ["cubic", "ellipse", ((0.13, 0.31), (0.36, 0.71))])
def test_a_moved_neck_is_the_one_meshed_anew(key, dome):
    """Node by node, within the decimals to which it is meshed: the plane of the clamp, which cuts a dome, stays."""
    neck = Neck(n_bells=3, dome=dome)
    mesh, other = grid_neck(neck), neck.with_lengths({key: 1.05 * getattr(neck, key)})
    points, _ = PrimitiveShape(neck).moved(mesh, np.zeros(0, dtype=int), {key: getattr(other, key)})
    anew = grid_neck(other)
    np.testing.assert_array_equal(mesh.tets, anew.tets)
    np.testing.assert_allclose(points, anew.points, atol=2e-10)
    assert abs(points - mesh.points).max() > 1e-4


@pytest.mark.parametrize("key", Bellows.lengths)
def test_a_moved_bellows_is_the_one_meshed_anew(key):
    """The same nodes, whose numbers may differ; within the decimals to which a bellows is meshed."""
    other = replace(BELLOWS, **{key: 1.05 * getattr(BELLOWS, key)})
    mesh, anew = BELLOWS.mesh(), other.mesh()
    points, shape = PrimitiveShape(BELLOWS).moved(mesh, np.zeros(0, dtype=int), {key: getattr(other, key)})
    assert shape == PrimitiveShape(other)
    distances, numbers = KDTree(anew.points).query(points)
    assert distances.max() < 2e-9
    assert len(np.unique(numbers)) == len(points) == anew.n_points
    assert abs(points - mesh.points).max() > 1e-5


def test_the_cores_of_a_symmetric_body_stay_in_their_tets():
    mesh = box_mesh((0.02, 0.02, 0.02), (4, 4, 4), origin=(-0.01, -0.01, 0.0))
    turned = replace(mesh, points=mesh.points @ np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]))
    own = body_skin(turned)
    for factor in (1.0 - 1e-7, 1.0 + 1e-7, 0.9, 1.1):
        moved = body_skin(replace(turned, points=factor * turned.points), turned)
        assert abs(factor * moved.core - own.core).max() < 1e-9 * abs(own.core).max()


@pytest.mark.parametrize("key", ["length", "diameter"])
def test_the_channels_follow_a_length_where_friction_remembers(key, monkeypatch):
    robot = rod_robot("P1")
    cable = replace(robot.cables[0], line=CableLine(friction_memory=True))
    protocol = pulled(0.002, 0.006, 0.0055, 0.004)
    require_derivatives(replace(robot, cables=(cable,)), protocol, {f"neck.{key}": 1e-7}, monkeypatch)


@needs_gmsh
@pytest.mark.slow
def test_a_moved_neck_pulls_as_one_that_is_meshed_anew():
    """At diameters some hundredths off, and its derivative as their difference's.

    All lengths follow the outer diameter, so that the other mesh is the same one, scaled: by other lengths two meshes
    of Gmsh differ by more than what the length does.
    """
    key, error = "outer_diameter", 1e-4
    neck = Neck(n_bells=3, tets=900, sectors=6, waist_refinement=6.0)
    robot, protocol = neck_robot(neck.mesh(), neck), pulled(0.01)
    value = getattr(neck, key)
    tension = {}
    for share in (0.96, 1.04):
        other = neck.with_lengths({key: share * value})
        anew = neck_robot(other.mesh(), other)
        moved = simulate(robot, protocol, {f"neck.{key}": share * value}).channels["front.tension"]
        tension[share] = simulate(anew, protocol).channels["front.tension"]
        np.testing.assert_allclose(moved, tension[share], rtol=error)
    found = simulate(robot, protocol, sensitivities=(f"neck.{key}",))
    slope = (tension[1.04] - tension[0.96]) / (0.08 * value)
    np.testing.assert_allclose(found.sensitivities["front.tension"][f"neck.{key}"], slope, rtol=1e-3)


@pytest.mark.parametrize("key", Neck.lengths)
def test_the_surface_of_a_moved_neck_is_that_of_the_other_neck(key):
    neck, mesh = Neck(), read_mesh(NECK_MESH, unit="mm")
    other = neck.with_lengths({key: 1.03 * getattr(neck, key)})
    points, shape = PrimitiveShape(neck).moved(mesh, np.zeros(0, dtype=int), {key: getattr(other, key)})
    assert shape.primitive == other
    surface = np.unique(boundary_faces(mesh))
    z, new = mesh.points[surface, 2], points[surface]
    r, new_r = (np.hypot(*one[surface, :2].T) for one in (mesh.points, points))
    for old_top, top in zip(neck.waists, other.waists, strict=True):
        on_dome = (z < old_top - 1e-9) & (z > old_top - neck.dome_height)
        # Nodes on the dome itself; those between two layers of a sweep are a little inside it.
        on_dome &= np.abs(r - [neck.dome_radius(old_top - one) for one in z]) < 1e-6
        assert np.count_nonzero(on_dome) > 10
        want = [other.dome_radius(top - one) for one in new[on_dome, 2]]
        np.testing.assert_allclose(new_r[on_dome], want, atol=2e-6)
    assert new_r.max() == pytest.approx(0.5 * other.outer_diameter, rel=1e-6)
    assert new[:, 2].max() == pytest.approx(other.height)
    assert check_quality(replace(mesh, points=points)).inverted == ()


def test_lengths_that_were_omitted_follow_the_outer_diameter():
    neck = Neck(waist_diameter=0.02)
    wider = neck.with_lengths({"outer_diameter": 0.04})
    assert wider == Neck(0.04, waist_diameter=0.02)
    assert wider.with_lengths({"outer_diameter": 0.038}) == neck
    assert wider.link_pitch == pytest.approx(0.481 * 0.04)
    assert wider.with_lengths({"link_pitch": 0.02}).link_pitch == 0.02


def test_what_is_on_the_body_moves_along_and_what_is_in_space_stays():
    robot = rod_robot()
    (plate,) = robot.plates
    disc = Disc(0.08, 0.004)
    robot = replace(robot, plates=(replace(plate, holes={"h1": np.array([0.04, 0.0, 0.1])}, disc=disc),))
    longer = with_parameters(robot, {"neck.length": 0.11, "neck.diameter": 0.033})
    (plate,), (body,) = longer.plates, longer.bodies
    up = np.array([0.0, 0.0, 0.01])
    np.testing.assert_allclose(plate.reference, [0.0, 0.0, 0.11], atol=1e-12)
    np.testing.assert_allclose(plate.centre_of_mass, [0.0, 0.004, 0.13], atol=1e-12)
    np.testing.assert_allclose(plate.holes["h1"], [0.04, 0.0, 0.11], atol=1e-12)
    assert plate.disc is not None
    np.testing.assert_allclose(plate.disc.centre, [0.0, 0.0, 0.11], atol=1e-12)
    first, second, last = (via.at for via in longer.cables[0].via_points)
    np.testing.assert_allclose(first - up, [0.04, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(second, [0.0044, 0.0022, 0.066], atol=1e-9)
    np.testing.assert_array_equal(last, [0.05, 0.0, 0.0])
    np.testing.assert_allclose(longer.loads[0].at, [0.0, 0.011, 0.055], atol=1e-9)
    np.testing.assert_allclose(longer.loads[1].at, [0.01, 0.0, 0.13], atol=1e-12)
    low, high = longer.markers
    np.testing.assert_allclose(low.at, [0.0055, 0.0044, 0.033], atol=1e-9)
    np.testing.assert_allclose(high.at, [0.0, 0.02, 0.11], atol=1e-12)
    np.testing.assert_array_equal(body.fixed, robot.bodies[0].fixed)
    assert robot_parameters(longer)["neck.length"].value == 0.11
    back = with_parameters(longer, {"neck.length": 0.1, "neck.diameter": 0.03})
    np.testing.assert_allclose(back.bodies[0].mesh.points, robot.bodies[0].mesh.points, atol=1e-15)


def test_a_placed_primitive_moves_in_its_own_frame():
    placement = Placement((0.01, 0.02, 0.03), (Turn((0.0, 1.0, 0.0), 0.5 * np.pi),))
    mesh = placed_mesh(ROD.mesh(), placement.pose)
    points, _ = PrimitiveShape(ROD, placement).moved(mesh, np.zeros(0, dtype=int), {"length": 0.12})
    np.testing.assert_allclose(points[:, 0] - 0.01, 1.2 * (mesh.points[:, 0] - 0.01), atol=1e-12)
    np.testing.assert_allclose(points[:, 1:], mesh.points[:, 1:], atol=1e-12)


@pytest.mark.parametrize("primitive", [ROD, BELLOWS, Neck(n_bells=2)], ids=lambda primitive: type(primitive).__name__)
def test_no_placement_changes_how_a_primitive_moves(primitive):
    """In a placed mesh, nodes on a plane of the primitive are off it by rounding errors."""
    mesh = grid_neck(primitive) if isinstance(primitive, Neck) else primitive.mesh()
    placement = Placement((0.013, -0.02, 0.031), (Turn((1.0, 2.0, 0.3), 0.5),))
    for key in primitive.lengths:
        new, none = {key: 1.02 * getattr(primitive, key)}, np.zeros(0, dtype=int)
        want, _ = PrimitiveShape(primitive).moved(mesh, none, new)
        found, _ = PrimitiveShape(primitive, placement).moved(placed_mesh(mesh, placement.pose), none, new)
        np.testing.assert_allclose(found, placement.pose.apply(want), atol=1e-9, err_msg=key)


@pytest.mark.parametrize("order", [1, 2])
def test_an_offset_moves_every_face_of_a_box_by_itself(order):
    mesh = box_mesh((0.03, 0.02, 0.1), (3, 3, 8), order=order)
    points, _ = DrawnShape().moved(mesh, mesh.node_sets["z0"], {"wall_offset": 0.001})
    np.testing.assert_allclose(points.min(axis=0), -0.001, atol=1e-12)
    np.testing.assert_allclose(points.max(axis=0), [0.031, 0.021, 0.101], atol=1e-12)
    found = check_quality(replace(mesh, points=points))
    assert found.volume == pytest.approx(0.032 * 0.022 * 0.102, rel=1e-9)
    assert found.min_quality > 0.8 * check_quality(mesh).min_quality


def test_a_moved_rod_is_the_one_meshed_anew():
    other = replace(ROD, length=0.12, diameter=0.025)
    points, shape = PrimitiveShape(ROD).moved(ROD.mesh(), np.zeros(0, dtype=int), {"length": 0.12, "diameter": 0.025})
    np.testing.assert_allclose(points, other.mesh().points, atol=1e-12)
    assert shape == PrimitiveShape(other)


def test_an_offset_widens_a_round_wall_and_a_scale_keeps_the_fixed_nodes_centre():
    mesh = ROD.mesh()
    points, shape = DrawnShape().moved(mesh, mesh.node_sets["start"], {"wall_offset": 0.0005})
    skin = np.setdiff1d(mesh.node_sets["skin"], [*mesh.node_sets["start"], *mesh.node_sets["end"]])
    radius = np.hypot(*points[skin, :2].T)
    np.testing.assert_allclose(radius, 0.0155, atol=1e-4)
    back, _ = shape.moved(replace(mesh, points=points), mesh.node_sets["start"], {"wall_offset": 0.0})
    np.testing.assert_allclose(back, mesh.points, atol=5e-5)
    points, _ = DrawnShape().moved(mesh, mesh.node_sets["end"], {"scale": 1.1})
    np.testing.assert_allclose(points - [0.0, 0.0, 0.1], 1.1 * (mesh.points - [0.0, 0.0, 0.1]), atol=1e-12)


def test_a_disc_gets_thicker_about_its_holes():
    disc = SolidDisc(0.06, 0.008)
    mesh = box_mesh((0.0424, 0.0424, 0.008), (2, 2, 1), origin=(-0.0212, -0.0212, 0.0))
    points, _ = PrimitiveShape(disc).moved(mesh, np.zeros(0, dtype=int), {"thickness": 0.01})
    np.testing.assert_allclose(points, mesh.points * [1.0, 1.0, 1.25], atol=1e-15)


def test_shapes_that_a_mesh_cannot_have_are_refused():
    robot = drawn(column_robot())
    with pytest.raises(MeshError, match=r"neck: \d+ of 144 tets are turned inside out; got wall_offset -20 mm"):
        with_parameters(robot, {"neck.wall_offset": -0.02})
    with pytest.raises(ParameterError, match="out of range"):
        with_parameters(robot, {"neck.scale": 0.0})
    with pytest.raises(MeshError, match=r"neck\.shape: the mesh does not have the shape[\s\S]*height 120 mm"):
        replace(rod_robot().bodies[0], shape=PrimitiveShape(replace(ROD, length=0.12)))
    neck = neck_robot(read_mesh(NECK_MESH, unit="mm"), Neck())
    with pytest.raises(MeshError, match=r"waist_diameter[\s\S]*outer_diameter"):
        with_parameters(neck, {"neck.waist_diameter": 0.039})


def test_parts_that_would_have_to_move_along_are_named():
    robot = drawn(column_robot())
    (body,), (plate,) = robot.bodies, robot.plates
    other = Body("other", body.mesh, body.mesh.node_sets["z0"], elastic(), element="P1")
    shared = replace(plate, nodes={**plate.nodes, "other": body.mesh.node_sets["z1"]})
    with pytest.raises(MeshError, match=r"other parts would have to move along; got body other on plate"):
        with_parameters(replace(robot, bodies=(body, other), plates=(shared,)), {"neck.scale": 1.1})
    tie = Tie("glue", "other", body.mesh.node_sets["x0"], "neck")
    with pytest.raises(MeshError, match="got tie glue"):
        with_parameters(replace(robot, bodies=(body, other), ties=(tie,)), {"neck.scale": 1.1})
    still = replace(robot, bodies=(body, other), plates=(replace(shared, fixed=True),), cables=())
    np.testing.assert_array_equal(with_parameters(still, {"neck.scale": 1.1}).plates[0].reference, plate.reference)


def test_a_body_without_a_shape_has_no_lengths():
    assert "neck.scale" not in robot_parameters(column_robot())
    with pytest.raises(ParameterError, match=r"no such parameter"):
        simulate(column_robot(), pulled(0.01), {"neck.scale": 1.1})
