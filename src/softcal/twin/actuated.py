"""The family of the robot's actuators: parts with a coordinate and an effort, of which a command prescribes one.

A kind of actuator is one file: a frozen dataclass, derived from `Actuator` and registered, whose fields are the keys of
`robot.actuators` in a project file, and the sensor that reads its two channels. Commands, protocols, channels, limits,
parameters and calibration ask the family. Cables, which have a section of their own and share one term, are of it too.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, Self, cast

from softcal.catalogue import Catalogue
from softcal.checks import Floats, Ints
from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, unknown
from softcal.quantities import Quantity
from softcal.sensing.channel import channel_name
from softcal.sensing.kind import ChannelKind
from softcal.twin.part import NamedPart
from softcal.units import format_quantity, format_range

if TYPE_CHECKING:
    from softcal.mechanics.actuator import ActuatorTerm
    from softcal.twin.cables import ViaPoint


class Numbering(Protocol):
    """The numbering of the robot's points, as an actuator needs it to build its term."""

    @property
    def X(self) -> Floats:
        """The points of the undeformed robot so far (n_points, 3) [m]."""
        ...

    def faces(self, body: str, faces: Ints | str, where: str, *, is_wall: bool = False) -> Ints:
        """Points of faces (n, 3 or 6) of a body's elements, outwards.

        Parameters
        ----------
        body
            Name of the body.
        faces
            Corners of faces (n, 3 or more) of its mesh, or the name of a group of that.
        where
            Place for error messages.
        is_wall
            Whether they must be on the body's surface, each once, and bound the space of one actuator alone.
        """
        ...

    def cable(self, name: str, where: str) -> int:
        """The number of a cable among the actuators.

        Parameters
        ----------
        name
            Name of the cable.
        where
            Place for error messages.
        """
        ...

    def support(self, at: Floats, on: str, where: str) -> Sequence[tuple[int, float]]:
        """A point as points with weights.

        Parameters
        ----------
        at
            The point (3,) [m].
        on
            Name of the body, plate or rod that it is on; "" in space.
        where
            Place for error messages.
        """
        ...


class ActuatedPart(NamedPart, ABC):
    """A part that drives the robot: a cable, or a named actuator. Pictures draw its route and its surfaces."""

    @property
    @abstractmethod
    def kind(self) -> str:
        """Noun for the actuator, such as cable or chamber."""

    @property
    @abstractmethod
    def route(self) -> tuple[ViaPoint, ...]:
        """The points that it runs through; none where it is no line."""

    @property
    def surfaces(self) -> Mapping[str, Ints | str]:
        """Body -> the part of its surface that it acts on: faces (n, 3 or 6) of its mesh, or a region's name."""
        return {}

    @property
    @abstractmethod
    def channels(self) -> tuple[ChannelKind, ChannelKind]:
        """Kinds of the channels of its coordinate and of its effort."""

    @property
    @abstractmethod
    def ranges(self) -> tuple[Quantity, Quantity]:
        """Kinds of quantity of the commands of its coordinate and of its effort."""

    @property
    def controls(self) -> dict[str, Quantity]:
        """Name -> kind of quantity that a command can prescribe: the coordinate and the effort."""
        return {kind.name: quantity for kind, quantity in zip(self.channels, self.ranges, strict=True)}

    def command_fault(self, control: str, values: Floats) -> Fault | None:
        """Why it cannot follow a command; None where it can.

        Parameters
        ----------
        control
            Name of its coordinate or effort.
        values
            Values of the command (n,) [SI].
        """
        where = f"{self.name}.{control}"
        if control not in self.controls:
            return unknown("the actuator cannot be commanded by this quantity", self.name, control, self.controls)
        kind = self.controls[control]
        faults = (kind.fault(float(end), where) for end in (values.min(), values.max()))
        return next((fault for fault in faults if fault is not None), None)


