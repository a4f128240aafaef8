"""Schema of the `robot` section of a project file. Names are not resolved and files not read here.

A section stands beside a part's class where it names what only the whole project has: meshes, regions, stations, holes
of plates, which become nodes and points. A class that had the names, and a `Robot` that resolved them, would be longer:
all names that are wrong are reported at once, also where other parts have faults, so before there can be a `Robot`.
What a section and its class share has one kind and one default, that of the class.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from softcal.arrays import Gravity, Position, Traction, UnitVector
from softcal.declare import ByShape, Reading, listed, require_one, shown
from softcal.errors import Fault, InputError
from softcal.geometry.placement import Placement
from softcal.geometry.ring import Ring
from softcal.limits import LIMITS, folded, part_name_fault
from softcal.mechanics.elements import ElementName
from softcal.mechanics.path_limits import PathLimits
from softcal.project.constants import ConstantsSection, LawSection
from softcal.project.document import Document, Findings
from softcal.project.mesh_schema import Mesh, MeshShape, RegionSection
from softcal.project.rod_schema import RodSection
from softcal.project.section import Given, Section, validated
from softcal.project.sensor_schema import ActuatorSection, SensorSection
from softcal.quantities import Clearance, Density, Direction, Force, Friction, Mass, Size
from softcal.quantities import Moment as MomentSize
from softcal.twin.barrier import Contact
from softcal.twin.cables import Cable, CableLine, RoutingAxis
from softcal.twin.clamp import Clamp
from softcal.twin.manipulator import Manipulator
from softcal.twin.material import Winding
from softcal.twin.robot import Body, Disc, Inertia, Plate, PointLoad, Tie, ViaPoint

KINDS = ("bodies", "rods", "plates", "ties", "cables", "actuators", "loads", "markers", "sensors")


class MaterialSection(ConstantsSection):
    """The material of a region of a body; omitted values are the body's. region: by default its name."""

    region: str | None = None
    density: Density | None = None


class BodySection(LawSection):
    """A deformable body: its mesh, material, fixed region, clamp, and placement.

    shape: that of a mesh from a file, whose lengths then are parameters.
    """

    mesh: Mesh
    shape: MeshShape | None = None
    element: ElementName = Body.element
    density: Density = Body.density
    materials: Mapping[str, MaterialSection] = Field(default_factory=dict)
    regions: Mapping[str, RegionSection] = Field(default_factory=dict)
    fixed: Annotated[list[str], BeforeValidator(listed)] = Field(default_factory=list)
    clamp: Clamp | None = Body.clamp
    build_direction: Direction | None = Body.build_direction
    winding: Winding | None = Body.winding
    placement: Placement | None = None


class HolesSection(Section):
    """The guide holes of a plate: points by name, or a ring of them, or both."""

    points: Mapping[str, Position] = Field(default_factory=dict)
    ring: Ring | None = None

    def _check(self) -> None:
        twice = sorted(set(self.points) & set(self.ring.hole_names if self.ring else []))
        if twice:
            raise InputError(
                Fault("a hole is in both points and ring", got=", ".join(twice), allowed="one of each name")
            )

    @property
    def names(self) -> list[str]:
        """Every hole's name."""
        return [*self.points, *(self.ring.hole_names if self.ring else [])]


class PlateSection(Section):
    """A rigid plate: tied to a region of one body or of several, clamped to rods, or fixed."""

    reference: Position
    body: str | None = None
    region: str | None = None
    bodies: Mapping[str, str] = Field(default_factory=dict)
    mass: Mass = Plate.mass
    centre_of_mass: Position = Plate.centre_of_mass
    inertia: Inertia | None = Plate.inertia
    fixed: bool = Plate.fixed
    holes: HolesSection = HolesSection()
    disc: Disc | None = Plate.disc

    def _check(self) -> None:
        if (self.body is None) != (self.region is None):
            given = "body" if self.region is None else "region"
            raise InputError(
                Fault("a plate is tied to a region of a body", got=f"only {given}", allowed="body and region")
            )
        if self.body is not None and self.bodies:
            raise InputError(
                Fault("the regions of the plate are specified twice", got="body and bodies", allowed="one of the two")
            )

    @property
    def tied(self) -> Mapping[str, str]:
        """Body -> region that the plate is tied to."""
        return self.bodies if self.body is None or self.region is None else {self.body: self.region}


