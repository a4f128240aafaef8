"""Build the system of equations of a robot's statics."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError, unknown
from softcal.geometry.cell import face_keys
from softcal.geometry.centreline import place_on_rod
from softcal.geometry.mesh import TetMesh
from softcal.geometry.regions import Named, select_faces
from softcal.geometry.surface import boundary_faces
from softcal.mechanics.attachment import attach_ball, attach_point, attach_rate
from softcal.mechanics.cable_routes import build_cables
from softcal.mechanics.crossing import Skins
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.kept_nodes import KeptPaths
from softcal.mechanics.layout import FIXED, FREE, TIED, Layout
from softcal.mechanics.neighbours import STEP, Neighbours
from softcal.mechanics.rod import build_rod
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.solid_build import build_solid
from softcal.mechanics.system import System, build_system
from softcal.sensing.channel import ChannelName
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensor import NamedSensor
from softcal.twin.actuated import ActuatedPart
from softcal.twin.channels import channels_of, require_sensors, sensors_of
from softcal.twin.clearance import RobotSurface, build_surface
from softcal.twin.contacts import build_contacts, disc_skin
from softcal.twin.crossings import build_skins
from softcal.twin.joints import join_ties, nodes_in_use, number_frames
from softcal.twin.loads import (
    PointForce,
    Weights,
    build_loads,
    build_moments,
    faces_in_use,
    points_of_forces,
    surface_forces,
    walls,
)
from softcal.twin.markers import MarkerPlace, directions_in
from softcal.twin.parameters import MARKER_OFFSETS, robot_parameters, with_shape
from softcal.twin.robot import Body, Cable, Marker, PointLoad, Robot, SurfaceLoad
from softcal.units import format_quantity


@dataclass(frozen=True)
class Twin:
    """A robot's system, and the numbering of its parts in it.

    Attributes
    ----------
    robot, system : The robot, and the terms of its equations
    first_point : Body or rod (and plate, where surfaces may touch) -> the number of its first point
    meshes : Body -> the mesh of its element [m]
    frame : Plate -> the number of its frame
    routes : Cable, or other actuator with a route -> its via points as weighted points
    markers : Marker -> its place on its part
    pressure_nodes
        Material of a mixed body -> the number of its first pressure, the body, and the numbers of the nodes (n,) that
        have one.
    """

    robot: Robot
    system: System
    first_point: dict[str, int]
    meshes: dict[str, TetMesh]
    frame: dict[str, int]
    routes: dict[str, list[Weights]]
    markers: dict[str, MarkerPlace]
    pressure_nodes: dict[str, tuple[int, str, Ints]]

    @cached_property
    def sensors(self) -> tuple[NamedSensor, ...]:
        """Every sensor of the robot."""
        return sensors_of(self.robot)

    @cached_property
    def columns(self) -> dict[ChannelName, int]:
        """Every channel of the robot, and its column in tables of all."""
        return {channel: k for k, channel in enumerate(channels_of(self.sensors))}

    def column(self, carrier: str, kind: ChannelKind) -> int:
        """The column of one channel."""
        return self.columns[ChannelName(kind, carrier)]

    @cached_property
    def kept(self) -> KeptPaths:
        """The nodes of its load paths so far."""
        return KeptPaths()

    @cached_property
    def tets(self) -> dict[str, Ints]:
        """Body -> connectivity (n_tets, 4 or 10) of the mesh of its element."""
        return {name: mesh.tets for name, mesh in self.meshes.items()}

    @cached_property
    def walls(self) -> dict[str, dict[str, Ints]]:
        """Actuator -> body -> faces (n, 3 or 6) of that mesh which it acts on."""
        return walls(self.robot, self.meshes)

    @cached_property
    def skins(self) -> Skins | None:
        """The skins of the bodies, where no contact keeps them from passing through each other."""
        return build_skins(self.robot, self.system.layout, self.meshes, self.first_point)

    @cached_property
    def surface(self) -> RobotSurface:
        """The surface that obstacles limit."""
        return build_surface(self.robot, self.system, self.meshes, self.first_point, self.frame)


def build_twin(robot: Robot, drawn: Robot | None = None) -> Twin:
    """Number the unknowns, place the extra points, build the terms.

    drawn: the same robot before the shapes of its bodies were changed; see `softcal.twin.cores.CoredSkin`.

    Raises
    ------
    MeshError
        For a node that is fixed twice or a part that is not supported, a plate without nodes, a via point outside its
        body.
    ParameterError
        For a sensor of a marker, plate or cable that the robot does not have.
    """
    require_sensors(robot)
    frames = number_frames(robot)
    builder = _Points()
    meshes: dict[str, TetMesh] = {}
    unmoved: dict[str, TetMesh] = {}  # before the depth of a clamp moves them: points on a body have their places there
    solids: list[SolidTerm] = []
    pressure_nodes: dict[str, tuple[int, str, Ints]] = {}
    n_pressures = 0
    for body in robot.bodies:
        element = ELEMENTS[body.element]
        unmoved[body.name] = element.mesh(body.mesh)
        mesh = meshes[body.name] = body.clamped(unmoved[body.name])
        rider = _riders(body, mesh, robot, frames.of_plate)
        first = builder.add(mesh.points, rider)
        builder.first[body.name] = first
        # A tet whose nodes are all fixed, or all on one plate, moves rigidly and is stress-free.
        riders = rider[mesh.tets]
        deforms = (riders != riders[:, :1]).any(axis=1) | (riders[:, 0] == FREE) | (riders[:, 0] == TIED)
        if not deforms.any():
            raise MeshError(
                Fault("no tet of the body can deform: its nodes are all fixed or on one plate", where=body.name)
            )
        if body.zone is not None:
            carried = (body.zone.shares(unmoved[body.name]) > 0.0) & (rider != FREE) & (rider != FIXED)
            if carried.any():
                near = format_quantity(body.zone.length, "m")
                raise MeshError(
                    Fault(
                        "the body is tied to a plate or another body near its clamp, where a depth moves its mesh",
                        where=f"{body.name}.clamp",
                        got=f"{int(carried.sum())} tied nodes within {near} of the face",
                        allowed="a body that is tied further away",
                        attempt="no clamp: its depth must then be drawn",
                    )
                )
        for material in body.materials:
            tets = mesh.tets[material.elements[deforms[material.elements]]]
            if len(tets) == 0:
                continue
            solid, with_pressure = build_solid(
                material.name,
                body.elasticity,
                element,
                mesh.points,
                tets,
                first_point=first,
                first_pressure=n_pressures,
            )
            directions = body.directions(element.places(mesh.points, tets))
            solids.append(replace(solid, directions=directions, history=body.past))
            if element.is_mixed:
                pressure_nodes[material.name] = (n_pressures, body.name, with_pressure)
            n_pressures += len(with_pressure)
    rods = {rod.name: rod for rod in robot.rods}
    for rod in robot.rods:
        builder.first[rod.name] = builder.add(rod.centreline.nodes, frames.of_rod[rod.name])
    rod_terms = tuple(
        replace(
            build_rod(
                material.name,
                rod.section,
                rod.centreline,
                frames.of_rod[rod.name],
                frames.references,
                material.elements,
            ),
            history=rod.past,
        )
        for rod in robot.rods
        for material in rod.materials
    )

    def carriers(on: str, drawn: Floats) -> list[tuple[Ints, float]]:
        """The frames, each with its weight, that carry a point of a plate, of a rod's section at a place, or of
        space.
        """
        if on in rods:
            places = place_on_rod(rods[on].centreline, drawn).weights
            return [(frames.of_rod[on][node : node + 1], weight) for node, weight in places]
        return [(np.array([frames.of_plate[on] if on else FIXED]), 1.0)]

    def support(
        at: Floats,
        on: str,
        where: str,
        *,
        may_stand_off: bool = False,
        radius: float | None = 0.0,
        drawn: Floats | None = None,
    ) -> Weights:
        """A point as a weighted sum; drawn: where it was before its offset, so that it keeps its section of a rod."""
        if on == "" or on in frames.of_plate or on in rods:
            carried = carriers(on, at if drawn is None else drawn)
            return [(builder.add(at[None, :], frame), weight) for frame, weight in carried]
        if on not in meshes:
            known = [*meshes, *rods, *frames.of_plate]
            raise MeshError(unknown("there is no such body, rod or plate", where, on, known))
        if may_stand_off:
            held = attach_point(unmoved[on], at, may_stand_off=True, where=where)
        else:
            held = attach_ball(unmoved[on], at, radius, where=where)
        return [(builder.first[on] + int(n), float(w)) for n, w in zip(held.nodes, held.weights, strict=True)]

    def routed(parts: Sequence[ActuatedPart]) -> dict[str, list[Weights]]:
        """The via points of the actuators that have a route."""
        return {
            part.name: [
                support(p.at, p.on, f"{part.name}, via point {i + 1}", radius=p.radius, drawn=p.at - p.offset)
                for i, p in enumerate(part.route)
            ]
            for part in parts
            if part.route
        }

    via = routed(robot.cables)

    def beside(at: Floats, on: str, way: Floats, size: float, drawn: Floats) -> Weights:
        """The derivative of a point on a plate, a rod or in space by a motion along `way` (3,), as weighted points of
        its frames: the difference over a length `size` [m]; drawn: see `support`.
        """
        return [
            (builder.add((at + shift)[None, :], frame), sign * weight / size)
            for frame, weight in carriers(on, drawn)
            for sign, shift in ((1.0, size * way), (-1.0, np.zeros(3)))
        ]

    def placed(cable: Cable) -> dict[str, list[Weights]]:
        """Derivatives of the via points by each parameter that moves them."""
        size = 0.1 * cable.length
        rates_of: dict[str, list[Weights]] = {}
        for name, ways in cable.ways().items():
            rates_of[name] = []
            for i, (point, way) in enumerate(zip(cable.via_points, ways, strict=True)):
                if not way.any():
                    rates_of[name].append([])
                elif point.on in meshes:
                    where = f"{cable.name}, via point {i + 1}"
                    nodes, rates = attach_rate(unmoved[point.on], point.at, way, point.radius, where=where)
                    first = builder.first[point.on]
                    rates_of[name].append([(first + int(n), float(r)) for n, r in zip(nodes, rates, strict=True)])
                else:
                    rates_of[name].append(beside(point.at, point.on, way, size, point.at - point.offset))
        return rates_of

    def offsets(marker: Marker) -> tuple[Weights, ...]:
        """Derivatives of a marker's place by its offsets, on a body or rod."""
        if marker.on in meshes:
            return directions_in(unmoved[marker.on], marker, builder.first[marker.on])
        if marker.on not in rods:
            return ()
        size = float(rods[marker.on].centreline.lengths.mean())
        return tuple(beside(marker.at, marker.on, axis, size, marker.at) for axis in np.eye(3))

    placed_by = {cable.name: placed(cable) for cable in robot.cables}
    markers = {
        marker.name: MarkerPlace(
            marker,
            support(marker.at, marker.on, marker.name, may_stand_off=True),
            offsets(marker),
        )
        for marker in robot.markers
    }
    forces: list[PointForce] = []
    given = {body.name: body.mesh for body in robot.bodies}
    weighed = {plate.name: support(plate.centre_of_mass, plate.name, plate.name) for plate in robot.plates}
    for load in robot.loads:
        if isinstance(load, PointLoad):
            forces.append((f"{load.name}.force", support(load.at, load.on, load.name), load.direction))
        elif isinstance(load, SurfaceLoad):
            forces.extend(surface_forces(load, given, meshes, builder.first))

    places = _Numbering(builder, given, meshes, support, [cable.name for cable in robot.cables])
    others = tuple(part.actuator.term(part.name, places) for part in robot.actuators)
    routes = via | routed(robot.actuators)
    if robot.contact is not None:
        for plate in robot.plates:
            if plate.disc is not None:
                skin, _ = disc_skin(plate.disc)
                builder.first[plate.name] = builder.add(skin, np.full(len(skin), frames.of_plate[plate.name]))
    layout = Layout(
        X=np.concatenate(builder.X),
        rider=np.concatenate(builder.rider),
        references=frames.references,
        n_pressures=n_pressures,
        n_actuators=len(robot.cables) + sum(len(term.actuators) for term in others),
        n_fixed_frames=frames.n_fixed,
        ties=join_ties(robot, unmoved, builder.first),
    )
    pulled_last = np.array([cable.pulled_end == "last" for cable in robot.cables], dtype=bool)
    loads = build_loads(robot, meshes, builder.first, forces, weighed, layout.n_points)
    moments = build_moments(robot, layout, frames.of_plate, frames.of_rod)
    drawn = drawn or robot
    before = (
        meshes
        if drawn is robot
        else {body.name: body.clamped(ELEMENTS[body.element].mesh(body.mesh)) for body in drawn.bodies}
    )
    contacts = build_contacts(robot, layout, meshes, builder.first, before)
    stated = tuple(f"{cable.name}.{key}" for cable in robot.cables for key in cable.properties)
    speeds = [cable.line.friction_speed for cable in robot.cables]
    slowness = np.array([0.0 if speed is None else 1.0 / speed for speed in speeds]) if any(speeds) else None
    cables = build_cables(layout.X, via, pulled_last, placed_by, stated, slowness)
    terms = (*solids, *rod_terms, cables, *others, loads, moments, *contacts)
    system = build_system(layout, terms, points_of_forces(robot))
    return Twin(
        robot=robot,
        system=system,
        first_point=builder.first,
        meshes=meshes,
        frame=frames.of_plate,
        routes=routes,
        markers=markers,
        pressure_nodes=pressure_nodes,
    )


