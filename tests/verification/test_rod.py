"""The rod's element: energy, gradient and tangent belong together, and it keeps still in rigid motions."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rod_cases import Pose, assembled, at_rest, modulus, on_own_frames, solved
from scipy.spatial.transform import Rotation

from softcal.geometry.centreline import Centreline, helix, polyline, straight
from softcal.geometry.section import RectangularBar
from softcal.mechanics.rod import RodTerm, build_rod

THETA = modulus(2.0, 0.3)
SECTION = RectangularBar(0.3, 0.5)
LINES = {
    "straight": straight((0, 0, 0), (1, 2, 3), 5),
    "helix": helix((0, 0, 0), (0, 0, 1), diameter=2.0, pitch=0.7, turns=0.8, at=5),
    "polyline": polyline([(0, 0, 0), (1, 0, 0), (2, 0.5, 0), (3, 0.5, 1), (3, 1, 2)]),
}
# How far frames are from rest: a hair, where series serve, and up to angles near half a turn between neighbours.
AMPLITUDES = [1e-3, 0.3, 1.0]


def with_arms(line: Centreline) -> tuple[RodTerm, np.ndarray]:
    """A rod whose frames' reference points are beside it; its second and third nodes may share a frame."""
    references = line.nodes + 0.3 * np.random.default_rng(1).normal(size=line.nodes.shape)
    return build_rod("rod", SECTION, line, np.arange(len(line.nodes)), references), references


def displaced(references: np.ndarray, amplitude: float, seed: int = 2) -> Pose:
    rng = np.random.default_rng(seed)
    dz = amplitude * rng.uniform(-1.0, 1.0, (len(references), 6))
    return at_rest(references).moved(dz.ravel())


def orders(remainders: np.ndarray) -> np.ndarray:
    return np.log2(np.abs(remainders[:-1]) / np.abs(remainders[1:]))


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_gradient_and_tangent_are_derivatives_of_the_energy(line, amplitude):
    rod, references = with_arms(line)
    pose = displaced(references, amplitude)
    E, g, K = assembled(rod, pose, THETA)
    d = np.random.default_rng(3).normal(size=g.size)
    steps = 2.0 ** -np.arange(6, 10)
    change = np.array([rod.assemble(*_poses(pose.moved(h * d)), THETA).energy for h in steps]) - E
    assert orders(change - steps * (g @ d)) == pytest.approx(2.0, abs=0.1)
    assert orders(change - steps * (g @ d) - 0.5 * steps**2 * (d @ K @ d)) == pytest.approx(3.0, abs=0.1)


def _poses(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    return pose.c, pose.R


@pytest.mark.parametrize("amplitude", AMPLITUDES)
def test_tangent_is_symmetric_and_each_entry_a_second_derivative(amplitude):
    """Every entry by differences of the energy, which a few directions could miss."""
    rod, references = with_arms(LINES["helix"])
    pose = displaced(references, amplitude)
    tangent = rod.assemble(pose.c, pose.R, THETA).tangent
    assert tangent is not None
    assert np.abs(tangent - tangent.swapaxes(1, 2)).max() < 1e-14 * np.abs(tangent).max()
    one = build_rod(
        "rod", SECTION, Centreline(LINES["helix"].nodes[:2], LINES["helix"].triads[:2], LINES["helix"].lengths[:1]),
        [0, 1], references[:2],
    )  # fmt: skip
    pair, h = Pose(pose.c[:2], pose.R[:2]), 1e-3
    e = h * np.eye(12)

    def energy(dz):
        return one.assemble(*_poses(pair.moved(dz)), THETA).energy

    for i in range(12):
        for j in range(i, 12):
            mixed = energy(e[i] + e[j]) - energy(e[i] - e[j]) - energy(e[j] - e[i]) + energy(-e[i] - e[j])
            assert mixed / (4 * h * h) == pytest.approx(tangent[0, i, j], abs=3e-6 * np.abs(tangent[0]).max())


@pytest.mark.parametrize("name", ["youngs_modulus", "poissons_ratio"])
def test_gradient_by_parameters(name):
    rod, references = with_arms(LINES["helix"])
    pose, h = displaced(references, 0.5), 1e-4
    plus, minus = (rod.assemble(pose.c, pose.R, {**THETA, name: THETA[name] + s * h}).gradient for s in (1, -1))
    law = rod._law(rod._coordinates(pose.c, pose.R)[0], THETA)
    expected = rod._gradient(pose.c, pose.R, rod.volumes[:, None] * law.by_constant(name)[1])
    assert (plus - minus) / (2 * h) == pytest.approx(expected, abs=1e-7 * np.abs(expected).max())


# Rigid motions.

vector = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3).map(np.array)


