"""Commands for wanted poses: reachable targets are reached, others answered by the nearest state, on the exact twin."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from soft_robots import COLUMN, ROUGH, TENDONS, TENTACLE

import softcal
from benchmarks.reach import Case, against_brute, cases, drawn, found, posed
from softcal.analysis.reach import ReachStep
from softcal.geometry.centreline import straight
from softcal.geometry.mesh import TetMesh
from softcal.geometry.obstacle import BoxObstacle, HalfSpace, Obstacle, SphereObstacle
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RectangularBar, RoundBar
from softcal.geometry.surface import boundary_faces
from softcal.twin.barrier import Contact
from softcal.twin.live import LiveTwin
from softcal.twin.manipulator import Manipulator, Springs, manipulator
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, Rod, ViaPoint

PLANE = ("tip.x", "tip.y")


def assert_answered(step: ReachStep) -> None:
    """Reached within all tolerances, at least; or the nearest state, or refused, with a reason that was checked."""
    if step.outcome == "reached":
        for name, miss in step.misses.items():
            assert abs(miss) <= (1e-5 if name[-1] in "xyz" else np.radians(0.01)), step.status
    elif step.outcome == "nearest":
        assert step.gradient < 1e-3
        assert step.active, step.status
    else:
        assert any(told in step.status for told in ("The way ends there", "not stable", "another equilibrium"))


@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_random_targets_of_a_tentacle_are_reached_by_the_commands(control: str) -> None:
    live = LiveTwin(TENTACLE, "tension")
    for target in drawn(Case("", TENTACLE, PLANE, 1.2, 3.0), 6):
        result = softcal.reach(TENTACLE, target, controls=control, limits={"tension": (0.0, 3.0)})
        (step,) = result.steps
        assert step.outcome == "reached", step.status
        assert_answered(step)
        assert step.channels == pytest.approx(softcal.LiveTwin(TENTACLE, control).at(
            {name.partition(".")[0]: value for name, value in step.commands.items()}).channels, abs=1e-9)  # fmt: skip
        tensions = {name: step.channels[f"{name}.tension"] for name in TENDONS}
        assert min(tensions.values()) >= -1e-9
        seen = live.at({name: max(value, 0.0) for name, value in tensions.items()}).channels
        assert [seen[name] for name in PLANE] == pytest.approx([target[name] for name in PLANE], abs=1e-5)


def test_least_effort_is_that_of_either_command_and_of_a_minimiser() -> None:
    case = Case("", TENTACLE, PLANE, 1.2, 3.0)
    (target,) = drawn(case, 1)
    by = {control: softcal.reach(TENTACLE, target, controls=control).steps[0] for control in ("tension", "shortening")}
    efforts = {c: np.array([step.channels[f"{name}.tension"] for name in TENDONS]) for c, step in by.items()}
    assert efforts["tension"] == pytest.approx(efforts["shortening"], abs=2e-4)
    end = posed(case, LiveTwin(TENTACLE, "tension"), target).least(np.full(3, 0.3), 3.0)
    assert efforts["tension"] == pytest.approx(end, abs=2e-3)


def test_a_floor_of_pretension_is_kept_with_the_least_effort_above_it() -> None:
    target = {"tip.x": 0.016, "tip.y": 0.006}
    for control in ("tension", "shortening"):
        step = softcal.reach(TENTACLE, target, controls=control, pretension=0.4).steps[0]
        tensions = [step.channels[f"{name}.tension"] for name in TENDONS]
        assert step.outcome == "reached", step.status
        assert min(tensions) == pytest.approx(0.4, abs=1e-3)
        assert "at its lower limit 0.4 N" in " ".join(step.active)


def test_a_target_out_of_reach_is_answered_by_the_nearest_state_and_its_limits() -> None:
    limits = {"tension": (0.0, 0.5)}
    step = softcal.reach(TENTACLE, {"tip.x": 0.09, "tip.y": 0.02}, limits=limits).steps[0]
    assert step.outcome == "nearest"
    assert_answered(step)
    random, live = np.random.default_rng(0), LiveTwin(TENTACLE, "tension")
    own = np.hypot(*step.misses.values())
    here = np.array(list(step.commands.values()))
    for size in (0.5, 0.05, 0.005) * 20:
        T = np.clip(here + size * random.normal(size=3), 0.0, 0.5)
        seen = live.at(dict(zip(TENDONS, T.tolist(), strict=True))).channels
        assert np.hypot(seen["tip.x"] - 0.09, seen["tip.y"] - 0.02) >= own * (1.0 - 1e-4)


@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_reversing_friction_is_followed_from_target_to_target_and_replayed(control: str) -> None:
    targets = {"tip.x": [0.008, 0.016, 0.012, 0.008, 0.016], "tip.y": [0.003, 0.006, 0.002, 0.003, 0.006]}
    result = softcal.reach(ROUGH, targets, controls=control, prefer="nearest")
    assert [step.outcome for step in result.steps] == ["reached"] * 5
    replayed = softcal.simulate(ROUGH, result.protocol)
    assert replayed.succeeded, replayed.status
    for name, values in targets.items():
        assert replayed.channels[name] == pytest.approx(values, abs=1e-5)
    first, last = (list(result.steps[k].commands.values()) for k in (0, 3))
    assert np.abs(np.array(first) - last).max() > 1e-4, "the same place by other commands: friction has reversed"


def test_rates_hold_from_target_to_target() -> None:
    result = softcal.reach(
        TENTACLE, {"tip.x": [0.0, 0.005, 0.005, 0.005]}, times=[0.0, 1.0, 2.0, 4.0], rates={"tension": 0.3}
    )
    commands = np.array([list(step.commands.values()) for step in result.steps])
    assert np.abs(np.diff(commands, axis=0)).max() <= 0.6 + 1e-9
    assert np.abs(np.diff(commands[:3], axis=0)).max() <= 0.3 + 1e-9
    assert result.steps[1].outcome == "nearest"
    assert "by its rate" in result.steps[1].active[0]
    assert result.steps[-1].outcome == "reached"
    assert result.protocol.times == pytest.approx([0.0, 1.0, 2.0, 4.0])


def test_any_channel_may_be_wanted_or_limited() -> None:
    seen = LiveTwin(COLUMN, "tension").at({"c0": 3.0, "c1": 1.0, "c2": 2.0}).channels
    wanted = {name: seen[name] for name in ("plate.pitch", "c0.tension")}
    y = seen["plate.y"]
    step = softcal.reach(COLUMN, wanted, limits={"plate.y": (y - 1e-4, y + 1e-4)}).steps[0]
    assert step.outcome == "reached", step.status
    assert step.commands["c0.tension"] == pytest.approx(3.0, abs=0.01)
    assert step.channels["plate.y"] == pytest.approx(y, abs=1.001e-4)


def test_two_targets_of_one_cable_are_answered_by_the_nearest_state_without_a_limit() -> None:
    seen = LiveTwin(TENTACLE, {"front": "tension"}).at({"front": 0.8}).channels
    wanted = {"tip.x": seen["tip.x"], "tip.z": seen["tip.z"] + 0.003}
    step = softcal.reach(TENTACLE, wanted, controls={"front": "tension"}).steps[0]
    assert step.outcome == "nearest", step.status
    assert step.gradient < 1e-3
    assert not step.active
    assert 0.0 < np.hypot(*step.misses.values()) < 0.003


def three_discs() -> Robot:
    """Three discs on a slender rod, with three cables to the upper disc and three to the one below."""
    height, at = 0.06, range(4)
    discs = [Plate(f"d{i}", {}, (0.0, 0.0, i * height), mass=0.012, fixed=i == 0) for i in at]
    rods = [
        Rod(
            f"r{i}",
            straight((0.0, 0.0, (i - 1) * height), (0.0, 0.0, i * height), 6),
            RoundBar(0.003),
            {"youngs_modulus": 1.2e9, "poissons_ratio": 0.38},
            clamped={f"d{i - 1}": np.array([0]), f"d{i}": np.array([6])},
            density=1200.0,
        )
        for i in at[1:]
    ]
    cables = []
    for k in range(6):
        angle = 2.0 * np.pi * k / 3.0 + (np.pi / 3.0 if k >= 3 else 0.0)
        hole = 0.02 * np.array([np.cos(angle), np.sin(angle), 0.0])
        via = [ViaPoint(hole + np.array([0.0, 0.0, i * height]), f"d{i}") for i in range(1, 4 if k < 3 else 3)]
        cables.append(Cable(f"c{k + 1}", (ViaPoint(hole - np.array([0.0, 0.0, 0.01])), *via), pulled_end="first"))
    return Robot(plates=tuple(discs), rods=tuple(rods), cables=tuple(cables), gravity=(0.0, 0.0, -9.81))


def test_two_places_that_nearly_depend_on_each_other_are_reached() -> None:
    """The height of an inextensible rod's tip follows from its deflection but for an S-shape: a curved valley."""
    step = softcal.reach(three_discs(), {"d3.y": 0.10954, "d3.z": 0.13365}, limits={"tension": (0.0, 1.2)}).steps[0]
    assert step.outcome == "reached", step.status


