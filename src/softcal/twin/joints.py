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

GROUND = ""  # in the place of a part: what does not move


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
        For bodies that do not exist, nodes too far from the other body, and nodes tied to nodes that another tie ties.
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
    for k, tie in enumerate(robot.ties):
        for other, tied in zip(robot.ties, point, strict=True):
            if len(chained := np.intersect1d(master[k], tied)):
                what = f"nodes of {tie.body} are tied to nodes of {tie.on} that {other.name} ties to {other.on}"
                attempt = "one tie between two bodies, and ties of one body to others apart from each other"
                raise MeshError(Fault(what, tie.name, f"{len(chained)} such nodes of {tie.on}", "none", attempt))
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


def hinges(robot: Robot) -> list[tuple[str, str]]:
    """The joints whose nodes are on one line, about which a part can turn without any deformation: the name of the
    plate or tie, or of a body by its fixed nodes, and that of the part that turns.
    """
    meshes = {body.name: body.mesh for body in robot.bodies}
    fixed = {plate.name for plate in robot.plates if plate.fixed}
    joints = [(body.name, body.name, GROUND, body.mesh.points[body.fixed]) for body in robot.bodies]
    joints += [
        (plate.name, body, GROUND if plate.fixed else plate.name, meshes[body].points[nodes])
        for plate in robot.plates
        for body, nodes in plate.nodes.items()
    ]
    joints += [(tie.name, tie.body, tie.on, meshes[tie.body].points[tie.nodes]) for tie in robot.ties]
    joints = [(name, one, other, _frame_of(points)) for name, one, other, points in joints if len(points)]
    if all(len(points) > 2 for *_, points in joints):
        return []
    for rod in robot.rods:
        size = rod.centreline.lengths.sum() * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        ends = [(GROUND if name in fixed else name, nodes) for name, nodes in rod.clamped.items()]
        for name, nodes in [*ends, (GROUND, rod.fixed)]:
            joints += [(rod.name, rod.name, name, rod.centreline.nodes[node] + size) for node in nodes]
    parts = {name: k for k, name in enumerate(dict.fromkeys(name for _, *two, _ in joints for name in two if name))}
    middle = np.mean([points[0] for *_, points in joints], axis=0)
    size = max(float(np.abs(points - middle).max()) for *_, points in joints) or 1.0  # all at one point

    def slip(one: str, other: str, points: Floats) -> Floats:
        """How fast points of two parts move apart (3 n, 6 parts), by their velocities and, over the size, turns."""
        arms = np.cross(np.eye(3), (points[:, None] - middle) / size).reshape(-1, 3)
        motion = np.hstack([np.tile(np.eye(3), (len(points), 1)), arms])
        rows = np.zeros((3 * len(points), len(parts), 6))
        for name, sign in ((one, 1.0), (other, -1.0)):
            if name:
                rows[:, parts[name]] = sign * motion
        return rows.reshape(len(rows), -1)

    _, s, modes = np.linalg.svd(np.concatenate([slip(*joint[1:]) for joint in joints]))
    free = modes[np.count_nonzero(s > 1e-6) :]
    plates = {plate.name for plate in robot.plates}
    found: list[tuple[str, str]] = []
    for name, one, other, points in joints:
        apart = slip(one, other, points[0] + size * np.eye(3)) @ free.T
        if len(points) < 3 and np.abs(apart).max(initial=0.0) > 1e-3:
            found.append((name, name if name in plates - fixed else one))
    return found


def _frame_of(points: Floats) -> Floats:
    """The middle of points (n, 3), and one more point along each direction in which they extend."""
    middle = points.mean(axis=0)
    _, s, axes = np.linalg.svd(points - middle, full_matrices=False)
    extends = s > 1e-6 * max(float(s.max()), 1e-12)
    return np.concatenate([middle[None], middle + s[extends, None] * axes[extends]])
