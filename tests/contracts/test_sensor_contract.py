"""What every sensor promises; a new one is registered, and so joins the list and inherits the tests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
from mechanics_cases import blown_box
from sensor_checks import CHECKS, robot_with

from softcal.sensing.sensor import SENSORS, NamedSensor, Sensor
from softcal.twin.actuated import NamedActuator
from softcal.twin.actuators.drive import Drive
from softcal.twin.robot import Robot

# Of a sensor that project files list: one that reads the checks' robot (plate `plate`, cable `front`, markers m1, m2).
LISTED: dict[str, Sensor] = {}


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
@pytest.mark.parametrize("name", SENSORS)
def test_every_sensor_keeps_the_promise(name: str, check: Callable[[type[Sensor], Robot], None]) -> None:
    sensor = SENSORS[name]
    if sensor.of == "chamber":
        check(sensor, blown_box("P1", is_open=True, medium="gas"))
    elif sensor.of == "drive":
        drive = NamedActuator("servo", Drive({"front": 1.0}, 0.01))
        check(sensor, replace(robot_with(), actuators=(drive,)))
    else:
        check(sensor, robot_with() if sensor.of else robot_with(NamedSensor("own", LISTED[name])))
