"""Offsets of named via points: derivatives of all channels by them against central differences, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import column_robot, elastic

from softcal.errors import InputError
from softcal.geometry.centreline import spaced, straight
from softcal.geometry.section import RoundBar
from softcal.twin.build import build_twin
from softcal.twin.cables import CableLine, RoutingAxis
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Cable, Marker, Robot, Rod, ViaPoint
from softcal.twin.routing import bored
from softcal.twin.simulate import simulate

pytestmark = pytest.mark.usefixtures("small_balls")
AXES = [f"front.base.{axis}_offset" for axis in "xyz"] + [f"front.end.{axis}_offset" for axis in "xy"]


@pytest.fixture(autouse=True)
def _solved_to_rounding(monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)


def tentacle(line: CableLine | None = None, friction: float = 0.0) -> Robot:
    """A rod that hangs, with a cable that converges to its axis, a point at every node."""
    rod = Rod(
        "arm",
        straight((0.0, 0.0, 0.0), (0.0, 0.0, -0.3), spaced((0.04, 1.0), 0.125)),
        RoundBar(0.02),
        {"youngs_modulus": 0.5e6, "poissons_ratio": 0.45},
        fixed=np.array([0]),
        density=1200.0,
    )
    ends = (ViaPoint([0.006, 0.009, -0.012], "arm", name="base"), ViaPoint([0.001, 0.002, -0.3], "arm", name="end"))
    via = bored(ends, {}, {"arm": rod.centreline})
    assert len(via) > 7
    cable = Cable("front", via, friction, "first", line=line or CableLine())
    return Robot(
        rods=(rod,), cables=(cable,), markers=(Marker("tip", "arm", [0.0, 0.0, -0.3]),), gravity=(0.0, 0.0, -9.81)
    )


def column() -> Robot:
    """A column whose cable runs through a named point on its plate, one in its body, and one in space."""
    via = (
        ViaPoint([0.012, 0.0031, 0.1], "plate", name="end"),
        ViaPoint([0.0113, 0.0031, 0.071], "neck", name="base"),
        ViaPoint([0.011, 0.0, 0.0], name="foot"),
    )
    return column_robot(
        "P1", parameters=elastic(0.4e6, 0.43), divisions=(2, 2, 4), mass=0.05, cables=(Cable("front", via, 0.2),)
    )


def driven(*values: float, by: str = "tension") -> Protocol:
    return Protocol({"front": Command(by, np.array(values))})


def assert_derivatives(robot: Robot, protocol: Protocol, names: list[str], h: float = 1e-6) -> None:
    response = simulate(robot, protocol, sensitivities=tuple(names), curve_tolerance=0.0)
    assert response.succeeded, response.status
    for name in names:
        ends = [simulate(robot, protocol, {name: s * h}, curve_tolerance=0.0).channels for s in (1.0, -1.0)]
        want = {channel: (ends[0][channel] - ends[1][channel]) / (2.0 * h) for channel in ends[0]}
        for unit in set(response.units.values()):
            of_unit = [channel for channel in want if response.units[channel] == unit]
            scale = max(np.abs(want[channel]).max() for channel in of_unit)
            for channel in of_unit:
                got = response.sensitivities[channel][name]
                np.testing.assert_allclose(
                    got, want[channel], rtol=1e-5, atol=5e-6 * scale + 1e-8, err_msg=f"{channel} by {name}"
                )
        assert max(np.abs(one).max() for one in want.values()) > 0.0


@pytest.mark.parametrize("by", ["tension", "shortening"])
def test_a_tentacles_channels_follow_its_via_points(by):
    values = (0.5, 2.0) if by == "tension" else (0.002, 0.008)
    assert_derivatives(tentacle(friction=0.1), driven(*values, by=by), AXES)


@pytest.mark.parametrize("line", [{}, {"friction_preload": 0.4, "friction_speed": 0.02}], ids=["plain", "preload"])
@pytest.mark.parametrize("by", ["tension", "shortening"])
def test_they_do_so_through_a_history_of_friction_and_stretch(by, line):
    """Pulled, let go and pulled again; in statics the viscous part takes no part."""
    robot = tentacle(CableLine(stiffness=2e3, friction_memory=True, **line), 0.2)
    values = (0.5, 2.0, 1.2, 1.6) if by == "tension" else (0.002, 0.009, 0.006, 0.008)
    assert_derivatives(robot, driven(*values, by=by), AXES[::2], h=1e-7)


def test_via_points_on_a_plate_in_a_body_and_in_space_move_each_by_itself():
    names = [f"front.{via}.{axis}_offset" for via, axis in (("end", "x"), ("base", "y"), ("base", "z"), ("foot", "y"))]
    assert_derivatives(column(), driven(0.002, 0.006, by="shortening"), names)


def test_points_between_two_follow_their_offsets_in_proportion():
    robot = tentacle()
    moved = with_parameters(robot, {"front.base.x_offset": 1e-3, "front.end.y_offset": -2e-3})
    was, now = (np.array([via.at for via in one.cables[0].via_points]) for one in (robot, moved))
    share = np.linalg.norm(was - was[0], axis=1) / np.linalg.norm(was[-1] - was[0])
    np.testing.assert_allclose((now - was)[:, 0], 1e-3 * (1.0 - share), atol=1e-9)
    np.testing.assert_allclose((now - was)[:, 1], -2e-3 * share, atol=1e-9)
    assert robot_parameters(moved)["front.end.y_offset"].value == -2e-3
    back = with_parameters(moved, {"front.base.x_offset": 0.0, "front.end.y_offset": 0.0})
    np.testing.assert_allclose([via.at for via in back.cables[0].via_points], was, atol=1e-15)


def test_an_offset_along_a_rod_keeps_the_section_that_carries_the_point():
    moved = with_parameters(tentacle(), {"front.base.z_offset": 5e-3})
    twin, before = build_twin(moved), build_twin(tentacle())
    assert [len(place) for place in twin.routes["front"]] == [len(place) for place in before.routes["front"]]


def test_only_named_via_points_are_parameters():
    robot = column()
    via = robot.cables[0].via_points
    plain = replace(robot, cables=(replace(robot.cables[0], via_points=(replace(via[0], name=""), *via[1:])),))
    found = {name for name in robot_parameters(plain) if name.endswith("_offset")}
    assert found == {f"front.{name}.{axis}_offset" for name in ("base", "foot") for axis in "xyz"}


def test_two_of_one_name_and_a_routing_axis_beside_names_are_refused():
    via = column().cables[0].via_points
    with pytest.raises(InputError, match="two via points share a name"):
        Cable("front", (via[0], replace(via[1], name="end")))
    with pytest.raises(InputError, match="cannot be the name of a via point"):
        Cable("front", (replace(via[0], name="a.b"), via[1]))
    with pytest.raises(InputError, match="no named via points"):
        Cable("front", via, routing_axis=RoutingAxis())


def test_offsets_of_markers_beside_them_leave_theirs_in_place():
    both = {"front.base.y_offset": 1e-3, "tip.x_offset": 1e-3}
    rest, alone, found = (
        simulate(tentacle(), driven(1.0), theta).channels["tip.y"][0]
        for theta in ({}, {"front.base.y_offset": 1e-3}, both)
    )
    assert abs(alone - rest) > 1e-4
    assert found == pytest.approx(alone, abs=2e-5)
