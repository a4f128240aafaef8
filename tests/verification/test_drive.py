"""Drives: a motor that pulls one cable and pays out another, against the same cables commanded one by one."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from sofa_case import use_fake

import softcal
from softcal.errors import InputError, ParameterError, SimulationError
from softcal.geometry.centreline import straight
from softcal.geometry.primitives import box_mesh
from softcal.geometry.section import RoundBar
from softcal.mechanics.drive import PLAY_TORQUE
from softcal.plugins.calculix.crosscheck import crosscheck
from softcal.plugins.calculix.deck import in_its_law, write_calculix
from softcal.plugins.sofa.robot import command_faults_of_sofa, scene_faults
from softcal.plugins.sofa.simulator import sofa_engine
from softcal.plugins.sofa.writing import write_sofa
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.drive import Drive
from softcal.twin.cables import CableLine
from softcal.twin.in_time import simulate_in_time
from softcal.twin.live import LiveTwin
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Body, Cable, Plate, Robot, Rod, ViaPoint
from softcal.twin.schedule import Schedule
from softcal.twin.simulate import simulate
from softcal.twin.time_settings import TimeSettings

E, LONG, WIRE, ARM, RADIUS = 1e9, 0.1, RoundBar(0.003), 0.01, 0.008
EI, EA = E * WIRE.constants.I1, E * WIRE.constants.area
SPRUNG = {"spring_rate": 2e3, "pretension": 1.5}
EVERYTHING = {**SPRUNG, "gear_ratio": 5.0, "gear_backlash": 0.05, "zero": 0.1}
MEMORY = CableLine(stiffness=2e3, pretension=1.0, friction_memory=True, presliding=1e-4)


def rod(
    line: CableLine | None = None,
    friction: float = 0.0,
    sides: tuple[str, ...] = ("left", "right"),
    *,
    turns: bool = False,
) -> Robot:
    """A rod with a plate at its tip and cables beside it, each through a middle point of the rod; turns: and by a right
    angle around its foot.
    """
    places = {"left": (ARM, 0.0), "right": (-ARM, 0.0), "aside": (0.8 * ARM, 0.6 * ARM)}
    centre = straight((0.0, 0.0, 0.0), (0.0, 0.0, LONG), 6)
    spine = Rod(
        "spine",
        centre,
        WIRE,
        {"youngs_modulus": E, "poissons_ratio": 0.35},
        clamped={"tip": np.array([6])},
        fixed=np.array([0]),
        density=1200.0,
    )
    tip = Plate("tip", {}, np.array([0.0, 0.0, LONG]))
    cables = []
    for name in sides:
        x, y = places[name]
        via = [ViaPoint([x, y, z], on) for z, on in ((0.0, ""), (0.5 * LONG, "spine"), (LONG, "tip"))]
        first = [ViaPoint([3.0 * x, 3.0 * y, 0.0])] if turns else []
        cables.append(Cable(name, tuple(first + via), friction, "first", line=line or CableLine()))
    return Robot(rods=(spine,), plates=(tip,), cables=tuple(cables))


def driven(robot: Robot | None = None, cables: Mapping[str, float] | None = None, **own: float) -> Robot:
    drive = Drive(cables or {"left": 1.0, "right": -1.0}, RADIUS, **own)
    return replace(robot or rod(), actuators=(NamedActuator("servo", drive),))


def turned(robot: Robot, control: str, *values: float, theta: Mapping[str, float] | None = None, **by: object):
    return simulate(robot, Protocol({"servo": Command(control, np.array(values))}), theta, **by)


def pulled(robot: Robot, *angles: float) -> Response:
    """The cables alone, each by the length that the drive would take up."""
    ways = RADIUS * np.array(angles)
    return simulate(robot, Protocol({"left": Command("shortening", ways), "right": Command("shortening", -ways)}))


ANGLES = (0.1, 0.6, -0.4, 0.0)
READ = ("left.tension", "right.tension", "tip.x", "tip.z", "tip.pitch")


@pytest.mark.parametrize(
    ("line", "friction", "own"),
    [
        (CableLine(), 0.0, {}),
        (CableLine(compliance=1.0 / SPRUNG["spring_rate"], pretension=1.5), 0.0, SPRUNG),
        (CableLine(stiffness=3e3, pretension=1.0), 0.3, {}),
        (MEMORY, 0.3, {}),
    ],
    ids=["stiff", "springs", "friction", "friction with a memory"],
)
def test_its_cables_do_what_they_do_by_themselves(line: CableLine, friction: float, own: Mapping[str, float]) -> None:
    """Commanded by shortening r a, the cables have the same tensions; springs are the compliance of their machines."""
    by_drive = turned(driven(rod(CableLine() if own else line, friction), **own), "angle", *ANGLES)
    alone = pulled(rod(line, friction), *ANGLES)
    assert by_drive.succeeded, by_drive.status
    for channel in READ:
        expected = alone.channels[channel]
        tolerance = 1e-9 * np.abs(expected).max()
        np.testing.assert_allclose(by_drive.channels[channel], expected, rtol=0.0, atol=tolerance)
    torque = RADIUS * (alone.channels["left.tension"] - alone.channels["right.tension"])
    np.testing.assert_allclose(by_drive.channels["servo.torque"], torque, rtol=1e-9, atol=1e-12)
    assert (alone.channels["left.tension"] > 0.1).any()


def test_a_small_angle_bends_as_a_beam_with_springs() -> None:
    """r a = T (L/EA + h^2 L/EI + 1/k), with the cable at the distance h that is pulled, the other one slack."""
    angle, k = 1e-3, 5e3
    response = turned(driven(spring_rate=k), "angle", angle)
    tension = RADIUS * angle / (LONG / EA + ARM**2 * LONG / EI + 1.0 / k)
    assert response.channels["left.tension"][0] == pytest.approx(tension, rel=1e-3)
    assert response.channels["right.tension"][0] == 0.0
    assert response.channels["tip.pitch"][0] == pytest.approx(ARM * tension * LONG / EI, rel=1e-3)


def test_what_it_pays_out_is_slack() -> None:
    """The bent rod takes up less than the pulley pays out; without springs and pretension."""
    response = turned(driven(), "angle", 0.3, 0.6)
    np.testing.assert_array_equal(response.channels["right.tension"], 0.0)
    np.testing.assert_allclose(response.channels["left.shortening"], RADIUS * np.array([0.3, 0.6]), rtol=1e-9)
    assert (response.channels["right.shortening"] > -RADIUS * np.array([0.3, 0.6])).all()


def test_cables_on_other_radii() -> None:
    """A stepped pulley, both of its cables wound the same way."""
    response = turned(driven(cables={"left": 1.0, "right": 0.5}), "angle", 0.1)
    read = {name: values[0] for name, values in response.channels.items()}
    assert read["right.shortening"] == pytest.approx(0.5 * read["left.shortening"], rel=1e-9)
    expected = RADIUS * (read["left.tension"] + 0.5 * read["right.tension"])
    assert read["servo.torque"] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("own", [{}, SPRUNG, EVERYTHING], ids=["stiff", "springs", "everything"])
def test_driven_by_either_it_comes_to_one_state(own: Mapping[str, float]) -> None:
    robot, gear = driven(**own), own.get("gear_ratio", 1.0)
    by_angle = turned(robot, "angle", *(gear * np.array(ANGLES[:3])))
    by_torque = turned(robot, "torque", *by_angle.channels["servo.torque"])
    assert by_torque.succeeded, by_torque.status
    for channel in (*READ, "servo.angle"):
        expected = by_angle.channels[channel]
        tolerance = 1e-7 * np.abs(expected).max()
        np.testing.assert_allclose(by_torque.channels[channel], expected, rtol=0.0, atol=tolerance)


def test_a_gear_turns_the_motor_further_by_less_torque() -> None:
    plain, geared = turned(driven(**SPRUNG), "angle", 0.4), turned(driven(**SPRUNG, gear_ratio=-5.0), "angle", -2.0)
    assert geared.channels["servo.torque"][0] == pytest.approx(-plain.channels["servo.torque"][0] / 5.0, rel=1e-9)
    assert geared.channels["tip.pitch"][0] == pytest.approx(plain.channels["tip.pitch"][0], rel=1e-9)


def test_a_zero_shifts_the_angle() -> None:
    plain, shifted = turned(driven(**SPRUNG), "angle", 0.4), turned(driven(**SPRUNG, zero=0.1), "angle", 0.5)
    assert shifted.channels["servo.torque"][0] == pytest.approx(plain.channels["servo.torque"][0], rel=1e-9)


def test_within_its_backlash_it_turns_freely_and_beyond_lags_by_half_of_it() -> None:
    backlash = 0.1
    robot, plain = driven(**SPRUNG, gear_backlash=backlash), driven(**SPRUNG)
    free = turned(robot, "angle", *(0.49 * backlash * np.array([-1.0, -0.5, 0.5, 1.0])))
    assert np.abs(free.channels["servo.torque"]).max() < 10.0 * PLAY_TORQUE
    beyond = np.array([0.1, 0.4, -0.3])
    found = turned(robot, "angle", *(beyond + np.sign(beyond) * 0.5 * backlash))
    expected = turned(plain, "angle", *beyond).channels["servo.torque"]
    slope = expected[0] / beyond[0]
    lag = 0.25 * backlash * (PLAY_TORQUE / expected) ** 2  # the stated error of the angle
    assert np.abs(found.channels["servo.torque"] - expected).max() < 1.1 * slope * lag.max()


def test_friction_keeps_the_rod_bent_while_the_motor_turns_through_its_backlash() -> None:
    """The loop of a drive that is turned back: at no torque, a way of the backlash without any motion."""
    backlash, robot = 0.3, rod(MEMORY, friction=0.3, turns=True)
    way = np.concatenate([np.linspace(0.0, 1.0, 5), np.linspace(0.95, -1.0, 40)])
    loops = [turned(driven(robot, gear_backlash=b), "angle", *way) for b in (0.0, backlash)]
    still = []
    for loop in loops:
        assert loop.succeeded, loop.status
        still.append((np.abs(loop.channels["servo.torque"]) < 20.0 * PLAY_TORQUE) & (np.arange(len(way)) > 4))
    assert np.count_nonzero(still[0]) <= 1
    turns = way[still[1]]
    assert np.ptp(turns) == pytest.approx(backlash, abs=2.0 * 0.05)
    pitch = loops[1].channels["tip.pitch"]
    assert np.ptp(pitch[still[1]]) < 0.01 * np.ptp(pitch)
    assert pitch[still[1]].min() > 0.1 * pitch.max()


@pytest.mark.slow
@pytest.mark.parametrize("control", ["angle", "torque"])
def test_its_derivatives_are_those_of_differences(control: str) -> None:
    """By each of its parameters, by a modulus, and by its command, of every channel."""
    robot = driven(rod(CableLine(stiffness=4e3), friction=0.2), **EVERYTHING)
    values = np.array([2.0, 3.5, 0.3, -2.5] if control == "angle" else [2e-3, -1e-3, 4e-6])
    names = [name for name in robot_parameters(robot) if name.startswith("servo.")]
    assert len(names) == 5
    names += ["spine.youngs_modulus", "left.friction_coefficient"]
    command = f"servo.{control}"
    exact = turned(robot, control, *values, sensitivities=[*names, command])
    assert exact.succeeded, exact.status
    channels = [name for name in exact.channels if name.partition(".")[0] in ("servo", "left", "right", "tip")]

    def read(response: Response) -> np.ndarray:
        return np.array([response.channels[name] for name in channels]).T

    for name in (*names, command):
        h = 1e-6 * np.abs(values).max() if name == command else 1e-5 * robot_parameters(robot)[name].value
        ends = [
            turned(robot, control, *(values + s * h))
            if name == command
            else turned(robot, control, *values, theta={name: robot_parameters(robot)[name].value + s * h})
            for s in (1, -1)
        ]
        slope = (read(ends[0]) - read(ends[1])) / (2.0 * h)
        found = exact.sensitivities.by(name, channels)
        rounding = 1e-9 * np.abs(read(exact)).max(axis=0) / h
        assert (np.abs(found - slope) <= 1e-6 * np.abs(slope).max(axis=0) + 1e-3 * rounding + 1e-12).all(), name


def test_round_a_closed_loop_it_does_no_work() -> None:
    """With another cable that pulls aside: the sum of M da and T dq, by the trapezoidal rule of smooth loops."""
    robot = driven(rod(sides=("left", "right", "aside")), **SPRUNG)
    s = 2.0 * np.pi * np.arange(24) / 24
    angle, way = 0.1 * np.cos(s), 1.5e-3 + 1e-3 * np.sin(s)
    commands = {"servo": Command("angle", angle), "aside": Command("shortening", way)}
    response = simulate(robot, Protocol(commands))
    assert response.succeeded, response.status
    read = response.channels
    assert min(read[f"{name}.tension"].min() for name in ("left", "right", "aside")) > 0.0
    done = [read["servo.torque"] * -0.1 * np.sin(s), read["aside.tension"] * 1e-3 * np.cos(s)]
    assert abs(float(np.sum(done))) < 1e-8 * float(np.abs(done).sum())
    assert np.abs(np.sum(done, axis=1)).min() > 1e-3 * float(np.abs(done).sum())  # of each by itself


def test_a_live_twin_goes_where_simulations_go() -> None:
    robot = driven(**EVERYTHING)
    angles = (1.0, 2.0, 0.1, -1.5)
    twin, expected = LiveTwin(robot, {"servo": "angle"}), turned(robot, "angle", *angles)
    for k, angle in enumerate(angles):
        state = twin.at({"servo": angle})
        assert state.succeeded, state.status
        assert state.channels["servo.torque"] == pytest.approx(expected.channels["servo.torque"][k], rel=1e-6)
        assert state.channels["servo.angle"] == pytest.approx(angle)
    still, freed = twin.at({}), twin.at({}, released=["servo"])
    assert still.channels["servo.angle"] == freed.channels["servo.torque"] == 0.0
    assert min(freed.channels["left.tension"], freed.channels["right.tension"]) > 0.0
    free = LiveTwin(robot)
    assert free.controls == {"servo": "torque"}
    by = free.at({"servo": 1e-3}).by_commands()
    assert by["servo.angle", "servo.torque"] == pytest.approx(1.0 / twin_slope(robot, free), rel=1e-5)


def twin_slope(robot: Robot, free: LiveTwin) -> float:
    """d torque / d angle where a live twin is."""
    by_angle = LiveTwin(robot, {"servo": "angle"})
    state = by_angle.at({"servo": free.state.channels["servo.angle"]})
    return state.by_commands()["servo.torque", "servo.angle"]


@pytest.mark.parametrize(("control", "value"), [("angle", 1.5), ("torque", 1e-3)])
def test_moved_slowly_it_comes_to_rest_where_statics_do(control: str, value: float) -> None:
    robot = driven(**EVERYTHING)
    schedule = Schedule(np.array([0.0, 20.0, 60.0]), {"servo": Command(control, np.array([0.0, value, value]))})
    moved = simulate_in_time(robot, schedule, TimeSettings(time_step=1.0))
    still = turned(robot, control, value)
    assert moved.succeeded, moved.status
    for channel in ("servo.angle", "servo.torque", "left.tension", "right.tension", "tip.x"):
        assert moved.channels[channel][-1] == pytest.approx(still.channels[channel][0], rel=1e-4, abs=1e-9), channel


def test_a_torque_that_pulls_no_cable_is_no_state() -> None:
    response = turned(driven(cables={"left": 1.0}), "torque", 2e-3, -2e-3)
    assert not response.succeeded
    assert response.samples == (0,)
    assert "pulls no cable." in response.status


def test_its_cables_have_no_commands() -> None:
    robot = driven(rod(sides=("left", "right", "aside")))
    told = "left: this cable has no command of its own; got servo drives it"
    commands = {"left": Command("tension", np.ones(2))}
    with pytest.raises(ParameterError, match=told):
        simulate(robot, Protocol(commands))
    with pytest.raises(ParameterError, match=told):
        LiveTwin(robot, {"left": "tension"})
    with pytest.raises(ParameterError, match=told):
        simulate_in_time(robot, Schedule(np.array([0.0, 1.0]), commands), TimeSettings(time_step=0.1))
    alone = simulate(robot, Protocol({"aside": Command("shortening", np.array([1e-3]))}))
    assert alone.channels["servo.torque"][0] == alone.channels["left.tension"][0] == 0.0


needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)


def column(order: Literal[1, 2], law: str, **own: float) -> Robot:
    """A heavy column between two cables on a stepped pulley."""
    mesh = box_mesh((0.02, 0.02, 0.1), (2, 2, 6), order=order, origin=(-0.01, -0.01, 0.0))
    elastic = {"youngs_modulus": 1e6, "poissons_ratio": 0.4}
    body = Body(
        "column", mesh, mesh.node_sets["z0"], elastic, law=law, element="P1" if order == 1 else "P2", density=1e3
    )
    tip = Plate("tip", {"column": mesh.node_sets["z1"]}, np.array([0.0, 0.0, 0.1]))
    cables = [
        Cable(name, (ViaPoint([x, 0.0, 0.0]), ViaPoint([x, 0.0, 0.1], "tip")), 0.0, "first")
        for name, x in (("left", 0.015), ("right", -0.015))
    ]
    robot = Robot((body,), (tip,), tuple(cables), gravity=np.array([0.0, 0.0, -9.81]))
    return driven(robot, {"left": 1.0, "right": -0.8}, **own)


@needs_ccx
@pytest.mark.parametrize("own", [{}, {**SPRUNG, "gear_ratio": 4.0, "gear_backlash": 0.05}], ids=["stiff", "springs"])
@pytest.mark.parametrize(("control", "value"), [("angle", 1.2), ("torque", 0.02)])
def test_calculix_bends_a_column_by_the_tensions_of_its_drive(own, control, value) -> None:
    """Its cables have softcal's tensions, its shortenings are those that the drive takes up."""
    gear = own.get("gear_ratio", 1.0)
    command = Command(control, np.array([0.0, value * gear if control == "angle" else value / gear]))
    found = crosscheck(column(2, "neo-hooke-isochoric", **own), Protocol({"servo": command}), ["calculix"])
    assert not found.failed, found.failed
    (one,) = found.comparisons
    by_name = {difference.quantity: difference for difference in one.differences}
    assert one.agrees, one.verdict
    assert max(difference.relative for difference in one.differences) < 1e-6
    assert {"left.shortening", "right.shortening", "left.tension (by slope)"} <= by_name.keys()
    assert by_name["tip.rotation"].softcal > 0.3
    if not own and control == "angle":
        assert by_name["left.shortening"].engine == pytest.approx(RADIUS * value, rel=1e-5)


