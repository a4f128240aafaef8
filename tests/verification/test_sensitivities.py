"""Derivatives of tension, pitch and the rest by parameters against central differences."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, side_cable, tensed, twin_and_theta

from softcal.geometry.centreline import straight
from softcal.geometry.section import RoundBar
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import follow
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Plate, Robot, Rod, ViaPoint
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
    ends = [simulate(robot, protocol, {name: value + s * h}, curve_tolerance=0.0).channels for s in (1, -1)]
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


def random_robot(seed: int) -> Robot:
    """A soft column, or a rod with a plate at its tip, under its own weight; E, nu, size and mass at random."""
    rng = np.random.default_rng(seed)
    E, nu, mass = 10.0 ** rng.uniform(5.3, 6.6), float(rng.uniform(0.3, 0.4999)), float(rng.uniform(0.0, 0.1))
    gravity = (0.0, 0.0, -9.81)
    if seed % 3:
        element = ("P1", "P2P1")[seed % 2]
        divisions = (2, 2, 4) if element == "P1" else (1, 1, 4)
        parameters = elastic(E, nu)
        return column_robot(
            element, parameters=parameters, divisions=divisions, gravity=gravity, density=1100.0, mass=mass
        )
    line = straight((0.0, 0.0, 0.0), (0.0, 0.0, 0.1), 8)
    fixed, tip = np.array([0]), {"plate": np.array([8])}
    rod = Rod("neck", line, RoundBar(0.03), elastic(E, nu), tip, fixed, density=1100.0)
    plate = Plate("plate", {}, np.array([0.0, 0.0, 0.1]), mass=mass)
    return Robot((), (plate,), (side_cable("front", (0.05, 0.0)),), gravity=np.array(gravity), rods=(rod,))


@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize("seed", range(12))
def test_sensitivities_between_nodes_are_as_exact_as_stated(seed, drive):
    """At every sample within 1e-3 of the largest derivative of the channels of one unit (under a tension, of those at
    given shortening too, of which they are made), where that is more than 1e-3 of the most sensitive ones; by a few
    factorisations more than without.
    """
    robot, d = random_robot(seed), np.random.default_rng(seed).uniform(0.02, 0.045) * np.linspace(0.05, 1.0, 17)
    by_shortening = simulate(robot, pulled(*d), sensitivities=NAMES, curve_tolerance=0.0)
    tension = by_shortening.channels["front.tension"]
    protocol = pulled(*d) if drive == "shortening" else tensed(*np.linspace(0.05, 1.0, 17) * tension[-1])
    exact = simulate(robot, protocol, sensitivities=NAMES, curve_tolerance=0.0)
    read = simulate(robot, protocol, sensitivities=NAMES)
    assert exact.succeeded
    assert read.n_factorisations <= simulate(robot, protocol).n_factorisations + 9
    for name in NAMES:
        largest, error, scale = {}, {}, {}
        for channel, values in exact.channels.items():
            want, unit = exact.sensitivities[channel][name], exact.units[channel]
            off = np.abs(read.sensitivities[channel][name] - want).max()
            at_shortening = by_shortening.sensitivities[channel][name]
            for of, value in (
                (largest, np.abs([want, at_shortening]).max()),
                (error, off),
                (scale, np.abs(values).max()),
            ):
                of[unit] = max(of.get(unit, 0.0), value)
        most = max(largest[unit] / scale[unit] for unit in ("N", "m", "rad"))
        for unit in ("N", "m", "rad"):
            assert error[unit] <= 1e-3 * max(largest[unit], 1e-3 * most * scale[unit]), (name, unit)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_mixed_derivatives_are_the_differences_along_the_path(seed):
    robot = random_robot(seed)
    (cable,) = robot.cables
    robot = replace(robot, cables=(replace(cable, via_points=(*cable.via_points, ViaPoint([0.06, 0.0, -0.02]))),))
    names = (*NAMES, "front.friction_coefficient")
    twin, theta = twin_and_theta(with_parameters(robot, {"front.friction_coefficient": 0.2}))
    statics = Statics(twin.system, theta)
    one = np.ones(1)
    line = Line(one == 0, 0 * one, 0 * one, 0 * one, one)
    c, h = 0.02, 1e-5
    start = statics.equilibrium(rest_state(twin.system.layout), line.at(0.0))
    path = follow(statics, line, node_at(statics, line, 0.0, start.state, ()), c, first_step=0.01)
    before, node, after = (
        node_at(statics, line, at, statics.equilibrium(path.nodes[-1].state, line.at(at)).state, names)
        for at in (c - h, c, c + h)
    )
    difference = (after.by_parameter - before.by_parameter) / (2.0 * h)
    for k, name in enumerate(names):
        scale = np.abs(difference[:, k]).max()
        assert scale > 0.0
        np.testing.assert_allclose(node.mixed[:, k], difference[:, k], rtol=0, atol=1e-4 * scale, err_msg=name)
