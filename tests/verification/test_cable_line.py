"""A cable's line: stretch and pretension in closed form, and friction that reverses, over a drum."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drum_case import LEAD, MU, WRAP, K, blocks, drum, robot_over_a_drum, theta_of, walk, with_slip
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed

from softcal.mechanics.cable import cables_of
from softcal.mechanics.damping import Damping
from softcal.mechanics.dynamics import Dynamics
from softcal.mechanics.memory import Memory
from softcal.mechanics.statics import Statics
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import at_rest
from softcal.twin.build import twin_of
from softcal.twin.cables import Cable, CableLine, ViaPoint
from softcal.twin.in_time import simulate_in_time
from softcal.twin.masses import robot_inertia
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import respond, simulate
from softcal.twin.start import loaded
from softcal.twin.time_settings import Settling, TimeSettings

DELTA = 1e-5
STRETCH = {"stiffness": 500.0, "compliance": 1e-3, "pretension": 1.5}


def test_a_line_that_stretches_is_a_spring_in_series():
    """T = (d + T0 C) / (1/K + C), C = L0/EA + c: the block's spring, the line and the machine, and a pretension."""
    system = blocks(0, stated=tuple(STRETCH))
    d = np.array([0.0, 2e-3, 11e-3])
    found = walk(system, theta_of(system, **STRETCH), d)
    C = 2.0 * LEAD / STRETCH["stiffness"] + STRETCH["compliance"]
    np.testing.assert_allclose(found.tension[:, 0], (d + STRETCH["pretension"] * C) / (1.0 / K + C), rtol=1e-9)
    np.testing.assert_allclose(K * found.way[:, 0], found.tension[:, 0], rtol=1e-9)


def test_a_cable_along_a_bar_presses_it_as_two_springs_in_series_do():
    """T = d / (L / EA of the bar + L0 / EA of the line): the bar's law is Hooke's at 1e-5 of strain."""
    E, EA, d = 1e7, 3e3, 1e-6
    via = (ViaPoint(np.array([0.0, 0.0, 0.1]), "plate"), ViaPoint(np.zeros(3)))
    cable = Cable("front", via, line=CableLine(EA))
    found = simulate(column_robot(parameters=elastic(E, 0.0), cables=(cable,)), pulled(d), curve_tolerance=0.0)
    T = d / (0.1 / (E * 0.03**2) + 0.1 / EA)
    assert found.channels["front.tension"][0] == pytest.approx(T, rel=1e-4)
    assert found.channels["plate.z"][0] - 0.1 == pytest.approx(-T * 0.1 / (E * 0.03**2), rel=1e-4)


@pytest.mark.parametrize("memory", [False, True])
def test_a_line_that_stretches_adds_its_stretch_to_the_shortening(memory):
    """At one tension the robot has one shape: in a column, round a drum, with the stretch of every segment."""
    ideal = robot_over_a_drum(MU)
    line = CableLine(2e3, compliance=1e-4, friction_memory=memory, presliding=1e-8 if memory else None)
    soft = replace(ideal, cables=(replace(ideal.cables[0], line=line),))
    T = np.array([0.5, 1.0, 2.0])
    one, other = (simulate(r, tensed(*T), curve_tolerance=0.0) for r in (ideal, soft))
    via = np.array([p.at for p in ideal.cables[0].via_points])
    v = np.diff(via, axis=0)
    lengths = np.linalg.norm(v, axis=1)
    turn = np.arccos(np.clip((v[1:] * v[:-1]).sum(axis=1) / lengths[1:] / lengths[:-1], -1, 1))
    beyond = np.append(np.cumsum(turn[::-1])[::-1], 0.0)  # between each segment and the machine, at rest
    for channel in ("plate.pitch", "plate.x"):
        np.testing.assert_allclose(other.channels[channel], one.channels[channel], rtol=1e-5)
    stretch = other.channels["front.shortening"] - one.channels["front.shortening"]
    at_rest = T * (lengths @ np.exp(-MU * beyond) / 2e3 + 1e-4)
    np.testing.assert_allclose(stretch, at_rest, rtol=2e-3)  # the plate's end swings


