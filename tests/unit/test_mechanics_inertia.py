"""Mass of elements, plates and rods: totals, moments, and the derivative of what they make of accelerations."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import body_theta, column_robot, constants, elastic, held, irregular_box

from softcal.errors import InputError
from softcal.geometry.cell import LINEAR
from softcal.geometry.centreline import straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.section import RectangularBar
from softcal.materials.catalogue import LAWS
from softcal.materials.law import Law
from softcal.mechanics.damping import Damping, TimeStep
from softcal.mechanics.dynamics import efforts_within
from softcal.mechanics.elements import P1
from softcal.mechanics.inertia import Rates, element_masses, second_moments
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.solid_build import build_solid
from softcal.mechanics.state import exponential, moved, rest_state
from softcal.mechanics.term import Given, Sum, Term
from softcal.mechanics.time_step import Instant, after, at_rest, in_step
from softcal.twin.build import build_twin
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.robot import Body, Disc, Plate, Robot, Rod, Tie

LENGTHS = (0.03, 0.02, 0.05)


def test_mass_of_a_linear_tet_is_the_textbooks():
    mesh = TetMesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]]))
    np.testing.assert_allclose(element_masses(mesh)[0], (1.0 + np.eye(4)) / 120.0, rtol=1e-13)
    np.testing.assert_allclose(element_masses(mesh, lumped=True)[0], np.eye(4) / 24.0, rtol=1e-13)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_consistent_mass_has_the_moments_of_the_box(element):
    mesh = irregular_box(LENGTHS, (2, 2, 3), element)
    X = mesh.points[mesh.tets]
    M = element_masses(mesh)
    volume = np.prod(LENGTHS)
    assert M.sum() == pytest.approx(volume, rel=1e-12)
    second = np.einsum("eab,eai,ebj->ij", M, X, X)
    exact = volume * (np.outer(LENGTHS, LENGTHS) / 4.0 + np.diag(np.square(LENGTHS)) / 12.0)
    np.testing.assert_allclose(second, exact, rtol=1e-11)


def test_consistent_mass_of_a_bent_tet_integrates_its_volume():
    mesh = to_quadratic(TetMesh(np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3]])))
    points = mesh.points.copy()
    points[mesh.tets[0, 4]] += [0.0, -0.1, -0.05]
    bent = TetMesh(points, mesh.tets)
    M = element_masses(bent)[0]
    assert M.sum() > 1.02 / 6.0
    # by parts: the volume is a third of the sum of what its gradient weighs, here by differences
    step, volumes = 1e-6, []
    for sign in (1.0, -1.0):
        scaled = TetMesh(points * (1.0 + sign * step), mesh.tets)
        volumes.append(element_masses(scaled).sum())
    assert (volumes[0] - volumes[1]) / (2.0 * step) == pytest.approx(3.0 * M.sum(), rel=1e-8)


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_lumped_mass_is_positive_and_whole(element):
    mesh = irregular_box(LENGTHS, (2, 1, 2), element)
    M = element_masses(mesh, lumped=True)
    assert M.sum() == pytest.approx(np.prod(LENGTHS), rel=1e-12)
    assert np.einsum("eaa->ea", M).min() > 0.0
    assert np.count_nonzero(M) == M.shape[0] * M.shape[1]


def test_a_rod_weighs_its_length_and_turns_with_its_section():
    """Rigid discs at both ends keep the rod's end nodes; all of its mass is on frames."""
    bar, density, length = RectangularBar(0.004, 0.002), 1200.0, 0.1
    section = bar.constants
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, length), at=np.linspace(0.0, 1.0, 6), first=(1.0, 0.0, 0.0))
    plates = (Plate("a", {}, np.zeros(3)), Plate("b", {}, np.array([0.0, 0.0, length])))
    ends = {"a": np.array([0]), "b": np.array([5])}
    robot = Robot(plates=plates, rods=(Rod("rod", line, bar, elastic(), ends, density=density),))
    twin = build_twin(robot)
    carried = robot_inertia(twin, robot).carried
    assert carried.mass.sum() == pytest.approx(density * section.area * length)
    S = carried.second.sum(axis=0)
    np.testing.assert_allclose(S, density * length * np.diag([section.I2, section.I1, 0.0]), atol=1e-18)


