"""The dead loads of a robot as forces on points: weight, forces at points, tractions on faces."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, MeshError
from softcal.geometry.cell import LINEAR
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import linear_numbers
from softcal.geometry.surface import matching_faces
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.loads import Loads
from softcal.twin.robot import Robot, SurfaceLoad

Weights = list[tuple[int, float]]
# The parameter a force is per unit of (None: none), the weighted points it acts on, the force.
PointForce = tuple[str | None, Weights, Floats]


def surface_forces(
    load: SurfaceLoad, given: dict[str, TetMesh], meshes: dict[str, TetMesh], first: dict[str, int]
) -> list[PointForce]:
    """Consistent nodal forces of a constant traction; quadratic straight faces load their middle nodes alone.

    given: the bodies' meshes in whose node numbers the load's faces are; meshes: those of the bodies' elements.

    Raises
    ------
    MeshError
        For a body that does not exist, or a triangle that is no face of its mesh.
    """
    if load.on not in meshes:
        raise MeshError(Fault("there is no such body", where=load.name, got=load.on, allowed=", ".join(meshes)))
    mesh, own = meshes[load.on], given[load.on]
    faces = matching_faces(own, load.faces, where=load.name)
    if mesh.cell is LINEAR and own.cell is not LINEAR:
        faces = linear_numbers(own)[faces[:, :3]]
    faces = matching_faces(mesh, faces, where=load.name)
    a, b, c = np.moveaxis(mesh.points[faces[:, :3]], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return [
        (None, [(first[load.on] + node, 1.0)], share * size * load.traction)
        for face, size in zip(faces.tolist(), area, strict=True)
        for node, share in zip(face, mesh.cell.face_shares, strict=True)
        if share != 0.0
    ]


def build_loads(
    robot: Robot,
    meshes: dict[str, TetMesh],
    first: dict[str, int],
    forces: list[PointForce],
    n_points: int,
) -> Loads:
    """Every dead load of the robot, by the parameter it is proportional to."""
    constant = np.zeros((n_points, 3))
    per_unit: dict[str, Floats] = {}
    for name, weights, force in forces:
        target = constant if name is None else per_unit.setdefault(name, np.zeros((n_points, 3)))
        for point, weight in weights:
            target[point] += weight * force
    for body in robot.bodies:
        mesh, start = meshes[body.name], first[body.name]
        for material in body.materials:
            unit = per_unit[f"{material.name}.density"] = np.zeros((n_points, 3))
            volumes = ELEMENTS[body.element].nodal_volumes(mesh.points, mesh.tets[material.tets])
            unit[start : start + mesh.n_points] = volumes[:, None] * robot.gravity
    for rod in robot.rods:
        unit = per_unit[f"{rod.name}.density"] = np.zeros((n_points, 3))
        half = 0.5 * rod.section.constants.area * rod.centreline.lengths[:, None] * robot.gravity
        n = first[rod.name]
        unit[n : n + len(half)] += half
        unit[n + 1 : n + 1 + len(half)] += half
    return Loads(constant, per_unit)
