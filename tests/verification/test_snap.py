"""A shallow roof that snaps through: the cable that pulls its ridge down would have to push it up in between."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mechanics_cases import elastic, pulled

import softcal
from softcal.geometry.centreline import straight
from softcal.geometry.section import RectangularBar
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.project.project import load
from softcal.twin.build import build_twin
from softcal.twin.cables import CableLine
from softcal.twin.parameters import parameter_values, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Plate, PointLoad, Robot, Rod, ViaPoint
from softcal.twin.simulate import simulate

SPAN, RISE = 0.05, 0.004
HINGE, WIDTH, THICKNESS, MODULUS = 0.0015, 0.01, 0.0009, 5.0e7
SIDES = {"left": -1.0, "right": 1.0}


def hinge(name, start, end, **held):
    return Rod(name, straight(start, end, 2), RectangularBar(WIDTH, THICKNESS), elastic(MODULUS, 0.3), **held)


@pytest.fixture(scope="module")
def roof() -> Robot:
    """Two rigid slabs between short elastic hinges at the feet and at the ridge, and a cable straight down from it."""
    ridge = np.array([0.0, 0.0, RISE])
    plates, rods = [Plate("ridge", {}, ridge)], []
    for side, sign in SIDES.items():
        foot = np.array([sign * SPAN, 0.0, 0.0])
        along = HINGE * (ridge - foot) / np.linalg.norm(ridge - foot)
        plates.append(Plate(side, {}, 0.5 * (foot + ridge)))
        rods.append(hinge(f"{side}_foot", foot, foot + along, fixed=[0], clamped={side: [2]}))
        rods.append(hinge(f"{side}_top", ridge - along, ridge, clamped={side: [0], "ridge": [2]}))
    cable = Cable("front", (ViaPoint(np.array([0.0, 0.0, -0.1])), ViaPoint(ridge, "ridge")))
    return Robot(plates=tuple(plates), cables=(cable,), rods=tuple(rods))


def force(d: np.ndarray) -> np.ndarray:
    """What holds the ridge d lower [N]: slabs that pivot in the hinges' middles; stretch and bending."""
    area, rest = WIDTH * THICKNESS, np.hypot(SPAN, RISE) - HINGE
    base, height = SPAN * rest / (rest + HINGE), RISE * rest / (rest + HINGE) - d
    length = np.hypot(base, height)
    stretch = MODULUS * area / (2.0 * HINGE) * (rest - length) * height / length
    bend = 2.0 * MODULUS * area * THICKNESS**2 / 12.0 / HINGE * d / rest**2
    return 2.0 * (stretch + bend)


def test_a_length_that_only_a_push_could_hold_is_told(roof: Robot) -> None:
    d = RISE * np.array([0.3, 0.6, 1.5, 1.1])
    assert force(d)[2] == min(force(d)) < -0.1
    response = simulate(roof, pulled(*d))
    assert not response.succeeded
    assert response.status == "Cable front would have to push at 6 mm: the robot snaps through there."
    assert len(response.channels["front.tension"]) == 0


def test_before_and_beyond_the_snap_the_cable_pulls(roof: Robot) -> None:
    d = RISE * np.array([0.3, 0.6, 2.4])
    response = simulate(roof, pulled(*d))
    assert response.succeeded, response.status
    tension = response.channels["front.tension"]
    np.testing.assert_allclose(tension[:2], force(d)[:2], rtol=0.02)
    # There the hinges are stretched by 6 %, which the formula takes for small.
    assert tension[2] == pytest.approx(force(d)[2], rel=0.15)
    assert tension.min() > 0.1


@pytest.mark.parametrize("by", ["weight", "cables", "fall"])
def test_a_force_that_the_roof_cannot_bear_snaps_it_through(roof: Robot, by: str) -> None:
    d = np.linspace(0.0, 3.0, 3001) * RISE
    limit = force(d[d < RISE]).max()
    shares = np.array([0.9, 1.2])
    if by == "weight":
        loads = [
            PointLoad("weight", "ridge", np.array([0.0, 0.0, RISE]), np.array([0.0, 0.0, -s * limit])) for s in shares
        ]
        answers = [simulate(replace(roof, loads=(load,)), Protocol({})) for load in loads]
        low = RISE - np.array([answer.channels["ridge.z"][0] for answer in answers])
    elif by == "fall":
        twin, none = build_twin(roof), np.zeros(1)
        statics = Statics(twin.system, parameter_values(roof))
        rest = rest_state(twin.system.layout)
        ends = [
            overdamped_equilibrium(statics, rest, Controls(np.array([True]), none + s * limit, none)) for s in shares
        ]
        assert all(end.converged for end in ends), [end.status for end in ends]
        low = RISE - np.array([end.state.position[twin.frame["ridge"], 2] for end in ends])
        statics.release()
    else:
        two = replace(roof, cables=(*roof.cables, replace(roof.cables[0], name="back")))
        half = Command("tension", 0.5 * shares * limit)
        answer = simulate(two, Protocol({"front": half, "back": half}))
        assert answer.succeeded, answer.status
        low = RISE - answer.channels["ridge.z"]
    assert low[0] == pytest.approx(d[np.argmax(force(d) > shares[0] * limit)], rel=0.02)
    assert low[1] > 2.0 * RISE
    assert low[1] == pytest.approx(d[np.flatnonzero(force(d) < shares[1] * limit)[-1]], rel=0.02)


def test_a_snap_between_two_samples_of_friction_with_a_memory_is_told(roof: Robot):
    """Newton's method would reach the other side in one step, as if nothing had happened."""
    mu = 0.15
    via = (ViaPoint(np.array([0.03, 0.0, -0.1])), ViaPoint(np.array([0.0, 0.0, -0.1])), roof.cables[0].via_points[1])
    cable = Cable("front", via, mu, pulled_end="first", line=CableLine(friction_memory=True))
    d = np.linspace(0.0, 1.0, 1001) * RISE
    limit = force(d).max() * np.exp(mu * 0.5 * np.pi)
    found = simulate(replace(roof, cables=(cable,)), Protocol({"front": Command("tension", np.array([1.2 * limit]))}))
    assert found.channels["ridge.z"][0] < 0.0
    assert "Not stable before sample 1" in found.instabilities


@pytest.mark.slow
def test_a_slender_robot_falls_along_a_narrow_curved_valley() -> None:
    """The manipulator with soft springs snaps back: what bends it takes a billionth of what stretches it."""
    robot = load(Path(softcal.__file__).parent / "templates" / "manipulator" / "project.yaml").robot
    soft = with_parameters(robot, {f"spring{k}.youngs_modulus": 0.2236e9 for k in range(1, 5)})
    response = simulate(soft, Protocol({"cable1": Command("tension", np.array([9.81, 19.62]))}), curve_tolerance=0.0)
    assert response.succeeded, response.status
    assert response.instabilities.count(" mm of") == 1
    assert response.n_factorisations < 900


def test_a_pose_beyond_the_snap_is_refused_and_one_before_it_is_reached(roof: Robot) -> None:
    step = softcal.reach(roof, {"ridge.z": -RISE}).steps[0]
    assert step.outcome == "refused"
    assert step.commands == {"front.tension": 0.0}, "the last commands stay"
    assert step.channels["ridge.z"] == pytest.approx(RISE)
    assert "the robot has another equilibrium" in step.status
    assert softcal.reach(roof, {"ridge.z": 0.9 * RISE}).steps[0].outcome == "reached"