def test_a_plate_has_the_inertia_of_its_disc_or_the_one_given():
    disc = Disc(diameter=0.08, thickness=0.006, centre=np.zeros(3))
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), at=np.linspace(0.0, 1.0, 3))
    rod = Rod("rod", line, RectangularBar(0.004, 0.002), elastic(), {"disc": np.array([2])}, fixed=np.array([0]))
    plate = Plate("disc", {}, np.array([0.0, 0.0, 0.1]), mass=0.03, disc=disc)

    def tensor(given: Plate) -> np.ndarray:
        robot = Robot(plates=(given,), rods=(rod,))
        twin = build_twin(robot)
        S = robot_inertia(twin, robot).carried.second[twin.frame["disc"]]
        return np.trace(S) * np.eye(3) - S

    across, along = 0.03 * (3 * 0.04**2 + 0.006**2) / 12.0, 0.03 * 0.04**2 / 2.0
    np.testing.assert_allclose(tensor(plate), np.diag([across, across, along]), rtol=1e-12, atol=1e-20)
    own = np.diag([3e-6, 4e-6, 5e-6])
    np.testing.assert_allclose(tensor(replace(plate, inertia=own)), own, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(tensor(replace(plate, disc=None)), 0.0, atol=1e-20)
    # off its reference point: Steiner's theorem
    off = replace(plate, inertia=own, centre_of_mass=np.array([0.01, 0.0, 0.1]))
    np.testing.assert_allclose(tensor(off), own + 0.03 * 1e-4 * np.diag([0.0, 1.0, 1.0]), rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("bad", [np.diag([1.0, 1.0, 3.0]), np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]])])
def test_an_inertia_that_no_body_has_is_refused(bad):
    with pytest.raises(InputError, match=r"lid\.inertia: no rigid body has this inertia"):
        Plate("lid", {}, np.zeros(3), inertia=bad)


def test_tets_on_one_plate_move_as_one_rigid_body():
    """A column whose upper half is a plate: the plate has that half's inertia, the rest is on the points."""
    mesh = box_mesh((0.03, 0.03, 0.1), (2, 2, 4))
    upper = np.flatnonzero(mesh.points[:, 2] >= 0.05 - 1e-9)
    body = Body("neck", mesh, fixed=mesh.node_sets["z0"], parameters=elastic(), element="P1", density=1000.0)
    robot = Robot((body,), (Plate("plate", {"neck": upper}, np.array([0.0, 0.0, 0.1])),))
    twin = build_twin(robot)
    inertia = robot_inertia(twin, robot)
    half = 1000.0 * 0.03 * 0.03 * 0.05
    assert inertia.carried.mass[0] == pytest.approx(half)
    np.testing.assert_allclose(inertia.carried.first[0], half * np.array([0.015, 0.015, -0.025]), rtol=1e-12)
    exact = half * (np.diag([0.03**2, 0.03**2, 0.05**2]) / 12.0)
    centre = np.array([0.015, 0.015, -0.025])
    np.testing.assert_allclose(inertia.carried.second[0], exact + half * np.outer(centre, centre), rtol=1e-12)
    assert inertia.matrix.sum() == pytest.approx(half)


def moving_robots() -> dict[str, Robot]:
    column = column_robot("P1", density=1200.0, mass=0.05, cables=())
    plate = replace(column.plates[0], inertia=np.diag([4e-5, 5e-5, 6e-5]))
    line = straight((0.0, 0.0, 0.1), (0.0, 0.05, 0.16), at=np.linspace(0.0, 1.0, 4))
    rod = Rod("whip", line, RectangularBar(0.004, 0.002), elastic(1e8), {"plate": np.array([0])}, density=1e4)
    low = box_mesh((0.03, 0.03, 0.05), (2, 2, 3))
    high = box_mesh((0.03, 0.03, 0.04), (3, 3, 2), origin=(0.0, 0.0, 0.05))
    bodies = (
        Body("low", low, fixed=low.node_sets["z0"], parameters=elastic(), element="P1", density=1000.0),
        Body("high", high, fixed=[], parameters=elastic(), element="P1", density=2000.0),
    )
    tie = Tie("glue", "high", high.node_sets["z0"], "low")
    return {
        "plate and rod": replace(column, plates=(plate,), rods=(rod,)),
        "P2P1": column_robot("P2P1", density=1200.0, mass=0.05, cables=(), divisions=(1, 1, 2)),
        "tied": Robot(bodies, ties=(tie,)),
    }


