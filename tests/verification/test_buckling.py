"""Where equilibria cease to be stable the robot falls to the stable ones: Euler's loads, and elasticas beyond them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import elastic, pulled
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk
from sweep_case import robot

from softcal.geometry.centreline import straight
from softcal.geometry.primitives import box_mesh
from softcal.geometry.quadratic import to_quadratic
from softcal.geometry.section import RectangularBar, RoundBar
from softcal.mechanics import path as path_module
from softcal.mechanics.node import Line, node_at, pushing
from softcal.mechanics.path import between, follow
from softcal.mechanics.state import rest_state
from softcal.mechanics.statics import Statics
from softcal.twin.build import build_twin
from softcal.twin.in_time import simulate_in_time
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, PointLoad, Robot, Rod, ViaPoint
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import simulate

E, LENGTH, WIDTH, THICKNESS = 5e7, 0.2, 0.01, 0.004
EI = E * WIDTH * THICKNESS**3 / 12.0
TOP = np.array([0.0, 0.0, LENGTH])
PINNED = np.pi**2 * EI / LENGTH**2  # a cable from tip to foot has no moment about either
CANTILEVER = PINNED / 4.0
WAIT = Schedule(np.array([0.0, 0.01]), {})


def column(
    section=None, *, cables: tuple[Cable, ...] = (), loads: tuple[PointLoad, ...] = (), elements: int = 40
) -> Robot:
    """A straight rod that stands on the ground, with a plate on top."""
    section = RectangularBar(WIDTH, THICKNESS) if section is None else section
    line = straight((0, 0, 0), tuple(TOP), elements)
    rod = Rod("column", line, section, elastic(E, 0.3), clamped={"top": [elements]}, fixed=[0])
    return Robot(plates=(Plate("top", {}, TOP),), rods=(rod,), cables=cables, loads=loads)


def axial(side: float = 0.0, name: str = "front") -> Cable:
    """A cable from the top down to the foot, beside the axis by `side` [m] along x."""
    beside = np.array([side, 0.0, 0.0])
    return Cable(name, (ViaPoint(beside), ViaPoint(TOP + beside, "top")), pulled_end="first")


def modulus_of(measure: Callable[[float], float], target: float) -> float:
    """The elliptic modulus k at which an elastica's measure, falling in k, is `target`."""
    return float(brentq(lambda k: measure(k) - target, 1e-9, 0.995))


def chord_of(k: float) -> float:
    """Tip to foot of a pinned elastica, over its length."""
    return float(2.0 * ellipe(k * k) / ellipk(k * k) - 1.0)


def test_a_column_that_a_cable_presses_follows_the_elastica() -> None:
    d = np.array([0.2, 1.0, 5.0, 10.0, 20.0, 40.0, 60.0]) * 1e-3
    response = simulate(column(cables=(axial(),)), pulled(*d), sensitivities=["column.youngs_modulus"])
    assert response.succeeded, response.status
    exact = [4.0 * ellipk(k * k) ** 2 * EI / LENGTH**2 for k in (modulus_of(chord_of, 1.0 - v / LENGTH) for v in d)]
    # Shear and stretch, which the elastica has none of, take 0.08 % away.
    np.testing.assert_allclose(response.channels["front.tension"], exact, rtol=1e-3)
    assert np.all(response.channels["front.tension"] < exact)
    # Everything scales with the modulus.
    slope = E * response.sensitivities["front.tension"]["column.youngs_modulus"]
    np.testing.assert_allclose(slope, response.channels["front.tension"], rtol=1e-6)


def test_it_is_told_where_it_buckles() -> None:
    response = simulate(column(cables=(axial(),)), pulled(0.001))
    critical = 1e3 * PINNED * LENGTH / (E * WIDTH * THICKNESS)
    assert "Not stable at " in response.status
    at = float(response.status.split("Not stable at ")[1].split(" mm of shortening of front")[0])
    assert critical * (1.0 - 1e-3) < at < critical * (1.0 + 5e-3)  # shear, and how closely it is looked for
    assert response.instabilities == response.status[response.status.index("Not stable") :]
    straight_on = simulate(column(cables=(axial(),)), pulled(0.9e-3 * critical))
    assert "stable" not in straight_on.status
    assert straight_on.instabilities == ""
    assert straight_on.channels["top.x"][0] == straight_on.channels["top.y"][0] == pytest.approx(0.0, abs=1e-12)


