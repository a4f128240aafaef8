"""Rods against solid meshes of the same rods: straight, coiled, and a whole manipulator's springs.

The solids' end faces are held or moved as rigid discs, which keeps them from thinning under tension and from warping:
over about a diameter at each end they are stiffer than a rod is (Saint-Venant), some 0.3 % in a rod 20 diameters long.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softcal.geometry.centreline import Centreline, helix, straight
from softcal.geometry.section import RoundBar
from softcal.twin.manipulator import Discs, Manipulator, Springs, manipulator
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Plate, PointLoad, Robot, Rod
from softcal.twin.simulate import simulate
from softcal.twin.solid_rods import with_solid_rods

E, NU = 1e9, 0.3
G = E / (2.0 * (1.0 + NU))


def held(line: Centreline, diameter: float, at: np.ndarray, forces: list[tuple[np.ndarray, np.ndarray]]) -> Robot:
    """A rod fixed at its start; its end moves with a plate, on which forces (place, force) act."""
    rod = Rod(
        "rod",
        line,
        RoundBar(diameter),
        {"youngs_modulus": E, "poissons_ratio": NU},
        clamped={"tip": np.array([len(line.nodes) - 1])},
        fixed=np.array([0]),
    )
    loads = tuple(PointLoad(f"force{i}", "tip", at + place, force) for i, (place, force) in enumerate(forces))
    return Robot(plates=(Plate("tip", {}, at),), rods=(rod,), loads=loads)


def tip(robot: Robot) -> np.ndarray:
    """Position [m] and pitch, roll, yaw [rad] of the plate."""
    response = simulate(robot, Protocol({}))
    assert response.succeeded, response.status
    return np.array([response.channels[f"tip.{name}"][-1] for name in ("x", "y", "z", "pitch", "roll", "yaw")])


# A straight rod of 20 diameters.

LENGTH, THICK = 0.2, 0.01
SLENDER = RoundBar(THICK)
X, Y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
ORIGIN = np.zeros(3)


def cantilever(forces: list[tuple[np.ndarray, np.ndarray]], layers: int = 40) -> Robot:
    line = straight((0, 0, 0), (0, 0, LENGTH), 2 * layers, first=(1, 0, 0))
    return held(line, THICK, np.array([0.0, 0.0, LENGTH]), forces)


BENDING = 3.0 * E * SLENDER.constants.I1 / LENGTH**2  # this force times an angle [rad]
SMALL = 1e-3
CASES = {
    "bending": ([(ORIGIN, SMALL * BENDING * X)], 0),
    "turning": ([(ORIGIN, SMALL * BENDING * Y)], 4),
    "torsion": (
        [
            (0.05 * Y, -X * SMALL * G * SLENDER.constants.J / LENGTH / 0.1),
            (-0.05 * Y, X * SMALL * G * SLENDER.constants.J / LENGTH / 0.1),
        ],
        5,
    ),
}
MESHES: dict[str, tuple[int, str, int]] = {
    "one ring, P2P1": (1, "P2P1", 40),
    "two rings, P2P1": (2, "P2P1", 20),
    "two rings, P2": (2, "P2", 20),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("mesh", MESHES)
def test_a_cantilever_is_a_solid_one(case, mesh):
    forces, channel = CASES[case]
    rings, element, layers = MESHES[mesh]
    robot = cantilever(forces, layers)
    rod, solid = tip(robot), tip(with_solid_rods(robot, rings=rings, element=element))
    assert solid[channel] == pytest.approx(rod[channel], rel=0.01)
    rest = np.array([0.0, 0.0, LENGTH, 0.0, 0.0, 0.0])
    assert np.abs(rod - rest)[channel] > 1e-5
    # Bending stays in its plane, and torsion is torsion alone.
    others = np.flatnonzero(np.abs(rod - rest) < 1e-12)
    assert len(others) >= 3
    assert np.abs(solid - rest)[others].max() < 1e-6 * np.abs(rod - rest).max()


def test_the_rod_has_the_textbooks_stiffness():
    """So that rod and solid are not wrong together; shear adds 0.2 % to the bending."""
    by = {case: tip(cantilever(forces))[channel] for case, (forces, channel) in CASES.items()}
    assert by["bending"] == pytest.approx(SMALL * LENGTH, rel=0.002)
    assert abs(by["turning"]) == pytest.approx(1.5 * SMALL, rel=1e-5)
    assert abs(by["torsion"]) == pytest.approx(SMALL, rel=1e-6)


def test_a_large_bend_is_a_solid_ones():
    """P L^2 / E I = 4: the tip moves aside by 0.67 of the length."""
    robot = cantilever([(ORIGIN, 4.0 / 3.0 * BENDING * X)])
    rod, solid = tip(robot), tip(with_solid_rods(robot))
    assert rod[0] == pytest.approx(0.671 * LENGTH, rel=0.002)
    assert np.linalg.norm(solid[:3] - rod[:3]) < 0.01 * np.hypot(rod[0], rod[2] - LENGTH)
    assert solid[3] == pytest.approx(rod[3], rel=0.01)


# Helical springs of two turns; the end is free to turn.


def spring(index: float, layers_per_turn: int, way: np.ndarray) -> tuple[Robot, float, np.ndarray]:
    """A spring, its axial stiffness by the textbook's G d^4 / (8 D^3 n), and where its free end is."""
    turns, d = 2.0, 1e-3
    D, pitch = index * d, 2.0 * d
    stiffness = G * d**4 / (8.0 * D**3 * turns)
    at = np.array([0.0, 0.0, turns * pitch])
    line = helix(
        (0, 0, 0),
        (0, 0, 1),
        diameter=D,
        pitch=pitch,
        turns=turns,
        at=round(2 * turns * layers_per_turn),
        towards=(1, 0, 0),
    )
    return held(line, d, at, [(ORIGIN, 1e-4 * at[2] * stiffness * way)]), stiffness, at