@pytest.mark.parametrize("kind", ["strain", "tangent"])
@pytest.mark.parametrize("name", ["plate and rod", "P2P1", "tied"])
def test_tangent_of_a_step_is_the_derivative_of_its_forces(name, kind):
    import scipy.sparse as sp

    robot = moving_robots()[name]
    twin = build_twin(robot)
    theta = parameter_values(robot)
    system, layout = twin.system, twin.system.layout
    n = layout.first_effort_unknown
    random = np.random.default_rng(3)
    scale = np.full(n, 1e-3)
    scale[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)[:, 3:] = 0.1
    scale[layout.first_pressure_unknown :] = 1e3

    before = moved(layout, rest_state(layout), 0.3 * scale * random.standard_normal(n))
    start = after(at_rest(rest_state(layout)), before, 0.004)
    step = in_step(system, robot_inertia(twin, robot), Damping(0.03, 2.0, kind), 0.005, start, theta)
    state = moved(layout, before, scale * random.standard_normal(n))
    at = step.linearise(state, held(), theta)
    assert at.is_admissible
    upper = sp.csr_matrix((at.data, system.pattern.indices, system.pattern.indptr), shape=(n, n)).toarray()
    K = upper + np.triu(upper, 1).T

    dz = scale * random.standard_normal(n)
    plus = step.linearise(moved(layout, state, 1e-5 * dz), held(), theta, tangent=False).reduced
    minus = step.linearise(moved(layout, state, -1e-5 * dz), held(), theta, tangent=False).reduced
    expected = K @ dz
    # The moment on a frame, seen from space, turns with it: half of that is no second derivative.
    frames = slice(layout.first_frame_unknown, layout.first_pressure_unknown)
    moment, spin = at.reduced[frames].reshape(-1, 6)[:, 3:], dz[frames].reshape(-1, 6)[:, 3:]
    expected[frames].reshape(-1, 6)[:, 3:] += 0.5 * np.cross(spin, moment)
    error = ((plus - minus) / 2e-5 - expected) * scale
    assert np.abs(error).max() < 1e-7 * np.abs(expected * scale).max()


def test_momentum_of_a_spinning_robot_is_that_of_its_particles():
    robot = moving_robots()["plate and rod"]
    twin = build_twin(robot)
    layout, inertia = twin.system.layout, robot_inertia(twin, robot)
    rest = rest_state(layout)
    omega, v = np.array([0.3, -0.2, 0.5]), np.array([0.1, 0.0, -0.4])
    turning = np.cross(omega, np.swapaxes(exponential(np.zeros((layout.n_frames, 3))), 1, 2)).swapaxes(1, 2)
    velocities = Rates(v + np.cross(omega, rest.x), v + np.cross(omega, rest.position), turning)
    got = inertia.momentum(rest, velocities)

    column = 1200.0 * 0.03 * 0.03 * 0.1
    line = 1e4 * 0.004 * 0.002 * np.linalg.norm([0.05, 0.06])
    nodes = np.linspace([0.0, 0.0, 0.1], [0.0, 0.05, 0.16], 4)
    lumps = line * np.array([1, 2, 2, 1]) / 6.0
    parts = [(column, np.array([0.0, 0.0, 0.05])), (0.05, np.array([0.0, 0.0, 0.12])), *zip(lumps, nodes, strict=True)]
    linear = sum(m * (v + np.cross(omega, x)) for m, x in parts)
    np.testing.assert_allclose(got.linear, linear, rtol=1e-11)
    own = second_moments(np.zeros((3, 3))) + column * np.diag([0.03**2, 0.03**2, 0.1**2]) / 12.0
    own += second_moments(np.diag([4e-5, 5e-5, 6e-5]))
    axes = robot.rods[0].centreline.triads[0]
    section = robot.rods[0].section.constants
    own += 1e4 * np.linalg.norm([0.05, 0.06]) * axes @ np.diag([section.I2, section.I1, 0.0]) @ axes.T
    angular = sum(np.cross(x, m * (v + np.cross(omega, x))) for m, x in parts)
    angular = angular + (np.trace(own) * np.eye(3) - own) @ omega
    np.testing.assert_allclose(got.angular, angular, rtol=1e-11, atol=1e-15)
    energy = 0.5 * sum(m * np.sum((v + np.cross(omega, x)) ** 2) for m, x in parts)
    energy += 0.5 * omega @ (np.trace(own) * np.eye(3) - own) @ omega
    assert got.kinetic_energy == pytest.approx(energy, rel=1e-11)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
