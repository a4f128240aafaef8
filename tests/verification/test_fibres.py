"""Fibres wound around a tube: thick tubes under pressure against closed forms, and what the angle does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import constants
from scipy.integrate import quad
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from softcal.checks import Floats
from softcal.errors import InputError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.surface import boundary_faces
from softcal.materials.catalogue import LAWS
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.chamber import Chamber
from softcal.twin.material import Winding
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Robot
from softcal.twin.simulate import simulate

INNER, OUTER, LENGTH = 0.02, 0.024, 0.2  # [m]
LAYERS = (1, 12, 20)  # bricks along the radius, around and along the axis
MU, FIBRES, PRESSURE = 1e5, 3e6, 1.5e4  # [Pa]
PUMPED = Protocol({"air": Command("pressure", np.array([PRESSURE]))})
NEUTRAL = np.rad2deg(np.arctan(np.sqrt(2.0)))  # of a braid, to its axis: 54.7 deg


def tube(angle: float, *, law: str = "neo-hooke-fibres", fibre_modulus: float = FIBRES) -> Robot:
    """A tube with fibres at an angle [deg] to its axis, fixed at one end and closed by a flat cap at the other."""
    flat = box_mesh((OUTER - INNER, 2 * np.pi, LENGTH), LAYERS, order=2, origin=(INNER, 0.0, 0.0))
    radius, around, z = flat.points.T
    points = np.column_stack([radius * np.cos(around), radius * np.sin(around), z])
    _, first, number = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    points, tets = points[first], number.ravel()[flat.tets]
    faces = boundary_faces(TetMesh(points, tets))
    wall = faces[(np.hypot(*points[:, :2].T)[faces] < 1.0001 * INNER).all(axis=1)]
    constants = {"youngs_modulus": 3 * MU, "poissons_ratio": 0.49999}
    more = {"fibre_modulus": fibre_modulus} if law == "neo-hooke-fibres" else {"build_ratio": 5.0}
    body = Body(
        "tube",
        TetMesh(points, tets),
        np.flatnonzero(points[:, 2] < 1e-9),
        {**constants, **more},
        law=law,
        winding=Winding(np.deg2rad(angle)),
    )
    return Robot((body,), actuators=(NamedActuator("air", Chamber({"tube": wall}, medium="liquid")),))


def middle_stretches(robot: Robot) -> tuple[float, float, float]:
    """Of the inner surface around the axis, along it, and the twist [rad/m], at the middle of the tube."""
    response = simulate(robot, PUMPED, curve_tolerance=0.0, snapshots=True)
    assert response.succeeded, response.status
    X, x = robot.bodies[0].mesh.points, response.snapshots[-1].points["tube"]
    layer = LENGTH / LAYERS[2]
    above, middle, below = (np.abs(X[:, 2] - 0.5 * LENGTH - k * layer) < 1e-9 for k in (1, 0, -1))
    inner = middle & (np.hypot(X[:, 0], X[:, 1]) < 1.0001 * INNER)
    centre = x[inner, :2].mean(axis=0)
    turned = [
        np.angle(np.sum(((x[at, :2] - centre) @ [1, 1j]) * np.conj(X[at, :2] @ [1, 1j]))) for at in (above, below)
    ]
    around = np.linalg.norm(x[inner, :2] - centre, axis=1).mean() / INNER
    return around, (x[above, 2].mean() - x[below, 2].mean()) / (2.0 * layer), (turned[0] - turned[1]) / (2.0 * layer)


def closed_form(angle: float, fibre_modulus: float) -> Floats:
    """Stretches around and along the axis of a thick incompressible tube with closed ends, at its inner surface.

    sigma_tt - sigma_rr = s W_s and sigma_zz - sigma_rr = z W_z of W(s, z), over radii R of the undeformed tube:
    the pressure is int W_s / (z s R) dR, and int (2 z W_z - s W_s) R / z dR = 0 where only the cap pulls.
    """
    c, n = np.cos(np.deg2rad(angle)) ** 2, np.sin(np.deg2rad(angle)) ** 2

    def rates(R: float, inner: float, z: float) -> tuple[float, float, float]:
        s = np.sqrt((INNER * inner) ** 2 + (R**2 - INNER**2) / z) / R
        fibre = 0.5 * fibre_modulus * (1.0 - 1.0 / (c * z**2 + n * s**2))
        return s, MU * (s - s**-3 * z**-2) + n * s * fibre, MU * (z - z**-3 * s**-2) + c * z * fibre

    def missing(stretches: Floats) -> tuple[float, float]:
        inner, z = stretches

        def of_pressure(R: float) -> float:
            s, by_s, _ = rates(R, inner, z)
            return by_s / (z * s * R)

        def of_force(R: float) -> float:
            s, by_s, by_z = rates(R, inner, z)
            return (2.0 * z * by_z - s * by_s) * R / z

        found, force = (quad(of, INNER, OUTER, epsabs=1e-9)[0] for of in (of_pressure, of_force))
        return found / PRESSURE - 1.0, force / (PRESSURE * INNER**2)

    return np.asarray(fsolve(missing, (1.001, 1.001), xtol=1e-12))


@pytest.mark.slow
@pytest.mark.parametrize(("angle", "lengthens"), [(35.0, False), (75.0, True)])
def test_a_braided_tube_is_that_of_the_closed_form(angle: float, lengthens: bool):
    """Wound nearly along the axis it widens and shortens, as a muscle does; nearly around it, it lengthens instead."""
    around, along, twist = middle_stretches(tube(angle))
    np.testing.assert_allclose([around - 1.0, along - 1.0], closed_form(angle, FIBRES) - 1.0, rtol=1e-3)
    assert (along > 1.05, around < 1.04) == (lengthens, lengthens)
    assert lengthens or (along < 0.93 and around > 1.2)
    assert abs(twist) < 1e-3


def test_at_the_neutral_angle_stiff_fibres_let_a_tube_neither_widen_nor_lengthen():
    """At 54.7 deg a braid has its largest volume. Inextensible fibres would keep the tube as it is; these have 10 000
    times the modulus of the rest.
    """
    around, along, _ = middle_stretches(tube(NEUTRAL, fibre_modulus=3e9))
    np.testing.assert_allclose([around, along], closed_form(NEUTRAL, 3e9), atol=1e-4)
    np.testing.assert_allclose([around, along], 1.0, atol=2e-4)
    for apart in (-5.0, 5.0):
        assert abs(closed_form(NEUTRAL + apart, 3e9)[1] - 1.0) > 0.015


@pytest.mark.slow
def test_fibres_of_one_hand_twist_a_tube():
    right, left = (middle_stretches(tube(angle, law="neo-hooke-layered")) for angle in (45.0, -45.0))
    assert right[2] == pytest.approx(-left[2], rel=1e-2)
    assert abs(right[2]) * LENGTH > 0.05
    np.testing.assert_allclose(right[:2], left[:2], rtol=1e-3)


def test_the_axis_may_point_anywhere():
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
    X = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 3))
    upright = Winding(0.7, (0.1, 0.2, 0.0)).directions(X)
    turned = Winding(0.7, tuple(turn @ (0.1, 0.2, 0.0)), tuple(2.0 * turn[:, 2])).directions(X @ turn.T)
    np.testing.assert_allclose(turned, upright @ turn.T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(upright, axis=2), 1.0)
    np.testing.assert_allclose(upright[..., 2], np.cos(0.7))


@pytest.mark.long
def test_the_stiffness_of_the_fibres_has_its_derivative():
    def volumes(E_f: float, **options):
        return simulate(tube(70.0, fibre_modulus=E_f), PUMPED, curve_tolerance=0.0, **options)

    h = 1e-3 * FIBRES
    found = volumes(FIBRES, sensitivities=["tube.fibre_modulus"]).sensitivities["air.volume"]["tube.fibre_modulus"]
    plus, minus = (volumes(FIBRES + s * h).channels["air.volume"] for s in (1, -1))
    np.testing.assert_allclose(np.ravel(found), (plus - minus) / (2.0 * h), rtol=1e-4)


@pytest.mark.parametrize(
    ("law", "given", "says"),
    [
        ("neo-hooke-fibres", {}, "two directions; got none; allowed: winding"),
        ("neo-hooke-fibres", {"build_direction": (0.0, 0.0, 1.0)}, "two directions; got build_direction"),
        ("neo-hooke", {"winding": Winding(0.5)}, "no direction; got law neo-hooke; allowed: neo-hooke-layered, neo"),
        ("neo-hooke-layered", {"winding": Winding(0.5), "build_direction": (1.0, 0.0, 0.0)}, "specified twice"),
    ],
)
def test_directions_that_a_law_does_not_have_are_refused(law: str, given: dict, says: str):
    with pytest.raises(InputError, match=says):
        replace(tube(45.0).bodies[0], law=law, **{"winding": None, **given}, parameters=constants(LAWS[law]))


def test_material_on_the_axis_is_refused():
    with pytest.raises(InputError, match=r"winding: material is on the axis of its winding; got point 2 of 2"):
        Winding(0.5).directions(np.array([[0.1, 0.0, 0.0], [0.0, 0.0, 0.3]]))