@pytest.mark.parametrize("drive", [pulled, tensed])
@pytest.mark.parametrize("friction", [0.0, MU])
def test_a_stiff_line_is_one_without_stretch(drive, friction):
    ideal = robot_over_a_drum(friction)
    stiff = replace(ideal, cables=(replace(ideal.cables[0], line=CableLine(1e10, compliance=1e-12)),))
    command = drive(0.004, 0.012) if drive is pulled else drive(0.6, 1.6)
    one, other = (simulate(r, command, curve_tolerance=0.0).channels for r in (ideal, stiff))
    for channel, values in one.items():
        np.testing.assert_allclose(other[channel], values, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("way", [pulled(3e-3, 8e-3, 7.9e-3, 4e-3, 6e-3), tensed(0.5, 1.5, 1.45, 0.8, 1.2)])
def test_so_is_one_whose_friction_has_a_memory(way):
    """Loaded, let go and loaded again."""
    one, other = (simulate(remembering(**line), way).channels for line in ({}, {"stiffness": 1e10}))
    for channel, values in one.items():
        np.testing.assert_allclose(other[channel], values, rtol=1e-8, atol=1e-10, err_msg=channel)


def stick(x: np.ndarray, turned: np.ndarray, sign: float) -> np.ndarray:
    """Tension at a block's way x, slipped back by `turned` since it slid all the way with `sign` (+1: pulled)."""
    sigma = np.clip(sign * (1.0 - turned / DELTA), -1.0, 1.0)
    return K * x * np.exp(MU * WRAP * sigma)


@pytest.mark.parametrize("n", [3, 30, 1000])
def test_the_loop_over_a_drum_is_that_of_the_closed_form(n):
    """Both branches, the two stick phases, the area, and the state that a closed cycle returns to."""
    low, high = 4e-3, 12e-3
    down = np.concatenate([high - DELTA * np.linspace(0.0, 2.0, 21), [0.5 * (low + high), low]])
    up = np.concatenate([low + DELTA * np.linspace(0.0, 2.0, 21), [0.5 * (low + high), high]])
    system = blocks(n, stated=("presliding",))
    found = walk(system, theta_of(system, presliding=DELTA), np.concatenate([[high], down, up, down, up]))
    expected = np.concatenate(
        [[K * high * np.exp(MU * WRAP)], stick(down, high - down, 1.0), stick(up, up - low, -1.0)]
    )
    T, m = found.tension[:, 0], 1 + len(down) + len(up)
    np.testing.assert_allclose(T[:m], expected, rtol=1e-7)
    np.testing.assert_allclose(T[m : 2 * m - 1], T[1:m], rtol=1e-9)  # the second cycle
    before, after = (found.reached[i].state.memory.values for i in (m - 1, -1))
    np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-12)
    area = np.trapezoid(T[m - 1 : 2 * m - 1], found.shortening[m - 1 : 2 * m - 1, 0])
    e = MU * WRAP
    # Of the triangles K x^2 / 2, less the corners where it sticks: K x exp(+-e (1 - u / delta)) over u to 2 delta.
    slide = 0.5 * K * (np.exp(e) * (high**2 - (low + 2 * DELTA) ** 2) - np.exp(-e) * ((high - 2 * DELTA) ** 2 - low**2))
    u = np.linspace(0.0, 2.0 * DELTA, 20001)
    sticks = np.trapezoid(stick(low + u, u, -1.0), u) - np.trapezoid(stick(high - u, u, 1.0), u)
    assert area == pytest.approx(slide + sticks, rel=1e-6)


@pytest.mark.parametrize("line", [{}, {"presliding": DELTA}, {"presliding": DELTA, "stiffness": 1e9}])
def test_a_preload_is_a_constant_part_of_the_friction(line):
    """L(T) = L(K x) e^(+- mu phi): far above a / 10, T changes by a (e^(+- mu phi) - 1). A slack cable is slack."""
    a, d = 0.02, 1e-3 * np.array([4.0, 12.0, 8.0, 4.0])
    system = blocks(30, stated=("friction_preload", *line))
    found = walk(system, theta_of(system, friction_preload=a, **line), d)
    T, F = found.tension[:, 0], K * found.way[:, 0]
    e = np.exp(MU * WRAP * (np.array([1, 1, -1, -1]) if line else np.ones(4)))
    np.testing.assert_allclose(T + a * T / (T + a / 10), e * (F + a * F / (F + a / 10)), rtol=1e-7)
    np.testing.assert_allclose(T - F * e, a * (e - 1.0), rtol=5e-3)
    slack = walk(system, theta_of(system, friction_preload=5.0, **line), np.array([1e-3, 0.0]))
    np.testing.assert_allclose([slack.tension[1], slack.way[1]], 0.0, atol=1e-5)


