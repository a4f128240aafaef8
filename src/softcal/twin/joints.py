"""Connections of the robot's parts: the frames that plates and rods share, and the ties between bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError, unknown
from softcal.geometry.cell import LINEAR
from softcal.geometry.locate import distances_outside
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import attach
from softcal.mechanics.links import Ties
from softcal.twin.robot import Robot, Tie
from softcal.units import format_quantity


@dataclass(frozen=True)
class Frames:
    """references (n_frames, 3) [m], the moving ones first; of_plate: plate -> its frame; of_rod: rod -> the frame of
    each of its nodes; n_fixed: number of fixed frames.
    """

    references: Floats
    of_plate: dict[str, int]
    of_rod: dict[str, Ints]
    n_fixed: int


def number_frames(robot: Robot) -> Frames:
    """The frames of plates and rods: one per plate, one per node of a rod that is not clamped, one for all fixed nodes.

    Raises
    ------
    MeshError
        For a rod without support or clamped to a missing plate; for a moving plate without a body or rod.
    """
    plates = {plate.name: plate for plate in robot.plates}
    moving = [plate for plate in robot.plates if not plate.fixed]
    references: list[Floats] = [plate.reference[None] for plate in moving]
    of_plate = {plate.name: i for i, plate in enumerate(moving)}
    n = len(moving)
    own: dict[str, Ints] = {}
    for rod in robot.rods:
        for name in rod.clamped:
            if name not in plates:
                raise MeshError(unknown("there is no such plate", f"{rod.name}, clamped", name, plates))
        held = np.concatenate([rod.fixed, *rod.clamped.values()])
        if len(held) == 0:
            raise MeshError(Fault("the rod is not attached: no node is fixed or clamped to a plate", where=rod.name))
        free = np.setdiff1d(np.arange(len(rod.centreline.nodes)), held)
        frame = np.full(len(rod.centreline.nodes), -1, dtype=np.int64)
        frame[free] = n + np.arange(len(free))
        references.append(rod.centreline.nodes[free])
        own[rod.name] = frame
        n += len(free)
    for plate in moving:
        if not any(len(nodes) for nodes in plate.nodes.values()) and not any(
            plate.name in r.clamped for r in robot.rods
        ):
            raise MeshError(Fault("the plate is tied to no body and no rod", where=plate.name))
    still = [plate for plate in robot.plates if plate.fixed]
    of_plate.update({plate.name: n + i for i, plate in enumerate(still)})
    references += [plate.reference[None] for plate in still]
    n_fixed = len(still)
    if any(len(rod.fixed) for rod in robot.rods):
        references.append(np.zeros((1, 3)))
        n_fixed += 1
    ground = n + n_fixed - 1
    for rod in robot.rods:
        own[rod.name][rod.fixed] = ground
        for plate, nodes in rod.clamped.items():
            own[rod.name][nodes] = of_plate[plate]
    return Frames(np.concatenate([np.zeros((0, 3)), *references]), of_plate, own, n_fixed)


def join_ties(robot: Robot, meshes: dict[str, TetMesh], first: dict[str, int]) -> Ties:
    """The masters of the tied nodes: the nearest element of the other body for each.

    Parameters
    ----------
    robot
        The robot.
    meshes
        Body -> the mesh of its elements [m].
    first
        Part -> the number of its first point.

    Raises
    ------
    MeshError
        For bodies that do not exist, and nodes too far from the other body.
    """
    point: list[Ints] = []
    master: list[Ints] = []
    weight: list[Floats] = []
    bodies = {body.name: body for body in robot.bodies}
    for tie in robot.ties:
        for key, name in (("body", tie.body), ("on", tie.on)):
            if name not in bodies:
                raise MeshError(unknown("there is no such body", f"{tie.name}.{key}", name, bodies))
        if tie.body == tie.on:
            raise MeshError(Fault("a body cannot be tied to itself", where=tie.name, got=tie.body))
        fault = tie_fault(tie, bodies[tie.body].mesh, meshes[tie.on])
        if fault is not None:
            raise MeshError(fault)
        mesh = meshes[tie.body]
        nodes = nodes_in_use(bodies[tie.body].mesh, mesh, tie.nodes)
        masters, weights = attach(meshes[tie.on], mesh.points[nodes], tolerance=tie.tolerance, where=tie.name)
        point.append(np.repeat(first[tie.body] + nodes, masters.shape[1]))
        master.append(first[tie.on] + masters.ravel())
        weight.append(weights.ravel())
    none = np.zeros(0, dtype=np.int64)
    return Ties(np.concatenate([none, *point]), np.concatenate([none, *master]), np.concatenate([np.zeros(0), *weight]))


def tie_fault(tie: Tie, mesh: TetMesh, on: TetMesh) -> Fault | None:
    """The fault of a tie whose nodes lie too far from the body that they are to be bonded to; or None.

    Parameters
    ----------
    tie
        The tie.
    mesh
        Mesh of the tied body, whose numbering the tie's nodes have [m].
    on
        Mesh of the other body [m].
    """
    if len(tie.nodes) == 0:
        return Fault("the tie has no nodes", where=tie.name)
    distance, by_default = distances_outside(on, mesh.points[tie.nodes])
    allowed = by_default if tie.tolerance is None else np.full_like(distance, tie.tolerance)
    loose = distance > allowed
    if not loose.any():
        return None
    limit = float(allowed[loose].max())
    tolerance = f"at most {format_quantity(limit, 'm')} from {tie.on}"
    attempt = f"another region or placement, or a tolerance above {format_quantity(float(distance.max()), 'm')}"
    if loose.all():
        nearest = format_quantity(float(distance.min()), "m")
        return Fault(
            "the tie touches nothing",
            where=tie.name,
            got=f"the nearest of {len(distance)} nodes is {nearest} from {tie.on}",
            allowed=tolerance,
            attempt=attempt,
        )
    return Fault(
        f"{int(loose.sum())} of {len(distance)} nodes of the tie are off {tie.on}",
        where=tie.name,
        got=f"up to {format_quantity(float(distance.max()), 'm')}",
        allowed=tolerance,
        attempt=attempt,
    )


def nodes_in_use(given: TetMesh, used: TetMesh, nodes: Ints) -> Ints:
    """Node numbers of the mesh in use, for those of the body's mesh (middle nodes gained or lost).

    Parameters
    ----------
    given
        Mesh of the body.
    used
        Mesh of its elements.
    nodes
        Node numbers in the former (n,).
    """
    if given.cell is used.cell:
        return nodes
    chosen = np.zeros(max(given.n_points, used.n_points), dtype=bool)
    chosen[nodes] = True
    if used.cell is LINEAR:
        old = given.corners
        return np.flatnonzero(chosen[old])
    for i, (a, b) in enumerate(used.cell.edges):
        chosen[used.tets[:, 4 + i]] |= chosen[used.tets[:, a]] & chosen[used.tets[:, b]]
    return np.flatnonzero(chosen)


def loose_faults(robot: Robot) -> list[Fault]:
    """The parts that move as a whole, whose cables would pull them along: by pieces of their meshes. Contact, which may
    hold a part anywhere, joins all of them.
    """
    pieces = {body.name: body.mesh.pieces for body in robot.bodies}

    def parts(body: str, nodes: Ints | None = None) -> set[tuple[str, int]]:
        numbers = pieces[body] if nodes is None else pieces[body][nodes]
        return {(body, int(n)) for n in np.unique(numbers[numbers >= 0])}

    everything = {part for name in pieces for part in parts(name)} | {(rod.name, 0) for rod in robot.rods}
    links = [parts(tie.body, tie.nodes) | parts(tie.on) for tie in robot.ties if {tie.body, tie.on} <= pieces.keys()]
    links += [{(plate.name, 0)} | parts(body, nodes) for plate in robot.plates for body, nodes in plate.nodes.items()]
    links += [{(rod.name, 0), (plate, 0)} for rod in robot.rods for plate in rod.clamped]
    links += [everything] if robot.contact is not None else [{part} for part in everything]
    ground = {(plate.name, 0) for plate in robot.plates if plate.fixed}
    ground |= {(rod.name, 0) for rod in robot.rods if len(rod.fixed)}
    ground = ground.union(*(parts(body.name, body.fixed) for body in robot.bodies))
    while more := {part for link in links if ground & link for part in link} - ground:
        ground |= more
    faults: list[Fault] = []
    for part in robot.deformable:
        own = [each for each in everything if each[0] == part.name]
        if loose := [each for each in own if each not in ground]:
            kind, several = type(part).__name__.lower(), len(own) > 1
            what = f"{'a piece of ' * several}the {kind} is not attached: no node is fixed, nor of what it is tied to"
            faults.append(Fault(what, part.name, f"{len(loose)} of {len(own)} pieces of its mesh" * several))
    return faults