def test_a_search_that_ends_by_its_steps_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("softcal.analysis.reach.STEPS", 1)
    step = softcal.reach(TENTACLE, {"tip.x": 0.04}).steps[0]
    assert step.outcome == "refused"
    assert "The way ends there: the search still came closer" in step.status
    assert "derivatives jump" not in step.status


def test_limits_that_no_commands_keep_are_a_failure_with_a_reason() -> None:
    with pytest.raises(softcal.SimulationError, match="No commands within the limits were found"):
        softcal.reach(TENTACLE, {"tip.x": 0.01}, limits={"tension": (0.0, 0.1), "tip.y": (0.05, 0.06)})


@pytest.mark.slow
@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_random_targets_are_reached_or_refused_with_a_reason(case: Case) -> None:
    steps, _, unanswered = found(case, drawn(case, 12))
    assert not unanswered
    for step in steps:
        assert_answered(step)
    assert sum(step.outcome == "reached" for step in steps) >= 11


@pytest.mark.long
@pytest.mark.parametrize(
    "name", ["neck, 1 cable", pytest.param("neck, 3 cables by shortening", marks=pytest.mark.long)]
)
def test_the_nearest_state_is_as_near_as_that_of_a_brute_search(name: str) -> None:
    case = next(one for one in cases() if one.name == name)
    assert against_brute(case, drawn(case, 5), 64) == ["5 of 5", "0"]