@pytest.mark.parametrize("n", [3, 30, 300])
def test_a_line_that_stretches_sticks_as_long_as_its_tensions_need(n):
    """Coulomb's limit: the block stays until every via point slides back, T0 exp(-mu phi) at the pulled end."""
    EA, high = 300.0, 12e-3
    system = blocks(n, stated=("stiffness", "presliding"))
    theta = theta_of(system, stiffness=EA, presliding=1e-9)
    via = np.vstack([[-LEAD, 0.0, 0.0], drum(n)])
    v = np.diff(via, axis=0)
    lengths = np.linalg.norm(v, axis=1)
    turn = np.arccos(np.clip((v[1:] * v[:-1]).sum(axis=1) / lengths[1:] / lengths[:-1], -1, 1))
    angle = np.append(np.cumsum(turn[::-1])[::-1], 0.0)
    T0 = K * high * np.exp(MU * angle[0])
    top = high + T0 * (lengths @ np.exp(-MU * angle)) / EA
    whole = T0 * (lengths @ (np.exp(-MU * angle) - np.exp(MU * (angle - 2.0 * angle[0])))) / EA
    found = walk(system, theta, np.array([top, top - 0.5 * whole, top - 0.999 * whole, top - 1.2 * whole]))
    np.testing.assert_allclose(found.way[:3, 0], high, rtol=1e-6)
    assert found.tension[0, 0] == pytest.approx(T0, rel=1e-6)
    assert found.tension[2, 0] == pytest.approx(T0 * np.exp(-2.0 * MU * angle[0]), rel=1e-3)
    assert found.way[3, 0] < high - 1e-4
    # All of it slides back: spring, and line, as when it is let go.
    ratio = np.exp(-MU * angle[0])
    slides = (top - 1.2 * whole) / (1.0 + K * (lengths @ np.exp(MU * (angle - angle[0]))) / EA)
    assert found.way[3, 0] == pytest.approx(slides, rel=1e-6)
    assert found.tension[3, 0] == pytest.approx(K * slides * ratio, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [None, 300.0])
def test_energy_is_lost_and_never_made(stiffness):
    """On a random way: the machine's work less what spring, line and presliding store never decreases."""
    line = {"presliding": 2e-4} | ({} if stiffness is None else {"stiffness": stiffness})
    system = blocks(12, stated=tuple(line))
    theta = theta_of(system, **line)
    corners = 1e-3 * np.array([0.5, 8.0, 5.0, 6.0, 5.5, 11.0, 2.0, 9.0, 8.5, 9.5])
    d = np.concatenate([np.linspace(a, b, 30)[1:] for a, b in pairwise(corners)])
    found = walk(system, theta, d)
    T = np.concatenate([[0.0], found.tension[:, 0]])
    work = np.cumsum(0.5 * (T[1:] + T[:-1]) * np.diff(np.concatenate([[0.0], d])))
    stored = []
    for one in found.reached:
        along = with_slip(one, theta, system)
        stored.append(0.5 * along.softness @ along.segments**2)
    stored = 0.5 * K * found.way[:, 0] ** 2 + np.array(stored)
    lost = work - stored
    sliding = 0.5 * theta["a.presliding"] * MU * WRAP * T.max()  # most that presliding stores
    assert lost[-1] > 10.0 * sliding
    assert np.all(np.maximum.accumulate(lost) - lost < sliding)


