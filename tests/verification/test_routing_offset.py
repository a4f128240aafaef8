"""A cable's routing offset, angle and twist: derivatives of all channels against differences, and what they refuse."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic, pulled, tensed, twin_and_theta

from softcal.errors import InputError, MeshError
from softcal.mechanics.node import Line, node_at
from softcal.mechanics.path import follow
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.twin.build import build_twin
from softcal.twin.cables import RoutingAxis
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, ViaPoint
from softcal.twin.simulate import simulate

pytestmark = pytest.mark.usefixtures("small_balls")
OFFSET = "front.routing_offset"
ANGLE = "front.routing_angle"
TWIST = "front.routing_twist"
STEPS = {OFFSET: 2e-6, ANGLE: 1e-4, TWIST: 1e-3}  # m, rad, rad/m
ROUTING = tuple(STEPS)
NAMES = (*ROUTING, "neck.youngs_modulus", "front.friction_coefficient")
AXIS = RoutingAxis((0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
# Where the cable runs: its via points on the plate, in the body and in space.
ROUTES = {
    "plate and space": (ViaPoint([0.05, 0.0, 0.1], "plate"), ViaPoint([0.05, 0.0, 0.0])),
    "plate, space and a bend": (
        ViaPoint([0.02, 0.004, 0.1], "plate"),
        ViaPoint([0.035, 0.0, 0.06]),
        ViaPoint([0.02, 0.002, -0.02]),
    ),
    "body": (
        ViaPoint([0.012, 0.0031, 0.1], "plate"),
        ViaPoint([0.0113, 0.0031, 0.071], "neck"),
        ViaPoint([0.0117, 0.0023, 0.037], "neck"),
        ViaPoint([0.011, 0.0, 0.0]),
    ),
}


@pytest.fixture(autouse=True)
def _solved_to_rounding(monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)


def routed(route: str, element: str = "P1", *, friction: float = 0.0, more: tuple[Cable, ...] = ()):
    cable = Cable("front", ROUTES[route], friction, routing_axis=AXIS)
    return column_robot(
        element,
        parameters=elastic(0.4e6, 0.43),
        divisions=(2, 2, 4) if element == "P1" else (1, 1, 4),
        gravity=(0.0, 0.0, -9.81),
        density=1100.0,
        mass=0.05,
        cables=(cable, *more),
    )


def differences(robot, protocol, name):
    h = STEPS[name]
    ends = [simulate(robot, protocol, {name: s * h}, curve_tolerance=0.0).channels for s in (1.0, -1.0)]
    return {channel: (ends[0][channel] - ends[1][channel]) / (2.0 * h) for channel in ends[0]}


def assert_differences(response, want, name):
    for unit in ("N", "m", "rad"):
        of_unit = [channel for channel in want if response.units[channel] == unit]
        scale = max(np.abs(want[channel]).max() for channel in of_unit)
        for channel in of_unit:
            got = response.sensitivities[channel][name]
            np.testing.assert_allclose(got, want[channel], rtol=1e-5, atol=2e-6 * scale + 1e-8, err_msg=channel)


@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize("element", ["P1", "P2P1"])
@pytest.mark.parametrize("route", ROUTES)
def test_all_channels_follow_the_routing_as_their_differences_say(route, element, drive):
    robot = routed(route, element, friction=0.2 if "bend" in route else 0.0)
    protocol = pulled(0.002, 0.006) if drive == "shortening" else tensed(0.4, 1.0)
    response = simulate(robot, protocol, sensitivities=NAMES, curve_tolerance=0.0)
    assert response.succeeded, response.status
    for name in ROUTING:
        want = differences(robot, protocol, name)
        assert_differences(response, want, name)
        assert np.all(want["front.tension" if drive == "shortening" else "front.shortening"] != 0.0)


def test_a_cable_beside_it_and_a_slack_one_follow_it_too():
    """Of three cables the offset's own is pulled, held at a tension, or lies slack: its length changes all the same."""
    side = Cable("side", (ViaPoint([0.0, 0.05, 0.1], "plate"), ViaPoint([0.0, 0.05, 0.0])))
    robot = routed("plate and space", more=(side,))
    slack = pulled(0.01, 0.02, cable="side")
    both = Protocol({name: Command("shortening", np.array([0.005, 0.01])) for name in ("front", "side")})
    mixed = Protocol(
        {"front": Command("tension", np.array([0.3, 0.5])), "side": Command("shortening", np.array([0.01, 0.02]))}
    )
    for protocol in (slack, both, mixed):
        response = simulate(robot, protocol, sensitivities=NAMES, curve_tolerance=0.0)
        assert response.succeeded, response.status
        for name in ROUTING:
            assert_differences(response, differences(robot, protocol, name), name)


