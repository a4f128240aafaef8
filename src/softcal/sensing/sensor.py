"""Sensors: their readings of a robot, the rates of these, and the register of sensors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

from softcal.catalogue import Catalogue
from softcal.checks import Floats
from softcal.declare import Checked, Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.limits import part_name_fault
from softcal.sensing.kind import ChannelKind

# Parts of a robot that sensors may come with, in the order of their channels.
PARTS = ("cables", "plates", "markers")
# What else project files call a column, or the end of a channel's name.
TAKEN = ("time", "mass", "qw", "qx", "qy", "qz")


class Posture(Protocol):
    """A state of the robot, as sensors see it."""

    def point(self, name: str) -> Floats:
        """Position (3,) [m] of a marker, or of a plate's reference."""
        ...

    def rotation(self, plate: str) -> Floats:
        """Rotation (3, 3) of a plate from its rest pose."""
        ...

    def coordinate(self, actuator: str) -> float:
        """Coordinate of an actuator, in its own unit: of a cable its shortening, slack or not."""
        ...

    def effort(self, actuator: str) -> float:
        """Effort of an actuator, in its own unit: of a cable its tension."""
        ...


class PostureRates(Protocol):
    """Rates of a posture by k parameters or controls at once."""

    def point(self, name: str) -> Floats:
        """Rates (3, k) of the position of a marker, or of a plate's reference."""
        ...

    def rotation(self, plate: str) -> Floats:
        """Angular velocities (3, k) of a plate, in the robot's frame."""
        ...

    def coordinate(self, actuator: str) -> Floats:
        """Rates (k,) of an actuator's coordinate."""
        ...

    def effort(self, actuator: str) -> Floats:
        """Rates (k,) of an actuator's effort."""
        ...


@displayed
class Sensor(Declared, ABC):
    """Reads one or more channels of a robot: a frozen dataclass, whose fields are the keys of a project file.

    Attributes
    ----------
    name
        By which project files know it.
    kinds
        Its channels' kinds, in the order of what it reads.
    columns
        Kinds of channels that tables may have of the part and a step of preparation turns into those that it reads.
    of
        "cables", "plates", "markers", or the name of a kind of actuator, where every such part has this sensor: its one
        field is then the part's name. "" of a sensor that a project file lists.
    """

    name: ClassVar[str]
    kinds: ClassVar[tuple[ChannelKind, ...]]
    columns: ClassVar[tuple[ChannelKind, ...]] = ()
    of: ClassVar[str] = ""

    @abstractmethod
    def sense(self, robot: Posture) -> Sequence[float] | Floats:
        """The channels (n,) [SI] of a posture."""

    @abstractmethod
    def rates(self, robot: Posture, moving: PostureRates) -> Sequence[Floats] | Floats:
        """The channels' rates (n, k) at a posture."""


@displayed
@dataclass(frozen=True)
class ActuatorSensor(Sensor):
    """Coordinate and effort of an actuator. A subclass states their kinds, in this order, and its kind as `of`."""

    actuator: str

    def sense(self, robot: Posture) -> list[float]:
        return [robot.coordinate(self.actuator), robot.effort(self.actuator)]

    def rates(self, robot: Posture, moving: PostureRates) -> list[Floats]:
        return [moving.coordinate(self.actuator), moving.effort(self.actuator)]


@displayed
@dataclass(frozen=True)
class NamedSensor(Checked):
    """A sensor on a robot. name: first part of its channels' names."""

    name: str
    sensor: Sensor

    def __post_init__(self) -> None:
        super().__post_init__()
        if fault := part_name_fault(self.name):
            raise InputError(replace(fault, where="name"))


def _faults(sensor: type[Sensor], known: Mapping[str, type[Sensor]]) -> list[Fault]:
    """Faults of a class to be registered: missing members, and kinds of channels that mean something else."""
    if not (isinstance(sensor, type) and issubclass(sensor, Sensor)):
        return [Fault("this is not a sensor", "sensor", repr(sensor)[:60], "a subclass of softcal.Sensor")]
    where = f"sensor {sensor.__name__}"
    attributes = [name for name in ("name", "kinds") if not hasattr(sensor, name)]
    missing = [*attributes, *sorted(sensor.__abstractmethods__)]
    faults = [Fault("the sensor lacks something", where, allowed=f"'{name}' must be there") for name in missing]
    others = [kind for kind in (*getattr(sensor, "kinds", ()), *sensor.columns) if not isinstance(kind, ChannelKind)]
    faults += [Fault("this is not a kind of channel", where, repr(one), "a softcal.ChannelKind") for one in others]
    if faults:
        return faults
    if sensor.of not in ("", *PARTS) and not issubclass(sensor, ActuatorSensor):
        faults.append(unknown("no such parts have sensors", where, sensor.of, PARTS))
    names = [kind.name for kind in sensor.kinds]
    if not names or len(set(names)) < len(names):
        faults.append(Fault("a sensor has one or more channels, of different kinds", where, ", ".join(names) or "none"))
    others = [one for one in known.values() if one.name != sensor.name]
    taken = {kind.name: kind for one in others for kind in (*one.kinds, *one.columns)}
    for kind in (*sensor.kinds, *sensor.columns):
        if not kind.name.isidentifier() or kind.name.endswith("_sd") or kind.name in TAKEN or not kind.unit:
            what = "a kind of channel cannot be called so, or has no unit"
            faults.append(Fault(what, where, f"'{kind.name}' in '{kind.unit}'", attempt="another name"))
        elif taken.get(kind.name, kind) != kind:
            what = "another sensor has channels of this name that are of another kind"
            faults.append(Fault(what, where, kind.name, attempt="another name"))
    return faults


SENSORS: Catalogue[type[Sensor]] = Catalogue("sensor", "softcal.sensors", _faults, home="softcal.sensing.sensors")

register_sensor = SENSORS.registrar(
    "register_sensor",
    "Add a sensor of one's own: a robot's `sensors`, columns of tables, results and reports know it from then on.",
)