class TieSection(Section):
    """A region of a body bonded to another body, whose mesh need not match."""

    body: str
    region: str
    on: str
    tolerance: Size | None = Tie.tolerance


class ViaSection(Section):
    """A point that a cable runs through: on a plate, in a hole of it, on a body, or fixed in space.

    radius: of the ball in a body over which the force is distributed, such as of a knot; None: 1.25 times
    the diameter of the bore, or 1 mm in the material. name: makes its offsets parameters of the cable.
    """

    on: str = ViaPoint.on
    at: Position | None = None
    hole: str | None = None
    radius: Clearance | None = ViaPoint.radius
    name: str = ViaPoint.name

    def _check(self) -> None:
        _require_place(self)


class MarkerSection(Section):
    """A point whose position is measured, on a plate or body."""

    on: str
    at: Position | None = None
    hole: str | None = None

    def _check(self) -> None:
        _require_place(self)


def _require_place(point: ViaSection | MarkerSection) -> None:
    require_one(point, ("at", "hole"), "the position of the point is not specified", allowed="at, or hole")
    if point.hole is not None and not point.on:
        raise InputError(Fault("the plate of the hole is not specified", got=f"hole {point.hole}", allowed="on: PLATE"))


class CableSection(Section):
    """A cable through two or more points; it is pulled at its last one by default.

    route: between two via points in one body, in a bore that moves with the body, or straight. routing_axis: axis from
    which the cable's routing offset moves its via points; None: it has no routing offset.
    """

    via: Annotated[list[ViaSection], Field(min_length=2), LIMITS["points of a line"].entries]
    friction_coefficient: Friction = Cable.friction_coefficient
    line: CableLine = Field(default_factory=CableLine)
    pulled_end: Literal["first", "last"] = Cable.pulled_end
    route: Literal["bore", "straight"] = "bore"
    routing_axis: RoutingAxis | None = Cable.routing_axis


POINT_LOADS = (
    {"at", "force"}, {"at", "direction", "force"}, {"at", "mass"},
    {"moment"}, {"direction", "moment"}, {"at", "moment"}, {"at", "direction", "moment"},
)  # fmt: skip


class LoadSection(Section):
    """A dead force at a point, a mass that hangs from one, or a traction on a region of a body's surface."""

    on: str
    at: Position | None = None
    hole: str | None = None
    force: Annotated[Force | tuple[Force, Force, Force], ByShape()] | None = None
    moment: Annotated[MomentSize | tuple[MomentSize, MomentSize, MomentSize], ByShape()] | None = None
    direction: UnitVector | None = PointLoad.direction
    mass: Mass | None = None
    region: str | None = None
    traction: Traction | None = None

    def _check(self) -> None:
        keys = ("at", "hole", "force", "moment", "direction", "mass", "region", "traction")
        given = [key for key in keys if getattr(self, key) is not None]
        kind = {"at" if key == "hole" else key for key in given}
        if len(kind) != len(given) or kind not in (*POINT_LOADS, {"region", "traction"}):
            raise InputError(
                Fault(
                    "a load is a force, a moment or a mass at a point, or a traction on a region",
                    got=", ".join(given) or "neither",
                    allowed="at (or hole) and force; at, direction and force; moment, on a rod with at; at and mass; "
                    "region and traction",
                )
            )
        key, size, one = ("force", self.force, "2 N") if self.moment is None else ("moment", self.moment, "2 N*m")
        if isinstance(size, tuple) and self.direction is not None:
            raise InputError(
                Fault("the load's direction is given twice", got=f"a vector as {key}", allowed=f"{key}: {one}")
            )
        if isinstance(size, float) and self.direction is None:
            raise InputError(
                Fault(
                    "the load has no direction",
                    got=f"{key} without direction",
                    allowed=f"{key}: [x, y, z], or a direction",
                )
            )


