"""Chambers in CalculiX: a bending finger under pressure ends where softcal's statics does."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import blown_box, hanging_finger

from softcal.plugins.calculix.chambers import forces_left_out
from softcal.plugins.calculix.crosscheck import EngineComparison, crosscheck
from softcal.plugins.calculix.deck import calculix_deck, in_its_law, write_calculix
from softcal.twin.build import twin_of
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Plate, Robot
from softcal.twin.simulate import simulate

needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX (ccx) is not installed; Debian: calculix-ccx"
)


def compared(robot: Robot, control: str, value: float) -> EngineComparison:
    found = crosscheck(robot, Protocol({"main": Command(control, np.array([0.0, value]))}), ["calculix"])
    assert not found.failed, found.failed
    return found.comparisons[0]


def assert_agrees(one: EngineComparison, bent: float) -> None:
    by_name = {difference.quantity: difference for difference in one.differences}
    assert set(by_name) == {"main.volume", "main.pressure (by slope)", "finger: largest displacement"}
    assert one.agrees, one.verdict
    assert one.verdict.startswith("calculix and softcal agree to 0.0001")
    assert by_name["finger: largest displacement"].softcal > bent
    assert by_name["main.volume"].unit == "m^3"
    assert by_name["main.pressure (by slope)"].engine != by_name["main.pressure (by slope)"].softcal


@needs_ccx
@pytest.mark.parametrize("is_open", [False, True])
def test_a_linear_finger_is_calculix_own(is_open):
    assert_agrees(compared(hanging_finger("P1", is_open=is_open), "pressure", 4e4), 1e-3)


@needs_ccx
@pytest.mark.slow
@pytest.mark.parametrize("is_open", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_bending_finger_is_calculix_own_up_to_40_kPa(is_open):
    assert_agrees(compared(hanging_finger("P2", is_open=is_open), "pressure", 4e4), 2e-3)


@needs_ccx
@pytest.mark.parametrize("on", ["side", "rim"])
def test_a_vacuum_and_a_volume_are_solved_at_softcals_pressure(on):
    """Of an open box with a plate beside its opening, or on it as a cap."""
    robot = replace(blown_box("P1", is_open=True, medium="gas"), gravity=np.array([0.0, 0.0, -9.81]))
    (box,) = robot.bodies
    x, _, z = box.mesh.points.T
    nodes = np.flatnonzero((x > 0.0199) & (z > 0.0) if on == "side" else z > 0.0199)
    robot = replace(robot, plates=(Plate("plate", {"box": nodes}, np.array([0.02, 0.0, 0.02]), mass=0.01),))
    for value in (-1e-6, 2e-6):
        one = compared(robot, "volume", value)
        assert one.agrees, one.verdict
        by_name = {difference.quantity: difference for difference in one.differences}
        assert by_name["main.volume"].engine == pytest.approx(value, rel=1e-4)
        assert abs(by_name["main.pressure (by slope)"].softcal) > 1e3
        assert by_name["plate.displacement"].softcal > 1e-5


def test_the_deck_presses_on_each_face_of_the_wall_and_names_the_pressure(tmp_path):
    robot = in_its_law(hanging_finger("P2", is_open=False))
    (body,), (main,) = robot.bodies, robot.actuators
    end = simulate(robot, Protocol({"main": Command("pressure", np.array([1e3]))}), snapshots=True).snapshots[-1]
    text = calculix_deck(robot, [end]).text
    lines = text.split("*DLOAD, OP=NEW\n")[1].split("*")[0].splitlines()
    sides = {1: (0, 1, 2), 2: (0, 3, 1), 3: (1, 3, 2), 4: (2, 3, 0)}  # of CalculiX's manual
    pressed = set()
    for line in lines:
        element, side, pressure = line.split(", ")
        assert float(pressure) == pytest.approx(1e3)
        pressed.add(frozenset(body.mesh.tets[int(element) - 1, list(sides[int(side[1:])])].tolist()))
    assert pressed == {frozenset(face[:3].tolist()) for face in main.actuator.walls["finger"]}
    write_calculix(robot, end, tmp_path)
    assert "main 1000 Pa" in (tmp_path / "README.txt").read_text()


@pytest.mark.parametrize("element", ["P1", "P2"])
def test_what_calculix_leaves_out_closes_the_surface(element):
    """Under a pressure all around the forces of a closed wall vanish, so those of an open one are the caps'."""
    closed, opened = (in_its_law(hanging_finger(element, is_open=is_open)) for is_open in (False, True))
    pressure, forces = 1e3, []
    for robot in (closed, opened):
        protocol = Protocol({"main": Command("pressure", np.array([pressure]))})
        shape = simulate(robot, protocol, snapshots=True).snapshots[-1]
        forces.append(forces_left_out(twin_of(robot), shape).sum(axis=0))
    area = 0.004 * 0.008
    np.testing.assert_allclose(forces[0], 0.0, atol=1e-6 * pressure * area)
    np.testing.assert_allclose(forces[1], [0.0, 0.0, -pressure * area], atol=1e-6 * pressure * area)
