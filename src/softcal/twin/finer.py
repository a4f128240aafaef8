"""The same robot on better discretisations that need no mesher: refined elements, or elements of higher order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.refine import count, refined_centreline, refined_mesh, refined_nodes
from softcal.mechanics.elements import ELEMENTS
from softcal.quantities import QUANTITIES
from softcal.twin.actuated import NamedActuator
from softcal.twin.robot import Body, Moment, Plate, PointLoad, Robot, SurfaceLoad

# Apart from the names of the mesh's own sets.
_OURS = "of the robot: "


@dataclass(frozen=True)
class Size:
    """Size of a robot's discretisation: tets, elements of rods, and unknowns (those of fixed nodes included)."""

    tets: int
    rod_elements: int
    unknowns: int


def size(robot: Robot, halvings: int = 0) -> Size:
    """The size of a robot with its elements halved so many times; no mesh is built for it."""
    tets = unknowns = 0
    for body in robot.bodies:
        counts, element = count(body.mesh), ELEMENTS[body.element]
        for _ in range(halvings):
            counts = counts.refined
        tets += counts.tets
        unknowns += 3 * counts.nodes(element.cell)
        unknowns += 0 if element.pressure is None else counts.nodes(element.pressure)
    elements = [(len(rod.centreline.nodes) - 1) * 2**halvings for rod in robot.rods]
    return Size(tets, sum(elements), unknowns + 6 * sum(n + 1 for n in elements))


def has_lower(robot: Robot, element: str) -> bool:
    """Whether bodies have lower elements than this one."""
    return any(_is_lower(body, element) for body in robot.bodies)


def elevated(robot: Robot, element: str) -> Robot:
    """The robot with elements of this kind in all bodies that have lower ones; the tets stay."""
    bodies = (replace(body, element=element) if _is_lower(body, element) else body for body in robot.bodies)
    return replace(robot, bodies=tuple(bodies))


def _is_lower(body: Body, element: str) -> bool:
    return ELEMENTS[body.element].rank < ELEMENTS[element].rank


def halved(robot: Robot) -> Robot:
    """The robot with every tet in eight and every element of a rod in two; supports, ties and loads are unchanged.

    Tied nodes stay tied, also where the finer mesh's default tolerance would exclude them.
    """
    bodies: list[Body] = []
    meshes: dict[str, TetMesh] = {}  # with the robot's supports, ties and loads as sets
    for body in robot.bodies:
        node_sets = {_OURS + "fixed": body.fixed}
        node_sets |= {f"{_OURS}plate {p.name}": p.nodes[body.name] for p in robot.plates if body.name in p.nodes}
        node_sets |= {f"{_OURS}tie {tie.name}": tie.nodes for tie in robot.ties if tie.body == body.name}
        face_sets = {
            f"{_OURS}load {load.name}": load.faces
            for load in robot.loads
            if isinstance(load, SurfaceLoad) and load.on == body.name
        }
        for part in robot.actuators:
            wall = part.actuator.surfaces.get(body.name)
            face_sets |= {} if wall is None or isinstance(wall, str) else {f"{_OURS}actuator {part.name}": wall}
        old = body.mesh
        mesh = meshes[body.name] = refined_mesh(
            TetMesh(
                old.points,
                old.tets,
                {**old.node_sets, **node_sets},
                {**old.face_sets, **face_sets},
                {**old.element_sets, **{_OURS + part.name: part.elements for part in body.inclusions}},
            )
        )
        own = TetMesh(mesh.points, mesh.tets, _own(mesh.node_sets), _own(mesh.face_sets), _own(mesh.element_sets))
        inclusions = tuple(replace(part, elements=mesh.element_sets[_OURS + part.name]) for part in body.inclusions)
        bodies.append(replace(body, mesh=own, fixed=mesh.node_sets[_OURS + "fixed"], inclusions=inclusions))

    def nodes(body: str, key: str) -> Ints:
        return meshes[body].node_sets[_OURS + key]

    def plate(old: Plate) -> Plate:
        return replace(old, nodes={body: nodes(body, f"plate {old.name}") for body in old.nodes})

    def load(old: PointLoad | Moment | SurfaceLoad) -> PointLoad | Moment | SurfaceLoad:
        if isinstance(old, SurfaceLoad):
            return replace(old, faces=meshes[old.on].face_sets[f"{_OURS}load {old.name}"])
        return old

    def actuator(old: NamedActuator) -> NamedActuator:
        finer = {
            body: wall if isinstance(wall, str) else meshes[body].face_sets[f"{_OURS}actuator {old.name}"]
            for body, wall in old.actuator.surfaces.items()
        }
        return replace(old, actuator=old.actuator.on_surfaces(finer))

    return replace(
        robot,
        bodies=tuple(bodies),
        actuators=tuple(actuator(old) for old in robot.actuators),
        rods=tuple(
            replace(
                rod,
                centreline=refined_centreline(rod.centreline),
                clamped={plate: refined_nodes(nodes) for plate, nodes in rod.clamped.items()},
                fixed=refined_nodes(rod.fixed),
                inclusions=tuple(
                    replace(part, elements=np.sort(np.concatenate([2 * part.elements, 2 * part.elements + 1])))
                    for part in rod.inclusions
                ),
            )
            for rod in robot.rods
        ),
        plates=tuple(plate(old) for old in robot.plates),
        ties=tuple(
            replace(
                tie,
                nodes=nodes(tie.body, f"tie {tie.name}"),
                tolerance=QUANTITIES["size"].upper if tie.tolerance is None else tie.tolerance,
            )
            for tie in robot.ties
        ),
        loads=tuple(load(old) for old in robot.loads),
    )


def _own(sets: Mapping[str, Ints]) -> dict[str, Ints]:
    return {name: values for name, values in sets.items() if not name.startswith(_OURS)}