@settings(max_examples=30, deadline=None)
@given(vector, vector, st.sampled_from(sorted(LINES)), st.sampled_from(AMPLITUDES))
def test_rigid_motion_changes_nothing(shift, turn, line, amplitude):
    rod, references = with_arms(LINES[line])
    pose = displaced(references, amplitude)
    Q = Rotation.from_rotvec(turn).as_matrix()
    before = rod.assemble(pose.c, pose.R, THETA)
    after = rod.assemble(pose.c @ Q.T + shift, Q @ pose.R, THETA)
    assert after.energy == pytest.approx(before.energy, rel=1e-9, abs=1e-13)
    turned = np.einsum("ij,ekj->eki", Q, before.gradient.reshape(-1, 4, 3)).reshape(-1, 12)
    assert after.gradient == pytest.approx(turned, abs=1e-11 * max(1.0, np.abs(turned).max()))
    at_rest_turned = rod.assemble(references @ Q.T + shift, np.tile(Q, (len(references), 1, 1)), THETA)
    assert at_rest_turned.energy < 1e-25
    assert np.abs(at_rest_turned.gradient).max() < 1e-12


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_forces_and_moments_of_an_element_balance(line):
    rod, references = with_arms(line)
    pose = displaced(references, 0.5)
    g = rod.assemble(pose.c, pose.R, THETA).gradient.reshape(-1, 2, 2, 3)
    assert g[:, :, 0].sum(axis=1) == pytest.approx(np.zeros((len(g), 3)), abs=1e-13)
    moments = g[:, :, 1] + np.cross(pose.c[rod.frames], g[:, :, 0])
    assert moments.sum(axis=1) == pytest.approx(np.zeros((len(g), 3)), abs=1e-12)


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_six_rigid_modes_and_no_more(line):
    rod, pose = on_own_frames(SECTION, line)
    values = np.linalg.eigvalsh(assembled(rod, pose, THETA)[2])
    assert np.abs(values[:6]).max() < 1e-13 * values[-1]
    assert values[6] > 1e-7 * values[-1]


def test_a_rod_has_no_direction():
    """Numbered from its other end (d1 and d3 reversed), it stores the same energy."""
    line = LINES["helix"]
    flip = np.diag([-1.0, 1.0, -1.0])
    reverse = Centreline(line.nodes[::-1], line.triads[::-1] @ flip, line.lengths[::-1])
    (rod, rest), (other, _) = on_own_frames(SECTION, line), on_own_frames(SECTION, reverse)
    pose = displaced(rest.c, 0.7)
    one = rod.assemble(pose.c, pose.R, THETA).energy
    assert other.assemble(pose.c[::-1].copy(), pose.R[::-1].copy(), THETA).energy == pytest.approx(one, rel=1e-12)


# Patch tests: constant strain is met exactly by elements of any lengths.

UNEVEN = straight((0, 0, 0), (0, 0, 2.0), [0.0, 0.1, 0.45, 0.5, 1.0], first=(1, 0, 0))


@pytest.mark.parametrize("seed", [0, 1])
def test_patch_of_any_constant_strain(seed):
    """All six strains at once, large: nodes on the screw exp(s xi) carry it, with the energy of the exact density."""
    rng = np.random.default_rng(seed)
    strain, curvature = 0.2 * rng.normal(size=3), rng.uniform(-1.0, 1.0, 3)
    X = np.zeros((4, 4))
    X[:3, :3] = np.cross(np.eye(3), curvature)
    X[:3, 3] = strain + [0.0, 0.0, 1.0]
    from scipy.linalg import expm

    screws = np.array([expm(s * X) for s in UNEVEN.stations])
    rod, _ = on_own_frames(SECTION, UNEVEN)
    triad = UNEVEN.triads[0]
    pose = Pose(screws[:, :3, 3] @ triad.T, triad @ screws[:, :3, :3] @ triad.T)
    at = rod.strains(pose.c, pose.R)
    assert at == pytest.approx(np.tile([*strain, *curvature], (4, 1)), abs=1e-13)


@pytest.mark.parametrize("n", [3, 5])
def test_a_straight_rod_rolls_up_into_a_circle(n):
    """M = 2 pi E I / L, with elements of unequal lengths, to rounding; the middle is where the circle has it."""
    fractions = np.concatenate([[0.0], np.cumsum(np.arange(n) + 3.0)])
    line = straight((0, 0, 0), (0, 0, 1.0), fractions / fractions[-1], first=(1, 0, 0))
    rod, pose = on_own_frames(SECTION, line)
    load = np.zeros((n + 1, 6))
    load[-1, 4] = 2.0 * np.pi * THETA["youngs_modulus"] * SECTION.constants.I2
    pose = solved(rod, pose, THETA, load)
    radius, s = 1.0 / (2.0 * np.pi), line.stations
    circle = radius * np.stack([1.0 - np.cos(s / radius), 0.0 * s, np.sin(s / radius)], axis=1)
    assert pose.c == pytest.approx(circle, abs=1e-9)


@pytest.mark.parametrize("n", [1, 4])
def test_bars_in_tension_shear_and_torsion(n):
    """One element is exact, with a lever's worth of bending: u = P L^3 / 3EI + P L / kGA."""
    L, P, E, nu = 2.0, 1e-8, 2.0, 0.3
    rod, rest = on_own_frames(SECTION, straight((0, 0, 0), (0, 0, L), n, first=(1, 0, 0)))
    G = E / (2.0 * (1.0 + nu))
    k = 10.0 * (1.0 + nu) / (12.0 + 11.0 * nu)
    load = np.zeros((n + 1, 6))
    load[-1] = [P, 2 * P, 3 * P, 0.0, 0.0, 4 * P]
    pose = solved(rod, rest, THETA, load, tolerance=1e-8)
    moved = pose.c[-1] - rest.c[-1]
    A, I1, I2, J = (getattr(SECTION.constants, name) for name in ("area", "I1", "I2", "J"))
    expected = [P * (L**3 / (3 * E * I2) + L / (k * G * A)), 2 * P * (L**3 / (3 * E * I1) + L / (k * G * A))]
    assert moved[:2] == pytest.approx(expected, rel=1e-4)  # the rest is of second order in P
    assert moved[2] == pytest.approx(3 * P * L / (E * A), rel=1e-3)
    twist = Rotation.from_matrix(pose.R[-1]).as_rotvec()[2]
    assert twist == pytest.approx(4 * P * L / (G * J), rel=1e-4)