def clearance(robot: Robot, step: ReachStep, obstacle: Obstacle) -> float:
    """The least distance of dense points of the robot's surface at the commands of a step, by another twin."""
    live = LiveTwin(robot, "tension")
    state = live.at({name.partition(".")[0]: value for name, value in step.commands.items()})
    (body,) = robot.bodies
    faces = boundary_faces(body.mesh)[:, :3]
    shares = np.random.default_rng(0).dirichlet(np.full(3, 0.5), 300)
    points = (shares @ state.shape.points[body.name][faces]).reshape(-1, 3)
    return float(obstacle.distances(points)[0].min())


OBSTACLES = {
    "half-space": HalfSpace((0.02, 0.0, 0.0), (-1.0, 0.0, -0.1)),
    "sphere": SphereObstacle((0.035, 0.004, -0.1), 0.012),
    "corner of a box": BoxObstacle((0.017, -0.0013, -0.14), (0.06, 0.08, -0.075)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long if "box" in name else ()) for name in OBSTACLES]
)
def test_the_robot_does_not_enter_an_obstacle_and_is_as_near_to_its_target_as_it_can_be(name: str) -> None:
    obstacle, wanted = OBSTACLES[name], {"tip.x": 0.03, "tip.y": 0.006}
    free = softcal.reach(TENTACLE, wanted, limits={"tension": (0.0, 12.0)}).steps[0]
    assert clearance(TENTACLE, free, obstacle) < -1e-3, "the obstacle would be in the way"
    step = softcal.reach(TENTACLE, wanted, limits={"tension": (0.0, 12.0)}, obstacles={"it": obstacle}).steps[0]
    assert step.outcome == "nearest", step.status
    touches = "tentacle touches it" in step.active
    assert touches or "tentacle touches it on the way" in step.active
    assert clearance(TENTACLE, step, obstacle) == pytest.approx(step.clearances["it"], abs=1e-4)
    assert step.clearances["it"] == pytest.approx(0.0, abs=1e-8) if touches else step.clearances["it"] > 0.0
    random, live, here = np.random.default_rng(0), LiveTwin(TENTACLE, "tension"), np.array([*step.commands.values()])
    for size in (0.3, 0.03, 0.003) * 6:
        T = np.clip(here + size * random.normal(size=3), 0.0, 12.0)
        way = [live.at(dict(zip(TENDONS, (share * T).tolist(), strict=True))) for share in np.linspace(0.25, 1.0, 13)]
        seen = way[-1]
        if min(one.clearances({"it": obstacle}).values.min() for one in way) >= 0.0:
            off = np.hypot(seen.channels["tip.x"] - 0.03, seen.channels["tip.y"] - 0.006)
            assert off >= np.hypot(*step.misses.values()) * (1.0 - 1e-4)


