"""Viewing direction of a robot, normals of its plates, and radii of plates of unknown shape, for figures."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.twin.robot import Plate, Robot


def up_direction(robot: Robot) -> Floats:
    """The upward direction of a picture: against gravity; without it, the normal of the first plate; else z."""
    weight = float(np.linalg.norm(robot.gravity))
    if weight > 0.0:
        return -robot.gravity / weight
    return plate_normal(robot, robot.plates[0]) if robot.plates else np.array([0.0, 0.0, 1.0])


def plate_normal(robot: Robot, plate: Plate) -> Floats:
    """Unit normal of a plate at rest: its disc's axis, else pointing away from fixed parts, or along the rod clamped to
    it.
    """
    if plate.disc is not None:
        return plate.disc.axis
    tied = [body.mesh.points[plate.nodes[body.name]] for body in robot.bodies if body.name in plate.nodes]
    if tied:
        held = [body.mesh.points[body.fixed] for body in robot.bodies if len(body.fixed)]
        base = np.concatenate(held or [body.mesh.points for body in robot.bodies])
        axis = np.concatenate(tied).mean(axis=0) - base.mean(axis=0)
        size = float(np.linalg.norm(axis))
        return axis / size if size > 0 else np.array([0.0, 0.0, 1.0])
    tangents = [
        rod.centreline.triads[rod.clamped[plate.name][0], :, 2]
        for rod in robot.rods
        if len(rod.clamped.get(plate.name, ()))
    ]
    return np.asarray(tangents[0]) if tangents else np.array([0.0, 0.0, 1.0])


def plate_radius(robot: Robot, plate: Plate) -> float:
    """Radius [m] of the flat disc that covers the plate's nodes, holes and rods and the cable points on it."""
    if plate.disc is not None:
        return 0.5 * plate.disc.diameter
    normal = plate_normal(robot, plate)
    points = [body.mesh.points[plate.nodes[body.name]] for body in robot.bodies if body.name in plate.nodes]
    points += [via.at[None] for cable in robot.cables for via in cable.via_points if via.on == plate.name]
    points += [at[None] for at in plate.holes.values()]
    clamped = [rod for rod in robot.rods if plate.name in rod.clamped]
    points += [rod.centreline.nodes[rod.clamped[plate.name]] for rod in clamped]
    offsets = np.concatenate([*points, plate.reference[None]]) - plate.reference
    across = offsets - np.outer(offsets @ normal, normal)
    widest = float(np.max(np.linalg.norm(across, axis=1)))
    return 1.08 * max([widest, *(rod.section.constants.outer_diameter for rod in clamped)])