def twin_of(robot: Robot, theta: Mapping[str, float] | None = None) -> Twin:
    """`build_twin`, cached for each robot: the assembled system depends on no parameter values but those of its shape.
    Where only the offsets of markers differ, it is the same system.

    Parameters
    ----------
    theta
        Values [SI] of parameters by dotted name; where one changes the shape, the twin is that of the robot so shaped.

    Raises
    ------
    MeshError, ParameterError
        As `build_twin`, and for a shape that the robot cannot have.
    """
    shaped = with_shape(robot, theta or {})
    key = (
        id(robot),
        None if shaped is robot else tuple(info.value for info in robot_parameters(shaped).values() if info.shapes),
    )
    if key in _CACHE:
        _CACHE.move_to_end(key)
        return _CACHE[key][1]
    own = {f"{marker.name}.{key}" for marker in robot.markers for key in MARKER_OFFSETS} & set(theta or {})
    if not own:
        twin = build_twin(shaped, robot)
    else:
        others = {name: v for name, v in (theta or {}).items() if name not in own}
        drawn = twin_of(robot, others)
        twin = replace(drawn, robot=shaped, markers={m.name: drawn.markers[m.name].of(m) for m in shaped.markers})
    if neighbours := neighbours_of(robot, theta or {}, partial(build_twin, drawn=robot)):
        twin = replace(twin, system=replace(twin.system, neighbours=neighbours))
    _CACHE[key] = (robot, twin)
    while len(_CACHE) > CACHE_SIZE:
        _CACHE.popitem(last=False)
    return twin


