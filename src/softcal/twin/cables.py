"""The geometry of a cable: its via points, and the axis from which they can all be offset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from softcal.arrays import Position
from softcal.checks import Floats
from softcal.declare import Checked, Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.quantities import (
    QUANTITIES,
    Angle,
    CableStiffness,
    Clearance,
    Compliance,
    Direction,
    Friction,
    Length,
    Point,
    Presliding,
    Quantity,
    Share,
    Size,
    Speed,
    SpringRate,
    Tension,
    Twist,
)
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import SHORTENING, TENSION
from softcal.twin.actuated import ActuatedPart
from softcal.units import format_place

if TYPE_CHECKING:
    from softcal.twin.robot import Plate

PRESLIDING = 1e-5  # [m] of a cable's via points, where it is not stated
# How a routing axis moves the via points of a cable: its fields, and the last parts of the parameters' names.
ROUTING = ("routing_offset", "routing_angle", "routing_twist")
COINCIDENT = 1e-12  # of a cable's length: neighbouring via points as near as this are at one place
NOT_SLACK = 1e-4  # of a cable's length: so much longer it may be unstretched, as beside a pretension of zero
# Fields of a line that are parameters where they are stated.
PROPERTIES = ("stiffness", "spring_rate", "compliance", "pretension", "rest_length", "friction_preload")


@displayed
@dataclass(frozen=True)
class RoutingAxis(Declared):
    """A line: the routing offset of a cable moves its via points away from it, the routing angle and twist turn
    them about it.

    Attributes
    ----------
    point : A point (3,) [m] of the line, in the rest frame, at which a twist does not turn
    direction : Its direction (3,), of any length but zero
    """

    point: Point = (0.0, 0.0, 0.0)
    direction: Direction = (0.0, 0.0, 1.0)

    def away(self, at: Floats) -> tuple[Floats, Floats]:
        """Unit vectors (n, 3) from the axis to points (n, 3) [m], and their distances (n,) [m] from it.

        Raises
        ------
        InputError
            Where a point lies on the axis.
        """
        direction = np.asarray(self.direction) / np.linalg.norm(self.direction)
        arms = at - np.asarray(self.point)
        arms = arms - np.outer(arms @ direction, direction)
        distances = np.linalg.norm(arms, axis=1)
        on_axis = np.flatnonzero(distances <= 1e-9 * (1e-3 + np.abs(at).max(initial=0.0)))
        if len(on_axis):
            raise InputError(
                Fault(
                    "a via point is on the routing axis, so the direction of its offset is undefined",
                    got=f"via point {int(on_axis[0]) + 1}",
                    allowed="via points beside the axis",
                    attempt="another axis",
                )
            )
        return arms / distances[:, None], distances

    def around(self, away: Floats) -> Floats:
        """Unit vectors (n, 3) around the axis, right-handed, at points away from it in the directions (n, 3)."""
        return np.cross(np.asarray(self.direction) / np.linalg.norm(self.direction), away)

    def routing_rates(self, at: Floats) -> dict[str, Floats]:
        """Derivatives (n, 3) of points (n, 3) [m] by the parameters of the routing, by the last parts of their names.

        Raises
        ------
        InputError
            Where a point lies on the axis.
        """
        away, distances = self.away(at)
        around = distances[:, None] * self.around(away)
        return {
            "routing_offset": away,
            "routing_angle": around,
            "routing_twist": self._along(at)[:, None] * around,
        }

    def moved(self, at: Floats, offset: float, angle: float, twist: float) -> Floats:
        """Points (n, 3) [m], moved away from the axis and turned around it.

        Parameters
        ----------
        at
            The points (n, 3) [m].
        offset
            Distance by which they move away [m].
        angle
            Angle by which they turn [rad].
        twist
            Angle by which they turn for each metre along the axis [rad/m].
        """
        away, distances = self.away(at)
        angles = (angle + twist * self._along(at))[:, None]
        turned = np.cos(angles) * away + np.sin(angles) * self.around(away)
        return at + (distances + offset)[:, None] * turned - distances[:, None] * away

    def _along(self, at: Floats) -> Floats:
        """Distances (n,) [m] along the axis, from its point, of the feet of points (n, 3)."""
        return (at - np.asarray(self.point)) @ np.asarray(self.direction) / float(np.linalg.norm(self.direction))


@displayed
@dataclass(frozen=True)
class ViaPoint(Checked):
    """A point that a cable runs through.

    In a body its force is distributed over a ball; at one point it would indent the body without bound as the mesh gets
    finer.

    Attributes
    ----------
    at
        Position (3,) [m] in the rest frame.
    on
        Name of the body or plate that it moves with; "" for a point fixed in space.
    radius
        Radius [m] of the ball in a body over which the force is distributed, such as of a knot. None: 1.25 times
        the diameter of the bore for a point in a bore, 1 mm in the material. Zero: a force at the point, or on a ring
        of the wall.
    name
        Name of the point in its offset parameters, such as `front.exit.x_offset`; "" for a point without them.
    offset
        Offset (3,) [m] from the drawn position; `at` includes it already.
    share
        For a point added between two others: its fraction of the distance from the first to the second [-]. It
        follows their offsets in proportion.
    """

    at: Position
    on: str = ""
    radius: Clearance | None = None
    name: str = ""
    offset: Position = field(default_factory=lambda: np.zeros(3))
    share: Share | None = None

    def _where(self, name: str) -> str:
        return f"via point, {name}"


def refuse_presliding_alone(presliding: float | None, *, has_memory: bool) -> None:
    """Refuse a presliding displacement of friction without a memory, which has none.

    Raises
    ------
    InputError
        Where it is stated without the memory.
    """
    if presliding is not None and not has_memory:
        raise InputError(
            Fault(
                "friction without a memory has no presliding displacement",
                where="presliding",
                got=f"{1e3 * presliding:.6g} mm, and friction_memory: false",
                allowed="presliding with friction_memory: true",
                attempt="friction_memory: true, or no presliding",
            )
        )


@displayed
@dataclass(frozen=True)
class CableLine(Declared):
    """Stretch and friction of a cable; by default inextensible, with the friction of a cable that is only pulled.

    Attributes
    ----------
    stiffness : EA [N]; None: no stretch
    spring_rate : Instead of EA, the spring rate of the whole cable at its length at rest [N/m]
    compliance : Compliance of the testing machine or servo that pulls [m/N]
    pretension : Tension [N] at zero shortening of the robot at rest; None: just taut. Without a command, a
        cable with a pretension stays at zero shortening; any other is slack
    rest_length : Instead of the pretension, the length of the unstretched cable at zero shortening [m]
    friction_memory : Whether friction opposes the actual sliding, so that samples are a load path
    presliding : Slip [m] over which friction with a memory builds up; None: 0.01 mm
    friction_preload : Tension [N] whose constant friction is added to that of the cable's own; None: none
    friction_speed : Speed [m/s] of the slip at which friction is twice as large, in time; None: it depends on no speed
    """

    stiffness: CableStiffness | None = None
    spring_rate: SpringRate | None = None
    compliance: Compliance | None = None
    pretension: Tension | None = None
    rest_length: Size | None = None
    friction_memory: bool = False
    presliding: Presliding | None = None
    friction_preload: Tension | None = None
    friction_speed: Speed | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_presliding_alone(self.presliding, has_memory=self.friction_memory)
        for one, other in (("stiffness", "spring_rate"), ("pretension", "rest_length")):
            if None not in (getattr(self, one), getattr(self, other)):
                raise InputError(Fault(f"{one} and {other} exclude each other", got="both", allowed="one of the two"))
        stretches = self.stiffness is not None or self.spring_rate is not None or bool(self.compliance)
        if not stretches and (self.rest_length is not None or self.pretension):
            key = "pretension" if self.rest_length is None else "rest_length"
            raise InputError(
                Fault(
                    "a cable without stretch has no pretension at zero shortening",
                    got=f"{key}, without the stiffness of the cable or the compliance of its machine",
                    attempt="stiffness: 10 kN, of a braided line of 1 mm",
                )
            )


@displayed
@dataclass(frozen=True)
class Cable(ActuatedPart):
    """A cable through via points, its fixed end first or last; length L, the sum of the distances between them.

    Attributes
    ----------
    name
        First part of its channels' and parameters' names.
    via_points
        The points that it runs through, in order; at least two.
    friction_coefficient
        Coefficient [-] of the Euler-Eytelwein loss at each inner via point.
    pulled_end
        End at which the tension is prescribed or measured: "first" or "last" via point.
    routing_axis
        Axis from which the via points are offset, and about which they are turned, or None.
    routing_offset, routing_angle, routing_twist
        Offset [m] from the axis, angle [rad] about it, and how much that grows along it [rad/m]; the positions of the
        via points include them already.
    line
        What the cable is made of, and whether its friction has a memory.
    """

    via_points: tuple[ViaPoint, ...]
    friction_coefficient: Friction = 0.0
    pulled_end: Literal["first", "last"] = "last"
    routing_axis: RoutingAxis | None = None
    routing_offset: Length = 0.0
    routing_angle: Angle = 0.0
    routing_twist: Twist = 0.0
    line: CableLine = field(default_factory=CableLine)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.via_points) < 2:
            raise InputError(
                Fault("a cable needs at least two via points", where=self.name, got=str(len(self.via_points)))
            )
        if not self.length > 0.0:
            got = f"every via point at {format_place(self.via_points[0].at)}"
            raise InputError(Fault("the cable has no length", self.name, got, "via points at two places or more"))
        apart = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
        if len(same := np.flatnonzero(apart <= COINCIDENT * self.length)):
            raise InputError(
                Fault(
                    f"via points {same[0] + 1} and {same[0] + 2} are at one place, so that no direction leads "
                    "from one to the other",
                    where=self.name,
                    got=format_place(self.via_points[same[0]].at),
                    allowed="neighbouring via points apart",
                    attempt="one of the two",
                )
            )
        if self.line.rest_length is not None and self.line.rest_length > (1.0 + NOT_SLACK) * self.length:
            raise InputError(
                Fault(
                    "the unstretched cable is longer than its path, so that it hangs slack at zero shortening",
                    where=f"{self.name}.line.rest_length",
                    got=f"{1e3 * self.line.rest_length:.6g} mm",
                    allowed=f"{1e3 * self.length:.6g} mm or less",
                    attempt="the slack of the experiment",
                )
            )
        if self.routing_axis is not None:
            self.routing_axis.away(self._points)
        names = [via.name for via in self.via_points if via.name]
        if twice := sorted({name for name in names if names.count(name) > 1}):
            raise InputError(Fault("two via points share a name", self.name, ", ".join(twice), "a name for each"))
        if wrong := [name for name in names if not name.isidentifier()]:
            allowed = "letters, digits and _"
            raise InputError(Fault("this cannot be the name of a via point", self.name, repr(wrong[0]), allowed))
        if names and self.routing_axis is not None:
            told = "a cable with a routing axis has no named via points: both would move them"
            raise InputError(
                Fault(told, self.name, ", ".join(names), "the offset of the whole cable, or of its points")
            )

    @property
    def kind(self) -> str:
        return "cable"

    @property
    def route(self) -> tuple[ViaPoint, ...]:
        return self.via_points

    @property
    def channels(self) -> tuple[ChannelKind, ChannelKind]:
        return SHORTENING, TENSION

    @property
    def ranges(self) -> tuple[Quantity, Quantity]:
        return QUANTITIES["shortening"], QUANTITIES["tension"]

    def command_fault(self, control: str, values: Floats) -> Fault | None:
        """Why it cannot follow a command: a push, or a shortening beyond its length; None where it can."""
        if control == TENSION.name and (low := float(values.min(initial=0.0))) < 0.0:
            return Fault("a cable cannot push", f"{self.name}.tension", f"{low:.4g} N", ">= 0 N")
        high = float(values.max(initial=0.0))
        if control == SHORTENING.name and high >= self.length:
            what, allowed = "the cable is pulled in by more than its length", f"< {1e3 * self.length:.4g} mm"
            return Fault(what, f"{self.name}.shortening", f"{1e3 * high:.4g} mm", allowed)
        return super().command_fault(control, np.array([values.max(initial=0.0)]))

    @property
    def length(self) -> float:
        """The length [m] of the polyline at rest."""
        return float(np.linalg.norm(np.diff(self._points, axis=0), axis=1).sum())

    @property
    def _points(self) -> Floats:
        return np.array([via.at for via in self.via_points])

    @property
    def properties(self) -> dict[str, float]:
        """The stated properties of the line [SI], by the names of the cable's parameters, and of friction with a memory
        the presliding displacement.
        """
        presliding = (self.line.presliding or PRESLIDING) if self.line.friction_memory else None
        named = {name: getattr(self.line, name) for name in PROPERTIES} | {"presliding": presliding}
        return {name: value for name, value in named.items() if value is not None}

    def with_properties(self, values: Mapping[str, float]) -> Cable:
        """The same cable with other values of its stated properties."""
        return replace(self, line=replace(self.line, **values)) if values else self

    @property
    def stiffness(self) -> float | None:
        """EA [N], as stated or by the spring rate; None: no stretch."""
        return self.line.stiffness if self.line.spring_rate is None else self.line.spring_rate * self.length

    @property
    def pretension(self) -> float | None:
        """Tension [N] at zero shortening of the robot at rest, as stated or by the rest length; None: just taut."""
        if self.line.rest_length is None:
            return self.line.pretension
        soft = (0.0 if self.stiffness is None else self.length / self.stiffness) + (self.line.compliance or 0.0)
        return (self.length - self.line.rest_length) / soft

    @property
    def least_offset(self) -> float:
        """The routing offset [m] at which a via point reaches the routing axis; minus infinity without an axis."""
        if self.routing_axis is None:
            return -np.inf
        return self.routing_offset - float(self.routing_axis.away(self._points)[1].min())

    @property
    def placing(self) -> dict[str, float]:
        """The values [SI] of the parameters that move via points: of the cable with an axis, of named points."""
        routing = ROUTING if self.routing_axis is not None else ()
        own = {f"{self.name}.{kind}": float(getattr(self, kind)) for kind in routing}
        named = {
            self._offset_name(via, axis): offset
            for via in self.via_points
            if via.name
            for axis, offset in zip("xyz", via.offset.tolist(), strict=True)
        }
        return {**own, **named}

    def ways(self) -> dict[str, Floats]:
        """Rates of the via points (n_via, 3) by each of the parameters of `placing`."""
        if self.routing_axis is not None:
            rates = self.routing_axis.routing_rates(self._points)
            return {f"{self.name}.{kind}": ways for kind, ways in rates.items()}
        # Stated points are at 0, 1, …, those added between two of them in between.
        stated = np.flatnonzero([via.share is None for via in self.via_points])
        shares = np.array([via.share or 0.0 for via in self.via_points])
        place = np.searchsorted(stated, np.arange(len(shares)), side="right") - 1 + shares
        rates: dict[str, Floats] = {}
        for i, via in enumerate(self.via_points):
            if via.name:
                share = np.clip(1.0 - np.abs(place - place[i]), 0.0, None)
                for axis, way in zip("xyz", np.eye(3), strict=True):
                    rates[self._offset_name(via, axis)] = share[:, None] * way
        return rates

    def placed_by(self, values: Mapping[str, float]) -> Cable:
        """The same cable at other values [SI] of parameters by name, its via points moved accordingly."""
        was = self.placing
        now = {name: values.get(name, value) for name, value in was.items()}
        if now == was:
            return self
        routing = {kind: now[f"{self.name}.{kind}"] for kind in ROUTING} if self.routing_axis is not None else {}
        if self.routing_axis is not None:
            offset, angle, twist = (now[name] - was[name] for name in was)
            moves = self.routing_axis.moved(self._points, offset, angle, twist) - self._points
        else:
            steps = ((now[name] - was[name]) * way for name, way in self.ways().items())
            moves = sum(steps, np.zeros((len(self.via_points), 3)))
        moved = tuple(
            replace(via, at=via.at + move, offset=via.offset + move)
            for via, move in zip(self.via_points, moves, strict=True)
        )
        return replace(self, via_points=moved, **routing)

    def _offset_name(self, via: ViaPoint, axis: str) -> str:
        return f"{self.name}.{via.name}.{axis}_offset"


def require_changing_length(cable: Cable, plates: Iterable[Plate]) -> None:
    """Refuse a cable that no deformation lengthens or shortens: all its points are fixed in space, or on one plate.

    Raises
    ------
    InputError
        Where it is one.
    """
    is_fixed = {"": True, **{plate.name: plate.fixed for plate in plates}}
    carriers = {"" if is_fixed.get(via.on, False) else via.on for via in cable.via_points}
    if len(carriers) == 1 and carriers <= is_fixed.keys():
        (carrier,) = carriers
        raise InputError(
            Fault(
                "nothing changes the length of the cable",
                cable.name,
                f"every via point {f'on {carrier}' if carrier else 'fixed in space'}",
                "via points on two parts that move against each other, or on a body or rod",
                "`on` of the first or last via point",
            )
        )
