"""The dead loads of a robot: weight, forces at points, tractions on faces; moments on plates and rods. And the faces
that actuators act on.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import MeshError, unknown
from softcal.geometry.cell import LINEAR
from softcal.geometry.centreline import place_on_rod
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import linear_numbers
from softcal.geometry.regions import Named, select_faces
from softcal.geometry.surface import matching_faces
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.layout import Layout
from softcal.mechanics.loads import Loads
from softcal.mechanics.moments import Moments
from softcal.twin.robot import Moment, PointLoad, Robot, SurfaceLoad

Weights = list[tuple[int, float]]
# The parameter a force is per unit of (None: none), the weighted points it acts on, the force.
PointForce = tuple[str | None, Weights, Floats]


def points_of_forces(robot: Robot) -> dict[str, Floats]:
    """The points (3,) [m] at rest on which cables and loads act, by what they are called in sentences."""
    via = {f"via point {i + 1} of {c.name}": p.at for c in robot.cables for i, p in enumerate(c.via_points)}
    return via | {load.name: load.at for load in robot.loads if isinstance(load, PointLoad)}


def surface_forces(
    load: SurfaceLoad, given: dict[str, TetMesh], meshes: dict[str, TetMesh], first: dict[str, int]
) -> list[PointForce]:
    """Consistent nodal forces of a constant traction; quadratic straight faces load their middle nodes alone.

    Parameters
    ----------
    load
        The load.
    given
        Body -> the mesh in whose node numbers the load's faces are [m].
    meshes
        Body -> the mesh of its elements [m].
    first
        Part -> the number of its first point.

    Raises
    ------
    MeshError
        For a body that does not exist, or a triangle that is no face of its mesh.
    """
    if load.on not in meshes:
        raise MeshError(unknown("there is no such body", load.name, load.on, meshes))
    mesh = meshes[load.on]
    faces = faces_in_use(given[load.on], mesh, load.faces, where=load.name)
    a, b, c = np.moveaxis(mesh.points[faces[:, :3]], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return [
        (None, [(first[load.on] + node, 1.0)], share * size * load.traction)
        for face, size in zip(faces.tolist(), area, strict=True)
        for node, share in zip(face, mesh.cell.face_shares, strict=True)
        if share != 0.0
    ]


def walls(robot: Robot, meshes: Mapping[str, TetMesh]) -> dict[str, dict[str, Ints]]:
    """Actuator that acts on surfaces -> body -> faces (n, 3 or 6) of the body's mesh that it acts on.

    Parameters
    ----------
    robot
        The robot.
    meshes
        Body -> the mesh in use, its own or that of its element.
    """
    own = {body.name: body.mesh for body in robot.bodies}
    found: dict[str, dict[str, Ints]] = {}
    for part in robot.actuators:
        for body, faces in part.surfaces.items():
            where = f"{part.name} on {body}"
            given = select_faces(own[body], Named(faces), where=where) if isinstance(faces, str) else faces
            found.setdefault(part.name, {})[body] = faces_in_use(own[body], meshes[body], given, where=where)
    return found


def faces_in_use(given: TetMesh, used: TetMesh, faces: Ints, *, where: str) -> Ints:
    """Faces (n, 3 or 6) of the mesh in use, outwards, for those (n, 3 or more) of the body's mesh.

    Parameters
    ----------
    given
        Mesh of the body.
    used
        Mesh of its elements.
    faces
        Node numbers in the former.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where a triangle is no face.
    """
    faces = matching_faces(given, faces, where=where)
    if used.cell is LINEAR and given.cell is not LINEAR:
        faces = linear_numbers(given)[faces[:, :3]]
    return matching_faces(used, faces, where=where)


def build_loads(
    robot: Robot,
    meshes: dict[str, TetMesh],
    first: dict[str, int],
    forces: list[PointForce],
    plates: Mapping[str, Weights],
    n_points: int,
) -> Loads:
    """Every dead load of the robot, by the parameter it is proportional to.

    Parameters
    ----------
    robot
        The robot.
    meshes
        Body -> the mesh of its elements [m].
    first
        Part -> the number of its first point.
    forces
        Forces on points: parameter, weighted points, and direction.
    plates
        Plate -> weighted points of its centre of mass.
    n_points
        Number of the layout's points.
    """
    constant = np.zeros((n_points, 3))
    per_unit: dict[str, Floats] = {}
    for name, weights, force in forces:
        target = constant if name is None else per_unit.setdefault(name, np.zeros((n_points, 3)))
        for point, weight in weights:
            target[point] += weight * force
    weighed: dict[str, Floats] = {}
    for plate, weights in plates.items():
        mass = weighed[f"{plate}.mass"] = np.zeros(n_points)
        for point, weight in weights:
            mass[point] += weight
    for body in robot.bodies:
        mesh, start = meshes[body.name], first[body.name]
        for material in body.materials:
            mass = weighed[f"{material.name}.density"] = np.zeros(n_points)
            volumes = ELEMENTS[body.element].nodal_volumes(mesh.points, mesh.tets[material.elements])
            mass[start : start + mesh.n_points] = volumes
    for rod in robot.rods:
        for material in rod.materials:
            mass = weighed[f"{material.name}.density"] = np.zeros(n_points)
            for end in (0, 1):
                np.add.at(mass, first[rod.name] + material.elements + end, rod.volumes[material.elements, end])
    return Loads(constant, per_unit, weighed)


def build_moments(robot: Robot, layout: Layout, of_plate: Mapping[str, int], of_rod: Mapping[str, Ints]) -> Moments:
    """Every dead moment of the robot, on its part's frames.

    Parameters
    ----------
    robot
        The robot.
    layout
        Numbering of points, frames and unknowns.
    of_plate, of_rod
        Plate -> its frame, rod -> the frames of its nodes.

    Raises
    ------
    MeshError
        For a part that has no frames.
    """
    rods = {rod.name: rod for rod in robot.rods}
    per_unit: dict[str, Floats] = {}
    for load in robot.loads:
        if not isinstance(load, Moment):
            continue
        if load.on not in of_plate and load.on not in rods:
            raise MeshError(unknown("there is no such plate or rod", load.name, load.on, [*of_plate, *rods]))
        unit = per_unit[f"{load.name}.moment"] = np.zeros((layout.n_frames, 3))
        if load.on in of_plate:
            unit[of_plate[load.on]] = load.direction
            continue
        for node, weight in place_on_rod(rods[load.on].centreline, load.at).weights:
            unit[of_rod[load.on][node]] += weight * load.direction
    return Moments(layout, per_unit)
