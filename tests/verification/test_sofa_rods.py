"""Rods in SOFA itself come to rest where softcal has them: what the scene's beams are off by, and that it falls."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np
import pytest
from manipulator_case import manipulator
from mechanics_cases import column_robot, elastic, pulled, tensed

from softcal.geometry.centreline import helix, straight
from softcal.geometry.section import CrossSection, GivenSection, RectangularBar, RoundBar
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.sofa.simulator import sofa_engine
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Cable, Marker, Plate, PointLoad, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate

pytestmark = pytest.mark.skipif("SOFA_ROOT" not in os.environ, reason="SOFA is not installed: SOFA_ROOT is not set")

LENGTH = 0.1
NOTHING = tensed(0.0, cable="slack")


def cantilever(force, *, n: int, section: CrossSection, weight: bool = False) -> Robot:
    """A rod along x, its first node fixed, a force on the plate at its end; a cable that does nothing."""
    rod = Rod(
        "rod", straight((0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0), n, first=(0.0, 1.0, 0.0)), section, elastic(1e9, 0.4),
        clamped={"tip": np.array([n])}, fixed=[0], density=1000.0 if weight else 0.0,
    )  # fmt: skip
    tip = Plate("tip", {}, np.array([LENGTH, 0.0, 0.0]), mass=0.01)
    load = PointLoad("load", "tip", (LENGTH, 0.0, 0.0), force)
    slack = Cable("slack", (ViaPoint((LENGTH, 0.0, 0.0), "tip"), ViaPoint((LENGTH, 0.0, 0.1))))
    gravity = (0.0, 0.0, -9.81) if weight else (0.0, 0.0, 0.0)
    return Robot(plates=(tip,), rods=(rod,), cables=(slack,), loads=(load,), gravity=gravity)


def both(robot: Robot, protocol: Protocol) -> tuple[Response, Response]:
    """SOFA's response and softcal's."""
    theirs, ours = sofa_engine()(robot, protocol, snapshots=True), simulate(robot, protocol, curve_tolerance=0.0)
    assert theirs.succeeded, theirs.status
    assert ours.succeeded, ours.status
    return theirs, ours


def apart(responses: tuple[Response, Response], plate: str) -> np.ndarray:
    """Distance of the plate's reference in SOFA and in softcal [m], at each sample."""
    theirs, ours = (np.array([r.channels[f"{plate}.{axis}"] for axis in "xyz"]) for r in responses)
    return np.linalg.norm(theirs - ours, axis=0)


def test_small_deflections_are_softcals():
    """Of a stout rod, in whose deflection shear has a share; SOFA's own beams have none, nor such a section."""
    robot = cantilever((0.0, 0.5, 1.0), n=3, section=RectangularBar(0.02, 0.03))
    theirs, ours = both(robot, NOTHING)
    for axis, deflection in (("y", 4e-6), ("z", 2e-6)):
        moved = ours.channels[f"tip.{axis}"][0]
        assert moved > deflection
        assert theirs.channels[f"tip.{axis}"][0] == pytest.approx(moved, rel=2e-3)


def test_large_deflections_approach_softcals():
    """Three quarters of a slender rod's length sideways: off by 1 in 1000 of it, far less with shorter elements."""
    found = {}
    for n in (10, 20):
        robot = cantilever((0.0, 0.0, 8.0 / 2**4), n=n, section=RoundBar(0.002))
        responses = both(robot, NOTHING)
        assert responses[1].channels["tip.z"][0] > 0.7 * LENGTH
        (found[n],) = apart(responses, "tip") / LENGTH
    assert found[10] < 2e-3
    assert found[20] < found[10] / 4.0


def test_weight_of_rods():
    robot = cantilever((0.0, 0.0, 0.0), n=8, section=RoundBar(0.004), weight=True)
    responses = both(robot, NOTHING)
    assert responses[1].channels["tip.z"][0] < -2e-3
    assert apart(responses, "tip")[0] < 1e-3 * abs(responses[1].channels["tip.z"][0])


