"""The depth of a clamp: against shorter bodies, derivatives against central differences, and what it refuses."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, constants, elastic, hanging_finger, irregular_box, pulled, tensed

from softcal.errors import InputError, MeshError
from softcal.export.engine import ENGINES
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.surface import boundary_faces
from softcal.materials.catalogue import LAWS
from softcal.twin.build import build_twin
from softcal.twin.clamp import Clamp
from softcal.twin.finer import halved
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Marker, Material, Robot, SurfaceLoad
from softcal.twin.simulate import simulate

DEPTH = "neck.clamp_depth"
UP = (0.0, 0.0, 1.0)


def bar(mesh: TetMesh, element: str, traction, *, nu: float, at: float = 0.1, clamp: Clamp | None = None) -> Robot:
    """A bar clamped at z = 0 and loaded at its end face."""
    body = Body("neck", mesh, mesh.node_sets["z0"], elastic(1e6, nu), element=element, clamp=clamp)
    load = SurfaceLoad("pull", "neck", mesh.face_sets["z1"], np.array(traction))
    return Robot((body,), loads=(load,), markers=(Marker("tip", "neck", [0.015, 0.015, at]),))


def tip(robot: Robot, theta=None) -> np.ndarray:
    response = simulate(robot, Protocol({}), theta)
    assert response.succeeded, response.status
    return np.array([response.channels[f"tip.{axis}"][-1] for axis in "xyz"]) - robot.markers[0].at


@pytest.mark.parametrize("element", ["P1", "P2", "P2P1"])
@pytest.mark.parametrize("depth", [-0.01, 0.004, 0.012])
def test_a_bar_in_tension_is_shorter_by_the_depth_exactly(element, depth):
    """On an irregular mesh, and at a stretch of some 40 %: u = (L - d) (stretch - 1)."""
    mesh = irregular_box((0.03, 0.03, 0.1), (2, 2, 5), element)
    robot = bar(mesh, element, (0.0, 0.0, 4e5), nu=0.0, clamp=Clamp(UP))
    drawn = tip(robot)[2]
    assert drawn > 0.02
    assert tip(robot, {DEPTH: depth})[2] == pytest.approx(drawn * (0.1 - depth) / 0.1, rel=1e-8)


def test_a_cantilever_bends_as_one_that_is_shorter():
    """As a beam meshed by itself, to the accuracy of both meshes, and by the cube law of slender beams."""
    side = (2e3, 0.0, 0.0)
    robot = bar(box_mesh((0.03, 0.03, 0.1), (2, 2, 10)), "P2P1", side, nu=0.45, clamp=Clamp(UP))
    drawn = tip(robot)[0]
    for depth in (-0.005, 0.005, 0.01):
        shorter = bar(box_mesh((0.03, 0.03, 0.1 - depth), (2, 2, 10)), "P2P1", side, nu=0.45, at=0.1 - depth)
        found, want = tip(robot, {DEPTH: depth})[0], tip(shorter)[0]
        assert found == pytest.approx(want, rel=4e-3)
        assert found / drawn == pytest.approx(((0.1 - depth) / 0.1) ** 3, rel=0.02)


def test_a_clamp_that_is_drawn_deeper_does_the_same():
    """Fixed up to a layer of the mesh, or up to its foot with the layer's thickness as the depth; under a cable."""
    drawn = column_robot("P2P1", parameters=elastic(0.4e6, 0.43), divisions=(2, 2, 10))
    (body,) = drawn.bodies
    clamped = replace(drawn, bodies=(replace(body, clamp=Clamp(UP)),))
    deeper = np.flatnonzero(body.mesh.points[:, 2] < 0.0101)
    fixed = replace(drawn, bodies=(replace(body, fixed=deeper),))
    protocol = pulled(0.01, 0.02)
    plain, found, want = (
        simulate(robot, protocol, theta).channels
        for robot, theta in ((clamped, None), (clamped, {DEPTH: 0.01}), (fixed, None))
    )
    for channel in ("front.tension", "plate.x"):
        assert np.all(np.abs(want[channel] / plain[channel] - 1.0) > 0.02)
        np.testing.assert_allclose(found[channel], want[channel], rtol=4e-3)


