"""Rods against closed forms, published solutions and their own differential equations."""

import numpy as np
import pytest
from rod_cases import Pose, assembled, at_rest, loaded, modulus, on_own_frames, solved, tip_by_shooting
from scipy.optimize import brentq
from scipy.special import ellipeinc, ellipk, ellipkinc

from softcal.geometry.centreline import helix, straight
from softcal.geometry.section import CrossSection, GivenSection, RectangularBar, RoundBar
from softcal.mechanics.rod import RodTerm, build_rod

# A cantilever under a dead load across its end, P L^2 / E I = `times`: the elastica.

SLENDER = RoundBar(1e-3)  # on a length of 1: shear and stretch count for less than 1e-6
STEEL = modulus(2e11, 0.3)
STIFFNESS = 2e11 * SLENDER.constants.I1


def elastica_tip(times: float) -> np.ndarray:
    """Deflection and remaining reach by elliptic integrals (Bisshopp and Drucker, 1945)."""

    def modulus_and_start(p):
        return p * p, np.arcsin(1.0 / (p * np.sqrt(2.0)))

    def excess(p):
        m, start = modulus_and_start(p)
        return ellipk(m) - ellipkinc(start, m) - np.sqrt(times)

    p = brentq(excess, np.sqrt(0.5) * (1 + 1e-15), 1.0 - 1e-12, xtol=1e-15)
    m, start = modulus_and_start(p)
    complete = ellipeinc(np.pi / 2, m) - ellipeinc(start, m)
    deflection = 1.0 - 2.0 * complete / np.sqrt(times)
    reach = np.sqrt(2.0 * (2.0 * p * p - 1.0) / times)
    return np.array([deflection, reach])


def test_elastica_is_the_published_one():
    assert elastica_tip(2.0) == pytest.approx([0.49346, 1 - 0.16064], abs=1e-5)


def cantilever(times: float, n: int) -> Pose:
    rod, pose = on_own_frames(SLENDER, straight((0, 0, 0), (0, 0, 1.0), n))
    return solved(rod, pose, STEEL, loaded(pose, n, force=(times * STIFFNESS, 0.0, 0.0)), steps=2, tolerance=1e-7)


@pytest.mark.parametrize("times", [0.5, 2.0, 10.0])
def test_cantilever_is_the_elastica(times):
    """Ten elements, in two load steps: within 0.01 %, and with the fourth power of their number."""
    errors = []
    for n in (10, 20):
        tip = cantilever(times, n).c[-1]
        assert abs(tip[1]) < 1e-9
        errors.append(np.linalg.norm(tip[[0, 2]] - elastica_tip(times)))
    assert errors[0] < 1e-4 * elastica_tip(times)[0]
    assert errors[1] < errors[0] / 10.0 + 2e-7 * times  # what shear and stretch add


# The 45 degree bend: Bathe and Bolourchi (1979). Radius 100, section 1 x 1, E = 1e7, nu = 0, a dead force across.

BEND = modulus(1e7, 0.0)
PUBLISHED = {300.0: (22.33, 58.84, 40.08), 450.0: (18.62, 52.32, 48.39), 600.0: (15.79, 47.23, 53.37)}
ARC = helix((0, 0, 0), (0, 0, 1), diameter=200.0, pitch=0.0, turns=1 / 8, at=1, towards=(1, 0, 0))


def bend_tip(section: CrossSection, force: float, n: int) -> np.ndarray:
    line = helix((0, 0, 0), (0, 0, 1), diameter=200.0, pitch=0.0, turns=1 / 8, at=n, towards=(1, 0, 0))
    rod, pose = on_own_frames(section, line)
    pose = solved(rod, pose, BEND, loaded(pose, n, force=(0.0, 0.0, force)), steps=2)
    return _seen_from_the_clamp(pose.c[-1] - line.nodes[0])


