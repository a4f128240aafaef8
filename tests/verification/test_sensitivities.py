"""Derivatives of tension, pitch and the rest by parameters against central differences."""

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed

from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

NAMES = ("neck.youngs_modulus", "neck.poissons_ratio", "neck.density", "plate.mass")
CHANNELS = ("front.tension", "front.shortening", "plate.pitch", "plate.x", "plate.z")


@pytest.fixture(autouse=True)
def _solved_to_rounding(monkeypatch):
    # Differences of 3e-4 amplify what a solve leaves: 1e-9 would cost the digits that are compared.
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)


def heavy_column(element: str, nu: float):
    return column_robot(
        element,
        parameters=elastic(0.4e6, nu),
        divisions=(2, 2, 4) if element == "P1" else (1, 1, 4),
        gravity=(0.0, 0.0, -9.81),
        density=1100.0,
        mass=0.05,
    )


def differences(robot, protocol, name, channels):
    value = robot_parameters(robot)[name].value
    h = 3e-4 * value if name != "neck.poissons_ratio" else 0.1 * min(1e-3, 0.5 - value)
    ends = [
        simulate(with_parameters(robot, {name: value + s * h}), protocol, curve_tolerance=0.0).channels for s in (1, -1)
    ]
    return {channel: (ends[0][channel] - ends[1][channel]) / (2.0 * h) for channel in channels}


@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize(
    ("element", "nu"),
    [
        ("P1", 0.43),
        ("P2", 0.45),
        ("P2P1", 0.43),
        ("P2P1", 0.4999),
        *[(e, nu) for e in ("P1", "P2", "P2P1") for nu in (0.0, -0.3)],
    ],
)
def test_sensitivities_are_the_differences(element, drive, nu):
    robot = heavy_column(element, nu)
    protocol = pulled(0.01, 0.025) if drive == "shortening" else tensed(0.4, 1.0)
    response = simulate(robot, protocol, sensitivities=NAMES, curve_tolerance=0.0)
    assert response.succeeded, response.status
    for name in NAMES:
        expected = differences(robot, protocol, name, CHANNELS)
        for channel in CHANNELS:
            got = response.sensitivities[channel][name]
            np.testing.assert_allclose(
                got,
                expected[channel],
                rtol=1e-5,
                atol=1e-5 * np.abs(expected[channel]).max(),
                err_msg=f"{channel} {name}",
            )
    moving = "plate.pitch" if drive == "tension" else "front.tension"
    assert all(np.all(response.sensitivities[moving][name] != 0.0) for name in NAMES)


def test_sensitivities_of_a_slack_cable():
    robot = heavy_column("P1", 0.45)
    protocol = pulled(-0.01, -0.005)
    response = simulate(robot, protocol, sensitivities=NAMES, curve_tolerance=0.0)
    for name in NAMES:
        expected = differences(robot, protocol, name, CHANNELS)
        for channel in CHANNELS:
            np.testing.assert_allclose(
                response.sensitivities[channel][name], expected[channel], rtol=1e-5, atol=1e-12 / 1e-4
            )


def test_sensitivities_with_two_cables():
    robot = column_robot(
        "P1",
        parameters=elastic(0.4e6, 0.45),
        divisions=(2, 2, 4),
        gravity=(0.0, 0.0, -9.81),
        density=1100.0,
        mass=0.05,
        cables=(side_cable("front", (0.05, 0.0)), side_cable("side", (0.0, 0.05))),
    )
    protocol = Protocol(
        {
            "front": Command("shortening", np.array([0.01, 0.02])),
            "side": Command("tension", np.array([0.3, 0.5])),
        }
    )
    channels = (*CHANNELS, "side.tension", "side.shortening", "plate.roll", "plate.yaw")
    response = simulate(robot, protocol, sensitivities=NAMES)
    assert response.succeeded, response.status
    for name in NAMES:
        expected = differences(robot, protocol, name, channels)
        for channel in channels:
            got, want = response.sensitivities[channel][name], expected[channel]
            np.testing.assert_allclose(got, want, rtol=1e-5, atol=1e-5 * np.abs(want).max() + 1e-15)


@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_slopes_are_the_differences_along_the_control(drive):
    robot = heavy_column("P2P1", 0.45)
    middle = np.array([0.01, 0.02]) if drive == "shortening" else np.array([0.4, 0.9])
    h = 1e-4 * middle
    make = pulled if drive == "shortening" else tensed
    response = simulate(robot, make(*middle), curve_tolerance=0.0)
    ends = [simulate(robot, make(*(middle + s * h)), curve_tolerance=0.0).channels for s in (1, -1)]
    for channel in CHANNELS:
        want = (ends[0][channel] - ends[1][channel]) / (2 * h)
        np.testing.assert_allclose(response.slopes[channel], want, rtol=1e-5, err_msg=channel)


def test_interpolated_sensitivities_are_near_the_exact_ones():
    """What a calibration reads between the nodes of a curve."""
    robot = heavy_column("P1", 0.43)
    d = np.linspace(0.001, 0.04, 14)
    exact = simulate(robot, pulled(*d), sensitivities=NAMES, curve_tolerance=0.0)
    read = simulate(robot, pulled(*d), sensitivities=NAMES)
    values = {name: info.value for name, info in robot_parameters(robot).items()}
    for channel in ("front.tension", "plate.pitch"):
        largest = np.abs(exact.channels[channel]).max()
        for name in NAMES:
            error = (read.sensitivities[channel][name] - exact.sensitivities[channel][name]) * values[name]
            assert np.abs(error).max() < 5e-3 * largest