@pytest.mark.parametrize("depth", [0.0, 0.006])
@pytest.mark.parametrize(
    ("element", "law"), [("P1", "neo-hooke"), ("P2", "mooney-rivlin"), ("P2P1", "mooney-rivlin"), ("P2P1", "neo-hooke")]
)
@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_all_channels_follow_the_depth_as_their_differences_say(element, law, depth, drive, monkeypatch):
    """With two materials behind the face, and gravity; in the midst of the depths too."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    found = constants(LAWS.named(law), 0.4e6, 0.43)
    robot = column_robot(
        element,
        parameters=found,
        law=law,
        mesh=None if element == "P1" else irregular_box((0.03, 0.03, 0.1), (1, 1, 4), element, shift=0.1),
        gravity=(0.0, 0.3, -9.81),
        density=1100.0,
        mass=0.05,
    )
    (body,) = robot.bodies
    half = np.flatnonzero(body.mesh.points[body.mesh.tets[:, :4]].mean(axis=1)[:, 0] > body.mesh.points[:, 0].mean())
    soft = Material("soft", half, {key: 0.7 * value for key, value in found.items() if key != "poissons_ratio"})
    robot = replace(
        robot,
        bodies=(replace(body, clamp=Clamp(UP, depth), inclusions=(soft,)),),
        markers=(Marker("low", "neck", [0.005, 0.004, 0.01]),),
    )
    protocol = pulled(0.002, 0.006) if drive == "shortening" else tensed(0.2, 0.5)
    response = simulate(robot, protocol, sensitivities=(DEPTH, "neck.density"), curve_tolerance=0.0)
    assert response.succeeded, response.status
    h = 2e-6
    ends = [simulate(robot, protocol, {DEPTH: depth + s * h}, curve_tolerance=0.0).channels for s in (1.0, -1.0)]
    want = {channel: (ends[0][channel] - ends[1][channel]) / (2.0 * h) for channel in ends[0]}
    for unit in ("N", "m", "rad"):
        of_unit = [channel for channel in want if response.units[channel] == unit]
        scale = max(np.abs(want[channel]).max() for channel in of_unit)
        for channel in of_unit:
            got = response.sensitivities[channel][DEPTH]
            np.testing.assert_allclose(got, want[channel], rtol=1e-5, atol=2e-6 * scale + 1e-8, err_msg=channel)
    assert np.all(want["front.tension" if drive == "shortening" else "front.shortening"] != 0.0)


def test_the_strain_energy_is_that_of_a_mesh_moved_by_hand():
    """Linear in the height behind the face, up to the root of its area; the body as other programs get it, too."""
    side, mesh = (2e3, 0.0, 0.0), box_mesh((0.03, 0.03, 0.1), (2, 2, 10))
    by_hand = mesh.points.copy()
    by_hand[:, 2] += 0.007 * np.clip(1.0 - mesh.points[:, 2] / 0.03, 0.0, 1.0)
    moved = TetMesh(by_hand, mesh.tets, mesh.node_sets, mesh.face_sets)
    robot = bar(mesh, "P2P1", side, nu=0.45, clamp=Clamp(UP, 0.007))
    want = tip(bar(moved, "P2P1", side, nu=0.45))
    np.testing.assert_allclose(tip(robot), want, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(tip(robot.as_clamped), want, rtol=1e-9, atol=1e-12)
    assert robot.as_clamped.bodies[0].clamp is None
    for name in ("calculix", "sofa"):
        (body,) = ENGINES[name].own(robot).bodies
        np.testing.assert_allclose(body.mesh.points, by_hand)
    assert DEPTH not in robot_parameters(robot.as_clamped)


@pytest.mark.parametrize("depth", [0.0, 0.002])
def test_weight_tractions_and_chambers_are_those_of_a_mesh_moved_by_hand(depth, monkeypatch):
    """Of a finger that hangs, blown up and pressed at its side, with a chamber that begins at the clamp."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = hanging_finger("P2P1", is_open=True)
    (body,), name = robot.bodies, "finger.clamp_depth"
    side = boundary_faces(body.mesh)
    side = side[(body.mesh.points[side[:, :3], 0] < 1e-9).all(axis=1)]
    wind, tip = SurfaceLoad("wind", "finger", side, np.array([200.0, 0.0, 50.0])), Marker("tip", "finger", [0, 0, 0.06])
    robot = replace(robot, loads=(wind,), markers=(tip,))
    clamped = replace(robot, bodies=(replace(body, clamp=Clamp(UP, depth)),))
    zone = clamped.bodies[0].zone
    assert zone is not None

    def by_hand(at: float) -> dict[str, np.ndarray]:
        moved = body.mesh.points + at * np.outer(zone.shares(body.mesh), UP)
        anew = replace(robot, bodies=(replace(body, mesh=replace(body.mesh, points=moved)),))
        return dict(simulate(anew, protocol, curve_tolerance=0.0).channels)

    protocol, h = Protocol({"main": Command("pressure", np.array([2e3]))}), 2e-5
    found, want = simulate(clamped, protocol, sensitivities=(name,), curve_tolerance=0.0), by_hand(depth)
    less, more = by_hand(depth - h), by_hand(depth + h)
    for channel in ("main.volume", "tip.x", "tip.z"):
        np.testing.assert_allclose(found.channels[channel], want[channel], rtol=1e-9, err_msg=channel)
        slope = (more[channel] - less[channel]) / (2.0 * h)
        np.testing.assert_allclose(found.sensitivities[channel][name], slope, rtol=1e-4, err_msg=channel)