def test_the_deck_of_a_drive_has_its_cables_and_names_its_torque(tmp_path) -> None:
    robot = in_its_law(column(1, "neo-hooke", **SPRUNG))
    end = turned(robot, "angle", 0.1, snapshots=True).snapshots[-1]
    write_calculix(robot, end, tmp_path)
    text = (tmp_path / "robot.inp").read_text()
    assert text.count("*SPRING, ELSET=CABLE_LEFT") == text.count("*SPRING, ELSET=CABLE_RIGHT") == 1
    assert f"servo {end.efforts['servo']:.6g} N*m" in (tmp_path / "README.txt").read_text()


@pytest.mark.slow
def test_sofa_pulls_the_cables_of_a_drive_by_its_radii(monkeypatch: pytest.MonkeyPatch) -> None:
    """In the stand-in of tests/fake_sofa; derivatives by the drive's parameters are those of its cables' ways."""
    use_fake(monkeypatch, mechanics="twin")
    robot, engine = column(1, "neo-hooke", gear_ratio=2.0, zero=0.1), sofa_engine()
    protocol = Protocol({"servo": Command("angle", np.array([0.1, 1.0, -0.7]))})
    theirs, ours = (run(robot, protocol, sensitivities=["servo.radius"]) for run in (engine, simulate))
    assert theirs.succeeded, theirs.status
    for channel in (*READ, "servo.angle", "servo.torque", "left.shortening", "right.shortening"):
        scale = np.abs(ours.channels[channel]).max()
        np.testing.assert_allclose(theirs.channels[channel], ours.channels[channel], atol=1e-6 * scale, err_msg=channel)
    slopes = [one.sensitivities["tip.x"]["servo.radius"][1:] for one in (theirs, ours)]
    np.testing.assert_allclose(*slopes, rtol=3e-3)
    (one,) = crosscheck(robot, protocol, ["sofa"]).comparisons
    assert one.agrees, one.verdict
    assert {"servo.torque", "left.tension", "right.shortening"} <= {each.quantity for each in one.differences}