def test_mixed_derivatives_are_the_differences_along_the_path():
    robot = routed("body", friction=0.2)
    twin, theta = twin_and_theta(robot)
    statics = Statics(twin.system, theta)
    one = np.ones(1)
    line = Line(one == 0, 0 * one, 0 * one, 0 * one, one)
    c, h = 0.006, 1e-5
    start = statics.equilibrium(rest_state(twin.system.layout), line.at(0.0))
    path = follow(statics, line, node_at(statics, line, 0.0, start.state, ()), c, first_step=0.002)
    before, node, after = (
        node_at(statics, line, at, statics.equilibrium(path.nodes[-1].state, line.at(at)).state, NAMES)
        for at in (c - h, c, c + h)
    )
    difference = (after.by_parameter - before.by_parameter) / (2.0 * h)
    for k, name in enumerate(NAMES):
        scale = np.abs(difference[:, k]).max()
        np.testing.assert_allclose(node.mixed[:, k], difference[:, k], rtol=0, atol=1e-4 * scale, err_msg=name)


def test_the_offset_moves_every_via_point_away_from_the_axis():
    robot = with_parameters(routed("body"), {OFFSET: 0.001})
    (cable,) = robot.cables
    for before, after in zip(ROUTES["body"], cable.via_points, strict=True):
        assert np.hypot(*after.at[:2]) == pytest.approx(np.hypot(*before.at[:2]) + 0.001)
        assert after.at[2] == before.at[2]
        assert after.on == before.on
    back = with_parameters(robot, {OFFSET: 0.0}).cables[0]
    for before, after in zip(ROUTES["body"], back.via_points, strict=True):
        np.testing.assert_allclose(after.at, before.at, rtol=0, atol=1e-15)


def test_angle_and_twist_turn_every_via_point_about_the_axis():
    robot = with_parameters(routed("body"), {ANGLE: 0.3, TWIST: -2.0, OFFSET: 0.001})
    for before, after in zip(ROUTES["body"], robot.cables[0].via_points, strict=True):
        there, here = (complex(*via.at[:2]) for via in (after, before))
        assert abs(there) == pytest.approx(abs(here) + 0.001)
        assert np.angle(there / here) == pytest.approx(0.3 - 2.0 * before.at[2])
        assert after.at[2] == before.at[2]
    back = with_parameters(robot, {ANGLE: 0.0, TWIST: 0.0, OFFSET: 0.0}).cables[0]
    for before, after in zip(ROUTES["body"], back.via_points, strict=True):
        np.testing.assert_allclose(after.at, before.at, rtol=0, atol=1e-15)


def test_it_cannot_lead_through_the_axis_nor_be_there_without_one():
    info = robot_parameters(routed("plate and space"))[OFFSET]
    assert (info.unit, info.value, info.floor) == ("m", 0.0, pytest.approx(-0.05))
    with pytest.raises(InputError, match="out of range"):
        with_parameters(routed("plate and space"), {OFFSET: -0.05})
    assert OFFSET not in robot_parameters(column_robot())
    with pytest.raises(InputError, match="direction of its offset is undefined"):
        Cable("front", (ViaPoint([0.0, 0.0, 0.1], "plate"), ViaPoint([0.05, 0.0, 0.0])), routing_axis=AXIS)


def test_a_via_point_outside_the_material_is_refused():
    cable = Cable("front", (ViaPoint([0.0151, 0.0, 0.05], "neck"), ViaPoint([0.05, 0.0, 0.0])), routing_axis=AXIS)
    with pytest.raises(MeshError, match="must lie inside its body"):
        build_twin(replace(routed("plate and space"), cables=(cable,)))
    build_twin(replace(routed("plate and space"), cables=(replace(cable, routing_axis=None),)))