def test_an_obstacle_that_is_far_changes_nothing() -> None:
    wanted = {"tip.x": 0.016, "tip.y": 0.006}
    free = softcal.reach(TENTACLE, wanted).steps[0]
    far = softcal.reach(TENTACLE, wanted, obstacles={"far": SphereObstacle((0.0, 0.0, -0.3), 0.1)}).steps[0]
    assert far.commands == pytest.approx(free.commands, abs=1e-9)
    assert not free.clearances
    assert far.clearances["far"] > 0.05
    assert not any("far" in name for name in far.active)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name == "half-space" else pytest.mark.long) for name in (*OBSTACLES, "wall")],
)
def test_the_straight_line_of_commands_is_free_of_obstacles(name: str) -> None:
    """Or the target is refused, with the place, and the last commands stay."""
    wall = BoxObstacle((0.0125, -0.1, -0.145), (0.0175, 0.1, -0.118))
    around, live = {"it": {**OBSTACLES, "wall": wall}[name]}, LiveTwin(TENTACLE, "tension")
    steps = softcal.reach(
        TENTACLE, {"tip.x": [0.002, 0.034], "tip.y": [0.0, 0.0]}, limits={"tension": (0.0, 12.0)}, obstacles=around
    ).steps
    last = np.zeros(3)
    for step in steps:
        commands = np.array([*step.commands.values()])
        if step.outcome == "refused":
            assert "passes through it: tentacle by" in step.status
            assert commands == pytest.approx(last)
        for share in np.linspace(0.0, 1.0, 33):
            T = last + share * (commands - last)
            state = live.at(dict(zip(TENDONS, np.maximum(T, 0.0).tolist(), strict=True)))
            assert state.clearances(around).values.min() > (-1e-5 if float(16 * share).is_integer() else -1e-4)
        last = commands
    assert steps[0].outcome == "reached"
    assert steps[1].outcome != "reached"


def test_the_distances_have_the_derivatives_of_their_differences() -> None:
    for robot, plate in (
        (TENTACLE, False),
        (manipulator(Manipulator(springs=Springs(youngs_modulus=1.6e9, poissons_ratio=0.43))), True),
    ):
        live = LiveTwin(robot, "tension")
        names = [one.name for one in live.actuators]
        begin = dict.fromkeys(names, 0.3) | {names[0]: 2.0 if plate else 0.8}
        state = live.at(begin)
        middle = state.channels["S4.z"] if plate else -0.1
        ball = {"ball": SphereObstacle((0.05, 0.01, middle), 0.02)}
        near = state.clearances(ball)
        k = near.nearest("ball")
        assert near.parts[k] in (("S4", "S3_S4") if plate else ("tentacle",)) or near.parts[k].startswith("S")
        exact, h = state.clearances_by_commands(near).values[k], 1e-4
        for column, name in enumerate(names):
            ends = [live.at(begin | {name: begin[name] + s * h}).clearances(ball).values.min() for s in (1.0, -1.0)]
            assert (ends[0] - ends[1]) / (2.0 * h) == pytest.approx(exact[column], rel=2e-3, abs=1e-8)


