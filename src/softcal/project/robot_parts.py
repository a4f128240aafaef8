"""Build a project's plates, ties, cables, loads and markers, with names and holes resolved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.bore import wall_around
from softcal.geometry.locate import extents, nearest_places
from softcal.project.document import Findings, KeyPath
from softcal.project.robot_bodies import BuiltBodies
from softcal.project.robot_schema import (
    CableSection,
    LoadSection,
    MarkerSection,
    PlateSection,
    TieSection,
    ViaSection,
)
from softcal.project.section import Given
from softcal.twin.actuated import ActuatedPart, Actuator, NamedActuator, limited_channels, limits_faults
from softcal.twin.cables import require_changing_length
from softcal.twin.joints import tie_fault
from softcal.twin.robot import Cable, Marker, Moment, Plate, PointLoad, Rod, SurfaceLoad, Tie, ViaPoint
from softcal.twin.routing import bored, require_movable
from softcal.units import format_place, format_quantity, parse_quantity

NEARLY_OUTSIDE = 0.2
"""Share of the distance at which a point counts as outside its body: a curved surface is that far from plane faces."""


@dataclass(frozen=True)
class Carriers:
    """The parts that points can be on: bodies, rods, and plates with their holes.

    built: the bodies. plates: plates without faults. holes: names of the holes of all plates, with or without faults.
    rods: None for a rod with faults.
    """

    built: BuiltBodies
    plates: Mapping[str, Plate]
    holes: Mapping[str, list[str]]
    rods: Mapping[str, Rod | None]
    findings: Findings

    def place(self, where: ViaSection | MarkerSection | LoadSection, path: KeyPath) -> Floats | None:
        """The point [m] that a section describes; None with a fault, which is recorded, or if its plate has one."""
        if where.hole is not None:
            if where.on in self.built.sections or where.on in self.rods:
                kind = "a body" if where.on in self.built.sections else "a rod"
                known = ", ".join(name for name, holes in self.holes.items() if holes) or "none has any"
                self.findings.add((*path, "on"), "only plates have holes", got=f"'{where.on}', {kind}", allowed=known)
            elif where.on not in self.holes:
                self.findings.unknown((*path, "on"), "plate", where.on, self.holes)
            elif where.hole not in self.holes[where.on]:
                self.findings.unknown((*path, "hole"), f"hole in {where.on}", where.hole, self.holes[where.on])
            elif where.on in self.plates:
                return self.plates[where.on].holes[where.hole]
            return None
        return where.at

    def support(self, on: str, at: Floats | None, path: KeyPath, *, may_stand_off: bool = False) -> None:
        """Record that a part's carrier does not exist, or that its point is outside the carrying body.

        Parameters
        ----------
        on
            Name of the carrier; "" for a point fixed in space.
        at
            The point (3,) [m]; None if it has a fault.
        path
            Key path of the section in the file, for faults.
        may_stand_off
            The point may be outside the body, as a marker on a stick is.
        """
        if on and not any(on in parts for parts in (self.built.sections, self.holes, self.rods)):
            known = [*self.built.sections, *self.rods, *self.holes]
            self.findings.unknown((*path, "on"), "body, rod or plate", on, known)
        elif on in self.built.meshes and at is not None and not may_stand_off:
            self.within(on, {(*path, "at"): at})

    def within(self, body: str, points: Mapping[KeyPath, Floats]) -> None:
        """Record points that lie outside their body and in none of its bores, as one fault at the first of them; as one
        warning if all are so near that they move with the nearest element.
        """
        mesh, at = self.built.meshes[body], np.array(list(points.values()))
        found = nearest_places(mesh, at)
        beyond = np.flatnonzero(found.distances > NEARLY_OUTSIDE * found.allowed)
        near = [i for i in beyond if wall_around(mesh, at[i]) is None]
        off = [i for i in near if found.is_off[i]]
        if not near:
            return
        record, outside = (self.findings.add, off) if off else (self.findings.warn, near)
        furthest = format_quantity(float(found.distances[outside].max()), "m")
        place = format_place(at[outside[0]])
        is_single = len(outside) == 1
        most = float(found.allowed[outside].min()) * (1.0 if off else NEARLY_OUTSIDE)
        record(
            list(points)[outside[0]],
            f"the point lies outside its body by {furthest}"
            if is_single
            else f"{len(outside)} via points lie outside their body, by up to {furthest}",
            got=place if is_single else f"{place} and {len(outside) - 1} more",
            allowed=f"at most {format_quantity(most, 'm')} outside {body}, which spans "
            f"{extents(mesh)}, or in a bore whose wall is all around",
            attempt="the unit of mesh and points; where a channel is open to a side, points in its wall",
        )


def build_plate(name: str, plate: PlateSection, built: BuiltBodies, findings: Findings) -> Plate | None:
    """One plate; None with a fault, which goes to `findings`.

    Parameters
    ----------
    name
        Name in the project file.
    plate
        Its section of the file.
    built
        The built bodies, with their meshes and regions.
    findings
        Collects the faults and warnings.
    """
    path = ("robot", "plates", name)
    nodes = {}
    for body, region in plate.tied.items():
        at = (*path, "bodies", body) if plate.bodies else (*path, "region")
        if body not in built.sections:
            findings.unknown(at if plate.bodies else (*path, "body"), "body", body, built.sections)
        else:
            nodes[body] = built.nodes(body, region, at, findings)
    if len(nodes) < len(plate.tied) or any(found is None for found in nodes.values()):
        return None
    with findings.at((*path, "holes")):
        holes = {**plate.holes.points, **(ring.holes(plate.reference) if (ring := plate.holes.ring) else {})}
        with findings.at(path):
            return Plate(
                name=name,
                nodes=nodes,
                reference=plate.reference,
                mass=plate.mass,
                centre_of_mass=plate.centre_of_mass,
                fixed=plate.fixed,
                holes=holes,
                disc=plate.disc,
                inertia=plate.inertia,
            )
    return None


def build_tie(name: str, tie: TieSection, built: BuiltBodies, findings: Findings) -> Tie | None:
    """One tie; None with a fault, such as that it touches nothing.

    Parameters
    ----------
    name
        Name in the project file.
    tie
        Its section of the file.
    built
        The built bodies, with their meshes and regions.
    findings
        Collects the faults and warnings.
    """
    path = ("robot", "ties", name)
    for key, body in (("body", tie.body), ("on", tie.on)):
        if body not in built.sections:
            findings.unknown((*path, key), "body", body, built.sections)
    if tie.body == tie.on:
        findings.add((*path, "on"), "a body cannot be tied to itself", got=tie.on, allowed="another body")
        return None
    if tie.body not in built.sections or tie.on not in built.sections:
        return None
    nodes = built.nodes(tie.body, tie.region, (*path, "region"), findings)
    if nodes is None or tie.on not in built.meshes:
        return None
    found = Tie(name, tie.body, nodes, tie.on, tie.tolerance)
    fault = tie_fault(found, built.meshes[tie.body], built.meshes[tie.on])
    if fault is None:
        return found
    findings.add(path, fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
    return None


def build_cable(name: str, cable: CableSection, carriers: Carriers) -> Cable | None:
    """One cable; None with a fault.

    Parameters
    ----------
    name
        Name in the project file.
    cable
        Its section of the file.
    carriers
        The parts that points can be on.
    """
    path = ("robot", "cables", name)
    via: list[ViaPoint] = []
    on_body: dict[str, dict[KeyPath, Floats]] = {}
    for i, section in enumerate(cable.via):
        at = carriers.place(section, (*path, "via", i))
        if section.hole is None and section.on in carriers.built.meshes and at is not None:
            on_body.setdefault(section.on, {})[*path, "via", i, "at"] = at
        elif section.hole is None:
            carriers.support(section.on, at, (*path, "via", i))
        if at is not None:
            via.append(ViaPoint(at, section.on, section.radius, section.name))
        if section.radius is not None and section.on not in carriers.built.sections:
            carriers.findings.add(
                (*path, "via", i, "radius"),
                "only a via point in a body has a radius",
                got=f"on: {section.on or 'space'}",
            )
    for body, points in on_body.items():
        carriers.within(body, points)
    if len(via) < len(cable.via):
        return None
    with carriers.findings.at(path):
        if cable.route == "bore":
            lines = {name: rod.centreline for name, rod in carriers.rods.items() if rod is not None}
            via = list(bored(via, carriers.built.meshes, lines))
        found = Cable(
            name, tuple(via), cable.friction_coefficient, cable.pulled_end, cable.routing_axis, line=cable.line
        )
        require_movable(found, carriers.built.meshes)
        require_changing_length(found, carriers.plates.values())
        return found
    return None


def build_actuator(name: str, actuator: Actuator, carriers: Carriers) -> NamedActuator | None:
    """One actuator, its regions as faces; None with a fault.

    Parameters
    ----------
    name
        Name in the project file.
    actuator
        As the file has it.
    carriers
        The bodies.
    """
    path, findings = ("robot", "actuators", name), carriers.findings

    surfaces: dict[str, Ints | str] = {}
    for body, region in actuator.surfaces.items():
        where = (*path, *actuator.region_key, body)
        faces = carriers.built.faces(body, region, where, where, findings) if isinstance(region, str) else region
        if faces is None:
            return None
        surfaces[body] = faces
    with findings.at(path):
        return NamedActuator(name, actuator.on_surfaces(surfaces))
    return None


def build_load(
    name: str, load: LoadSection, gravity: Floats, carriers: Carriers
) -> PointLoad | Moment | SurfaceLoad | None:
    """One load; None with a fault.

    Parameters
    ----------
    name
        Name in the project file.
    load
        Its section of the file.
    gravity
        Gravity (3,) [m/s^2].
    carriers
        The parts that points can be on.
    """
    path = ("robot", "loads", name)
    findings = carriers.findings
    if load.traction is not None and load.region is not None:
        faces = carriers.built.faces(load.on, load.region, (*path, "on"), (*path, "region"), findings)
        if faces is None:
            return None
        return SurfaceLoad(name, load.on, faces, load.traction)
    at = carriers.place(load, path)
    if load.moment is not None:
        known = [*carriers.rods, *carriers.holes]
        if load.on not in known:
            findings.unknown((*path, "on"), "plate or rod", load.on, known)
            return None
        size, way = _sized(load.moment, load.direction)
        with findings.at(path):
            return Moment(name, load.on, size, np.zeros(3) if at is None else at, way)
        return None
    if load.hole is None:
        carriers.support(load.on, at, path)
    if load.mass is None:
        force, direction = _sized(load.force or 0.0, load.direction)
    elif np.any(gravity):
        force, direction = load.mass * gravity, gravity
    else:
        findings.add(
            (*path, "mass"),
            "a mass hangs, but there is no gravity",
            got=f"{load.mass:g} kg",
            allowed="gravity in the robot, or a force",
            attempt="gravity: [0 m/s^2, 0 m/s^2, -9.81 m/s^2]",
        )
        return None
    if at is None:
        return None
    with findings.at(path):
        return PointLoad(name, load.on, at, force, direction)
    return None


def _sized(given: float | tuple[float, float, float], direction: Floats | None) -> tuple[Floats, Floats]:
    """A vector, stated as such or by size and direction, and its direction."""
    if isinstance(given, tuple):
        return np.array(given), PointLoad.direction
    assert direction is not None  # noqa: S101
    return given * direction, direction


def build_marker(name: str, marker: MarkerSection, carriers: Carriers) -> Marker | None:
    """One marker, which may be outside its body; None with a fault.

    Parameters
    ----------
    name
        Name in the project file.
    marker
        Its section of the file.
    carriers
        The parts that points can be on.
    """
    path = ("robot", "markers", name)
    at = carriers.place(marker, path)
    if marker.hole is None:
        carriers.support(marker.on, at, path, may_stand_off=True)
    return None if at is None else Marker(name, marker.on, at)


def build_limits(
    given: Mapping[str, Sequence[Given]], actuators: Sequence[ActuatedPart], findings: Findings
) -> dict[str, tuple[float, float]]:
    """The limits of actuators' channels [SI], without those that have a fault.

    Parameters
    ----------
    given
        Channel or kind of channel -> the lower and the upper one, as written.
    actuators
        The robot's.
    findings
        Collects the faults.
    """
    found: dict[str, tuple[float, float]] = {}
    for key, ends in given.items():
        path = ("robot", "actuator_limits", key)
        with findings.at(path):
            quantity = next(iter(limited_channels(actuators, key).values()), None)
            low, high = (0.0, 0.0) if quantity is None else (parse_quantity(end, quantity.unit) for end in ends)
            if faults := limits_faults(actuators, key, low, high):
                findings.take(path, [replace(fault, where="") for fault in faults])
            else:
                found[key] = low, high
    return found