def effort_shares(
    parts: Iterable[ActuatedPart], efforts: Mapping[str, float], *others: Mapping[str, float]
) -> dict[str, float]:
    """Actuator -> its effort over the largest of its kind [-], of those of a kind of which one has an effort.

    Parameters
    ----------
    parts
        The actuators.
    efforts, others
        Actuator -> its effort [SI]; in other states, of which the largest may be.
    """
    known = [part for part in parts if part.name in efforts]
    largest: dict[str, float] = {}
    for part in known:
        each = (abs(one.get(part.name, 0.0)) for one in (efforts, *others))
        largest[part.kind] = max(largest.get(part.kind, 0.0), *each)
    return {part.name: abs(efforts[part.name]) / most for part in known if (most := largest[part.kind]) > 0.0}


@displayed
class Actuator(Declared, ABC):
    """Drives a robot by an effort on a coordinate: a frozen dataclass, whose fields are the keys of a project file.

    Attributes
    ----------
    name
        By which project files know it.
    channels, ranges
        Kinds of the channels, and of the quantities that commands have, of its coordinate and of its effort.
    quantities
        Kinds of quantity of its parameters, by the names of the fields that have their values; a field that is None is
        no parameter.
    region_key
        The key of a project file, if any, that maps bodies to their regions.
    """

    name: ClassVar[str]
    channels: ClassVar[tuple[ChannelKind, ChannelKind]]
    ranges: ClassVar[tuple[Quantity, Quantity]]
    quantities: ClassVar[Mapping[str, Quantity]] = {}
    region_key: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def term(self, name: str, places: Numbering) -> ActuatorTerm:
        """Its term: one actuator, by the name of the part, its coordinate and effort by those of its channels.

        Parameters
        ----------
        name
            Name of the part, first part of its parameters' names.
        places
            The numbering of the robot's points.

        Raises
        ------
        MeshError
            Where it cannot be attached.
        """

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the cables that the actuator drives, which have no commands of their own."""
        return ()

    @property
    def has_pretension(self) -> bool:
        """Whether the actuator stays at zero without a command, as a cable with a pretension does."""
        return False

    def with_values(self, values: Mapping[str, float]) -> Self:
        """The same with other values [SI] of its parameters, by the names of the fields."""
        return replace(cast("Any", self), **values)

    @property
    def route(self) -> tuple[ViaPoint, ...]:
        """The points that it runs through, on what carries them, as it is drawn; none where it is no line."""
        return ()

    @property
    def surfaces(self) -> Mapping[str, Ints | str]:
        """Body -> the part of its surface that it acts on: faces (n, 3 or 6) of its mesh, or a region's name."""
        return {}

    def on_surfaces(self, surfaces: Mapping[str, Ints | str]) -> Self:
        """The same on other surfaces, such as those of another mesh, of the same bodies."""
        return self


@displayed
@dataclass(frozen=True)
class NamedActuator(ActuatedPart):
    """An actuator of a robot. name: first part of the names of its channels and parameters."""

    actuator: Actuator

    @property
    def kind(self) -> str:
        return self.actuator.name

    @property
    def route(self) -> tuple[ViaPoint, ...]:
        return self.actuator.route

    @property
    def surfaces(self) -> Mapping[str, Ints | str]:
        return self.actuator.surfaces

    @property
    def channels(self) -> tuple[ChannelKind, ChannelKind]:
        return self.actuator.channels

    @property
    def values(self) -> dict[str, float]:
        """The values [SI] of the actuator's parameters, by the last parts of their names."""
        stated = {key: getattr(self.actuator, key) for key in self.actuator.quantities}
        return {key: float(value) for key, value in stated.items() if value is not None}

    def with_values(self, values: Mapping[str, float]) -> NamedActuator:
        """The actuator with the values [SI] of its own parameters among those by dotted name."""
        own = {key: values[f"{self.name}.{key}"] for key in self.values if f"{self.name}.{key}" in values}
        return replace(self, actuator=self.actuator.with_values(own)) if own else self

    @property
    def ranges(self) -> tuple[Quantity, Quantity]:
        return self.actuator.ranges