@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_stiffnesses_are_those_of_a_force_and_have_the_derivatives_of_their_differences(control: str) -> None:
    names = ("tip.x_stiffness", "tip.yaw_stiffness", "front.shortening_stiffness")
    begin = dict(zip(TENDONS, (0.8, 0.3, 0.5) if control == "tension" else (0.006, 0.005, 0.0055), strict=True))
    live = LiveTwin(TENTACLE, control)
    state = live.at(begin)
    assert min(state.channels[f"{name}.tension"] for name in TENDONS) > 0.0
    own, exact = state.stiffnesses(*names), state.stiffnesses_by_commands(*names)
    # A force at the tip's reference moves it by the inverse of the stiffness.
    place, F = tuple(TENTACLE.plates[0].reference), 1e-4
    pushed = replace(TENTACLE, loads=(PointLoad("push", "tip", place, np.array([F, 0.0, 0.0])),))
    ends = [LiveTwin(robot, control).at(begin).channels["tip.x"] for robot in (pushed, TENTACLE)]
    assert F / (ends[0] - ends[1]) == pytest.approx(own["tip.x_stiffness"], rel=1e-4)
    size = 1e-3 * max(begin.values())
    for name in TENDONS:
        up, down = (live.at(begin | {name: begin[name] + s * size}) for s in (1.0, -1.0))
        above, below = up.stiffnesses(*names), down.stiffnesses(*names)
        for one in names:
            slope = (above[one] - below[one]) / (2.0 * size)
            assert slope == pytest.approx(exact[one, f"{name}.{control}"], rel=3e-5, abs=1e-9)
    up, down = (live.at(begin | {"front": begin["front"] + s * size}).channels for s in (1.0, -1.0))
    slope = (up["front.tension"] - down["front.tension"]) / (up["front.shortening"] - down["front.shortening"])
    if control == "shortening":
        assert slope == pytest.approx(own["front.shortening_stiffness"], rel=1e-5)


def test_a_slack_cable_has_no_stiffness_and_friction_no_linear_one() -> None:
    state = LiveTwin(TENTACLE, "shortening").at({"front": 0.004, "left": -0.01, "right": -0.01})
    assert state.channels["left.tension"] == 0.0
    assert state.stiffnesses("left.shortening_stiffness")["left.shortening_stiffness"] == 0.0
    with pytest.raises(softcal.ParameterError, match="no such stiffness is computed"):
        state.stiffnesses("tip.w_stiffness")
    with pytest.raises(softcal.ParameterError, match=r"the robot has no such stiffness.*memory"):
        softcal.reach(ROUGH, {"tip.x_stiffness": 20.0})


def test_a_stiffness_is_reached_beside_a_place_and_kept_as_a_limit() -> None:
    step = softcal.reach(TENTACLE, {"tip.x": 0.01, "tip.x_stiffness": 27.0}).steps[0]
    assert step.outcome == "reached", step.status
    there = LiveTwin(TENTACLE, "tension").at({k.partition(".")[0]: v for k, v in step.commands.items()})
    assert there.stiffnesses("tip.x_stiffness")["tip.x_stiffness"] == pytest.approx(27.0, abs=0.027)
    assert there.channels["tip.x"] == pytest.approx(0.01, abs=1e-5)
    least = softcal.reach(TENTACLE, {"tip.x": 0.01}).steps[0]
    stiff = softcal.reach(TENTACLE, {"tip.x": 0.01}, limits={"tip.x_stiffness": (28.0, np.inf)}).steps[0]
    assert stiff.outcome == "reached", stiff.status
    assert stiff.channels["tip.x_stiffness"] == pytest.approx(28.0, abs=0.03)
    assert "tip.x_stiffness at its lower limit 28 N/m" in stiff.active
    assert sum(least.commands.values()) < sum(stiff.commands.values())
    beyond = softcal.reach(TENTACLE, {"tip.x_stiffness": 200.0}, limits={"tension": (0.0, 3.0)}).steps[0]
    assert beyond.outcome == "nearest", beyond.status
    assert "tension at its upper limit 3 N" in " ".join(beyond.active)


EI, LENGTH = 5e7 * 0.01 * 0.004**3 / 12.0, 0.2
TOP, PINNED = np.array([0.0, 0.0, LENGTH]), np.pi**2 * EI / LENGTH**2


def column(weight: float) -> Robot:
    """A straight rod on the ground, a cable from its top to its foot, and a dead weight [N] on top."""
    material = {"youngs_modulus": 5e7, "poissons_ratio": 0.3}
    rod = Rod("column", straight((0, 0, 0), tuple(TOP), 40), RectangularBar(0.01, 0.004), material,
              clamped={"top": [40]}, fixed=[0])  # fmt: skip
    cable = Cable("front", (ViaPoint(np.zeros(3)), ViaPoint(TOP, "top")), pulled_end="first")
    loads = (PointLoad("payload", "top", TOP, np.array([0.0, 0.0, -weight])),) if weight else ()
    return Robot(plates=(Plate("top", {}, TOP),), rods=(rod,), cables=(cable,), loads=loads)