CACHE_SIZE = 8
_CACHE: OrderedDict[Hashable, tuple[Robot, Twin]] = OrderedDict()  # keeps the robot alive, so that its id is not reused


class _Points:
    """Points in the order they are added."""

    def __init__(self) -> None:
        self.X: list[Floats] = []
        self.rider: list[Ints] = []
        self.first: dict[str, int] = {}
        self._n = 0

    def add(self, X: Floats, rider: Ints) -> int:
        """Append points and return the number of the first."""
        first = self._n
        self.X.append(np.asarray(X, dtype=np.float64))
        self.rider.append(rider)
        self._n += len(X)
        return first


@dataclass(frozen=True)
class _Numbering:
    """The numbering of the points, as the terms of actuators need it."""

    builder: _Points
    given: Mapping[str, TetMesh]
    meshes: Mapping[str, TetMesh]
    supported: Callable[[Floats, str, str], Weights]
    cables: Sequence[str]
    walls: dict[str, tuple[str, Ints]] = field(default_factory=dict[str, tuple[str, Ints]])  # place -> body, faces

    @property
    def X(self) -> Floats:
        return np.concatenate(self.builder.X)

    def faces(self, body: str, faces: Ints | str, where: str, *, is_wall: bool = False) -> Ints:
        if body not in self.meshes:
            raise MeshError(unknown("there is no such body", where, body, self.meshes))
        mesh = self.given[body]
        own = select_faces(mesh, Named(faces), where=where) if isinstance(faces, str) else faces
        found = faces_in_use(mesh, self.meshes[body], own, where=where)
        if is_wall:
            used = self.meshes[body]
            keys, surface = (face_keys(one, used.n_points) for one in (found, boundary_faces(used)))
            allowed = "faces of the body's surface, each once, and of no other wall"
            if not len(keys):
                raise MeshError(Fault("the wall has no face", where, allowed=allowed))
            others = ((other, np.isin(keys, of)) for other, (on, of) in self.walls.items() if on == body)
            once = np.isin(np.arange(len(keys)), np.unique(keys, return_index=True)[1])
            wrong = {"inside the body": ~np.isin(keys, surface), "duplicated": ~once}
            for what, which in [*wrong.items(), *((f"of {other}, too", which) for other, which in others)]:
                if which.any():
                    got = f"{np.count_nonzero(which)} of {len(keys)} faces are {what}"
                    raise MeshError(Fault("this is no wall of a chamber of its own", where, got, allowed))
            self.walls[where] = body, keys
        return found + self.builder.first[body]

    def cable(self, name: str, where: str) -> int:
        if name not in self.cables:
            raise MeshError(unknown("there is no such cable", where, name, self.cables))
        return self.cables.index(name)

    def support(self, at: Floats, on: str, where: str) -> Weights:
        return self.supported(at, on, where)