@pytest.mark.slow
@given(
    corners=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=5),
    mu=st.floats(0.02, 0.6),
    presliding=st.floats(1e-4, 1e-3),
    stiffness=st.sampled_from([None, 100.0, 1e4]),
)
@settings(max_examples=15, deadline=None)
def test_a_closed_way_takes_energy_and_comes_back_to_its_state(corners, mu, presliding, stiffness):
    """Once as far as it goes, every closed way ends with the tensions that it began with, and never gains work: what
    spring and line do not store is lost by the drop of tension at every via point on what slips there, by the memory,
    and on what slides back, by the tensions alone.
    """
    line = {"presliding": presliding} | ({} if stiffness is None else {"stiffness": stiffness})
    system = blocks(6, stated=tuple(line))
    theta = theta_of(system, friction_coefficient=mu, **line)
    turns = np.array([12.0, *(2.0 + 9.0 * x for x in corners), 12.0])
    d = 1e-3 * np.interp(np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, len(turns)), turns)
    found = walk(system, theta, np.concatenate([d, d[1:]]))
    T, low = found.tension[:, 0], 1e-6 * found.tension.max()
    np.testing.assert_allclose(T[40:], T[:41], rtol=1e-8, atol=low)
    np.testing.assert_allclose(found.reached[80].state.memory.values, found.reached[40].state.memory.values, atol=1e-10)
    # Between samples T is monotonous: the work is below that of the upper staircase.
    steps = np.diff(d)
    most = np.where(steps > 0.0, np.maximum(T[1:41], T[:40]), np.minimum(T[1:41], T[:40])) @ steps
    assert most > -low * np.abs(steps).sum()

    work = 0.5 * (T[1:] + T[:-1]) * np.diff(found.shortening[:, 0])
    memories = [one.state.memory.values for one in found.reached]
    memories = [np.zeros_like(memories[0]), *memories]  # of the spring, which does not yield, and of the cable
    courses = [_with_memory(one, before, theta, system) for one, before in zip(found.reached, memories, strict=False)]
    along = np.array([one.segments for one in courses])
    stored = 0.5 * K * found.way[:, 0] ** 2 + 0.5 * along**2 @ courses[0].softness
    drop = along[:, :-1] - along[:, 1:]
    elastic_slip = presliding * np.log(along[:, 1:] / along[:, :-1]) / (mu * courses[0].course.turns.phi[1:])
    slipped = -np.diff(np.array(memories[1:])[:, -drop.shape[1] :], axis=0)
    lost = 0.5 * (drop[1:] + drop[:-1]) * (slipped - np.diff(elastic_slip, axis=0))
    np.testing.assert_allclose(work, np.diff(stored) + lost.sum(axis=1), rtol=0.0, atol=1e-8 * np.abs(work).max())
    assert (drop[1:] * slipped).min() >= -1e-9 * np.abs(work).max()


def _with_memory(reached, memory: np.ndarray, theta, system):
    """The tensions along the cables at a sample, with the memory that it began with."""
    return with_slip(replace(reached, state=replace(reached.state, memory=Memory(memory, {}))), theta, system)


def test_a_reversal_of_one_of_three_cables_leaves_the_others():
    system = blocks(12, 3, stated=("presliding",))
    theta = theta_of(system, presliding=DELTA)
    d = 1e-3 * np.array([[4, 4, 4], [8, 8, 6], [9, 6, 6], [10, 5, 6.0 + 1e3 * DELTA]])
    T = walk(system, theta, d).tension
    e = np.exp(MU * WRAP)
    np.testing.assert_allclose(T[2], K * d[2] * [e, 1 / e, e], rtol=1e-7)
    np.testing.assert_allclose(T[3], K * d[3] * [e, 1 / e, e], rtol=1e-7)


def remembering(**line: float) -> Robot:
    robot = robot_over_a_drum(MU, law=elastic(0.5e6, 0.4))
    own = CableLine(friction_memory=True, **{"presliding": 1e-4, **line})
    return replace(robot, cables=(replace(robot.cables[0], line=own),))