def test_it_bends_the_way_of_the_weaker_side_in_a_drive_by_tension_too() -> None:
    share = np.array([0.5, 0.95, 1.1, 1.3])
    protocol = Protocol({"front": Command("tension", share * PINNED)})
    response = simulate(column(cables=(axial(),)), protocol)
    assert response.succeeded, response.status
    k = np.array(
        [np.nan, np.nan] + [brentq(lambda k, s=s: (2 * ellipk(k * k) / np.pi) ** 2 - s, 0, 0.99) for s in share[2:]]
    )
    d = response.channels["front.shortening"]
    np.testing.assert_allclose(d[:2], share[:2] * PINNED * LENGTH / (E * WIDTH * THICKNESS), rtol=1e-3)
    # The load hardly grows with the bend, so 0.08 % of the load is more of the length.
    np.testing.assert_allclose(d[2:], [LENGTH * (1.0 - chord_of(v)) for v in k[2:]], rtol=0.02)


def test_a_weight_on_a_column_bends_it_as_a_cantilever() -> None:
    for share in (0.9, 1.2, 2.0):
        load = PointLoad("weight", "top", TOP, np.array([0.0, 0.0, -share * CANTILEVER]))
        robot = column(loads=(load,))
        response = simulate(robot, Protocol({}))
        assert response.succeeded, response.status
        aside = float(np.hypot(response.channels["top.x"][0], response.channels["top.y"][0]))
        if share < 1.0:
            assert aside < 1e-9
            assert "stable" not in response.status
            continue
        assert "Not stable under its loads" in response.status
        in_time = simulate_in_time(replace(robot, plates=(replace(robot.plates[0], mass=0.01),)), WAIT)
        assert "Not stable under its loads" in in_time.status
        k = brentq(lambda k, s=share: (2.0 * ellipk(k * k) / np.pi) ** 2 - s, 0.0, 0.999)
        assert aside == pytest.approx(2.0 * k * LENGTH / ellipk(k * k), rel=5e-3)


@pytest.mark.slow
def test_a_solid_column_buckles_at_eulers_load() -> None:
    mesh = box_mesh((WIDTH, THICKNESS, LENGTH), (1, 1, 40))
    corner = np.array([0.5 * WIDTH, 0.5 * THICKNESS, 0.0])
    ends = {z: np.flatnonzero(np.isclose(to_quadratic(mesh).points[:, 2], z)) for z in (0.0, LENGTH)}
    body = Body("solid", to_quadratic(mesh), fixed=ends[0.0], parameters=elastic(E, 0.3), element="P2P1")
    top = Plate("top", {"solid": ends[LENGTH]}, corner + TOP)
    cable = Cable("front", (ViaPoint(corner), ViaPoint(corner + TOP, "top")), pulled_end="first")
    response = simulate(Robot((body,), (top,), (cable,)), pulled(0.002, 0.02))
    assert response.succeeded, response.status
    assert "Not stable" in response.status
    exact = [
        4.0 * ellipk(k * k) ** 2 * EI / LENGTH**2
        for k in (modulus_of(chord_of, 1.0 - v / LENGTH) for v in (0.002, 0.02))
    ]
    np.testing.assert_allclose(response.channels["front.tension"], exact, rtol=0.03)


def test_two_cables_that_pull_alike_buckle_it_too() -> None:
    cables = (axial(0.004, "left"), axial(-0.004, "right"))
    half = 0.5 * PINNED * np.array([0.5, 1.5])
    response = simulate(
        column(RectangularBar(THICKNESS, WIDTH), cables=cables),
        Protocol({n: Command("tension", half) for n in ("left", "right")}),
    )
    assert response.succeeded, response.status
    assert "Not stable before sample 2 (left " in response.status
    aside = np.hypot(response.channels["top.x"], response.channels["top.y"])
    assert aside[0] < 1e-9
    assert aside[1] > 0.1 * LENGTH