def _riders(body: Body, mesh: TetMesh, robot: Robot, frame: dict[str, int]) -> Ints:
    """The frame, or other support, that each node of the body follows: see `Layout`. frame: plate -> its frame."""
    rider = np.full(mesh.n_points, FREE, dtype=np.int64)
    for plate in robot.plates:
        if body.name not in plate.nodes:
            continue
        nodes = nodes_in_use(body.mesh, mesh, plate.nodes[body.name])
        taken = nodes[rider[nodes] != FREE]
        if len(taken):
            raise MeshError(Fault(f"{len(taken)} node(s) are tied to two plates", where=f"{plate.name} on {body.name}"))
        rider[nodes] = frame[plate.name]
    fixed = nodes_in_use(body.mesh, mesh, body.fixed)
    both = fixed[rider[fixed] != FREE]
    if len(both):
        raise MeshError(
            Fault(f"{len(both)} node(s) are both fixed and tied to a plate", where=body.name, got=f"node {both[0]}")
        )
    rider[fixed] = FIXED
    for tie in robot.ties:
        if tie.body != body.name:
            continue
        nodes = nodes_in_use(body.mesh, mesh, tie.nodes)
        held = nodes[rider[nodes] != FREE]
        if len(held):
            raise MeshError(
                Fault(
                    f"{len(held)} node(s) are tied to a body and also fixed or tied otherwise",
                    where=tie.name,
                    got=f"node {held[0]} of {body.name}",
                    allowed="regions that do not overlap",
                )
            )
        rider[nodes] = TIED
    lies_loose = np.all(rider == FREE) and all(tie.on != body.name for tie in robot.ties)
    if lies_loose and robot.contact is None:
        raise MeshError(
            Fault("the body is not attached: no node is fixed or tied to a plate or another body", where=body.name)
        )
    return rider


