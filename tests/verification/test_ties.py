"""Bodies bonded to each other with meshes that do not match."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from softcal.errors import MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.regions import Plane, select_faces
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Marker, Plate, PointLoad, Robot, SurfaceLoad, Tie, ViaPoint
from softcal.twin.simulate import simulate

MATERIAL = {"youngs_modulus": 1e6, "poissons_ratio": 0.3}
SIDE, LENGTH = 0.02, 0.1


def bar(name: str, start: float, end: float, divisions: tuple[int, int, int], element: str, *, held: bool) -> Body:
    box = box_mesh((SIDE, SIDE, end - start), divisions)
    mesh = TetMesh(box.points + [0.0, 0.0, start], box.tets)
    fixed = np.flatnonzero(np.isclose(mesh.points[:, 2], start)) if held else np.array([], dtype=int)
    return Body(name, mesh, fixed, MATERIAL, element=element)


def two_bars(element: str, upper: tuple[int, int, int] = (3, 3, 6), lower: tuple[int, int, int] = (2, 2, 5)) -> Robot:
    below = bar("below", 0.0, LENGTH / 2, lower, element, held=True)
    above = bar("above", LENGTH / 2, LENGTH, upper, element, held=False)
    on_seam = np.flatnonzero(np.isclose(above.mesh.points[:, 2], LENGTH / 2))
    return Robot(bodies=(below, above), ties=(Tie("seam", "above", on_seam, "below"),))


def tip_load(robot: Robot, force: tuple[float, float, float], body: str) -> Robot:
    tip = np.array([SIDE / 2, SIDE / 2, LENGTH])
    return Robot(
        bodies=robot.bodies,
        ties=robot.ties,
        loads=(PointLoad("weight", body, tip, np.array(force)),),
        markers=(Marker("tip", body, tip),),
    )


def tip_of(robot: Robot) -> np.ndarray:
    response = simulate(robot, Protocol({}))
    assert response.succeeded, response.status
    return np.array([response.channels[f"tip.{axis}"][0] for axis in "xyz"])


@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_tied_bodies_move_rigidly_without_force(element):
    """A rigid motion of masters and free nodes leaves no stress anywhere: the tied nodes follow exactly."""
    robot = two_bars(element)
    robot = Robot(
        bodies=(Body("below", robot.bodies[0].mesh, [], MATERIAL, element=element), robot.bodies[1]),
        ties=robot.ties,
        plates=(
            Plate("top", {"above": np.flatnonzero(robot.bodies[1].mesh.points[:, 2] > LENGTH - 1e-9)}, np.zeros(3)),
        ),
    )
    twin = build_twin(robot)
    layout = twin.system.layout
    state = rest_state(layout)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    x, rotation = layout.X @ turn.T, turn[None].copy()
    layout.links.place(x, layout.references @ turn.T, rotation)
    turned = type(state)(x, layout.references @ turn.T, rotation, state.pressure, state.effort)
    theta = parameter_values(robot)
    none = np.zeros(0)
    at = twin.system.linearise(turned, Controls(none.astype(bool), none, none), theta)
    assert np.abs(x - layout.X @ turn.T).max() < 1e-15
    assert np.abs(at.reduced).max() < 1e-9 * MATERIAL["youngs_modulus"] * SIDE**2


def test_tied_tangent_is_the_gradients_derivative():
    twin = build_twin(two_bars("P2P1"))
    theta = parameter_values(twin.robot)
    statics = Statics(twin.system, theta)
    layout = twin.system.layout
    rng = np.random.default_rng(2)
    z0 = 3e-4 * rng.uniform(-1, 1, layout.n_unknowns)
    z0[layout.first_pressure_unknown :] *= 1e7
    d = 1e-4 * rng.uniform(-1, 1, layout.n_unknowns)
    d[layout.first_pressure_unknown :] *= 1e7
    none = np.zeros(0)
    controls = Controls(none.astype(bool), none, none)
    rest = moved(layout, rest_state(layout), z0)
    at = twin.system.linearise(rest, controls, theta)
    pattern = twin.system.pattern
    upper = sp.csr_matrix((at.data, pattern.indices, pattern.indptr))
    K = upper + sp.triu(upper, 1).T
    errors = []
    for h in (1e-1, 5e-2):
        ahead = twin.system.linearise(moved(layout, rest, h * d), controls, theta, tangent=False)
        errors.append(np.linalg.norm(ahead.reduced - at.reduced - h * (K @ d)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)
    statics.release()


@pytest.mark.parametrize("element", ["P1", "P2"])  # P2P1 has a pressure on either side of the seam
def test_matching_meshes_tied_are_one_body(element):
    force = (0.05, 0.0, 0.3)
    tied = tip_of(tip_load(two_bars(element, upper=(2, 2, 5)), force, "above"))
    whole = bar("whole", 0.0, LENGTH, (2, 2, 10), element, held=True)
    one = tip_of(tip_load(Robot(bodies=(whole,)), force, "whole"))
    np.testing.assert_allclose(tied, one, atol=1e-9)


def test_non_matching_meshes_tied_bend_like_one_body():
    force = (0.05, 0.02, 0.0)
    tied = tip_of(tip_load(two_bars("P2P1"), force, "above"))
    whole = bar("whole", 0.0, LENGTH, (3, 3, 12), "P2P1", held=True)
    one = tip_of(tip_load(Robot(bodies=(whole,)), force, "whole"))
    rest = np.array([SIDE / 2, SIDE / 2, LENGTH])
    assert np.linalg.norm(tied - one) < 0.005 * np.linalg.norm(one - rest)


def test_a_cable_across_a_seam_has_exact_sensitivities():
    robot = two_bars("P2P1")
    top = np.flatnonzero(robot.bodies[1].mesh.points[:, 2] > LENGTH - 1e-9)
    via = tuple(ViaPoint(np.array([0.018, 0.01, z]), on) for z, on in ((0.0, ""), (0.05, "below"), (0.1, "cap")))
    robot = Robot(
        bodies=robot.bodies,
        ties=robot.ties,
        plates=(Plate("cap", {"above": top}, np.array([0.01, 0.01, LENGTH])),),
        cables=(Cable("pull", via, pulled_end="first"),),
    )
    protocol = Protocol({"pull": Command("shortening", np.array([0.004]))})
    name, step = "below.youngs_modulus", 1e3
    exact = simulate(robot, protocol, sensitivities=(name,), curve_tolerance=0.0)
    ahead, back = (simulate(robot, protocol, {name: 1e6 + h}, curve_tolerance=0.0) for h in (step, -step))
    for channel in ("pull.tension", "cap.pitch", "cap.z"):
        difference = (ahead.channels[channel] - back.channels[channel]) / (2 * step)
        scale = np.abs(exact.channels[channel]) / 1e6
        assert np.abs(exact.sensitivities[channel][name] - difference) < 1e-5 * scale


def test_constant_stress_passes_a_seam_of_other_mesh_nearly():
    """Collocated ties are not exact in the patch test; the error dies away from the seam and is bounded here."""
    robot = two_bars("P2P1")
    above = robot.bodies[1]
    faces = select_faces(above.mesh, Plane((0, 0, LENGTH), (0, 0, 1)))
    traction = 2e3
    pulled = Robot(
        bodies=robot.bodies,
        ties=robot.ties,
        loads=(SurfaceLoad("pull", "above", faces, np.array([0.0, 0.0, traction])),),
        markers=(Marker("tip", "above", np.array([SIDE / 2, SIDE / 2, LENGTH])),),
    )
    whole = bar("whole", 0.0, LENGTH, (3, 3, 12), "P2P1", held=True)
    faces = select_faces(whole.mesh, Plane((0, 0, LENGTH), (0, 0, 1)))
    one = Robot(
        bodies=(whole,),
        loads=(SurfaceLoad("pull", "whole", faces, np.array([0.0, 0.0, traction])),),
        markers=(Marker("tip", "whole", np.array([SIDE / 2, SIDE / 2, LENGTH])),),
    )
    stretch = tip_of(one)[2] - LENGTH
    assert tip_of(pulled)[2] - LENGTH == pytest.approx(stretch, rel=2e-3)


def test_what_cannot_be_tied_says_so():
    robot = two_bars("P1")
    apart = TetMesh(robot.bodies[1].mesh.points + [0.0, 0.0, 0.03], robot.bodies[1].mesh.tets)
    far = Body("above", apart, [], MATERIAL, element="P1")
    with pytest.raises(MeshError, match="touches nothing; got the nearest of 16 nodes is 30 mm from below"):
        build_twin(Robot(bodies=(robot.bodies[0], far), ties=robot.ties))
    with pytest.raises(MeshError, match="there is no such body"):
        build_twin(Robot(bodies=robot.bodies, ties=(Tie("seam", "above", robot.ties[0].nodes, "beside"),)))
    with pytest.raises(MeshError, match="tied to itself"):
        build_twin(Robot(bodies=robot.bodies, ties=(Tie("seam", "above", robot.ties[0].nodes, "above"),)))