def test_helical_spring_pulled_by_a_cable():
    """Pulled together by a third and bent aside; tension, pose, and every node of the wire."""
    n = 36
    wire = Rod(
        "wire", helix((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), diameter=0.03, pitch=0.03, turns=3, at=n), RoundBar(0.006),
        elastic(1e9, 0.4), clamped={"base": np.array([0]), "head": np.array([n])}, density=1000.0,
    )  # fmt: skip
    base = Plate("base", {}, np.zeros(3), fixed=True)
    head = Plate("head", {}, np.array([0.0, 0.0, 0.09]), mass=0.02)
    cable = Cable("front", (ViaPoint((0.01, 0.0, 0.09), "head"), ViaPoint((0.01, 0.0, 0.0), "base")))
    marker = Marker("seen", "head", (0.02, 0.0, 0.1))
    robot = Robot(plates=(base, head), rods=(wire,), cables=(cable,), markers=(marker,))
    theirs, ours = both(robot, pulled(0.01, 0.03))
    assert ours.channels["front.tension"][-1] > 5.0
    np.testing.assert_allclose(theirs.channels["front.tension"], ours.channels["front.tension"], rtol=1e-3)
    assert apart((theirs, ours), "head").max() < 1e-3 * 0.03
    for axis in "xyz":
        np.testing.assert_allclose(theirs.channels[f"seen.{axis}"], ours.channels[f"seen.{axis}"], rtol=0, atol=5e-5)
    shape = simulate(robot, pulled(0.03), snapshots=True).snapshots[-1].rods["wire"]
    np.testing.assert_allclose(theirs.snapshots[-1].rods["wire"], shape, rtol=0, atol=5e-5)


def test_crosscheck_compares_rods():
    robot = cantilever((0.0, 0.5, 1.0), n=3, section=RectangularBar(0.02, 0.03))
    found = crosscheck(robot, tensed(1.0, cable="slack"), ["sofa"])
    (comparison,) = found.comparisons
    assert comparison.agrees, comparison.verdict
    seen = {one.quantity: one for one in comparison.differences}
    assert seen["rod: largest displacement"].softcal > 2e-6
    assert seen["tip.displacement"].relative < 1e-4


def test_rod_beside_a_body():
    """Both hold one plate; the rod, of a section that is no circle, is drawn and bent."""
    column = column_robot(parameters=elastic(1e6, 0.4), divisions=(2, 2, 6))
    section = GivenSection(1.2e-5, 1.1e-11, 1.9e-11, 2.2e-11)
    rod = Rod(
        "rod", straight((-0.04, 0.0, 0.0), (-0.04, 0.0, 0.1), 8), section, elastic(1e9, 0.3),
        clamped={"plate": np.array([8])}, fixed=[0],
    )  # fmt: skip
    robot = replace(column, rods=(rod,), plates=(replace(column.plates[0], mass=0.01),))
    responses = both(robot, pulled(0.005, 0.01))
    tension = [response.channels["front.tension"] for response in responses]
    assert tension[1][-1] > 20.0
    np.testing.assert_allclose(tension[0], tension[1], rtol=1e-4)
    assert apart(responses, "plate").max() < 2e-4 * 0.01


def test_backbone_through_discs():
    """A rod held by discs along it, weightless under gravity, with a cable through the discs."""
    n = 12
    rod = Rod(
        "rod", straight((0.0, 0.0, 0.0), (0.0, 0.0, 2 * LENGTH), n), RoundBar(0.004), elastic(1e9, 0.4),
        clamped={"middle": np.array([5, 6, 7]), "top": np.array([n])}, fixed=[0],
    )  # fmt: skip
    middle = Plate("middle", {}, np.array([0.0, 0.0, LENGTH]), mass=0.01)
    top = Plate("top", {}, np.array([0.0, 0.0, 2 * LENGTH]), mass=0.01)
    via = (ViaPoint((0.02, 0.0, 0.0)), ViaPoint((0.02, 0.0, LENGTH), "middle"), ViaPoint((0.02, 0.0, 0.2), "top"))
    robot = Robot(
        plates=(middle, top), rods=(rod,), cables=(Cable("front", via, pulled_end="first"),), gravity=(1, 0, -9.81)
    )
    responses = both(robot, tensed(0.5, 1.0))
    for plate in ("middle", "top"):
        moved = abs(responses[1].channels[f"{plate}.x"][-1])
        assert moved > 5e-3
        assert apart(responses, plate).max() < 1e-3 * moved


def test_manipulator_of_springs_and_discs():
    """Paper B's kind: four springs, five discs, hanging, one of six cables pulled."""
    robot = manipulator(0.9e9)
    responses = both(robot, tensed(4.905, 9.81, cable="cable6"))
    for plate in ("S2", "S4"):
        rest = np.asarray(next(p.reference for p in robot.plates if p.name == plate))
        at = np.array([responses[1].channels[f"{plate}.{axis}"] for axis in "xyz"]).T
        moved = np.linalg.norm(at - rest, axis=1)
        assert moved[-1] > 0.02
        assert (apart(responses, plate) < 1e-3 * moved).all()
