"""Derivatives of the live twin against central differences of its own states, at poses reached by warm steps."""

import numpy as np
import pytest
from mechanics_cases import column_robot, side_cable

from softcal.errors import ParameterError
from softcal.twin.cables import Cable, CableLine, ViaPoint
from softcal.twin.live import LiveTwin

STEP = 3e-4
FRONT, BACK = side_cable("front", (0.05, 0.0)), side_cable("back", (-0.04, 0.03))
ROBOT = column_robot("P2P1", divisions=(1, 1, 3), cables=(FRONT, BACK), mass=0.1, gravity=(0.0, 0.0, -9.81))
CONTROLS = {"front": "shortening", "back": "tension"}
POSE = {"front": 0.0121, "back": 3.01}


def values(state):
    assert state.succeeded, state.status
    return np.array(list(state.channels.values()))


def assert_derivatives(jacobian, name, difference, units):
    """Equal to 1e-6 of the largest derivative of each unit."""
    exact = jacobian.values[:, jacobian.names.index(name)]
    for unit in set(units.values()):
        rows = [k for k, channel in enumerate(jacobian.channels) if units[channel] == unit]
        size = max(np.abs(difference[rows]).max(), 1e-12)
        np.testing.assert_allclose(exact[rows], difference[rows], rtol=0.0, atol=1e-6 * size, err_msg=f"{name}, {unit}")


@pytest.mark.parametrize("cable", ["front", "back"])
def test_by_commands(cable):
    live = LiveTwin(ROBOT, CONTROLS)
    live.at({"front": 0.012, "back": 3.0})
    state = live.at(POSE)
    assert state.n_iterations > 0
    h = STEP * POSE[cable]
    ahead, behind = (values(live.at({**POSE, cable: POSE[cable] + way * h})) for way in (1, -1))
    jacobian = state.by_commands()  # of a state that the twin has left
    assert jacobian.names == ("front.shortening", "back.tension")
    name = f"{cable}.{CONTROLS[cable]}"
    assert_derivatives(jacobian, name, (ahead - behind) / (2.0 * h), live.units)
    assert jacobian[name, name] == 1.0
    np.testing.assert_array_equal(
        jacobian.of(["plate.pitch"])[0], jacobian.values[jacobian.channels.index("plate.pitch")]
    )


@pytest.mark.parametrize("asked", [1, 3])
def test_by_commands_with_a_kept_tangent(asked):
    """Along small steps, asked at every one or every third: those of a twin that factorises there, to 1e-7 of the
    largest of each channel's, without a factorisation a step; and the states are those without derivatives.
    """
    live, plain = LiveTwin(ROBOT, CONTROLS), LiveTwin(ROBOT, CONTROLS)
    n, own, steps = 0, live._steps.statics.tangent, 60
    for k in range(steps):
        angle = 2.0 * np.pi * k / steps
        pose = {"front": 0.012 + 0.002 * np.sin(angle), "back": 3.0 + 0.5 * np.cos(angle)}
        state, alone = live.at(pose), plain.at(pose)
        np.testing.assert_allclose(values(state), values(alone), rtol=1e-9, atol=1e-12)
        if k % asked == 0 or k == steps - 1:
            rates, n = state.by_commands().values, n + 1
    assert own.n_factorisations < plain._steps.statics.n_factorisations + 0.5 * n
    fresh = LiveTwin(ROBOT, CONTROLS)
    fresh.at(pose)
    exact = fresh.state.by_commands().values
    for row, own in zip(rates, exact, strict=True):
        np.testing.assert_allclose(row, own, rtol=0.0, atol=1e-7 * max(np.abs(own).max(), 1e-6))


