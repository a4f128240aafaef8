"""Slender bars against beam theory: the elastica, and a tendon along the bar."""

import numpy as np
import pytest
from mechanics_cases import elastic, pulled, tensed
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from softcal.geometry.primitives import box_mesh
from softcal.twin.protocol import Protocol
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, SurfaceLoad, ViaPoint
from softcal.twin.simulate import simulate

E, LENGTH, SIDE = 1.0e6, 1.0, 0.025
STIFFNESS = E * SIDE**4 / 12.0  # E I


def bar(element: str, nu: float, divisions=(24, 1, 1)) -> Body:
    mesh = box_mesh((LENGTH, SIDE, SIDE), divisions, origin=(0.0, -SIDE / 2, -SIDE / 2))
    return Body("bar", mesh, fixed=mesh.node_sets["x0"], parameters=elastic(E, nu), element=element)


# The elastica: E I theta'' = -P cos(theta), theta(0) = 0, theta'(L) = 0, P across the undeformed bar and dead.


def elastica_tip(load: float) -> np.ndarray:
    """Position of the tip (x, z) [m]."""

    def shoot(curvature):
        return solve_ivp(
            lambda s, y: [y[1], -load / STIFFNESS * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])],
            (0.0, LENGTH),
            [0.0, curvature, 0.0, 0.0],
            rtol=1e-11,
            atol=1e-12,
        ).y[:, -1]

    return shoot(brentq(lambda curvature: shoot(curvature)[1], 0.0, 1.01 * load * LENGTH / STIFFNESS))[2:]


def test_elastica_is_the_published_one():
    """Bisshopp and Drucker (1945): P L^2 / E I = 2 gives a deflection of 0.4935 L and a shortening of 0.1606 L."""
    assert elastica_tip(2.0 * STIFFNESS / LENGTH**2) == pytest.approx([1 - 0.16064, 0.49346], abs=1e-5)


@pytest.mark.parametrize(("element", "nu"), [("P2", 0.0), ("P2P1", 0.1), ("P2P1", 0.3)])
@pytest.mark.parametrize("times", [0.5, 2.0, 5.0])
@pytest.mark.parametrize("loading", ["traction", "point"])
def test_cantilever_is_the_elastica(element, nu, times, loading):
    load = times * STIFFNESS / LENGTH**2
    body = bar(element, nu)
    force = np.array([0.0, 0.0, load])
    if loading == "traction":
        loads = (SurfaceLoad("tip", "bar", body.mesh.face_sets["x1"], force / SIDE**2),)
    else:
        loads = (PointLoad("tip", "bar", np.array([LENGTH, 0.0, 0.0]), force),)
    response = simulate(Robot((body,), loads=loads), Protocol({}), snapshots=True)
    assert response.succeeded, response.status
    tip = response.snapshots[-1].points["bar"][body.mesh.node_sets["x1"]].mean(axis=0)
    moved = tip - [LENGTH, 0.0, 0.0]
    expected = elastica_tip(load) - [LENGTH, 0.0]
    assert np.linalg.norm(moved[[0, 2]] - expected) < 0.01 * np.linalg.norm(expected)
    assert abs(moved[1]) < 1e-3 * np.linalg.norm(expected)


# A tendon along the bar at the offset e, guided by it all the way, T at its end. Every section carries the force -T
# along its normal at the offset e, so the bar is bent into an arc and pressed together evenly:
#
#     curvature per undeformed length  kappa = T e / (E I),     axial strain  -T / (E A)
#     cable                            shortening = T L / (E A) + T e^2 L / (E I)
#
# (the stationary point of E A eps^2/2 + E I kappa^2/2 + T (1 + eps - e kappa) per length). With eps the tip stands on
# an arc of length (1 - T/EA) L and angle kappa L.
#
# Between via points the tendon is a chord and lies further in than the arc; with 60 of them that is 0.2 % of e.

OFFSET, N_VIA = 0.4 * SIDE, 60


def tendon_robot(element: str, nu: float, n_via: int = N_VIA) -> Robot:
    body = bar(element, nu)
    mesh = body.mesh
    plate = Plate("tip", {"bar": mesh.node_sets["x1"]}, reference=np.array([LENGTH, 0.0, 0.0]))
    inside = [ViaPoint(np.array([x, 0.0, OFFSET]), "bar") for x in LENGTH * (np.arange(1, n_via) / n_via)]
    ends = ViaPoint(np.array([0.0, 0.0, OFFSET])), ViaPoint(np.array([LENGTH, 0.0, OFFSET]), "tip")
    return Robot((body,), (plate,), (Cable("tendon", (ends[1], *reversed(inside), ends[0])),))


@pytest.mark.parametrize(("element", "nu", "angle"), [("P2", 0.0, 0.3), ("P2", 0.0, 1.0), ("P2P1", 0.3, 0.5)])
def test_tendon_bends_the_bar_into_an_arc(element, nu, angle):
    tension = angle * STIFFNESS / (OFFSET * LENGTH)
    robot = tendon_robot(element, nu)
    response = simulate(robot, tensed(tension, cable="tendon"), curve_tolerance=0.0)
    assert response.succeeded, response.status
    got = {name: values[0] for name, values in response.channels.items()}
    strain = tension / (E * SIDE**2)
    arc = (1.0 - strain) * LENGTH
    tip = arc / angle * np.array([np.sin(angle), 1.0 - np.cos(angle)])
    # The tendon is on the side of +z and pulls the tip there: a turn about -y.
    assert got["tip.pitch"] == pytest.approx(-angle, rel=0.01)
    moved, expected = np.array([got["tip.x"], got["tip.z"]]) - [LENGTH, 0.0], tip - [LENGTH, 0.0]
    assert np.linalg.norm(moved - expected) < 0.01 * np.linalg.norm(expected)
    shortening = strain * LENGTH + tension * OFFSET**2 * LENGTH / STIFFNESS
    assert got["tendon.shortening"] == pytest.approx(shortening, rel=0.01)
    back = simulate(robot, pulled(got["tendon.shortening"], cable="tendon"), curve_tolerance=0.0)
    assert back.channels["tendon.tension"][0] == pytest.approx(tension, rel=1e-6)


def test_tendon_bar_is_an_arc_along_its_length():
    """Not only the tip: the axis has one curvature."""
    robot = tendon_robot("P2", 0.0)
    tension = STIFFNESS / (OFFSET * LENGTH)
    response = simulate(robot, tensed(tension, cable="tendon"), snapshots=True, curve_tolerance=0.0)
    shot = min(response.snapshots, key=lambda shot: abs(shot.efforts["tendon"] - tension))
    assert shot.efforts["tendon"] == pytest.approx(tension, rel=1e-6)
    cable = shot.routes["tendon"][::-1]
    step = np.diff(cable, axis=0)[:, [0, 2]]
    turns = np.diff(np.unwrap(np.arctan2(step[:, 1], step[:, 0])))
    np.testing.assert_allclose(turns[1:-1], 1.0 / N_VIA, rtol=0.1)
