"""States along a load path with friction and stretch: which branch it takes, where it starts, and where it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drum_case import MU, blocks, robot_over_a_drum, theta_of, walk
from mechanics_cases import column_robot, elastic, pulled, side_cable

import softcal.mechanics.tensions
from softcal.errors import ParameterError, SimulationError
from softcal.geometry.primitives import box_mesh
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.term import Controls
from softcal.twin.build import twin_of
from softcal.twin.cables import Cable, CableLine, ViaPoint
from softcal.twin.in_time import simulate_in_time
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Plate, Robot
from softcal.twin.schedule import Schedule, ramp
from softcal.twin.simulate import respond, simulate
from softcal.twin.time_settings import TimeSettings


@pytest.mark.parametrize("line", [{"friction_memory": True}, {"friction_speed": 0.01}])
def test_one_solve_does_not_take_friction_that_depends_on_the_slip(line):
    """Its one solve has the tangent without tension, which lacks the stiffness of the via points' friction."""
    robot = robot_over_a_drum(MU)
    robot = replace(robot, cables=(replace(robot.cables[0], line=CableLine(**line)),))
    with pytest.raises(ParameterError, match=r"front: one linear solve for each step .* scheme: converged"):
        simulate_in_time(robot, ramp({"front": ("tension", 1.0)}, 1.0), TimeSettings(scheme="one-solve"))


def test_tensions_that_are_not_found_are_a_state_that_failed(monkeypatch):
    system = blocks(12, stated=("stiffness", "presliding"))
    theta = theta_of(system, stiffness=300.0, presliding=1e-5)
    assert walk(system, theta, np.array([8e-3])).tension[0, 0] > 0.0
    monkeypatch.setattr(softcal.mechanics.tensions, "solve", lambda *_: 1)
    with pytest.raises(SimulationError, match=r"the tensions along a were not found at a pull of"):
        walk(system, theta, np.array([8e-3]))


def test_the_iteration_for_the_tensions_says_where_it_ends_without_them():
    """Friction of e^5 over five via points with next to no presliding, beside one that it finds."""
    ptr, n = np.array([0, 5, 10]), 10
    most, softness = np.full(n, 1.35), np.full(n, 2e-7)
    longer = np.array([1.0, -3.0, 2.0, -1.5, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0]) * 1e-4
    rho, sigma, slip = np.zeros(n), np.zeros(n), np.zeros(n)
    args = ptr, np.full(2, 1e5), np.zeros(2), most, softness, longer, np.zeros(n), np.full(2, 1e-16)
    args += np.zeros(2), np.zeros(n), rho, sigma, slip
    assert softcal.mechanics.tensions.solve(*args) == 1


def test_motion_starts_from_the_equilibrium_with_its_pretensions():
    """Nothing moves before the machine does: the column is shorter by its pretensions from the beginning."""
    sides = (side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.0)))
    lines = [replace(cable, line=CableLine(20.0, pretension=0.4)) for cable in sides]
    robot = column_robot(parameters=elastic(0.5e6, 0.4), density=1e3, cables=lines, divisions=(1, 1, 4))
    static = simulate(robot, pulled(0.0)).channels
    still = Schedule(np.array([0.0, 0.2]), pulled(0.0, 0.0).commands)
    moved = simulate_in_time(robot, still, TimeSettings(time_step=0.02))
    assert moved.succeeded, moved.status
    assert moved.channels["back.tension"][0] > 0.3
    for channel, values in static.items():
        np.testing.assert_allclose(moved.channels[channel], values[0], rtol=1e-6, atol=1e-10, err_msg=channel)
    let_go = Schedule(np.array([0.0, 0.2]), {"front": Command("tension", np.zeros(2))})
    begun = simulate_in_time(robot, let_go, TimeSettings(time_step=0.02)).channels
    assert begun["front.tension"][0] == 0.0  # commanded by its tension, it has none at zero