def bend_reference(section: CrossSection, force: float) -> np.ndarray:
    """By the differential equations, started from a computed tip."""
    F = np.array([0.0, 0.0, force])
    near = bend_tip(section, force, 16)
    start = np.cross(ARC.triads[0][:, [0, 2, 1]] * [1.0, 1.0, -1.0] @ near, F)
    tip = tip_by_shooting(section, BEND, ARC.triads[0], np.array([0, 0.01, 0]), 25 * np.pi, F, start)
    return _seen_from_the_clamp(tip)


def _seen_from_the_clamp(x: np.ndarray) -> np.ndarray:
    """Towards the arc's centre, along its tangent, and along the force, as published."""
    return np.array([x @ ARC.triads[0][:, 0], x @ ARC.triads[0][:, 2], x[2]])


POLAR = GivenSection(1.0, 1 / 12, 1 / 12, 1 / 6)  # with the polar moment for J, as in most publications
SQUARE = RectangularBar(1.0, 1.0)  # with Saint-Venant's J


@pytest.mark.parametrize("force", PUBLISHED)
def test_bend_is_the_published_one(force):
    """Simo and Vu-Quoc (1986) with eight straight elements, whose own error this is."""
    assert np.linalg.norm(bend_tip(POLAR, force, 8) - PUBLISHED[force]) < 0.2


def test_bend_is_bathes():
    assert bend_tip(POLAR, 600.0, 8) == pytest.approx([15.9, 47.2, 53.4], abs=0.25)


@pytest.mark.parametrize(("section", "order", "error"), [(POLAR, 4.0, 1e-5), (SQUARE, 2.0, 5e-5)])
@pytest.mark.parametrize("force", [300.0, 600.0])
def test_bend_converges_to_the_differential_equations(section, order, error, force):
    """Of fourth order where E I = G J, else of second, from an error of 3e-5 of the tip's position at n = 8."""
    reference = bend_reference(section, force)
    errors = [np.linalg.norm(bend_tip(section, force, n) - reference) for n in (8, 16, 32)]
    assert errors[0] < error * np.linalg.norm(reference)
    assert np.log2(errors[0] / errors[1]) > order - 0.2
    assert np.log2(errors[1] / errors[2]) > order - 0.35


def bend_of_eight() -> tuple[RodTerm, Pose, np.ndarray]:
    line = helix((0, 0, 0), (0, 0, 1), diameter=200.0, pitch=0.0, turns=1 / 8, at=8, towards=(1, 0, 0))
    rod, pose = on_own_frames(POLAR, line)
    return rod, pose, loaded(pose, 8, force=(0.0, 0.0, 600.0))


def test_newton_is_quadratic():
    """One iteration from beside the equilibrium leaves the square of how far it was."""
    rod, rest, load = bend_of_eight()
    there = solved(rod, rest, BEND, load, steps=2)
    rng, left = np.random.default_rng(4), []
    dz = np.zeros(54)
    dz[6:] = rng.uniform(-1.0, 1.0, 48)
    for size in (1e-3, 1e-4):
        beside = there.moved(size * dz)
        _, g, K = assembled(rod, beside, BEND)
        step = np.zeros(54)
        step[6:] = np.linalg.solve(K[6:, 6:], (load.ravel() - g)[6:])
        left.append(np.abs(beside.moved(step).c - there.c).max())
    assert np.log10(left[0] / left[1]) == pytest.approx(2.0, abs=0.2)


# Helical springs of small pitch, held at both ends by frames on the coil's axis.

D, d, E, NU = 20e-3, 1e-3, 2e11, 0.3
G = E / (2.0 * (1.0 + NU))


def spring(turns: float, pitch: float, per_turn: int) -> tuple[RodTerm, Pose]:
    n = round(turns * per_turn)
    line = helix((0, 0, 0), (0, 0, 1), diameter=D, pitch=pitch, turns=turns, at=n)
    references = np.array(line.nodes)
    references[0], references[-1] = (0, 0, 0), (0, 0, pitch * turns)
    return build_rod("spring", RoundBar(d), line, np.arange(n + 1), references), at_rest(references)