Build = Callable[[Robot], Any]


def neighbours_of(robot: Robot, theta: Mapping[str, float], build: Build) -> dict[str, Neighbours]:
    """By the name of each length, the twins next to that of a robot at theta; built when they are needed.

    What theta states of its shape stays as one length changes; other lengths follow it, as in the robot at theta.

    Parameters
    ----------
    robot
        The robot.
    theta
        Parameter values by dotted name [SI].
    build
        Robot -> its twin, or a part of it.
    """
    infos = robot_parameters(robot)
    own = {name: info.value for name, info in infos.items() if info.shapes}
    stated = {name: theta[name] for name, value in own.items() if theta.get(name, value) != value}
    shape = {name: info.value for name, info in robot_parameters(with_shape(robot, stated)).items() if info.shapes}
    neighbours: dict[str, Neighbours] = {}
    for body in robot.bodies:
        extent = float(np.ptp(body.mesh.points, axis=0).max())
        for key in (*(body.shape.values if body.shape else ()), *(("clamp_depth",) if body.clamp else ())):
            name = f"{body.name}.{key}"
            step = STEP * (extent if infos[name].unit == "m" else 1.0)
            neighbours[name] = Neighbours(partial(_beside, robot, {**stated, name: shape[name]}, name, build), step)
    return neighbours


def _beside(robot: Robot, stated: Mapping[str, float], name: str, build: Build, offset: float) -> Any:
    return build(with_shape(robot, {**stated, name: stated[name] + offset}))