def test_what_can_move_without_force_counts_as_stable() -> None:
    """A round column may buckle to any side: it turns about its axis without force, and that is no second buckling."""
    response = simulate(column(RoundBar(0.006), cables=(axial(),)), pulled(0.005, 0.01, 0.02))
    assert response.succeeded, response.status
    k = [modulus_of(chord_of, 1.0 - v / LENGTH) for v in (0.005, 0.01, 0.02)]
    bending = E * np.pi * 0.003**4 / 4.0
    exact = [4.0 * ellipk(v * v) ** 2 * bending / LENGTH**2 for v in k]
    np.testing.assert_allclose(response.channels["front.tension"], exact, rtol=2e-3)
    places = response.status.split("Not stable at ")[1].split(" mm of shortening of front")[0].split(", ")
    critical = 1e3 * np.pi**2 * bending / (E * np.pi * 0.003**2 * LENGTH)
    assert np.array(places, dtype=float) == pytest.approx(critical, rel=0.02)


def test_a_column_pressed_beside_its_axis_bends_without_a_fall() -> None:
    """Its curve has a knee, a hundred times as narrow as the pull is long; it is met all the same."""
    beside = np.array([0.0, 1e-4, 0.0])
    robot = column(cables=(Cable("front", (ViaPoint(beside), ViaPoint(TOP + beside, "top")), pulled_end="first"),))
    d = np.array([0.03, 0.07, 0.1, 0.5, 2.0, 20.0]) * 1e-3
    solved, read = (simulate(robot, pulled(*d), curve_tolerance=tolerance) for tolerance in (0.0, 1e-4))
    assert "stable" not in read.status
    for channel in ("front.tension", "top.y"):
        exact = solved.channels[channel]
        np.testing.assert_allclose(read.channels[channel], exact, atol=2e-4 * np.abs(exact).max())


@pytest.mark.parametrize("d", [(8.54,), (5.0,), (1.4702678540003604,), (1.557756217622556, 2.33281891, 2.67224729)])
def test_it_falls_once_and_always_to_the_same_side(d: tuple[float, ...]) -> None:
    """Wherever the samples are: a response that jumps from side to side with them, or with E, fits nothing."""
    first = simulate(column(cables=(axial(),)), pulled(0.001))
    response = simulate(column(cables=(axial(),)), pulled(*np.array(d) * 1e-3))
    assert np.all(np.sign(response.channels["top.y"]) == np.sign(first.channels["top.y"])), response.status
    assert "," not in response.status.split("Not stable at")[1].split(" mm of")[0]


@pytest.mark.parametrize("share", [1.1759, 1.2436, 1.4356, 1.5922])
def test_a_drive_by_tension_falls_once_too(share: float) -> None:
    response = simulate(column(cables=(axial(),)), Protocol({"front": Command("tension", np.array([share * PINNED]))}))
    assert response.channels["top.y"][0] < -0.05
    assert "," not in response.status.split("Not stable at")[1].split(" mm of")[0]


def test_a_curve_is_refined_where_it_is_read() -> None:
    """The column's knee is sharp, and no sample of the few is at it."""
    few, many = PINNED * np.array([0.5, 1.4356]), PINNED * np.linspace(0.5, 1.4356, 200)
    one, other = (simulate(column(cables=(axial(),)), Protocol({"front": Command("tension", T)})) for T in (few, many))
    assert one.succeeded, one.status
    for name, values in other.channels.items():
        np.testing.assert_allclose(one.channels[name], values[[0, -1]], rtol=1e-4, atol=1e-4 * np.abs(values).max())
    assert one.n_factorisations < 0.8 * other.n_factorisations


def test_slopes_where_the_last_sample_is_the_one_that_it_falls_to() -> None:
    """The line across the fall is some thousand times as steep."""
    d = 1.0015e-3 * PINNED * LENGTH / (E * WIDTH * THICKNESS) * 1e3
    last, goes_on = (simulate(column(cables=(axial(),)), pulled(*at)) for at in ((d,), (d, 1.5 * d)))
    for channel in ("front.tension", "top.z"):
        assert last.slopes[channel][0] == pytest.approx(goes_on.slopes[channel][0], rel=0.01)


