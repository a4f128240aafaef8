"""The via points of a robot that lie in a bore of their body, and are supported by the bore's wall all around."""

from __future__ import annotations

from softcal.mechanics.attachment import attach_point
from softcal.twin.robot import Robot


def bores(robot: Robot) -> dict[str, dict[int, float]]:
    """Cable -> the numbers of its via points in bores, from 0, with the bores' diameters [m]; only cables with such
    points.
    """
    meshes = {body.name: body.mesh for body in robot.bodies}
    found: dict[str, dict[int, float]] = {}
    for cable in robot.cables:
        for i, via in enumerate(cable.via_points):
            diameter = attach_point(meshes[via.on], via.at).bore if via.on in meshes else 0.0
            if diameter > 0.0:
                found.setdefault(cable.name, {})[i] = diameter
    return found