def _contact(value: object) -> object:
    if not isinstance(value, bool | dict | Contact | None):
        raise InputError(Fault("this is of the wrong kind", "", shown(value), "true, false, or a mapping of keys"))
    return {True: {}, False: None}[value] if isinstance(value, bool) else value


class RobotSection(Section):
    """Bodies, rods, plates, ties, cables, actuators, loads, markers, sensors, gravity; or a manipulator, and more."""

    manipulator: Manipulator | None = None
    bodies: Mapping[str, BodySection] = Field(default_factory=dict)
    rods: Mapping[str, RodSection] = Field(default_factory=dict)
    plates: Mapping[str, PlateSection] = Field(default_factory=dict)
    ties: Mapping[str, TieSection] = Field(default_factory=dict)
    cables: Mapping[str, CableSection] = Field(default_factory=dict)
    actuators: Mapping[str, ActuatorSection] = Field(default_factory=dict)
    loads: Mapping[str, LoadSection] = Field(default_factory=dict)
    markers: Mapping[str, MarkerSection] = Field(default_factory=dict)
    contact: Annotated[Contact | None, Reading(_contact)] = None
    limits: PathLimits = Field(default_factory=PathLimits)
    actuator_limits: Mapping[str, Annotated[list[Given], Field(min_length=2, max_length=2)]] = Field(
        default_factory=dict
    )
    sensors: Mapping[str, SensorSection] = Field(default_factory=dict)
    gravity: Gravity = Field(default_factory=lambda: np.zeros(3))

    def _check(self) -> None:
        if not (self.bodies or self.rods or self.manipulator):
            raise InputError(
                Fault("the robot has nothing that bends", got="neither", allowed="bodies, rods, or a manipulator")
            )

    def names(self, kind: str) -> list[str]:
        """Names of all parts of a kind such as "plates", including those that the manipulator generates."""
        own = self.manipulator.part_names(kind) if self.manipulator else ()
        return [*own, *(name for name in getattr(self, kind) if name not in own)]


def generated_names(section: RobotSection, kind: str) -> tuple[str, ...]:
    """The parts of a kind that a manipulator generates."""
    return section.manipulator.part_names(kind) if section.manipulator else ()


def part_names(document: Document) -> dict[str, list[str]] | None:
    """Names of the robot's parts by kind, even if the robot has other faults; None without a robot, or if its
    manipulator has faults.
    """
    robot = document.data.get("robot")
    if not isinstance(robot, dict):
        return None
    given: dict[str, object] = robot
    own: Manipulator | None = None
    if given.get("manipulator") is not None:
        own = validated(Manipulator, given["manipulator"], (), Findings(document))
        if own is None:
            return None
    found: dict[str, list[str]] = {}
    for kind in KINDS:
        written = given.get(kind)
        names = [str(name) for name in written] if isinstance(written, dict) else []
        found[kind] = list(dict.fromkeys([*(own.part_names(kind) if own else ()), *names]))
    return found


def check_part_names(section: RobotSection, findings: Findings) -> None:
    """Record part names that are not allowed or appear twice: parameters and channels are named after parts, so all
    share one namespace.
    """
    seen: dict[str, str] = {
        folded(name): "the manipulator's own" for kind in KINDS for name in generated_names(section, kind)
    }
    for kind in KINDS:
        for name in getattr(section, kind):
            path = ("robot", kind, name)
            if fault := part_name_fault(name):
                findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
            if folded(name) in seen:
                got = f"'{name}', first as {seen[folded(name)]}"
                findings.add(path, "two parts of the robot share a name", got=got)
            seen.setdefault(folded(name), kind)
    if fault := LIMITS["parts of a robot"].fault(max(len(seen), 1)):
        findings.add(("robot",), fault.what, got=fault.got, allowed=fault.allowed)