def test_a_node_that_is_put_in_beyond_a_fall_knows_of_it() -> None:
    twin = build_twin(column(cables=(axial(),)))
    statics = Statics(twin.system, parameter_values(twin.robot))
    line = Line(np.array([False]), np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))
    start = node_at(statics, line, 0.0, rest_state(twin.system.layout), ())
    path = follow(statics, line, start, 2e-4, first_step=2e-5)
    fell = next(i for i, node in enumerate(path.nodes) if node.is_snapped)
    upright = statics.equilibrium(start.state, line.at(2e-4)).state
    unseen = replace(path, nodes=(start, replace(node_at(statics, line, 2e-4, upright, ()), is_stable=True)))
    assert between(statics, line, unseen, 1e-4).is_snapped
    assert not between(statics, line, path, 0.5 * path.nodes[fell - 1].c).is_snapped
    # A tension that rounding makes negative is no push: it must not hide that the straight column is not stable.
    of_two = build_twin(column(cables=(axial(), axial(name="back")))).system
    twice = replace(upright, effort=np.array([*upright.effort, -1e-12]))
    assert not node_at(statics, line, 2e-4, upright, ()).is_stable
    assert not pushing(of_two, twice).any()
    assert list(pushing(of_two, replace(twice, effort=np.array([1.0, -1e-3])))) == [False, True]
    assert pushing(statics.system, replace(upright, effort=-upright.effort)).any()
    statics.release()


def test_via_points_that_meet_bear_what_presses_them_together() -> None:
    """A manipulator that is pulled together: its wires' ends meet, where it seemed to buckle again and again."""
    tension = {"cable1": np.array([15.0, 20.0]), "cable2": np.array([0.1, 0.1])}
    response = simulate(robot(), Protocol({name: Command("tension", values) for name, values in tension.items()}))
    assert response.succeeded, response.status
    assert "From sample 2 on via points 2 and 3 of cable1 have met (0.08" in response.status
    assert "stable" not in response.status
    apart = simulate(robot(), Protocol({name: Command("tension", values[:1]) for name, values in tension.items()}))
    assert "met" not in apart.status


def tendons(side: float = 0.004) -> tuple[Cable, ...]:
    """Three cables around the axis."""
    at = [side * np.array([np.cos(a), np.sin(a), 0.0]) for a in 2.0 * np.pi * np.arange(3) / 3.0]
    return tuple(Cable(f"c{i}", (ViaPoint(x), ViaPoint(TOP + x, "top")), pulled_end="first") for i, x in enumerate(at))


def test_three_cables_fold_a_round_column_up_once() -> None:
    """Beyond 2.18 of Euler's load foot and top meet. It seemed to fall again and again there."""
    alike = np.array([2.54 * np.pi**2 * ROUND_EI / LENGTH**2 / 3.0])
    robot = column(RoundBar(0.006), cables=tendons(), elements=16)
    response = simulate(robot, Protocol({cable.name: Command("tension", alike) for cable in robot.cables}))
    assert response.succeeded, response.status
    assert response.instabilities.count("before sample") == 1
    assert "have met (0.1" in response.status
    assert response.n_factorisations < 900


def test_what_falls_too_often_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(path_module, "MOST_SNAPS", 0)
    response = simulate(column(cables=(axial(),)), pulled(0.001))
    assert not response.succeeded
    assert "it buckles or snaps more than 0 times" in response.status


ROUND_EI = E * np.pi * 0.003**4 / 4.0