def test_the_schedule_of_a_scene_has_the_cables_of_its_drive(tmp_path) -> None:
    robot = column(1, "neo-hooke", zero=0.1)
    write_sofa(robot, Protocol({"servo": Command("angle", np.array([0.1, 0.6]))}), tmp_path, "column")
    head, *_, last = (tmp_path / "column" / "schedule.csv").read_text().splitlines()
    assert head == "time [s],left.shortening [m],right.shortening [m]"
    np.testing.assert_allclose([float(cell) for cell in last.split(",")[1:]], [RADIUS * 0.5, -0.8 * RADIUS * 0.5])
    assert "pulls servo by angle" in (tmp_path / "README.md").read_text()
    assert "(1 left, 2 right)" in (tmp_path / "README.md").read_text()


@pytest.mark.slow
def test_linear_tets_are_identified_from_the_angle_and_the_torque(tmp_path) -> None:
    robot = column(2, "neo-hooke")
    write_sofa(robot, Protocol({"servo": Command("angle", np.linspace(0.2, 0.6, 3))}), tmp_path, "column")
    parameters = json.loads((tmp_path / "column" / "parameters.json").read_text())
    left = parameters["differences_left"]["servo.torque"]
    assert left["unit"] == "N*m"
    assert left["largest_difference"] < 0.05 * left["of"]
    assert "N*mm" in (tmp_path / "README.md").read_text()


