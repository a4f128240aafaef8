"""Schema of `sensors` in a project file: the kind of each, its fields, and the parts that it reads."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError
from pydantic_core import InitErrorDetails

from softcal.declare import Reading, as_pydantic, shown
from softcal.errors import Fault, InputError
from softcal.project.document import Findings
from softcal.sensing.sensor import SENSORS, NamedSensor, Sensor
from softcal.twin.channels import part_fault, sensor_fault
from softcal.twin.robot import Robot

KEY = "sensor"


def _read(value: Any) -> Sensor:
    if not isinstance(value, dict):
        raise InputError(Fault("this is of the wrong kind", got=shown(value), allowed="a mapping of keys"))
    if KEY not in value:
        raise InputError(Fault("a key is missing", allowed=f"'{KEY}' must be given"))
    name = value[KEY]
    if not isinstance(name, str) or name not in SENSORS:
        unknown = as_pydantic(SENSORS.unknown(str(name), among=[one for one in SENSORS if not SENSORS[one].of]))
        raise ValidationError.from_exception_data(KEY, [InitErrorDetails(type=unknown, loc=(KEY,), input=name)])
    return TypeAdapter(SENSORS[name]).validate_python({key: given for key, given in value.items() if key != KEY})


# `sensor: NAME`, and the fields of the class that is registered by that name.
SensorSection = Annotated[Sensor, Reading(_read, "instead")]


def check_sensors(given: Mapping[str, object], parts: Mapping[str, list[str]], findings: Findings) -> None:
    """Record sensors that read parts which the robot does not have; faults within a sensor are recorded already.

    Parameters
    ----------
    given
        Plain data of each sensor.
    parts
        Names of the robot's parts by kind, such as "cables"; None if unknown, since the robot has faults.
    findings
        Collects the faults and warnings.
    """
    for name, one in given.items():
        try:
            sensor = _read(one)
        except (InputError, ValidationError):
            continue
        if fault := part_fault(name, sensor, parts):
            path = ("robot", "sensors", name)
            findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)


def built_sensors(given: Mapping[str, Sensor], robot: Robot, findings: Findings) -> tuple[NamedSensor, ...]:
    """Sensors of a robot; those that cannot read it are recorded.

    Parameters
    ----------
    given
        Sensors by name.
    robot
        The robot.
    findings
        Collects the faults and warnings.
    """
    for name, sensor in given.items():
        if fault := sensor_fault(robot, name, sensor):
            path = ("robot", "sensors", name)
            findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    return tuple(NamedSensor(name, sensor) for name, sensor in given.items())
