"""Workspaces: against the zonotope of small motions, brute search over commands, a fold, obstacles, buckling."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pytest
from soft_robots import COLUMN, ROUGH, TENDONS, TENTACLE

import softcal
from softcal.analysis.workspace import FOLD, Workspace, workspace_sentences
from softcal.geometry.centreline import straight
from softcal.geometry.obstacle import HalfSpace
from softcal.geometry.section import RoundBar
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.drive import Drive
from softcal.twin.live import LiveTwin
from softcal.twin.robot import Cable, Plate, Robot, Rod, ViaPoint

PLANE = ("tip.x", "tip.y")
SPINE = Rod(
    "spine",
    straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 6),
    RoundBar(0.003),
    {"youngs_modulus": 1e9, "poissons_ratio": 0.35},
    clamped={"tip": np.array([6])},
    fixed=np.array([0]),
)
DRIVEN = Robot(
    rods=(SPINE,),
    plates=(Plate("tip", {}, np.array([0.0, 0.0, 0.1])),),
    cables=tuple(
        Cable(name, (ViaPoint(np.array([x, 0.0, 0.0])), ViaPoint(np.array([x, 0.0, 0.1]), "tip")), pulled_end="first")
        for name, x in (("left", 0.01), ("right", -0.01))
    ),
    actuators=(NamedActuator("servo", Drive({"left": 1.0, "right": -1.0}, 0.008, spring_rate=2e3, pretension=1.5)),),
)


def holds(found: Workspace, place: Sequence[float], larger: float = 1.0) -> bool:
    """Whether a simplex of a workspace, drawn so many times larger about its middle, holds a place."""
    middle = found.places.mean(axis=0)
    corners = (middle + larger * (found.places - middle))[np.array(found.simplices)]
    edges = (corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1)
    shares = np.linalg.solve(edges, (np.array(place) - corners[:, 0])[..., None])[..., 0]
    return bool(np.any((shares >= 0.0).all(axis=1) & (shares.sum(axis=1) <= 1.0)))


@pytest.mark.parametrize(
    "channels", [("tip.x",), PLANE, pytest.param(("tip.x", "tip.y", "tip.z"), marks=pytest.mark.slow)]
)
def test_small_motions_have_the_zonotope_of_their_derivatives(channels: tuple[str, ...]) -> None:
    # The image of a box by a linear map: a sum of segments, whose size is that of all its parallelotopes.
    most, live = 2e-3, LiveTwin(TENTACLE, "tension")
    rates = live.at(dict.fromkeys(TENDONS, 0.5 * most)).by_commands().of(channels)
    exact = sum(abs(np.linalg.det(rates[:, list(each)])) for each in combinations(range(3), len(channels)))
    found = softcal.workspace(TENTACLE, channels, limits={"tension": (0.0, most)}, states=128)
    assert found.size == pytest.approx(exact * most ** len(channels), rel=1e-3 if len(channels) < 3 else 0.03)
    centre = found.places.mean(axis=0)
    for k in found.border:
        # On the border some normal has no command that leads further along it.
        normal = found.places[k] - centre
        assert normal @ rates @ np.array([*found.states[k].commands.values()]) <= np.maximum(
            normal @ rates, 0.0).sum() * most * (1.0 + 1e-3)  # fmt: skip
        assert all("limit" in limit for limit in found.states[k].limits)


def test_the_mobility_is_that_of_the_derivatives_and_the_compliance_that_of_a_force() -> None:
    found = softcal.workspace(TENTACLE, PLANE, limits={"tension": (0.0, 1.5)}, states=16)
    live, state = LiveTwin(TENTACLE, "tension"), found.states[3]
    at = live.at({name.partition(".")[0]: value for name, value in state.commands.items()})
    scaled = at.by_commands().of(PLANE) * 1.5 / live.extent
    assert state.mobility == pytest.approx(np.sqrt(np.linalg.eigvalsh(scaled @ scaled.T))[::-1].tolist(), rel=1e-6)
    assert state.manipulability == pytest.approx(np.sqrt(np.linalg.det(scaled @ scaled.T)), rel=1e-6)
    assert state.compliances == pytest.approx(
        {name: 1.0 / at.stiffnesses(f"{name}_stiffness")[f"{name}_stiffness"] for name in PLANE}, rel=1e-6)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_no_commands_lead_out_of_it_and_all_of_it_is_reached(control: str) -> None:
    limits = {control: (0.0, 2.0 if control == "tension" else 0.008)}
    found = softcal.workspace(TENTACLE, PLANE, controls=control, limits=limits, states=64)
    random, live, spans = np.random.default_rng(4), LiveTwin(TENTACLE, control), np.ptp(found.places, axis=0)
    for share in random.random((60, 3)) ** 0.5:
        state = live.at(dict(zip(TENDONS, (share * limits[control][1]).tolist(), strict=True)))
        assert holds(found, (state.channels["tip.x"], state.channels["tip.y"]), 1.01), share
    inside = [y for y in found.places.min(axis=0) + random.random((40, 2)) * spans if holds(found, y)]
    for y in inside[:8]:
        (step,) = softcal.reach(
            TENTACLE, dict(zip(PLANE, y.tolist(), strict=True)), controls=control, limits=limits
        ).steps
        assert step.outcome == "reached", step.status


def test_a_fold_ends_it_and_is_a_singular_pose() -> None:
    # A drive bends a rod to both sides: its tip is highest where it is straight, and there it loses its only direction.
    most = np.radians(40.0)
    channel, by = ("tip.z",), {"servo": "angle"}
    found = softcal.workspace(DRIVEN, channel, controls=by, limits={"angle": (-most, most)})
    live = LiveTwin(DRIVEN, by)
    ends = [live.at({"servo": angle}).channels["tip.z"] for angle in (0.0, -most, most)]
    assert found.places.max() == pytest.approx(ends[0], abs=1e-6)
    assert found.places.min() == pytest.approx(min(ends[1:]), abs=1e-9)
    (pose,) = found.singular
    assert pose.commands["servo.angle"] == pytest.approx(0.0, abs=2e-3)
    assert "At 1 pose the robot loses a direction" in " ".join(workspace_sentences(found))
    beside = softcal.workspace(DRIVEN, channel, controls=by, limits={"angle": (0.5 * most, most)})
    assert not beside.singular
    assert "No singular pose" in " ".join(workspace_sentences(beside))


@pytest.mark.parametrize("states", [3, 4, 6])
def test_few_states_end_at_the_fold_as_well(states: int) -> None:
    # The drive pulls to both sides: its torque has no limit that nobody stated.
    most, by = np.radians(40.0), {"servo": "angle"}
    found = softcal.workspace(DRIVEN, ["tip.z"], controls=by, limits={"angle": (-most, most)}, states=states)
    straight_up = LiveTwin(DRIVEN, by).at({"servo": 0.0}).channels["tip.z"]
    assert found.places.max() == pytest.approx(straight_up, abs=1e-6)
    assert [found.states[k].limits for k in found.border if found.places[k] > 0.099] == [(FOLD,)]
    assert all("torque" not in limit for k in found.border for limit in found.states[k].limits)
    told = " ".join(workspace_sentences(found))
    assert "a singular pose, no limit (1)" in told
    assert "No singular pose" not in told
    assert found.least.mobility[-1] == min(state.mobility[-1] for state in (*found.states, found.least))


@pytest.mark.long
def test_limits_of_channels_and_obstacles_cut_it() -> None:
    limits = {"tension": (0.0, 2.0)}
    free = softcal.workspace(TENTACLE, PLANE, limits=limits, states=32)
    middle = float(free.places[:, 0].mean())
    cut = softcal.workspace(TENTACLE, PLANE, limits=limits | {"tip.x": (-1.0, middle)}, states=32)
    assert cut.places[:, 0].max() == pytest.approx(middle, abs=2e-5)
    assert any("tip.x at its upper limit" in limit for k in cut.border for limit in cut.states[k].limits)
    assert cut.n_outside
    assert "lead beyond another limit or into an obstacle" in " ".join(workspace_sentences(cut))
    wall = HalfSpace(np.array([free.places[:, 0].max() + 7e-3, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    walled = softcal.workspace(TENTACLE, PLANE, limits=limits, obstacles={"wall": wall}, states=32)
    assert any("touches wall" in limit for k in walled.border for limit in walled.states[k].limits)
    assert walled.size < 0.98 * free.size
    assert "beyond another limit" not in " ".join(workspace_sentences(free))


@pytest.mark.long
def test_a_column_ends_where_it_buckles() -> None:
    # All cables together compress it; Euler's load is an end that no limit states.
    found = softcal.workspace(COLUMN, ("plate.z",), limits={"tension": (0.0, 400.0)}, states=32)
    told = " ".join(workspace_sentences(found))
    assert "buckles or snaps" in told
    assert found.refused


@pytest.mark.slow
def test_a_robot_that_remembers_is_pulled_from_rest_each_time() -> None:
    found = softcal.workspace(ROUGH, PLANE, limits={"tension": (0.0, 1.0)}, states=8)
    live = LiveTwin(ROUGH, "tension")
    for state in found.states:
        live.reset()
        at = live.at({name.partition(".")[0]: value for name, value in state.commands.items()})
        assert [at.channels[name] for name in PLANE] == pytest.approx([*state.channels.values()], abs=1e-9)
    assert "No compliances: " in " ".join(workspace_sentences(found))