def test_what_a_scene_does_not_have_of_a_drive_is_refused() -> None:
    said = "\n".join(map(str, scene_faults(driven(**SPRUNG, gear_backlash=0.05))))
    assert "servo: a drive in SOFA takes up r a of each cable" in said
    assert "got spring_rate 2000, gear_backlash 0.05" in said
    assert "CalculiX, which gets the tensions" in said
    assert scene_faults(column(1, "neo-hooke", gear_ratio=2.0, zero=0.1)) == []
    (fault,) = command_faults_of_sofa(Protocol({"servo": Command("torque", np.array([0.01]))}))
    assert str(fault).startswith("servo: a drive in SOFA is driven by its angle; got torque; allowed: angle")
    assert command_faults_of_sofa(Protocol({"servo": Command("angle", np.array([0.01]))})) == []


def test_a_rotor_on_the_springs_of_its_cables_swings_as_a_mass_on_a_spring() -> None:
    """J N^2 a'' = N M - K a under a step of torque: exactly as backward Euler has it, and nearly a (1 - cos w t)."""
    J, N, torque, times = 2e-6, 5.0, 1e-3, np.linspace(0.0, 1.0, 401)
    robot = driven(**SPRUNG, gear_ratio=N, rotor_inertia=J)
    stiff = {"youngs_modulus": 1e13, "poissons_ratio": 0.35}
    light = replace(robot, rods=(replace(robot.rods[0], density=1e-3, parameters=stiff),))
    rates = turned(light, "torque", torque, sensitivities=["servo.torque"]).sensitivities["servo.angle"]
    stiffness = N**2 / rates["servo.torque"]
    frequency = np.sqrt(stiffness[0] / (J * N**2))
    assert frequency == pytest.approx(np.sqrt(2.0 * RADIUS**2 * SPRUNG["spring_rate"] / (J * N**2)), rel=1e-2)
    h = np.pi / frequency / 400
    schedule = Schedule(np.array([0.0, h, 400 * h]), {"servo": Command("torque", np.array([0.0, torque, torque]))})
    settings = TimeSettings(time_step=h, rayleigh_stiffness=0.0, rayleigh_mass=0.0)
    moved = simulate_in_time(light, schedule, settings)
    assert moved.succeeded, moved.status
    angle, speed, expected = 0.0, 0.0, [0.0]
    for _ in range(400):
        new = (N * torque + J * N**2 * (angle / h**2 + speed / h)) / (J * N**2 / h**2 + stiffness[0])
        angle, speed = new, (new - angle) / h
        expected.append(N * angle)
    found = moved.channels["servo.angle"]
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4 * max(expected))
    swing = N**2 * torque / stiffness[0] * (1.0 - np.cos(np.pi * times))
    np.testing.assert_allclose(found, swing, atol=0.02 * swing.max())


