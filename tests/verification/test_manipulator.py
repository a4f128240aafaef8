"""The manipulator of paper B: symmetry to rounding, six cables in turn and together, slack ones found slack."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from softcal.geometry.centreline import Centreline, straight
from softcal.twin.manipulator import DiscMarkers, Discs, Manipulator, Springs, manipulator
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot, Rod
from softcal.twin.simulate import simulate

PULL = 6.0
SAMPLES = 3
SPRINGS = Springs(youngs_modulus=1.6e9, poissons_ratio=0.43, density=900.0)
SHAPE = Manipulator(springs=SPRINGS)
INSIDE = DiscMarkers(radius=0.0)


def default(**changes: object) -> Robot:
    return manipulator(replace(SHAPE, **changes))  # type: ignore[arg-type]


def symmetric() -> Robot:
    """The same with straight round backbones on the axis in the place of helices: six-fold about z."""

    def backbone(rod: Rod) -> Rod:
        z = rod.centreline.nodes[[0, -1], 2]
        line = straight((0.0, 0.0, z[0]), (0.0, 0.0, z[1]), len(rod.centreline.lengths) // 4)
        clamped = {name: nodes * (len(line.nodes) - 1) // max(nodes.max(), 1) for name, nodes in rod.clamped.items()}
        return replace(rod, centreline=line, clamped=clamped)

    robot = default(springs=replace(SPRINGS, wire_diameter=0.004), discs=Discs(mass=0.02))
    return replace(
        robot,
        rods=tuple(backbone(rod) for rod in robot.rods),
        markers=tuple(replace(m, at=np.array([0.0, 0.0, m.at[2]])) for m in robot.markers),
    )


def pulled(robot: Robot, **tensions: float) -> Response:
    ramp = np.linspace(0.0, 1.0, SAMPLES)
    protocol = Protocol({name: Command("tension", T * ramp) for name, T in tensions.items()})
    response = simulate(robot, protocol, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return response


def places(response: Response, robot: Robot) -> np.ndarray:
    """Positions of all markers in every sample, (n_samples, n_markers, 3) [m]."""
    names = [marker.name for marker in robot.markers]
    return np.stack([[response.channels[f"{name}.{axis}"] for axis in "xyz"] for name in names]).transpose(2, 0, 1)


def turn(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("cables", [("cable1", "cable2", "cable3"), ("cable4", "cable5", "cable6")])
def test_a_cable_120_deg_on_gives_the_answer_turned_by_120_deg(cables: tuple[str, ...]):
    robot = symmetric()
    first = places(pulled(robot, **{cables[0]: PULL}), robot)
    assert np.abs(first[-1, -1, :2]).max() > 0.01
    for k, cable in enumerate(cables[1:], start=1):
        other = places(pulled(robot, **{cable: PULL}), robot)
        np.testing.assert_allclose(other, first @ turn(2 * math.pi * k / 3).T, atol=1e-9 * SHAPE.total_length)


def test_the_plane_of_a_cable_is_one_of_symmetry():
    robot = symmetric()
    away = places(pulled(robot, cable1=PULL), robot)
    np.testing.assert_allclose(away[:, :, 1], 0.0, atol=1e-9 * SHAPE.total_length)
    # Cables 4 and 6 lie as mirror images about the plane of cable 2's azimuth turned by 60 deg, which holds cable 5.
    together = places(pulled(robot, cable4=PULL, cable6=PULL), robot)
    azimuth = SHAPE.cable_azimuths[4]
    across = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    np.testing.assert_allclose(together @ across, 0.0, atol=1e-9 * SHAPE.total_length)


def test_all_cables_of_an_end_pulled_alike_keep_a_symmetric_robot_straight():
    robot = symmetric()
    still = places(pulled(robot, cable4=0.3, cable5=0.3, cable6=0.3), robot)
    np.testing.assert_allclose(still[:, :, :2], 0.0, atol=1e-9 * SHAPE.total_length)
    assert np.all(np.diff(still[:, -1, 2]) > 0.0), "the tip of a hanging robot is pulled up"


def test_the_mirror_image_of_a_spring_gives_the_mirror_image_of_the_answer():
    """Seen in the plane y = 0: right-handed coils become left-handed, cable 2 becomes cable 3."""
    right = default(markers=INSIDE)
    left = default(markers=INSIDE, springs=replace(SPRINGS, left_handed=True))
    one = places(pulled(right, cable2=PULL), right)
    other = places(pulled(left, cable3=PULL), left)
    np.testing.assert_allclose(other, one * [1.0, -1.0, 1.0], atol=1e-9 * SHAPE.total_length)
    assert abs(one[-1, -1, 1]) > 0.04


def test_a_standing_manipulator_without_weight_is_a_hanging_one_turned_over():
    light = replace(SHAPE, springs=replace(SPRINGS, density=0.0), markers=INSIDE)
    hanging = manipulator(light, gravity=(0.0, 0.0, 0.0))
    standing = manipulator(replace(light, hanging=False), gravity=(0.0, 0.0, 0.0))
    # Half a turn about x takes azimuth a to -a: cable 2 comes to lie where cable 3 is.
    one = places(pulled(hanging, cable2=PULL), hanging)
    other = places(pulled(standing, cable3=PULL), standing)
    np.testing.assert_allclose(other, one * [1.0, -1.0, -1.0], atol=1e-9 * SHAPE.total_length)


@pytest.mark.parametrize("cable", SHAPE.cable_names)
def test_each_cable_bends_the_tip_towards_itself_and_leaves_the_others_slack(cable: str):
    robot = default()
    response = pulled(robot, **{cable: PULL})
    azimuth = SHAPE.cable_azimuths[SHAPE.cable_names.index(cable)]
    moved = places(response, robot)[-1] - places(response, robot)[0]
    towards = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    across = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    assert moved[-1] @ towards > 0.05
    assert abs(moved[-1] @ across) < 0.2 * (moved[-1] @ towards), "a helix is nearly symmetric"
    for other in SHAPE.cable_names:
        tension = response.channels[f"{other}.tension"]
        np.testing.assert_allclose(tension, PULL * np.linspace(0, 1, SAMPLES) if other == cable else 0.0, atol=1e-12)
    # A cable to the middle bends the half before it; the half after it only hangs.
    pitch = [response.channels[f"{disc}.z"][-1] - response.channels[f"{disc}.z"][0] for disc in SHAPE.disc_names]
    assert pitch[3] > pitch[1] > 0.0


def test_all_six_together_by_tension():
    robot = default()
    tensions = {"cable1": 3.0, "cable2": 0.0, "cable3": 0.0, "cable4": 0.0, "cable5": 4.0, "cable6": 0.0}
    few = pulled(robot, cable1=3.0, cable5=4.0)
    every = pulled(robot, **tensions)
    for name, values in few.channels.items():
        np.testing.assert_allclose(every.channels[name], values, atol=1e-9, err_msg=name)


def test_held_cables_go_slack_where_the_robot_bends_towards_them():
    """All six held at their length while one is pulled in: those that would have to push are slack, with no tension."""
    robot = default()
    ramp = np.linspace(0.0, 1.0, 3)
    # Pulled in by 1 mm all six are taut; then cable 6 by 15 mm more.
    shortening = {name: np.full(3, 0.001) for name in SHAPE.cable_names}
    shortening["cable6"] = 0.001 + 0.015 * ramp
    response = simulate(robot, Protocol({name: Command("shortening", d) for name, d in shortening.items()}))
    assert response.succeeded, response.status
    tension = {name: response.channels[f"{name}.tension"] for name in SHAPE.cable_names}
    assert all(values.min() > -1e-9 for values in tension.values()), "a cable pushes"
    assert tension["cable6"][-1] > 2.0
    slack = {name for name in SHAPE.cable_names if tension[name][-1] <= 1e-9}
    # Cables 1 and 3 pass through the discs beside cable 6.
    assert {"cable1", "cable3"} <= slack < set(SHAPE.cable_names) - {"cable6"}
    for name in SHAPE.cable_names:
        np.testing.assert_allclose(response.channels[f"{name}.shortening"], shortening[name], atol=1e-12)


def test_the_slack_ones_are_those_whose_way_is_shorter_than_they_are():
    """Cables held at rest length while cable 6 bends the robot: one is taut only where its way has become longer."""
    robot = default()
    free = pulled(robot, cable6=PULL)
    way = {
        name: -free.channels[f"{name}.shortening"][-1] for name in SHAPE.cable_names
    }  # grown beyond its length at rest
    held = [name for name in SHAPE.cable_names if name != "cable6"]
    for name in held:
        ramp = {"cable6": Command("shortening", free.channels["cable6.shortening"][-1:])}
        response = simulate(robot, Protocol({**ramp, name: Command("shortening", np.zeros(1))}))
        assert response.succeeded, response.status
        assert (response.channels[f"{name}.tension"][-1] > 1e-6) == (way[name] > 0.0), name


def test_a_finer_wire_hardly_moves_the_tip():
    coarse, fine = default(), default(springs=replace(SPRINGS, elements_per_turn=36))
    one, other = (places(pulled(robot, cable6=PULL), robot)[-1, -1] for robot in (coarse, fine))
    assert np.linalg.norm(one - other) < 5e-5


def test_sensitivities_to_every_springs_modulus_against_central_differences():
    robot = default()
    names = tuple(f"{spring}.youngs_modulus" for spring in SHAPE.spring_names)
    command = Protocol({"cable6": Command("tension", np.array([0.0, PULL]))})
    response = simulate(robot, command, sensitivities=names, curve_tolerance=0.0)

    for name in names:
        h = 1e-4 * 1.6e9
        up, down = (simulate(robot, command, {name: 1.6e9 + s * h}, curve_tolerance=0.0) for s in (1, -1))
        for channel in ("marker4.x", "marker4.y", "marker4.z", "marker2.x", "cable6.shortening"):
            central = (up.channels[channel][-1] - down.channels[channel][-1]) / (2 * h)
            exact = response.sensitivities[channel][name][-1]
            scale = abs(response.sensitivities["marker4.y"][name][-1])
            assert abs(exact - central) < 1e-5 * max(abs(central), 0.01 * scale), (name, channel)


def test_the_centreline_stands_between_the_faces_of_its_discs():
    robot = default()
    for k, rod in enumerate(robot.rods):
        line: Centreline = rod.centreline
        before, after = robot.plates[k].disc, robot.plates[k + 1].disc
        assert before is not None
        assert after is not None
        face = before.centre[2] - 0.5 * before.thickness
        assert line.nodes[0, 2] == pytest.approx(face, abs=1e-12)
        assert line.nodes[-1, 2] == pytest.approx(after.centre[2] + 0.5 * after.thickness, abs=1e-12)
    tip = robot.plates[-1].disc
    assert tip is not None
    assert tip.centre[2] - 0.5 * tip.thickness == pytest.approx(-SHAPE.total_length, abs=1e-12)