def test_derivatives_of_one_state_twice_take_no_further_work():
    live = LiveTwin(ROBOT, CONTROLS)
    tangent = live._steps.statics.tangent
    for d in (0.0100, 0.0101, 0.0102):
        state = live.at({"front": d, "back": 3.0})
    rates = state.by_commands().values
    before = tangent.n_iterations, tangent.n_factorisations
    again = state.by_commands().values
    assert (tangent.n_iterations, tangent.n_factorisations) == before
    np.testing.assert_allclose(again, rates, rtol=0.0, atol=1e-9 * np.abs(rates).max())


def test_derivatives_go_on_after_a_jump():
    """A step along a load path leaves no prediction; the derivatives there are right all the same."""
    live = LiveTwin(ROBOT, CONTROLS)
    for d in (0.004, 0.0041, 0.0042, 0.03):
        rates = live.at({"front": d, "back": 3.0}).by_commands().values
    fresh = LiveTwin(ROBOT, CONTROLS)
    exact = fresh.at({"front": 0.03, "back": 3.0}).by_commands().values
    np.testing.assert_allclose(rates, exact, rtol=0.0, atol=1e-7 * np.abs(exact).max())


def test_a_slack_cable_moves_nothing():
    live = LiveTwin(ROBOT)
    jacobian = live.at({"front": 0.01, "back": -0.02}).by_commands()
    assert jacobian["back.shortening", "back.shortening"] == 1.0
    assert jacobian["plate.pitch", "back.shortening"] == 0.0
    assert jacobian["plate.pitch", "front.shortening"] != 0.0


@pytest.mark.parametrize("name", ["neck.youngs_modulus", "plate.mass"])
def test_by_parameters(name):
    theta = {"neck.youngs_modulus": 2.3e6, "plate.mass": 0.1}
    h = STEP * theta[name]
    ahead, behind = (
        values(LiveTwin(ROBOT, CONTROLS, {**theta, name: theta[name] + way * h}).at(POSE)) for way in (1, -1)
    )
    live = LiveTwin(ROBOT, CONTROLS, theta)
    live.at({"front": 0.012, "back": 3.0})
    assert_derivatives(live.at(POSE).by_parameters(name), name, (ahead - behind) / (2.0 * h), live.units)


def rough():
    """A column with a cable that runs over two guides, with friction that remembers."""
    way = [[0.05, 0.0, 0.1], [0.05, 0.0, 0.0], [0.08, 0.0, -0.03], [0.12, 0.0, -0.03]]
    points = tuple(ViaPoint(np.array(at), "plate" if k == 0 else "") for k, at in enumerate(way))
    cable = Cable("front", points, 0.2, line=CableLine(friction_memory=True))
    return column_robot("P1", divisions=(1, 1, 3), cables=(cable,))


@pytest.mark.parametrize("name", ["neck.youngs_modulus", "front.friction_coefficient"])
def test_by_parameters_through_a_history(name):
    path, value = [2.0, 4.0, 4.01, 3.5], {"neck.youngs_modulus": 2.3e6, "front.friction_coefficient": 0.2}[name]

    def end(theta):
        live = LiveTwin(rough(), "tension", theta, sensitivities=[name])
        return [live.at({"front": T}) for T in path][-1], live

    h = STEP * value
    ahead, behind = (values(end({name: value + way * h})[0]) for way in (1, -1))
    state, live = end({})
    assert_derivatives(state.by_parameters(name), name, (ahead - behind) / (2.0 * h), live.units)


def test_by_commands_of_the_last_step_of_a_history():
    live = LiveTwin(rough(), "tension")
    path, h = [2.0, 4.0, 3.5], 1e-4

    def end(last):
        live.reset()
        return [live.at({"front": T}) for T in (*path[:-1], last)][-1]

    ahead, behind, state = end(3.5 + h), end(3.5 - h), end(3.5)
    difference = (values(ahead) - values(behind)) / (2.0 * h)
    assert_derivatives(state.by_commands(), "front.tension", difference, live.units)
    with pytest.raises(ParameterError, match="the memory has no derivative by this parameter"):
        state.by_parameters("neck.youngs_modulus")