def test_an_angle_takes_the_torque_that_accelerates_the_rotor() -> None:
    """At a constant acceleration the torque is more by J phi'', and the robot does the same."""
    J, h, bend = 1e-4, 0.01, 2.0
    times = h * np.arange(21)
    schedule = Schedule(times, {"servo": Command("angle", 0.5 * bend * times**2)})
    settings = TimeSettings(time_step=h, rayleigh_stiffness=0.0)
    with_it, without = (
        simulate_in_time(driven(**SPRUNG, gear_ratio=2.0, **own), schedule, settings)
        for own in ({"rotor_inertia": J}, {})
    )
    more = with_it.channels["servo.torque"] - without.channels["servo.torque"]
    acceleration = np.diff(0.5 * bend * times**2, n=2, prepend=0.0) / h**2
    rayleigh = settings.rayleigh_mass * np.diff(0.5 * bend * times**2)[1:] / h
    np.testing.assert_allclose(more[2:], J * (acceleration[1:] + rayleigh), rtol=1e-6)
    for channel in READ:
        np.testing.assert_allclose(with_it.channels[channel], without.channels[channel], atol=1e-9)


def test_a_rotor_says_nothing_at_rest_and_is_refused_where_it_is_left_out() -> None:
    robot = driven(**SPRUNG, gear_ratio=2.0, rotor_inertia=1e-4)
    still, bare = (turned(one, "torque", 0.01) for one in (robot, driven(**SPRUNG, gear_ratio=2.0)))
    np.testing.assert_array_equal(still.channels["servo.angle"], bare.channels["servo.angle"])
    by = turned(robot, "torque", 0.01, sensitivities=["servo.rotor_inertia"]).sensitivities
    assert by["servo.angle"]["servo.rotor_inertia"] == 0.0
    with pytest.raises(SimulationError, match=r"The rotor of a drive has inertia.*Try a drive without"):
        softcal.linearise(robot, {"servo": 0.01})
    with pytest.raises(InputError, match=r"a rotor before a backlash[\s\S]*one of the two"):
        Drive({"left": 1.0}, RADIUS, gear_backlash=0.1, rotor_inertia=1e-4)
