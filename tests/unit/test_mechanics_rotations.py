"""Rotations of plates: exponential, logarithm, the step that leads from one state to another, the sensed angles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import column_robot, twin_and_theta

from softcal.mechanics.state import difference, exponential, logarithm, moved, rest_state
from softcal.sensing.sensors.pose import angles
from softcal.twin.sensors import channel_units, sense, sense_rates

vector = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@settings(deadline=None)
@given(vector)
def test_logarithm_undoes_the_exponential(omega):
    assert np.linalg.norm(omega) < np.pi
    np.testing.assert_allclose(logarithm(exponential(omega[None]))[0], omega, atol=1e-12)


@settings(deadline=None)
@given(vector)
def test_exponential_is_a_rotation_about_its_vector(omega):
    R = exponential(omega[None])[0]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R @ omega, omega, atol=1e-12)
    assert np.trace(R) == pytest.approx(1.0 + 2.0 * np.cos(np.linalg.norm(omega)))


def test_exponential_turns_z_towards_x_about_y():
    np.testing.assert_allclose(exponential(np.array([[0, np.pi / 2, 0]]))[0] @ [0, 0, 1], [1, 0, 0], atol=1e-15)


def test_no_plates_are_no_rotations():
    assert exponential(np.zeros((0, 3))).shape == (0, 3, 3)
    assert logarithm(np.zeros((0, 3, 3))).shape == (0, 3)


@settings(deadline=None, max_examples=30)
@given(vector, vector, st.integers(0, 1000))
def test_difference_is_the_step_between_two_states(first, second, seed):
    twin, _ = twin_and_theta(column_robot("P2P1", divisions=(1, 1, 1)))
    layout = twin.system.layout
    rng = np.random.default_rng(seed)
    steps = rng.uniform(-1.0, 1.0, (2, layout.n_unknowns))
    turn = slice(layout.first_frame_unknown + 3, layout.first_frame_unknown + 6)
    steps[0, turn], steps[1, turn] = first, second
    before = moved(layout, rest_state(layout), steps[0])
    after = moved(layout, before, steps[1])
    if np.linalg.norm(second) < 3.0:
        np.testing.assert_allclose(difference(layout, after, before), steps[1], atol=1e-9)
    # points on the plate keep their distances
    rigid = layout.links.followers
    for a, b in ((before, layout.X), (after.x, layout.X)):
        x = a if isinstance(a, np.ndarray) else a.x
        got = np.linalg.norm(x[rigid] - x[rigid[0]], axis=1)
        np.testing.assert_allclose(got, np.linalg.norm(b[rigid] - b[rigid[0]], axis=1), atol=1e-12)


@settings(deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_angles_are_those_of_turns_about_y_then_x_then_z(pitch, roll, yaw):
    Ry, Rx, Rz = exponential(np.array([[0, pitch, 0], [roll, 0, 0], [0, 0, yaw]]))
    np.testing.assert_allclose(angles(Ry @ Rx @ Rz), [pitch, roll, yaw], atol=1e-9)


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3).map(np.array), st.integers(0, 100))
def test_rates_of_the_channels_are_their_differences(turn, seed):
    twin, _ = twin_and_theta(column_robot("P1", divisions=(1, 1, 1)))
    layout = twin.system.layout
    rng = np.random.default_rng(seed)
    start = rng.uniform(-0.01, 0.01, layout.n_unknowns)
    at = slice(layout.first_frame_unknown + 3, layout.first_frame_unknown + 6)
    start[at] = turn
    state = moved(layout, rest_state(layout), start)
    dz = rng.uniform(-0.01, 0.01, layout.n_unknowns)
    dz[at] *= 30.0
    h = 1e-5
    ends = [sense(twin, moved(layout, state, s * h * dz), {}) for s in (1, -1)]
    got = sense_rates(twin, state, {}, dz[:, None])[:, 0]
    assert len(got) == len(channel_units(twin))
    np.testing.assert_allclose(got, (ends[0] - ends[1]) / (2 * h), rtol=1e-6, atol=1e-8)
