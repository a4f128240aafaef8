"""Commands for wanted poses: reachable targets are reached, others answered by the nearest state, on the exact twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, side_cable
from soft_robots import TENDONS, tentacle

import softcal
from benchmarks.reach import Case, against_brute, cases, drawn, found, posed
from softcal.analysis.reach import ReachStep
from softcal.twin.cables import CableLine
from softcal.twin.live import LiveTwin

COLUMN = column_robot(
    "P1", cables=tuple(side_cable(f"c{k}", (0.05 * np.cos(2 * k), 0.05 * np.sin(2 * k))) for k in range(3))
)
TENTACLE = tentacle("P1")
ROUGH = replace(
    TENTACLE,
    cables=tuple(replace(c, friction_coefficient=0.1, line=CableLine(friction_memory=True)) for c in TENTACLE.cables),
)
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


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neck, 1 cable", "neck, 3 cables by shortening"])
def test_the_nearest_state_is_as_near_as_that_of_a_brute_search(name: str) -> None:
    case = next(one for one in cases() if one.name == name)
    assert against_brute(case, drawn(case, 5), 64) == ["5 of 5", "0"]