def notched() -> Robot:
    """A block of 20 x 10 x 30 mm with a slot of 2 mm in the middle of its height, open to +x, where a cable closes
    it.
    """
    mesh = box_mesh([0.02, 0.01, 0.03], [8, 2, 15], origin=[-0.01, -0.005, 0.0])
    centre = mesh.points[mesh.tets].mean(axis=1)
    tets = mesh.tets[~((np.abs(centre[:, 2] - 0.015) < 1e-3) & (centre[:, 0] > -0.005))]
    used = np.unique(tets)
    mesh = TetMesh(mesh.points[used], np.searchsorted(used, tets))
    z, material = mesh.points[:, 2], {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
    body = Body("finger", mesh, np.flatnonzero(z < 1e-9), material, element="P1")
    top = Plate("top", {"finger": np.flatnonzero(z > 0.03 - 1e-9)}, np.array([0.0, 0.0, 0.03]))
    return Robot((body,), (top,), (Cable("front", (ViaPoint((0.014, 0, 0.03), "top"), ViaPoint((0.014, 0, 0)))),))


@pytest.mark.slow
@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_the_way_ends_before_a_column_buckles_at_eulers_load(control: str) -> None:
    for weight in (0.0, 0.05):
        step = softcal.reach(column(weight), {"top.z": 0.15}, controls=control).steps[0]
        assert step.outcome == "refused"
        assert "The way ends there: the robot buckles or snaps to another equilibrium" in step.status
        found = re.search(r"last safe commands on that way are .*front\.tension ([\d.]+) N(.*)", step.status)
        assert found, step.status
        assert float(found[1]) == pytest.approx(buckling_tension(weight), rel=2e-3)
        assert (", under payload.force 0.05 N" in found[2]) == bool(weight)


def buckling_tension(weight: float) -> float:
    """The tension T, from tip to foot, at which a cantilever with a dead weight W on its tip buckles: the moment
    (W + T)(w(L) - w(z)) - T w(L) (1 - z / L) bends it by EI w'', so that T sin(kL) / kL + W cos(kL) = 0,
    k^2 = (W + T) / EI.
    """

    def moment(T: float) -> float:
        kL = float(np.sqrt((weight + T) / EI)) * LENGTH
        return T * np.sin(kL) / kL + weight * np.cos(kL)

    return float(brentq(moment, 0.5 * (PINNED - weight), 1.001 * PINNED))


@pytest.mark.slow
def test_bodies_do_not_pass_through_themselves_and_contact_lets_them_go_on() -> None:
    wanted = {"top.pitch": 0.3}
    step = softcal.reach(notched(), wanted, controls="shortening").steps[0]
    assert step.outcome == "refused"
    found = re.search(r"finger intersects itself .*set contact: true\..*front\.shortening ([\d.]+) mm", step.status)
    assert found, step.status
    live = LiveTwin(notched(), "shortening")
    end = 1e-3 * float(found[1])
    assert not live.at({"front": 0.999 * end}).crossed
    assert live.at({"front": 1.01 * end}).crossed
    pressed = softcal.reach(replace(notched(), contact=Contact()), wanted, controls="shortening").steps[0]
    assert pressed.outcome == "reached", pressed.status


@pytest.mark.slow
def test_what_stands_in_an_obstacle_at_rest_or_is_wanted_there_is_said() -> None:
    with pytest.raises(softcal.ParameterError, match=r"the robot at rest is inside the obstacle.*tentacle by"):
        softcal.reach(TENTACLE, {"tip.x": 0.01}, obstacles={"ball": SphereObstacle((0.0, 0.0, -0.1), 0.03)})
    wanted, ball = {"tip.x": 0.03, "tip.y": 0.0, "tip.z": -0.105}, SphereObstacle((0.035, 0.0, -0.1), 0.012)
    step = softcal.reach(TENTACLE, wanted, obstacles={"ball": ball}).steps[0]
    assert step.outcome != "reached"
    assert "The place wanted of tip is inside ball, by 4.929 mm." in step.status
    told = softcal.reach(TENTACLE, wanted, obstacles={"ball": replace(ball, radius=0.004)}).steps[0].status
    assert "is inside" not in told
