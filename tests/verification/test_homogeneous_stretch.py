"""Uniaxial, equibiaxial and pure-shear stretch of the neo-Hookean solid against the closed forms.

In principal stretches l_i the first Piola-Kirchhoff stress is P_i = mu (l_i - 1/l_i) + lambda ln J / l_i. The stretch
that no stress acts along follows from P_i = 0. A block is loaded by the tractions of the closed form, held at three
corners put where that form has them (which takes the rigid motions away and no more), and must take its shape, with no
reaction at the corners.
"""

import numpy as np
import pytest
from mechanics_cases import elastic, held, irregular_box, placed, solid_system
from scipy.optimize import brentq

from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.statics import Statics
from softcal.twin.build import build_twin
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Body, Robot, SurfaceLoad

E = 1.0e5


def principal_stress(stretch, i, nu):
    mu, lmbda = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    return mu * (stretch[i] - 1 / stretch[i]) + lmbda * np.log(np.prod(stretch)) / stretch[i]


def stretches(kind: str, along: float, nu: float) -> np.ndarray:
    shape = {
        "uniaxial": lambda free: np.array([along, free, free]),
        "equibiaxial": lambda free: np.array([along, along, free]),
        "pure shear": lambda free: np.array([along, 1.0, free]),
    }[kind]
    return shape(brentq(lambda free: principal_stress(shape(free), 2, nu), 0.05, 5.0, xtol=1e-15))


def dead_forces(mesh, stress):
    """Nodal forces of the tractions P N on all six sides."""
    loads = tuple(
        SurfaceLoad(f"on_{side}", "block", mesh.face_sets[side], stress * (1.0 if side[1] == "1" else -1.0) * axis)
        for axis, name in zip(np.eye(3), "xyz", strict=True)
        for side in (f"{name}0", f"{name}1")
    )
    block = Body("block", mesh, fixed=np.array([0]), parameters=elastic(), element="P1" if mesh.order == 1 else "P2")
    robot = Robot((block,), loads=loads)
    return build_twin(robot).system.loads.total(parameter_values(robot))[: mesh.n_points]


@pytest.mark.parametrize("element", ELEMENTS)
@pytest.mark.parametrize("nu", [0.3, 0.45])
@pytest.mark.parametrize(
    ("kind", "along"),
    [("uniaxial", 1.5), ("uniaxial", 0.7), ("equibiaxial", 1.2), ("equibiaxial", 0.8), ("pure shear", 1.4)],
)
def test_block_takes_the_shape_of_the_closed_form(kind, along, nu, element):
    stretch = stretches(kind, along, nu)
    stress = np.array([principal_stress(stretch, i, nu) for i in range(3)])
    mesh = irregular_box((0.02, 0.03, 0.025), (2, 2, 2), element)
    corners = np.array([np.argmin(np.linalg.norm(mesh.points - at, axis=1)) for at in np.diag([0.02, 0.03, 0.0])])
    system = solid_system(mesh, element, NEO_HOOKE, corners, dead_forces(mesh, stress))
    exact = mesh.points * stretch
    guess = exact.copy()
    free = system.layout.free_points
    guess[free] += np.random.default_rng(0).uniform(-1e-4, 1e-4, (len(free), 3))
    theta = {"body.youngs_modulus": E, "body.poissons_ratio": nu}
    start = placed(system, guess)
    start.pressure[:] = NEO_HOOKE.bulk_modulus(elastic(E, nu)) * np.log(np.prod(stretch))

    found = Statics(system, theta).equilibrium(start, held())

    assert found.converged, found.status
    np.testing.assert_allclose(found.state.x, exact, rtol=0, atol=1e-6 * 0.03)
    reactions = system.linearise(found.state, held(), theta, tangent=False).full[: 3 * mesh.n_points]
    assert np.abs(reactions).max() < 1e-6 * np.abs(stress).max() * 0.03**2


def test_uniaxial_stretch_is_sofas():
    """SOFA's NeoHookean at 40 kPa: stretches 1.53633790 along and 0.87323692 across."""
    stretch = stretches("uniaxial", 1.53633790, 0.3)
    assert stretch[1] == pytest.approx(0.87323692, abs=2e-8)
    assert principal_stress(stretch, 0, 0.3) == pytest.approx(40e3, rel=2e-8)


@pytest.mark.parametrize(
    ("kind", "stress"),
    [
        ("uniaxial", lambda a: a - a**-2),
        ("equibiaxial", lambda a: a - a**-5),
        ("pure shear", lambda a: a - a**-3),
    ],
)
def test_near_incompressibility_the_textbook_stress_is_met(kind, stress):
    """P = mu (l - l^-2), mu (l - l^-5), mu (l - l^-3) for an incompressible solid; P2P1 at nu = 0.49999."""
    nu, along = 0.49999, 1.3
    mu = E / (2 * (1 + nu))
    stretch = stretches(kind, along, nu)
    mesh = irregular_box((1.0, 1.0, 1.0), (1, 1, 1), "P2P1")
    theta = {"body.youngs_modulus": E, "body.poissons_ratio": nu}
    corner = np.flatnonzero((mesh.points == [0, 0, 0]).all(axis=1))
    system = solid_system(mesh, "P2P1", NEO_HOOKE, corner)
    state = placed(system, mesh.points * stretch)
    state.pressure[:] = NEO_HOOKE.bulk_modulus(elastic(E, nu)) * np.log(np.prod(stretch))
    forces = system.linearise(state, held(), theta, tangent=False).full[: 3 * mesh.n_points].reshape(-1, 3)
    pull = forces[mesh.node_sets["x1"], 0].sum()
    assert pull == pytest.approx(mu * stress(along), rel=1e-3)
    assert abs(forces[mesh.node_sets["z1"], 2].sum()) < 1e-8 * pull