def test_a_finer_mesh_has_the_same_zone_and_depth():
    robot = bar(box_mesh((0.03, 0.03, 0.1), (2, 2, 10)), "P1", UP, nu=0.3, clamp=Clamp(UP, 0.004))
    coarse, fine = robot_parameters(robot)[DEPTH], robot_parameters(halved(robot))[DEPTH]
    assert coarse == fine
    assert (coarse.value, coarse.unit, coarse.floor) == (0.004, "m", pytest.approx(-0.015))


def notched(height: float) -> TetMesh:
    """The bar with a corner cut away from its second layer on, whose height [m] is given."""
    mesh = box_mesh((0.03, 0.03, 0.1), (2, 2, 10))
    points = mesh.points.copy()
    points[points[:, 2] == 0.01, 2] = height
    mesh = replace(mesh, points=points)
    centre = mesh.points[mesh.tets].mean(axis=1)
    return replace(mesh, tets=mesh.tets[(centre[:, 0] < 0.015) | (centre[:, 2] < height)], face_sets={})


def clamped(mesh: TetMesh, clamp: Clamp, fixed=None) -> Robot:
    fixed = mesh.node_sets["z0"] if fixed is None else fixed
    return Robot((Body("neck", mesh, fixed, elastic(), element="P1", clamp=clamp),))


def test_the_zone_ends_where_the_cross_section_changes():
    assert robot_parameters(clamped(notched(0.008), Clamp(UP)))[DEPTH].floor == pytest.approx(-0.004)
    with pytest.raises(InputError, match="cross-section of the body changes right behind its fixed face"):
        clamped(notched(0.0004), Clamp(UP))


def test_what_no_depth_can_be_defined_of_is_refused():
    mesh = box_mesh((0.03, 0.03, 0.1), (2, 2, 10))
    with pytest.raises(InputError, match=r"no fixed face lies behind the body[\s\S]*the opposite direction"):
        clamped(mesh, Clamp((0.0, 0.0, -1.0)))
    with pytest.raises(InputError, match="no fixed face lies behind the body") as error:
        clamped(mesh, Clamp((1.0, 0.0, 0.0)))
    assert "opposite" not in str(error.value)
    x, _, z = mesh.points.T
    for beside in ((x == 0.0) & (z < 0.025), z > 0.045):
        with pytest.raises(InputError, match=r"no fixed face lies behind the body|does not end at a plane"):
            clamped(mesh, Clamp(UP), np.flatnonzero(beside))
    with pytest.raises(InputError, match="does not end at a plane across the direction"):
        clamped(mesh, Clamp(UP), np.flatnonzero((z == 0.0) | ((x == 0.0) & (z < 0.025))))
    with pytest.raises(InputError, match=r"neck\.clamp\.depth: the length is out of range[\s\S]*-0\.015 to 0\.015 m"):
        clamped(mesh, Clamp(UP, 0.016))
    with pytest.raises(InputError, match="out of range"):
        with_parameters(clamped(mesh, Clamp(UP)), {DEPTH: 0.016})
    assert robot_parameters(clamped(mesh, Clamp(UP), np.flatnonzero((z == 0.0) | (z == 0.1))))[DEPTH].value == 0.0


def test_a_body_tied_near_its_clamp_is_refused():
    robot = column_robot()
    (body,), (plate,) = robot.bodies, robot.plates
    ring = np.flatnonzero((body.mesh.points[:, 2] > 0.01) & (body.mesh.points[:, 2] < 0.02))
    with pytest.raises(MeshError, match="tied to a plate or another body near its clamp"):
        build_twin(
            replace(
                robot,
                bodies=(replace(body, clamp=Clamp(UP)),),
                plates=(plate, replace(plate, name="ring", nodes={"neck": ring})),
            )
        )