@pytest.mark.parametrize("elements", [10, 16, 33])
@pytest.mark.parametrize("share", [1.05, 1.7, 2.54])
def test_a_round_column_buckles_once_and_stays_in_its_plane(elements: int, share: float) -> None:
    """It turns about its axis without force: rounding chose how far, in every step, and thousands of nodes followed."""
    critical = np.pi**2 * ROUND_EI / LENGTH**2
    protocol = Protocol({"front": Command("tension", critical * np.array([0.5, 1.02, share]))})
    response = simulate(column(RoundBar(0.006), cables=(axial(),), elements=elements), protocol)
    assert response.succeeded, response.status
    assert response.n_factorisations < 300
    assert response.instabilities.count("mm of shortening") == 1
    assert "," not in response.instabilities.split("Not stable at")[1].split(" mm of")[0]
    places = np.stack([response.channels[f"top.{axis}"][1:] for axis in "xy"])
    middle = places / np.linalg.norm(places, axis=0)
    assert abs(middle[:, 0] @ middle[:, 1]) == pytest.approx(1.0, abs=1e-6)
    if share > 2.2:  # foot and top meet where the elastica closes, at 2.18 of the critical load
        assert response.channels["front.shortening"][-1] == pytest.approx(LENGTH, rel=2e-3)
        closed = float(response.status.split("zero length from ")[1].split(" N on")[0])
        assert closed == pytest.approx(4.0 * ellipk(0.8261) ** 2 * ROUND_EI / LENGTH**2, rel=5e-3)
        return
    k = float(brentq(lambda k: (2.0 * ellipk(k * k) / np.pi) ** 2 - share, 0.0, 0.99))
    assert response.channels["front.shortening"][-1] == pytest.approx(LENGTH * (1.0 - chord_of(k)), rel=0.03)


def test_a_round_column_leans_once_under_a_weight() -> None:
    for share in (1.05, 2.54, 5.0):
        load = np.array([0.0, 0.0, -share * np.pi**2 * ROUND_EI / LENGTH**2 / 4.0])
        robot = column(RoundBar(0.006), loads=(PointLoad("weight", "top", TOP, load),), elements=16)
        response = simulate(robot, Protocol({}))
        assert response.succeeded, response.status
        assert response.n_factorisations < 600
        k = brentq(lambda k, s=share: (2.0 * ellipk(k * k) / np.pi) ** 2 - s, 0.0, 0.99999)
        aside = float(np.hypot(response.channels["top.x"][0], response.channels["top.y"][0]))
        assert aside == pytest.approx(2.0 * k * LENGTH / ellipk(k * k), rel=0.01)


@pytest.mark.parametrize("control", ["tension", "shortening"])
def test_three_tendons_pulled_alike_buckle_a_round_column_once(control: str) -> None:
    """By length its top moves aside to any side as in a parallelogram: that is free as long as all cables are taut."""
    share = {"tension": 1.2 * np.pi**2 * ROUND_EI / LENGTH**2 / 3.0, "shortening": 0.9e-3}[control]
    robot = column(RoundBar(0.006), cables=tendons(), elements=16)
    commands = {cable.name: Command(control, share * np.array([0.2, 1.0])) for cable in robot.cables}
    response = simulate(robot, Protocol(commands))
    assert response.succeeded, response.status
    assert response.instabilities.count("before sample") == 1
    assert "later" not in response.instabilities
    assert response.n_factorisations < 700
    aside = np.hypot(response.channels["top.x"], response.channels["top.y"])
    assert aside[0] < 1e-9
    assert aside[1] > 0.01 * LENGTH


def test_free_modes_are_found_where_there_are_some() -> None:
    for section, n_free in (
        (RoundBar(0.006), 1),
        (RectangularBar(WIDTH, THICKNESS), 0),
        (RectangularBar(0.005, 0.0051), 0),
    ):
        twin = build_twin(column(section, cables=(axial(),)))
        statics = Statics(twin.system, parameter_values(twin.robot))
        line = Line(np.array([False]), np.zeros(1), np.zeros(1), np.zeros(1), np.ones(1))
        path = follow(
            statics, line, node_at(statics, line, 0.0, rest_state(twin.system.layout), ()), 1e-3, first_step=1e-5
        )
        assert path.nodes[0].free.size == 0
        assert path.reached
        fell = next(i for i, node in enumerate(path.nodes) if node.is_snapped)
        for node in path.nodes[fell:]:
            assert (node.free.shape[1] if node.free.size else 0) == n_free
            if n_free:  # the slope does not go along it
                free = node.free[:, 0] / np.linalg.norm(node.free[:, 0])
                assert abs(free @ node.slope[: len(free)]) < 1e-6 * np.linalg.norm(node.slope[: len(free)])
        statics.release()