WAYS = {
    "shortening": pulled(*1e-3 * np.array([3.0, 8.0, 7.95, 6.0, 3.0, 3.05, 5.0, 9.0])),
    "tension": tensed(0.5, 1.5, 2.0, 1.9, 1.2, 0.6, 0.7, 1.4),
}


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_sensitivities_through_a_cycle_are_the_differences(way, monkeypatch):
    """Loaded, let go and loaded again, with samples where it sticks."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = remembering(stiffness=2e3, compliance=1e-4, pretension=0.05, friction_preload=0.3)
    known = parameter_values(robot)
    own = ("friction_coefficient", "stiffness", "compliance", "pretension", "presliding", "friction_preload")
    names = ("neck.youngs_modulus", *(f"front.{kind}" for kind in own))
    exact = simulate(robot, WAYS[way], sensitivities=names)
    assert exact.succeeded, exact.status
    for name in names:
        h = 2e-4 * known[name]
        ends = [simulate(robot, WAYS[way], {name: known[name] + s * h}).channels for s in (1, -1)]
        for channel in ("front.tension", "front.shortening", "plate.pitch", "plate.x"):
            want = (ends[0][channel] - ends[1][channel]) / (2 * h)
            got = exact.sensitivities[channel][name]
            np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-5 * np.abs(want).max() + 1e-10, err_msg=name)


def test_a_cable_with_a_pretension_that_nothing_drives_stays():
    sides = (side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0)))
    lines = [replace(cable, line=CableLine(20.0, pretension=0.4)) for cable in sides]
    robot = column_robot(parameters=elastic(0.5e6, 0.4), cables=lines)
    held = simulate(robot, pulled(0.0, 0.004))
    assert held.succeeded, held.status
    assert held.channels["plate.pitch"][0] == pytest.approx(0.0, abs=1e-9)
    assert 0.3 < held.channels["back.tension"][0] < 0.4  # the column gives way a little
    assert held.channels["back.tension"][1] > held.channels["back.tension"][0]
    at_zero = Protocol(
        {name: Command("shortening", np.array(v)) for name, v in (("front", [0, 0.004]), ("back", [0, 0]))}
    )
    for channel, values in simulate(robot, at_zero).channels.items():
        np.testing.assert_allclose(held.channels[channel], values, rtol=1e-9, atol=1e-12)


def test_in_time_a_cable_with_a_pretension_comes_to_rest_as_in_the_statics():
    sides = (side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0)))
    lines = [replace(cable, line=CableLine(20.0, pretension=0.4)) for cable in sides]
    robot = column_robot(parameters=elastic(0.5e6, 0.4), density=1e3, cables=lines, divisions=(1, 1, 4))
    static = simulate(robot, pulled(0.004)).channels
    schedule = Schedule(np.array([0.0, 0.5]), pulled(0.0, 0.004).commands)
    settings = TimeSettings(time_step=0.05, settle=Settling(speed=1e-7, longest=20.0))
    moved = simulate_in_time(robot, schedule, settings)
    assert moved.succeeded, moved.status
    for channel, values in static.items():
        assert moved.channels[channel][-1] == pytest.approx(values[0], rel=1e-3, abs=1e-7)


def test_a_pretension_that_buckles_the_robot_is_a_state_with_a_sentence():
    sides = [side_cable(f"c{i}", at) for i, at in enumerate(((0.01, 0.0), (-0.01, 0.0)))]
    lines = [replace(cable, line=CableLine(compliance=1.0, pretension=40.0)) for cable in sides]
    found = simulate(column_robot(parameters=elastic(0.5e6, 0.4), cables=lines), pulled(0.0, cable="c0"))
    assert found.succeeded, found.status
    assert "Not stable before sample 1" in found.status
    assert abs(found.channels["plate.pitch"][0]) > 0.1


def test_slow_motion_reverses_as_the_statics_do():
    robot = remembering(stiffness=2e3)
    robot = replace(robot, bodies=(replace(robot.bodies[0], density=1e3),))
    twin, theta = twin_of(robot), parameter_values(robot)
    shortenings = WAYS["shortening"].commands["front"].values
    static = respond(twin, theta, WAYS["shortening"]).channels["front.tension"]
    dynamics = Dynamics(twin.system, robot_inertia(twin, robot), theta, Damping())
    now, tensions = at_rest(loaded(twin, Statics(twin.system, theta)).state), []
    for d in shortenings:
        controls = Controls(np.zeros(1, bool), np.zeros(1), np.array([d]))
        now = dynamics.advance(now, 30.0, lambda time, controls=controls: controls)
        tensions.append(now.state.effort[0])
    np.testing.assert_allclose(tensions, static, rtol=1e-6)


def test_a_line_that_gives_way_has_no_redundant_drive():
    """Two cables along one way: without stretch their tensions cannot be told apart."""
    side = side_cable("front", (0.05, 0.0))
    line = CableLine(1e3)
    robot = column_robot(cables=(replace(side, line=line), replace(side, name="beside", line=line)))
    both = Protocol({name: Command("shortening", np.array([0.004])) for name in ("front", "beside")})
    found = simulate(robot, both)
    assert found.succeeded, found.status
    assert found.channels["front.tension"][0] == pytest.approx(found.channels["beside.tension"][0], rel=1e-9)
    assert cables_of(twin_of(robot).system).stated == ("front.stiffness", "beside.stiffness")