def spring_flexibility(turns: float, pitch: float, per_turn: int) -> np.ndarray:
    """Of the free end (6, 6)."""
    rod, pose = spring(turns, pitch, per_turn)
    return np.linalg.inv(assembled(rod, pose, modulus(E, NU))[2][6:, 6:])[-6:, -6:]


@pytest.mark.parametrize("turns", [3, 10])
@pytest.mark.parametrize("per_turn", [4, 12])
def test_spring_has_the_textbooks_stiffness(turns, per_turn):
    """Wahl (1963), Timoshenko and Gere (1961): pull G d^4 / (8 D^3 n), bending E d^4 / (32 n D (2 + nu)), torsion
    E d^4 / (64 D n), and across the axis H^2 / (3 k_bend) + 8 n D^3 / (E d^4). What remains is the pitch's and the
    wire's own stretch and shear.
    """
    pitch = 2e-3
    F = spring_flexibility(turns, pitch, per_turn)
    H = pitch * turns
    k_bend = E * d**4 / (32 * turns * D * (2 + NU))
    assert 1.0 / F[2, 2] == pytest.approx(G * d**4 / (8 * D**3 * turns), rel=0.003)
    assert 1.0 / F[[3, 4], [3, 4]] == pytest.approx(np.full(2, k_bend), rel=0.001)
    assert 1.0 / F[5, 5] == pytest.approx(E * d**4 / (64 * D * turns), rel=0.001)
    across = H**2 / (3 * k_bend) + 8 * turns * D**3 / (E * d**4)
    assert F[[0, 1], [0, 1]] == pytest.approx(np.full(2, across), rel=0.004)


def test_spring_between_parallel_plates_is_haringxs():
    """Sideways, with ends that do not turn: 1 / k = H^3 / (12 B) + H / S of the equivalent column, unloaded."""
    turns, pitch = 10, 2e-3
    rod, pose = spring(turns, pitch, 8)
    K = assembled(rod, pose, modulus(E, NU))[2]
    free = np.concatenate([np.arange(6, len(K) - 6), len(K) - 6 + np.arange(3)])  # the end moves and does not turn
    flexibility = np.linalg.inv(K[np.ix_(free, free)])[-3:, -3:]
    H, B = pitch * turns, pitch * turns * E * d**4 / (32 * turns * D * (2 + NU))
    S = E * d**4 * H / (8 * turns * D**3)
    assert np.diag(flexibility)[:2] == pytest.approx(np.full(2, H**3 / (12 * B) + H / S), rel=0.003)


def test_four_elements_a_turn_are_exact_in_small_displacements():
    coarse, fine = (spring_flexibility(2.5, 6e-3, n) for n in (4, 32))
    assert coarse == pytest.approx(fine, abs=1e-7 * np.abs(fine).max(axis=1, keepdims=True).max())
    scale = np.sqrt(np.outer(np.diag(fine), np.diag(fine)))
    assert np.abs((coarse - fine) / scale).max() < 1e-7


@pytest.mark.parametrize(("way", "share"), [((0.0, 0.0, 1.0), 1.0), ((0.0, 0.0, -1.0), 0.4), ((1.0, 0.0, 0.0), 0.8)])
def test_eight_elements_a_turn_do_for_large_displacements(way, share):
    """Pulled to twice its length, pressed by 40 %, bent aside by 0.6 of it: within 1e-4 of 24 elements a turn."""
    turns, pitch = 4, 6e-3
    size = share * pitch * turns / np.diag(spring_flexibility(turns, pitch, 8))[:3] @ np.abs(way)
    tips = []
    for per_turn in (8, 24):
        rod, pose = spring(turns, pitch, per_turn)
        end = solved(rod, pose, modulus(E, NU), loaded(pose, -1, force=size * np.array(way)), tolerance=1e-7)
        assert len(end.residuals[0]) <= 11
        tips.append(end.c[-1] - pose.c[-1])
    assert np.linalg.norm(tips[0]) > 0.3 * pitch * turns
    assert np.linalg.norm(tips[0] - tips[1]) < 1e-4 * np.linalg.norm(tips[1])