def softness(index: float, layers_per_turn: int, rings: int, way: np.ndarray) -> tuple[float, float]:
    """How far the end moves along a small force on it, over that of the textbook's axial spring: rod, and solid."""
    robot, _, at = spring(index, layers_per_turn, way)
    moved = [(tip(r)[:3] - at) @ way / (1e-4 * at[2]) for r in (robot, with_solid_rods(robot, rings=rings))]
    return moved[0], moved[1]


Z = np.array([0.0, 0.0, 1.0])


@pytest.mark.slow
@pytest.mark.parametrize("way", [Z, X], ids=["axial", "lateral"])
def test_a_slender_spring_is_a_solid_one(way):
    """D / d = 12."""
    rod, solid = softness(12.0, 48, 2, way)
    assert solid == pytest.approx(rod, rel=0.01)


def by_index(index: float) -> float:
    """The softness of a solid spring over that of its rod, along the axis.

    In a thick coil the inner fibre is the shorter one and carries more shear: 1 - 3 / (16 c^2) of the elementary
    softness, shear included (Goehner, 1932; Ancker and Goodier, 1958). The rod has a straight bar's torsion and adds
    the shear force's own share, 1 + 1 / (2 k c^2).
    """
    k = 6.0 * (1.0 + NU) / (7.0 + 6.0 * NU)
    return (1.0 - 3.0 / (16.0 * index**2)) / (1.0 + 1.0 / (2.0 * k * index**2))


@pytest.mark.slow
@pytest.mark.parametrize(("index", "layers"), [(10.0 / 3.0, 20), (5.0, 24)])
def test_a_thick_spring_is_stiffer_than_its_rod_by_the_known_share(index, layers):
    """Along the axis by 6.4 % and 2.9 %; sideways by some 2 %."""
    rod, solid = softness(index, layers, 2, Z)
    assert solid / rod == pytest.approx(by_index(index), abs=0.003)
    assert 1.0 - by_index(index) > 0.025
    rod, solid = softness(index, layers, 2, X)
    assert 0.975 < solid / rod < 0.99


# Paper B's manipulator, whose springs' index is 3.3.

SPRINGS = Springs(youngs_modulus=0.8e9, poissons_ratio=0.43, density=900.0)
SHAPE = Manipulator(springs=SPRINGS, discs=Discs(mass=0.02))


def discs(robot: Robot, cable: str, force: float) -> np.ndarray:
    """Positions of S1 to S4 (4, 3) [m] with a cable pulled by a force [N]."""
    response = simulate(robot, Protocol({cable: Command("tension", np.array([force]))}))
    assert response.succeeded, response.status
    return np.array([[response.channels[f"{disc}.{axis}"][-1] for axis in "xyz"] for disc in SHAPE.disc_names])


def apart(cable: str, force: float) -> tuple[np.ndarray, np.ndarray]:
    """Of rods from solids, and of solids from the unloaded robot, in lengths of the robot; S1 to S4."""
    robots = [
        manipulator(replace(SHAPE, springs=replace(SPRINGS, model=model)))  # type: ignore[arg-type]
        for model in ("rod", "solid")
    ]
    rod, solid = discs(robots[0], cable, force), discs(robots[1], cable, force)
    rest = np.array([plate.reference for plate in robots[0].plates[1:]])
    return (
        np.linalg.norm(rod - solid, axis=1) / SHAPE.total_length,
        np.linalg.norm(solid - rest, axis=1) / SHAPE.total_length,
    )


@pytest.mark.long
def test_the_manipulator_on_solid_springs():
    """1.5 kgf on a cable to S2."""
    difference, moved = apart("cable2", 14.715)
    assert moved[3] > 0.5
    assert difference.max() < 0.01
    assert difference[3] < 0.015 * moved[3]


@pytest.mark.long
def test_the_manipulator_on_solid_springs_bent_the_most():
    """2 kgf on a cable to S4, which moves it by the whole length."""
    difference, moved = apart("cable6", 19.62)
    assert moved[3] > 0.9
    assert difference[3] < 0.02