def test_viscosity_has_the_moduli_of_the_undeformed_body(law):
    if law.is_directed:
        pytest.skip("its moduli depend on the direction")
    E, nu = 2.0e6, 0.37
    lame, shear = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), 0.5 * E / (1.0 + nu)
    mesh = box_mesh((1.0, 1.0, 1.0), (1, 1, 1))
    for element, bulk in ((P1, lame + 2.0 * shear / 3.0), (replace(P1, pressure=LINEAR), None)):
        solid, _ = build_solid("body", law, element, mesh.points, mesh.tets, first_point=0)
        lmbda, mu = solid.rest_moduli(body_theta(constants(law, E, nu)))
        assert mu == pytest.approx(shear, rel=1e-12)
        if bulk is not None:
            assert lmbda + 2.0 * mu / 3.0 == pytest.approx(bulk, rel=1e-12)
        else:
            assert lmbda + 2.0 * mu / 3.0 == pytest.approx(bulk_of(law, lame, shear), abs=1e-9 * shear)


def bulk_of(law: Law, lame: float, shear: float) -> float:
    """What psi_d alone has against a change of volume: the whole bulk modulus less kappa."""
    return lame + 2.0 * shear / 3.0 - law.bulk_modulus(constants(law, 2.0e6, 0.37))


def test_viscosity_of_a_small_motion_is_rayleighs():
    """About the undeformed body, r_s / h times what its stiffness makes of the step; nothing of a rotation."""
    robot = column_robot("P1", cables=(), divisions=(1, 1, 2))
    twin = build_twin(robot)
    layout, (solid,) = twin.system.layout, twin.system.of(SolidTerm)
    theta = parameter_values(robot)
    rest = rest_state(layout)
    begun = Given(rest, held(), theta, solid.kinematics(rest))
    _, viscous = solid.in_step(begun, TimeStep(layout, 0.1, Damping(stiffness=0.3)))

    def force(x: np.ndarray, of: Term = viscous) -> np.ndarray:
        state, total = replace(rest, x=x), Sum(layout)
        of.add(total, Given(state, held(), theta, of.kinematics(state)))
        return total.gradient

    u = 1e-7 * np.random.default_rng(0).standard_normal(rest.x.shape)
    elastic_force = force(rest.x + u, solid)
    np.testing.assert_allclose(force(rest.x + u), 3.0 * elastic_force, atol=1e-4 * np.abs(elastic_force).max())
    turned = rest.x @ exponential(np.array([[0.5, -1.0, 0.3]]))[0].T + [0.1, 0.2, 0.3]
    assert np.abs(force(turned)).max() < 1e-9 * np.abs(force(1.1 * rest.x)).max()


def test_cables_of_given_lengths_pull_or_are_slack():
    C = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.2], [0.0, 0.2, 3.0]])
    np.testing.assert_allclose(efforts_within(np.zeros(3), np.full(3, np.inf), C, C @ [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0])
    T = efforts_within(np.zeros(3), np.full(3, np.inf), C, np.array([1.0, 0.1, -2.0]))
    left = C @ T - np.array([1.0, 0.1, -2.0])
    assert T[0] > 0.0
    assert T[1] == 0.0
    assert T[2] == 0.0
    assert left.min() > -1e-12


def test_an_instant_keeps_its_parts():
    rest = rest_state(build_twin(column_robot()).system.layout)
    assert isinstance(at_rest(rest, 2.0), Instant)
    assert at_rest(rest, 2.0).time == 2.0