@pytest.mark.parametrize(
    "line", [{}, {"friction_memory": True}, {"stiffness": 1e9}, {"stiffness": 1e9, "friction_memory": True}]
)
def test_friction_increases_with_the_speed(line):
    """Pulled in at w without mass to speak of: the shape is that of the statics, and ln T is mu phi w / v larger."""
    v, w = 5e-3, 2e-3
    ideal = robot_over_a_drum(MU, law=elastic(0.5e6, 0.4))
    lines = [CableLine(**line), CableLine(**line, friction_speed=v)]
    slow, fast = (replace(ideal, cables=(replace(ideal.cables[0], line=one),)) for one in lines)
    fast = replace(fast, bodies=(replace(fast.bodies[0], density=1e-3),))
    times = np.array([0.0, 1.0, 2.0])
    commands = {"front": Command("shortening", w * times)}
    moved = simulate_in_time(fast, Schedule(times, commands), TimeSettings(0.02, 0.0, 0.0))
    assert moved.succeeded, moved.status
    static = simulate(slow, Protocol(commands), curve_tolerance=0.0)
    assert moved.channels["plate.pitch"][-1] == pytest.approx(static.channels["plate.pitch"][-1], rel=1e-5)
    via = np.array([p.at for p in fast.cables[0].via_points])
    via[0] = [moved.channels[f"plate.{c}"][-1] for c in "xyz"]
    pitch = moved.channels["plate.pitch"][-1]
    via[0] += 0.05 * np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
    u = np.diff(via, axis=0) / np.linalg.norm(np.diff(via, axis=0), axis=1)[:, None]
    phi = np.arccos(np.clip((u[1:] * u[:-1]).sum(axis=1), -1.0, 1.0)).sum()
    ratio = moved.channels["front.tension"][-1] / static.channels["front.tension"][-1]
    assert np.log(ratio) == pytest.approx(MU * phi * w / v, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("memory", [True, False])
def test_many_via_points_take_no_more_columns_than_the_unknowns_that_they_touch(memory):
    """And the tangent is that of the gradient: of sliding and of sticking via points, with stretch."""
    t = np.linspace(0.0, 1.0, 301)
    way = np.stack([0.01 * np.cos(np.pi * t), 0.01 * np.sin(np.pi * t), 0.095 - 0.09 * t], axis=1)
    via = (*(ViaPoint(at, "neck") for at in way), ViaPoint(np.array([-0.01, 0.0, -0.02])))
    line = CableLine(50.0, friction_memory=memory, presliding=1e-4 if memory else None)
    twin = twin_of(robot := column_robot(cables=(Cable("front", via, 0.3, line=line),), divisions=(2, 2, 4)))
    system, theta = twin.system, parameter_values(robot)
    layout, rng = system.layout, np.random.default_rng(3)
    n, driven = layout.first_effort_unknown, Controls(np.zeros(1, bool), np.zeros(1), np.array([2e-3]))
    bent = moved(layout, rest_state(layout), 1e-4 * rng.uniform(-1.0, 1.0, layout.n_unknowns))
    state = replace(bent, effort=np.ones(1))
    at = system.linearise(state, driven, theta)
    touched = np.count_nonzero(at.border.columns[:, 1:].any(axis=1))
    assert at.border.columns.shape[1] - 1 == touched < 300
    dz, h = rng.uniform(-1.0, 1.0, layout.n_unknowns), 1e-8
    ends = [system.linearise(moved(layout, state, s * h * dz), driven, theta).reduced for s in (1, -1)]
    found, want = system.tangent_times(at, dz[:, None])[:, 0], (ends[0] - ends[1]) / (2 * h)
    np.testing.assert_allclose(found[:n], want[:n], rtol=1e-5, atol=1e-6 * np.abs(want[:n]).max())
    np.testing.assert_allclose(found[n:], want[n:], rtol=1e-5)


@pytest.mark.parametrize(("stiffness", "tells"), [(1e8, True), (1e10, True), (1e12, False)])
def test_lines_too_stiff_to_share_a_load_depend_on_each_other(stiffness, tells):
    """Two cables side by side, the second twice as stiff: it bears twice as much, as far as numbers can tell."""
    side = side_cable("front", (0.05, 0.0))
    cables = [replace(side, name=name, line=CableLine(1.0)) for name in ("front", "beside")]
    twin = twin_of(robot := column_robot(cables=cables))
    theta = {**parameter_values(robot), "front.stiffness": stiffness, "beside.stiffness": 2.0 * stiffness}
    both = Protocol({name: Command("shortening", np.array([0.004])) for name in ("front", "beside")})
    found = respond(twin, theta, both)
    assert found.succeeded is tells, found.status
    if tells:
        tension = found.channels["beside.tension"][0] / found.channels["front.tension"][0]
        assert tension == pytest.approx(2.0, rel=1e-6)
    else:
        assert "The shortenings of front and beside depend on each other here" in found.status


@pytest.mark.parametrize("away", [0.02, 0.15, 3.0])
def test_a_robot_whose_nodes_are_all_on_its_plate_is_solved_however_far_its_drum_is(away: float):
    """A brick between the ground and a plate has no free point; a quarter of a drum above it, and the machine beyond.
    The tension at the plate is the brick's at every shortening; at the machine it is larger, and as the cable is let go
    smaller, by the drum's factor.
    """
    mesh = box_mesh((0.02, 0.02, 0.02), (1, 1, 1), origin=(-0.01, -0.01, 0.0))
    body = Body("brick", mesh, mesh.node_sets["z0"], elastic(1e6, 0.45), element="P1")
    angle = np.linspace(0.0, 0.5 * np.pi, 10)
    arc = [0.0, 0.0, 0.02 + away] + 0.02 * np.column_stack([1.0 - np.cos(angle), 0.0 * angle, np.sin(angle)])
    via = ([0.0, 0.0, 0.02], *arc.tolist(), [0.12, 0.0, 0.04 + away])
    points = (ViaPoint(via[0], "plate"), *(ViaPoint(at) for at in via[1:]))
    cable = Cable("front", points, 0.3, line=CableLine(friction_memory=True))
    robot = Robot((body,), (Plate("plate", {"brick": mesh.node_sets["z1"]}, via[0]),), (cable,))
    way = 1e-3 * np.array([0.0, 1.0, 2.0, 2.0, 1.0, 2.0])
    response = simulate(robot, Protocol({"front": Command("shortening", way)}))
    assert response.succeeded, response.status
    tension = response.channels["front.tension"]
    assert tension[2] > 1.5 * tension[1] > 100.0
    assert tension[[3, 5]] == pytest.approx(tension[2], rel=1e-9)
    assert tension[4] == pytest.approx(np.exp(-0.3 * np.pi) * tension[1], rel=1e-6)
