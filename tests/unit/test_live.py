"""The live twin: states as those of `simulate`, in any order, and what it does where there is none."""

from dataclasses import replace
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from manipulator_case import CABLES, manipulator
from mechanics_cases import column_robot, elastic, mirrored_box, side_cable
from soft_robots import tentacle

from softcal.errors import ParameterError
from softcal.mechanics import statics
from softcal.mechanics.state import moved, rest_state
from softcal.mechanics.term import Controls
from softcal.mechanics.trail import Trail
from softcal.twin.build import build_twin
from softcal.twin.cables import Cable, CableLine, ViaPoint
from softcal.twin.live import LiveTwin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

FRONT, BACK = side_cable("front", (0.05, 0.0)), side_cable("back", (-0.05, 0.01))
ROBOT = column_robot("P2P1", divisions=(1, 1, 3))
TWO = column_robot(
    "P1", divisions=(1, 1, 4), cables=(FRONT, BACK), gravity=(0.0, 0.0, -9.81), density=1000.0, mass=0.05
)


def simulated(robot, controls, commands, theta=None):
    """The channels of `simulate` at some commands by cable, without the error that its tolerance leaves."""
    protocol = Protocol({name: Command(controls[name], np.array([value])) for name, value in commands.items()})
    with mock.patch.object(statics, "TOLERANCE", 1e-12):
        response = simulate(robot, protocol, theta, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return {name: values[-1] for name, values in response.channels.items()}


def assert_same(state, expected, units, rtol=1e-9):
    """Equal to a share of the largest channel of each unit."""
    assert state.succeeded, state.status
    assert list(state.channels) == list(expected)
    for unit in set(units.values()):
        names = [name for name in expected if units[name] == unit]
        got, wanted = (np.array([of[name] for name in names]) for of in (state.channels, expected))
        np.testing.assert_allclose(got, wanted, rtol=0.0, atol=rtol * max(np.abs(wanted).max(), 1e-3))


@pytest.mark.parametrize("order", [1, -1])
def test_states_are_those_of_simulate_in_both_orders(order):
    live = LiveTwin(ROBOT)
    pulls = [0.0, 0.004, 0.0041, 0.0043, 0.0042, 0.02, 0.0202][::order]
    states = [live.at({"front": d}) for d in pulls]
    for d, state in zip(pulls, states, strict=True):
        assert_same(state, simulated(ROBOT, {"front": "shortening"}, {"front": d}), live.units)
        assert state.commands == {"front": d}
    assert sum(state.n_iterations > 0 for state in states) >= 4


def test_small_steps_need_no_factorisation():
    live = LiveTwin(ROBOT)
    live.at({"front": 0.01})
    live.at({"front": 0.0101})
    states = [live.at({"front": d}) for d in 0.0101 + np.arange(1, 9) * 5e-5]
    assert sum(state.n_factorisations for state in states) == 0
    assert all(0 < state.n_iterations < 6 and "iterations" in state.status for state in states)


def test_the_last_equilibria_predict_the_next_one():
    live = LiveTwin(ROBOT)
    states = [live.at({"front": d}) for d in 0.01 + 0.001 * np.sin(np.arange(40) / 12.0)]
    assert np.mean([state.n_iterations for state in states[8:]]) < 2.5


def test_they_predict_it_by_several_commands_too():
    live = LiveTwin(TWO, {"front": "tension", "back": "shortening"})
    angles = np.arange(60) / 15.0
    each = [{"front": 2.0 + 0.5 * np.sin(a), "back": 0.006 + 0.001 * np.cos(a)} for a in angles]
    states = [live.at(commands) for commands in each]
    assert np.mean([state.n_iterations for state in states[8:]]) < 3.5
    controls = {"front": "tension", "back": "shortening"}
    assert_same(states[-1], simulated(TWO, controls, each[-1]), live.units)


def test_they_are_counted_on_after_load_paths():
    """Six cables bend slender rods so far in a step that the first ones follow load paths."""
    live = LiveTwin(manipulator(), "tension")
    each = [{name: 6.0 + 5.0 * np.sin(k / 25.0 + j) for j, name in enumerate(CABLES)} for k in range(40)]
    states = [live.at(commands) for commands in each]
    assert sum(state.n_iterations == 0 for state in states) <= 6
    assert_same(states[-1], simulated(manipulator(), dict.fromkeys(CABLES, "tension"), each[-1]), live.units)


def test_equilibria_beyond_a_kink_are_not_counted_on():
    live = LiveTwin(ROBOT)
    for d in (0.01, 0.0101):
        live.at({"front": d})
    steps = live._steps
    steps._trail.add(replace(steps.last.controls, coordinate=np.array([0.01005])), steps.begin.state)
    state = live.at({"front": 0.0102})
    assert 0 < state.n_iterations <= 6
    assert_same(state, simulated(ROBOT, {"front": "shortening"}, {"front": 0.0102}), live.units)
    after = [live.at({"front": d}) for d in 0.0102 + np.arange(1, 9) * 5e-5]
    assert max(state.n_iterations for state in after[5:]) <= 2


@pytest.mark.parametrize(
    ("n", "m", "degree", "error"), [(8, 1, 4, 1e-9), (5, 1, 4, 1e-9), (6, 2, 2, 1e-3), (1, 2, 1, 1e-9)]
)
def test_a_trail_is_a_polynomial_of_the_commands(n, m, degree, error):
    """From n states of as high a degree as these determine; from one by dz/dcommand. error: relative."""
    rng = np.random.default_rng(n)
    layout = build_twin(TWO).system.layout
    terms = [rng.normal(0.0, 1e-3, (layout.n_unknowns, m**d)) for d in range(degree + 1)]
    for own in terms:
        own[layout.first_frame_unknown : layout.first_pressure_unknown] = 0.0  # turns do not add

    def step_to(commands):
        powers = [np.ones(1)]
        for _ in range(degree):
            powers.append(np.kron(powers[-1], commands[:m]))
        return sum(own @ power for own, power in zip(terms, powers, strict=True))

    def state_at(commands):
        return moved(layout, rest_state(layout), step_to(commands))

    def controls_at(commands):
        return Controls(np.array([True, False]), commands * [1.0, 0.0], commands * [0.0, 1.0])

    nodes = np.zeros((n, 2))
    nodes[:, :m] = rng.uniform(-1.0, 1.0, (n, m))
    trail = Trail(layout, controls_at(nodes[0]), state_at(nodes[0]))
    for k, commands in enumerate(nodes):
        if k > 0:
            trail.add(controls_at(commands), state_at(commands))
        trail.add_rates(step_to(commands)[:, None])
    by_command = np.zeros((layout.n_unknowns, 2))
    by_command[:, :m] = terms[1]
    target = np.array([0.3, 0.7 if m == 2 else 0.0])
    (predicted, rates), expected = trail.beyond(controls_at(target), by_command), state_at(target)
    np.testing.assert_allclose(predicted.x, expected.x, rtol=0.0, atol=1e-3 * error)
    np.testing.assert_allclose(predicted.effort, expected.effort, rtol=0.0, atol=1e-3 * error)
    if n > 1:
        np.testing.assert_allclose(rates[:, 0], step_to(target), rtol=0.0, atol=1e-3 * error)


def test_stability_is_judged_on_a_long_way():
    live = LiveTwin(ROBOT)
    live.at({"front": 0.01})
    states = [live.at({"front": d}) for d in np.arange(0.01, 0.02, 1e-4)]
    assert 2 <= sum(state.n_factorisations for state in states) <= 20


def test_tensions_and_shortenings_of_several_cables():
    controls = {"front": "tension", "back": "shortening"}
    live = LiveTwin(TWO, controls)
    steps = [{"front": 2.0, "back": 0.004}, {"front": 2.02, "back": 0.0041}, {"front": 2.01}, {"back": 0.002}, {}]
    for commands in steps:
        expected = simulated(TWO, controls, commands) if commands else None
        state = live.at(commands)
        if expected is not None:
            assert_same(state, expected, live.units)
    assert_same(live.state, live.reset().channels, live.units)


def test_values_of_parameters_and_a_project_like_owner():
    class Owner:
        robot = ROBOT

    theta = {"neck.youngs_modulus": 1.1e6}
    live = LiveTwin(Owner(), theta=theta)
    assert_same(live.at({"front": 0.01}), simulated(ROBOT, {"front": "shortening"}, {"front": 0.01}, theta), live.units)


def test_a_failure_is_a_sentence_and_the_twin_goes_on():
    robot = column_robot("P1", divisions=(1, 1, 3))
    live = LiveTwin(robot)
    before = live.at({"front": 0.01})
    limit = live.at({"front": 0.09999})
    assert not limit.succeeded
    assert limit.status.startswith("Not reached (front 99.99 mm): no equilibrium beyond")
    assert limit.status.endswith("The twin stays where it was.")
    assert limit.channels == before.channels
    assert limit.commands == {"front": 0.01}
    assert live.state is before
    after = live.at({"front": 0.0101})
    assert_same(after, simulated(robot, {"front": "shortening"}, {"front": 0.0101}), live.units)


def test_a_robot_without_cables_stays_at_rest():
    live = LiveTwin(column_robot("P1", divisions=(1, 1, 3), cables=()))
    rest = live.state
    assert_same(live.at({}), rest.channels, live.units)
    assert_same(live.at({}), rest.channels, live.units)


def test_reset_returns_to_rest():
    live = LiveTwin(TWO)
    rest = live.state
    live.at({"front": 0.01, "back": 0.002})
    back = live.reset()
    assert back.channels == rest.channels
    assert back.status == "At rest, all cables slack."
    assert live.state is back


def test_a_state_keeps_its_shape_after_later_steps():
    live = LiveTwin(ROBOT)
    first = live.at({"front": 0.01})
    live.at({"front": 0.02})
    shape = first.shape
    z = shape.plates["plate"][0][2]
    assert z == first.channels["plate.z"]
    assert shape.efforts["front"] == first.channels["front.tension"]
    assert first.warnings == ()


def test_buckling_is_a_sentence():
    mesh = mirrored_box((0.01, 0.012, 0.1), (1, 1, 8))
    straight = side_cable("front", (0.0, 0.0))
    robot = column_robot("P1", mesh=mesh, parameters=elastic(1e6, 0.3), cables=(straight,))
    live = LiveTwin(robot)
    states = [live.at({"front": d}) for d in np.arange(1, 61) * 1e-4]
    assert all(state.succeeded for state in states)
    jumps = [k for k, state in enumerate(states) if "Not stable before these commands" in state.status]
    assert len(jumps) == 1
    sideways = np.abs([state.channels["plate.x"] for state in states])
    assert sideways[: jumps[0]].max() < 1e-6 < 1e-3 < sideways[jumps[0]]


def drummed():
    """A column pulled by a cable with friction that remembers."""
    line = CableLine(friction_memory=True)
    way = [[0.05, 0.0, 0.1], [0.05, 0.0, 0.0], [0.08, 0.0, -0.03], [0.12, 0.0, -0.03]]
    points = tuple(ViaPoint(np.array(at), "plate" if k == 0 else "") for k, at in enumerate(way))
    return column_robot("P1", divisions=(1, 1, 4), cables=(Cable("front", points, 0.2, line=line),))


def test_reversing_friction_follows_the_order_of_the_calls():
    robot = drummed()
    live = LiveTwin(robot, "tension")
    path = [0.0, 1.0, 2.0, 2.02, 2.04, 2.02, 2.0, 1.5, 1.6]
    states = [live.at({"front": T}) for T in path]
    response = simulate(robot, Protocol({"front": Command("tension", np.array(path))}))
    pitch = response.channels["plate.pitch"]
    np.testing.assert_allclose([s.channels["plate.pitch"] for s in states], pitch, rtol=1e-8, atol=1e-10)
    assert abs(pitch[6] - pitch[2]) > 1e-3 * abs(pitch[2])  # the history matters
    assert live.reset().channels["plate.pitch"] == 0.0
    np.testing.assert_allclose(live.at({"front": 1.0}).channels["plate.pitch"], pitch[1], rtol=1e-8)


def test_wrong_arguments_are_sentences():
    live = LiveTwin(TWO, {"front": "shortening"})
    with pytest.raises(ParameterError, match="back: this cable is not driven; allowed: front"):
        live.at({"back": 0.01})
    with pytest.raises(ParameterError, match="pulled in by more than its length"):
        live.at({"front": 0.2})
    with pytest.raises(ParameterError, match="time does not go back"):
        live.at({"front": 0.01}, elapsed=-1.0)
    with pytest.raises(ParameterError, match="no such cable"):
        LiveTwin(TWO, {"up": "tension"})
    with pytest.raises(ParameterError, match=r"no such parameter"):
        LiveTwin(TWO, theta={"neck.modulus": 1.0})
    with pytest.raises(ParameterError, match=r"no such parameter"):
        live.state.by_parameters("neck.modulus")
    assert live.at({"front": 0.01}).succeeded


LIVE = LiveTwin(TWO)
PULL = st.floats(0.0, 0.012)


@settings(max_examples=15, deadline=None)
@given(a=st.tuples(PULL, PULL), b=st.tuples(PULL, PULL))
def test_a_state_does_not_depend_on_the_one_before(a, b):
    first, second = ({"front": f, "back": k} for f, k in (a, b))
    LIVE.reset()
    alone = LIVE.at(second)
    LIVE.at(first)
    after = LIVE.at(second)
    assert alone.succeeded == after.succeeded
    if alone.succeeded:
        assert_same(after, alone.channels, LIVE.units)


def test_it_returns_to_a_state_with_what_it_remembered():
    smooth, line = tentacle("P1"), CableLine(friction_memory=True)
    cables = tuple(replace(cable, friction_coefficient=0.2, line=line) for cable in smooth.cables)
    live = LiveTwin(replace(smooth, cables=cables), {"front": "tension"})
    assert live.remembers
    there = live.at({"front": 1.0})
    released = live.at({"front": 0.5})
    live.at({"front": 1.5})
    assert live.return_to(there) is live.state
    assert_same(live.at({"front": 0.5}), released.channels, live.units)
    live.reset()
    pulled = live.at({"front": 0.5})
    assert abs(pulled.channels["tip.x"] - released.channels["tip.x"]) > 5e-6


def test_a_released_cable_is_slack_and_has_a_derivative_by_its_tension():
    live = LiveTwin(TWO)
    state = live.at({"front": 0.01}, released=["back"])
    assert state.channels["back.tension"] == 0.0
    assert state.commands == {"front": 0.01, "back": 0.0}
    rates = state.by_commands()
    assert set(rates.names) == {"front.shortening", "back.tension"}
    back = live.at({"front": 0.01, "back": state.channels["back.shortening"] + 1e-7})
    by_tension = rates["back.shortening", "back.tension"]
    assert back.channels["back.tension"] == pytest.approx(1e-7 / by_tension, rel=1e-3)
    with pytest.raises(ParameterError, match="not driven"):
        live.at({"front": 0.01}, released=["side"])
