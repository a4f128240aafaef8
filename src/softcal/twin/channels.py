"""The channels of a robot: those of its cables, plates and markers, and those of its other sensors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, ParameterError, unknown
from softcal.sensing.channel import ChannelName, other_of
from softcal.sensing.sensor import PARTS, SENSORS, NamedSensor, Sensor
from softcal.twin.robot import Robot

STIFFNESS = "_stiffness"  # suffix of the stiffness of a channel: `tip.x_stiffness`


def sensors_of(robot: Robot) -> tuple[NamedSensor, ...]:
    """Every sensor: sensors of cables, actuators, plates and markers, then the robot's own."""
    parts = [("cables", cable.name) for cable in robot.cables]
    parts += [(part.actuator.name, part.name) for part in robot.actuators]
    parts += [(kind, part.name) for kind in ("plates", "markers") for part in getattr(robot, kind)]
    come = [
        NamedSensor(part, sensor(part))  # pyright: ignore[reportCallIssue] (the one field of such a sensor)
        for kind, part in parts
        for sensor in SENSORS.values()
        if sensor.of == kind
    ]
    return (*come, *robot.sensors)


def channels_of(sensors: Iterable[NamedSensor]) -> list[ChannelName]:
    """The channels of sensors, in their order."""
    return [ChannelName(kind, one.name) for one in sensors for kind in one.sensor.kinds]


def require_sensors(robot: Robot) -> None:
    """Check the robot's own sensors.

    Raises
    ------
    ParameterError
        For a sensor of a marker, plate or cable that the robot does not have, or one that does not read its channels.
    """
    if faults := [fault for one in robot.sensors if (fault := sensor_fault(robot, one.name, one.sensor))]:
        raise ParameterError(faults)


def part_fault(name: str, sensor: Sensor, parts: Mapping[str, Iterable[str]]) -> Fault | None:
    """The fault of a sensor that every part has, or that reads a part which is not among those of a robot; or None.

    Parameters
    ----------
    name
        Name of the sensor.
    sensor
        The sensor.
    parts
        Names of the parts by kind, such as "plates"; their places may not be known yet.
    """
    if fault := _of_parts(name, sensor):
        return fault
    # Somewhere, no two at the same place, so that what a sensor reads of two of them is a number.
    somewhere = {
        kind: {part: np.array([np.cos(k), np.sin(k), k + 0.5 * i]) for k, part in enumerate(parts[kind])}
        for i, kind in enumerate(PARTS)
    }
    try:
        driven = dict.fromkeys([*parts["cables"], *parts["actuators"]])
        sensor.sense(_AtRest(somewhere["markers"], somewhere["plates"], driven))
    except _NoPart as error:
        return replace(error.faults[0], where=name)
    except (ParameterError, ArithmeticError):
        return None  # it may read a number where the parts are
    return None


def sensor_fault(robot: Robot, name: str, sensor: Sensor) -> Fault | None:
    """The fault of a sensor on a robot at rest, or None.

    Parameters
    ----------
    robot
        The robot.
    name
        Name of the sensor.
    sensor
        The sensor.
    """
    if fault := _of_parts(name, sensor):
        return fault
    try:
        at_rest = _AtRest(
            {marker.name: marker.place for marker in robot.markers},
            {plate.name: plate.reference for plate in robot.plates},
            {part.name: part for part in robot.actuated},
        )
        read = np.asarray(sensor.sense(at_rest), dtype=np.float64)
    except ParameterError as error:
        (fault,) = error.faults
        return Fault(fault.what, name, fault.got, fault.allowed, fault.attempt)
    if read.shape != (len(sensor.kinds),) or not np.isfinite(read).all():
        allowed = f"a finite number for each of {', '.join(kind.name for kind in sensor.kinds)}"
        return Fault("the sensor does not read its channels at rest", name, np.array2string(read), allowed)
    return None


def _of_parts(name: str, sensor: Sensor) -> Fault | None:
    """The fault of a sensor that every part of a kind has already, or None."""
    if not sensor.of:
        return None
    allowed = ", ".join(sorted(key for key, one in SENSORS.items() if not one.of)) or "none"
    parts = sensor.of if sensor.of in PARTS else f"{sensor.of}s"
    return Fault(f"every one of the {parts} has this sensor", name, sensor.name, allowed)


class _NoPart(ParameterError):
    """A sensor reads a part that there is not."""


@dataclass(frozen=True)
class _AtRest:
    """The robot as it was built, as sensors see it: places [m] of markers and plates, and actuators, by name."""

    markers: Mapping[str, Floats]
    plates: Mapping[str, Floats]
    actuators: Mapping[str, object]

    def point(self, name: str) -> Floats:
        return _named(name, "marker or plate", {**self.markers, **self.plates})

    def rotation(self, plate: str) -> Floats:
        _named(plate, "plate", self.plates)
        return np.eye(3)

    def coordinate(self, actuator: str) -> float:
        _named(actuator, "cable or actuator", self.actuators)
        return 0.0

    def effort(self, actuator: str) -> float:
        return self.coordinate(actuator)


V = TypeVar("V")


def _named(name: str, what: str, known: Mapping[str, V]) -> V:
    if name not in known:
        raise _NoPart(unknown(f"the robot has no such {what}", "", name, known))
    return known[name]


def stiffness_units(robot: Robot) -> dict[str, str]:
    """The stiffnesses of moving plates' channels and of actuators' coordinates, and their units."""
    of_plate, moving = {"m": "N/m", "rad": "N*m/rad"}, {plate.name for plate in robot.plates if not plate.fixed}
    units: dict[str, str] = {}
    for channel in channels_of(sensors_of(robot)):
        if channel.carrier in moving and channel.kind.unit in of_plate:
            units[f"{channel}{STIFFNESS}"] = of_plate[channel.kind.unit]
        elif channel.kind.drives == "coordinate":
            units[f"{channel}{STIFFNESS}"] = f"{other_of(channel.kind).unit}/{channel.kind.unit}"
    return units
