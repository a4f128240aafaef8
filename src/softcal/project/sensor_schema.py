"""Schema of `sensors` and `actuators` in a project file: the kind of each, its fields, and the parts that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeVar

from pydantic import TypeAdapter, ValidationError
from pydantic_core import InitErrorDetails

from softcal.catalogue import Catalogue
from softcal.declare import Reading, as_pydantic, shown
from softcal.errors import Fault, InputError
from softcal.project.document import Findings
from softcal.sensing.sensor import SENSORS, NamedSensor, Sensor
from softcal.twin.actuated import ACTUATORS, Actuator
from softcal.twin.channels import part_fault, sensor_fault
from softcal.twin.robot import Robot

Member = TypeVar("Member")


def _member(value: Any, family: Catalogue[type[Member]], among: Sequence[str]) -> Member:
    """The member of a family that a section describes: `sensor: NAME`, and the fields of its class."""
    key = family.what
    if not isinstance(value, dict):
        raise InputError(Fault("this is of the wrong kind", got=shown(value), allowed="a mapping of keys"))
    if key not in value:
        raise InputError(Fault("a key is missing", allowed=f"'{key}' must be given"))
    name = value[key]
    if not isinstance(name, str) or name not in family:
        unknown = as_pydantic(family.unknown(str(name), among=among))
        raise ValidationError.from_exception_data(key, [InitErrorDetails(type=unknown, loc=(key,), input=name)])
    return TypeAdapter(family[name]).validate_python({field: given for field, given in value.items() if field != key})


def _sensor(value: Any) -> Sensor:
    return _member(value, SENSORS, [name for name, one in SENSORS.items() if not one.of])


# `sensor: NAME` or `actuator: NAME`, and the fields of the class that is registered by that name.
SensorSection = Annotated[Sensor, Reading(_sensor, "instead")]
ActuatorSection = Annotated[Actuator, Reading(lambda value: _member(value, ACTUATORS, list(ACTUATORS)), "instead")]


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
            sensor = _sensor(one)
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