def limited_channels(parts: Iterable[ActuatedPart], key: str) -> dict[str, Quantity]:
    """Channels of actuators that a key of limits means, with their kinds of quantity.

    Parameters
    ----------
    parts
        The actuators.
    key
        A channel, such as `front.tension`, or a kind of channel, such as `tension`, for all that have it.
    """
    return {
        f"{part.name}.{control}": quantity
        for part in parts
        for control, quantity in part.controls.items()
        if key in (control, f"{part.name}.{control}")
    }


def limits_faults(parts: Sequence[ActuatedPart], key: str, low: float, high: float) -> list[Fault]:
    """The faults of limits of actuators' channels.

    Parameters
    ----------
    parts
        The actuators.
    key
        See `limited_channels`.
    low, high
        The limits [SI].
    """
    where = f"actuator_limits.{key}"
    found = limited_channels(parts, key)
    if not found:
        known = dict.fromkeys(name for part in parts for one in part.controls for name in (f"{part.name}.{one}", one))
        return [unknown("no actuator has such a channel", "actuator_limits", key, known)]
    faults = [fault for quantity in found.values() for end in (low, high) if (fault := quantity.fault(end, where))]
    if not faults and not low < high:
        got = format_range(low, high, next(iter(found.values())).unit)
        faults.append(Fault("the limits contradict each other", where, got, "the lower one first"))
    return faults[:1]


def faults_of_limits(limits: Mapping[str, tuple[float, float]], values: Mapping[str, Floats]) -> list[Fault]:
    """A fault for each channel of an actuator that leaves its limits.

    Parameters
    ----------
    limits
        Channel -> lowest and highest value [SI].
    values
        Channel -> values [SI] of a test.
    """
    faults: list[Fault] = []
    for channel, (low, high) in limits.items():
        ends = (values[channel].min(), values[channel].max()) if channel in values else ()
        if beyond := [float(end) for end in ends if not low <= end <= high]:
            unit = channel_name(channel).kind.unit
            got, allowed = format_quantity(beyond[-1], unit), format_range(low, high, unit)
            faults.append(Fault(f"the test is beyond the limits of {channel}", "", got, allowed))
    return faults


def _faults(kind: type[Actuator], known: Mapping[str, type[Actuator]]) -> list[Fault]:
    """Faults of a class to be registered."""
    if not (isinstance(kind, type) and issubclass(kind, Actuator)):
        return [Fault("this is not an actuator", "actuator", repr(kind)[:60], "a subclass of softcal.Actuator")]
    where = f"actuator {kind.__name__}"
    lacks = [name for name in ("name", "channels", "ranges") if not hasattr(kind, name)]
    lacks += sorted(kind.__abstractmethods__)
    if lacks:
        return [Fault("the actuator lacks something", where, allowed=f"'{name}' must be there") for name in lacks]
    faults: list[Fault] = []
    if [one.drives for one in kind.channels] != ["coordinate", "effort"]:
        got = ", ".join(f"{one.name}: {one.drives or 'neither'}" for one in kind.channels)
        faults.append(Fault("an actuator has a coordinate and an effort", where, got, "channels that drive, in turn"))
    missing = [key for key in kind.quantities if key not in getattr(kind, "__dataclass_fields__", {})]
    return faults + [Fault("a parameter is no field of the actuator", where, key) for key in missing]


ACTUATORS: Catalogue[type[Actuator]] = Catalogue(
    "actuator", "softcal.actuators", _faults, home="softcal.twin.actuators"
)

register_actuator = ACTUATORS.registrar(
    "register_actuator",
    "Add a kind of actuator of one's own: a robot's `actuators`, commands, results and reports know it from then on.",
)
