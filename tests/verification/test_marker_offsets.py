"""Offsets of markers on their plate or body: they turn with it, and all channels have exact derivatives by them."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled

from softcal.twin.build import twin_of
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.robot import Marker, Robot
from softcal.twin.simulate import simulate

CARRIERS = {"plate": ([0.02, 0.01, 0.1], "plate"), "inside": ([0.004, 0.003, 0.052], "neck")}
CARRIERS["beside"] = ([0.019, 0.003, 0.052], "neck")
NAMES = tuple(f"eye.{axis}_offset" for axis in "xyz")
OFFSET = np.array([0.003, -0.002, 0.001])


def marked(carrier: str, element: str = "P2P1", offset=(0.0, 0.0, 0.0)) -> Robot:
    at, on = CARRIERS[carrier]
    robot = column_robot(
        element, parameters=elastic(4e4, 0.43), divisions=(1, 1, 3), gravity=(0, 0.5, -9.81), density=1100.0, mass=0.01
    )
    return replace(robot, markers=(Marker("eye", on, at, offset), Marker("other", "plate", [0.0, 0.0, 0.1])))


def seen(robot: Robot, theta=None, names=()):
    response = simulate(robot, pulled(0.01, 0.03), theta, sensitivities=names, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return response


def place(response) -> np.ndarray:
    return np.column_stack([response.channels[f"eye.{axis}"] for axis in "xyz"])


def test_on_a_plate_it_is_a_marker_drawn_there_that_turns_with_the_plate():
    robot = marked("plate")
    at, on = CARRIERS["plate"]
    drawn = replace(robot, markers=(Marker("eye", on, at + OFFSET), robot.markers[1]))
    theta = dict(zip(NAMES, OFFSET.tolist(), strict=True))
    want = seen(drawn)
    assert np.all(want.channels["plate.pitch"] > 0.1)
    for found in (seen(robot, theta), seen(marked("plate", offset=OFFSET)), seen(with_parameters(robot, theta))):
        np.testing.assert_allclose(place(found), place(want), rtol=0, atol=1e-15)
    moved = place(want) - place(seen(robot))
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), np.linalg.norm(OFFSET), rtol=1e-12)
    assert np.all(np.abs(moved - OFFSET).max(axis=1) > 1e-4), "it has turned"


def test_on_a_body_it_follows_the_deformation_where_the_marker_is():
    """In a linear tet as a marker drawn there; in a quadratic one the strain of the place as drawn is extrapolated."""
    at, on = CARRIERS["inside"]
    for element, least, most in (("P1", 0.0, 1e-15), ("P2P1", 1e-7, 1e-5)):
        robot, offset = marked("inside", element), 0.3 * OFFSET
        drawn = replace(robot, markers=(Marker("eye", on, at + offset), robot.markers[1]))
        error = place(seen(robot, dict(zip(NAMES, offset.tolist(), strict=True)))) - place(seen(drawn))
        assert least <= np.abs(error).max() <= most


@pytest.mark.parametrize(("element", "offset"), [("P1", 1.0), ("P2P1", 0.0), ("P2P1", 1.0)])
@pytest.mark.parametrize("carrier", CARRIERS)
def test_all_channels_have_exact_derivatives_by_it_and_with_it(carrier, element, offset, monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = marked(carrier, element, offset * OFFSET)
    steps = {**dict.fromkeys(NAMES, 1e-5), "neck.youngs_modulus": 4.0}
    values = {name: info.value for name, info in robot_parameters(robot).items()}
    response = seen(robot, names=tuple(steps))
    for name, h in steps.items():
        ends = [seen(robot, {name: values[name] + s * h}).channels for s in (1.0, -1.0)]
        for channel, got in response.sensitivities.items():
            want = (ends[0][channel] - ends[1][channel]) / (2.0 * h)
            rounding = 1e-10 * np.abs(response.channels[channel]).max() / h
            error = 1e-5 * np.abs(want).max() + rounding
            np.testing.assert_allclose(got[name], want, rtol=0, atol=error, err_msg=f"{channel}, {name}")
    assert np.all(response.sensitivities["plate.pitch"][NAMES[0]] == 0.0)


def test_it_needs_no_other_system_of_equations():
    robot = marked("inside")
    moved = twin_of(robot, {NAMES[0]: 0.001})
    assert moved.system is twin_of(robot).system
    assert moved.robot.markers[0].place[0] == CARRIERS["inside"][0][0] + 0.001
    softer = {"neck.youngs_modulus": 5e4}
    assert twin_of(robot, {**softer, NAMES[0]: 0.001}) is moved


@pytest.mark.parametrize("carrier", CARRIERS)
def test_shapes_have_the_marker_where_its_channels_are(carrier):
    response = simulate(marked(carrier, offset=OFFSET), pulled(0.01, 0.03), snapshots="samples")
    shapes = [shape.markers["eye"] for shape in response.snapshots[-2:]]
    np.testing.assert_allclose(shapes, place(response), rtol=0, atol=1e-12)
