"""Energy, gradient and tangent belong together: Taylor remainders of order two and three, a symmetric Jacobian."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import (
    body_theta,
    column_robot,
    constants,
    elastic,
    full_matrix,
    held,
    irregular_box,
    placed,
    potential,
    side_cable,
    solid_system,
    twin_and_theta,
)

from softcal.geometry.mesh import TetMesh
from softcal.materials.catalogue import LAWS
from softcal.materials.law import compile_law
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.materials.stress_at import points, whole_energy
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.term import Controls
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint

STEPS = 2.0 ** -np.arange(5, 10)


def orders(remainders: np.ndarray) -> np.ndarray:
    return np.log2(np.abs(remainders[:-1]) / np.abs(remainders[1:]))


# One element, any F.

deformation = st.lists(st.floats(-0.35, 0.35), min_size=9, max_size=9).map(
    lambda values: np.eye(3) + np.reshape(values, (3, 3))
)
direction = st.lists(st.integers(-4, 4), min_size=9, max_size=9).map(lambda values: np.reshape(values, (3, 3)) / 8.0)
TET = TetMesh(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float), np.array([[0, 1, 2, 3]]))


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@settings(max_examples=25, deadline=None)
@given(deformation, direction)
def test_stress_and_tangent_are_derivatives_of_the_energy(law, F, H):
    if np.linalg.det(F) < 0.3 or np.linalg.norm(H) == 0.0:
        return
    system = solid_system(TET, "P1", law, np.array([0]))
    theta = body_theta(constants(law, 1.0, 0.4))
    state, dz = placed(system, TET.points @ F.T), (TET.points @ H.T)[1:].ravel()
    at = system.linearise(state, held(), theta)
    slope, curvature = at.reduced @ dz, dz @ full_matrix(system, at) @ dz
    volume = 1.0 / 6.0
    h = 1e-3 / np.linalg.norm(H)
    plus, zero, minus = (potential(system, moved(system.layout, state, s * h * dz), held(), theta) for s in (1, 0, -1))
    scale = volume * np.linalg.norm(H) ** 2 / np.linalg.det(F) ** 2
    assert (plus - minus) / (2 * h) == pytest.approx(slope, rel=1e-4, abs=1e-4 * scale / np.linalg.norm(H))
    assert (plus - 2 * zero + minus) / h**2 == pytest.approx(curvature, rel=1e-3, abs=1e-3 * scale)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@settings(max_examples=25, deadline=None)
@given(deformation)
def test_stress_is_the_closed_form_of_the_law(law, F):
    """The first Piola-Kirchhoff stress by central differences of psi(F) itself, without shape functions."""
    if np.linalg.det(F) < 0.3:
        return
    compiled, values = compile_law(law), tuple(constants(law, 1.0, 0.4).values())
    system = solid_system(TET, "P1", law, np.array([0]))
    (solid,) = system.of(SolidTerm)

    def psi(F):
        return float(whole_energy(compiled, points(F[None], solid.directions), values)[0])

    P = np.zeros((3, 3))
    for i, j in np.ndindex(3, 3):
        dF = np.zeros((3, 3))
        dF[i, j] = 1e-5
        P[i, j] = (psi(F + dF) - psi(F - dF)) / 2e-5
    at = system.linearise(placed(system, TET.points @ F.T), held(), body_theta(constants(law, 1.0, 0.4)), tangent=False)
    forces = at.full.reshape(-1, 3)[1:]  # P N_a V, and N_a is the a-th unit vector
    np.testing.assert_allclose(6.0 * forces.T, P, atol=1e-7 * max(np.abs(P).max(), 1.0))


# Whole robots: plates turned far, cables through bodies, pressures, dead loads.


def a_robot(element: str, law: str, nu: float):
    through = Cable(
        "through",
        (
            ViaPoint(np.array([0.005, 0.002, 0.1]), "plate"),
            ViaPoint(np.array([0.006, 0.003, 0.07]), "neck"),
            ViaPoint(np.array([0.004, -0.004, 0.031]), "neck"),
            ViaPoint(np.array([0.005, 0.0, -0.02])),
        ),
    )
    return column_robot(
        element,
        parameters=constants(LAWS[law], 1.0, nu),
        divisions=(1, 1, 3),
        gravity=(0.1, -0.2, -9.81),
        density=3.0,
        mass=2e-4,
        cables=(side_cable("front", (0.05, 0.0)), through),
        law=law,
    )


def far_state(system, theta):
    """A large deformation: bent into an arc of 0.9 rad and roughened, pressures and tensions on."""
    layout = system.layout
    rng = np.random.default_rng(3)
    X = layout.X[layout.free_points]
    radius = 0.1 / 0.9
    phi = X[:, 2] / radius
    bent = np.column_stack([radius - (radius - X[:, 0]) * np.cos(phi), X[:, 1], (radius - X[:, 0]) * np.sin(phi)])
    dz = np.zeros(layout.n_unknowns)
    dz[: layout.first_frame_unknown] = (bent - X + rng.uniform(-4e-4, 4e-4, X.shape)).ravel()
    top = [radius * (1.0 - np.cos(0.9)), 1e-3, radius * np.sin(0.9) - 0.1]
    dz[layout.first_frame_unknown : layout.first_pressure_unknown] = [*top, 0.05, 0.9, -0.05]
    dz[layout.first_pressure_unknown : layout.first_effort_unknown] = rng.uniform(-0.5, 0.5, layout.n_pressures)
    dz[layout.first_effort_unknown :] = [1e-4, 3e-4]
    return moved(layout, rest_state(layout), dz)


def smallest_J(system, state):
    return min(solid.kinematics(state)[3].min() for solid in system.of(SolidTerm))


def rough_direction(system, seed):
    layout = system.layout
    rng = np.random.default_rng(seed)
    d = rng.uniform(-1e-3, 1e-3, layout.n_unknowns)
    d[layout.first_frame_unknown + 3 : layout.first_pressure_unknown] = rng.uniform(-0.2, 0.2, 3)
    d[layout.first_pressure_unknown :] = rng.uniform(-0.5, 0.5, layout.n_pressures + layout.n_actuators)
    d[layout.first_effort_unknown :] *= 1e-3
    return d


CASES = [
    *[(e, "neo-hooke", nu) for e in ELEMENTS for nu in (0.42, 0.0, -0.3)],
    *[(e, "mooney-rivlin", 0.42) for e in ("P1", "P2P1")],
]


@pytest.mark.parametrize(("element", "law", "nu"), CASES)
def test_gradient_and_tangent_of_a_robot_by_taylor(element, law, nu):
    twin, theta = twin_and_theta(a_robot(element, law, nu))
    system = twin.system
    controls = Controls(np.zeros(2, dtype=bool), np.zeros(2), np.array([0.01, 0.002]))
    state = far_state(system, theta)
    at = system.linearise(state, controls, theta)
    assert smallest_J(system, state) > 0.1
    K = full_matrix(system, at)
    for seed in range(3):
        d = rough_direction(system, seed)
        energies = np.array(
            [potential(system, moved(system.layout, state, h * d), controls, theta) for h in [0.0, *STEPS]]
        )
        first = energies[1:] - energies[0] - STEPS * (at.reduced @ d)
        second = first - 0.5 * STEPS**2 * (d @ K @ d)
        assert orders(first)[-1] == pytest.approx(2.0, abs=0.15)
        assert orders(second)[-1] == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize(("element", "law", "nu"), CASES)
def test_jacobian_of_the_gradient_is_symmetric_and_is_the_tangent(element, law, nu):
    """Differences of the gradient give the tangent. Between two turns of a plate they also give half the moment that
    is out of balance, skew-symmetric as the turns do not commute; nothing else may be skew."""
    twin, theta = twin_and_theta(a_robot(element, law, nu))
    system, layout = twin.system, twin.system.layout
    controls = Controls(np.array([False, True]), np.array([0.0, 2e-4]), np.array([0.01, 0.0]))
    state = far_state(system, theta)
    state.effort[1] = 2e-4
    at = system.linearise(state, controls, theta)
    K = full_matrix(system, at)
    unit = np.full(layout.n_unknowns, 1e-3)
    unit[layout.first_frame_unknown + 3 : layout.first_pressure_unknown] = 0.1
    unit[layout.first_pressure_unknown :] = 1.0
    n = layout.n_unknowns - 1  # without the tension that is given
    jacobian = np.zeros((n, n))
    for j in range(n):
        dz = np.zeros(layout.n_unknowns)
        dz[j] = 1e-4 * unit[j]
        ends = [system.linearise(moved(layout, state, s * dz), controls, theta, tangent=False).reduced for s in (1, -1)]
        jacobian[:, j] = (ends[0] - ends[1])[:n] / 2e-4 * unit[:n]
    K = (unit[:, None] * K * unit)[:n, :n]
    scale = np.abs(K).max()
    np.testing.assert_allclose(0.5 * (jacobian + jacobian.T), K, rtol=0, atol=1e-6 * scale)
    skew = 0.5 * (jacobian - jacobian.T)
    turn = slice(layout.first_frame_unknown + 3, layout.first_frame_unknown + 6)
    m = at.reduced[turn]
    expected = 0.5 * 0.1**2 * np.array([[0, m[2], -m[1]], [-m[2], 0, m[0]], [m[1], -m[0], 0]])
    np.testing.assert_allclose(np.abs(skew[turn, turn]), np.abs(expected), rtol=0, atol=1e-6 * scale)
    skew[turn, turn] = 0.0
    assert np.abs(skew).max() < 1e-6 * scale
    assert np.abs(expected).max() > 1e-5 * scale  # the exception is a real one


def test_general_tangent_equals_the_short_one():
    """By stress and tangent, on a law that also has the short form."""
    mesh = irregular_box((1.0, 1.0, 1.0), (1, 1, 1), "P2")
    system = solid_system(mesh, "P2", NEO_HOOKE, np.array([0]))
    x = mesh.points @ np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.2], [0.1, 0.0, 1.1]]).T
    theta = body_theta(elastic(1.0, 0.4))
    data = []
    for simple in (True, False):
        (solid,) = system.of(SolidTerm)
        object.__setattr__(solid, "compiled", type(solid.compiled)(**{**vars(solid.compiled), "is_simple": simple}))
        data.append(system.linearise(placed(system, x), held(), theta).data)
    np.testing.assert_allclose(data[1], data[0], rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("element", ELEMENTS)
def test_tangent_of_a_body_between_two_plates(element):
    """Elements whose nodes ride on two different plates, a cable from one to the other."""
    mesh = irregular_box((0.03, 0.03, 0.04), (1, 1, 1), element)
    body = Body("neck", mesh, fixed=np.zeros(0, dtype=int), parameters=elastic(1.0, 0.42), element=element)
    plates = tuple(
        Plate(name, {"neck": mesh.node_sets[side]}, reference=np.array([0.01, 0.0, z]), mass=1e-4)
        for name, side, z in (("foot", "z0", -0.01), ("head", "z1", 0.05))
    )
    cable = Cable("front", (ViaPoint(np.array([0.05, 0.01, 0.0]), "foot"), ViaPoint(np.array([0.05, 0, 0.05]), "head")))
    twin, theta = twin_and_theta(Robot((body,), plates, (cable,), gravity=np.array([0.5, 0.0, -9.81])))
    system = twin.system
    controls = Controls(np.zeros(1, dtype=bool), np.zeros(1), np.array([0.004]))
    start = np.zeros(system.layout.n_unknowns)
    plate_z = start[system.layout.first_frame_unknown : system.layout.first_pressure_unknown]
    plate_z[:] = [0.001, 0, 0.002, 0.2, -0.3, 0.1, -0.001, 0.001, 0.003, -0.1, 0.3, 0.2]
    start[system.layout.first_pressure_unknown :] = 1e-3
    state = moved(system.layout, rest_state(system.layout), start)
    at = system.linearise(state, controls, theta)
    assert smallest_J(system, state) > 0.1
    K = full_matrix(system, at)
    rng = np.random.default_rng(0)
    for _ in range(3):
        d = rng.uniform(-1e-3, 1e-3, system.layout.n_unknowns)
        turns = d[system.layout.first_frame_unknown : system.layout.first_pressure_unknown].reshape(2, 6)[:, 3:]
        turns[:] = rng.uniform(-0.1, 0.1, (2, 3))
        energies = np.array(
            [potential(system, moved(system.layout, state, h * d), controls, theta) for h in [0.0, *STEPS]]
        )
        first = energies[1:] - energies[0] - STEPS * (at.reduced @ d)
        assert orders(first)[-1] == pytest.approx(2.0, abs=0.15)
        assert orders(first - 0.5 * STEPS**2 * (d @ K @ d))[-1] == pytest.approx(3.0, abs=0.3)
