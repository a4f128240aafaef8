"""The faces of bodies that actuators act on, such as the walls of chambers."""

from __future__ import annotations

from collections.abc import Mapping

from softcal.checks import Ints
from softcal.geometry.mesh import TetMesh
from softcal.geometry.regions import Named, select_faces
from softcal.twin.loads import faces_in_use
from softcal.twin.robot import Robot


def walls(robot: Robot, meshes: Mapping[str, TetMesh]) -> dict[str, dict[str, Ints]]:
    """Actuator -> body -> faces (n, 3 or 6) of its mesh that it acts on, of those that act on surfaces.

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
