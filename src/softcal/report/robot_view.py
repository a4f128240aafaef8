"""How the parts of a robot look: where plates face, how wide they are, which way is up. Lengths in m."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.report.scene import Surface
from softcal.report.shapes import disc_surface, flat_disc, unit_circle
from softcal.twin.robot import Disc, Plate, Robot


def robot_points(robot: Robot) -> Floats:
    """Points (n, 3) of all bodies, rods and plates at rest."""
    found = [body.mesh.points for body in robot.bodies] + [rod.centreline.nodes for rod in robot.rods]
    for plate in robot.plates:
        found.append(plate.reference[None])
        if plate.disc is not None:
            found.append(_rim(plate.disc))
    return np.concatenate(found)


def up_direction(robot: Robot) -> Floats:
    """What is up in a picture: against gravity; without it, the way the first plate faces; else z."""
    weight = float(np.linalg.norm(robot.gravity))
    if weight > 0.0:
        return -robot.gravity / weight
    return plate_normal(robot, robot.plates[0]) if robot.plates else np.array([0.0, 0.0, 1.0])


def plate_normal(robot: Robot, plate: Plate) -> Floats:
    """Unit normal of a plate at rest: its disc's axis, else away from what is fixed, or of the rod that it holds."""
    if plate.disc is not None:
        return np.asarray(plate.disc.axis)
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
    return 1.08 * max([widest, *(rod.section.outer_diameter for rod in clamped)])


def plate_surface(robot: Robot, plate: Plate, pose: Pose, colour: str, *, opacity: float) -> Surface | None:
    """A plate where it is now, its own shape or a flat disc in its place; None where it has no extent.

    pose: of the plate's reference point.
    """
    if plate.disc is not None:
        rest = disc_surface(plate, plate.disc, colour, opacity=opacity)
        return replace(rest, points=pose.apply(rest.points - plate.reference))
    radius = plate_radius(robot, plate)
    if not radius > 0.0:
        return None
    return flat_disc(pose.position, pose.rotation @ plate_normal(robot, plate), radius, colour, opacity=opacity)


def plate_rim(robot: Robot, plate: Plate, pose: Pose) -> Floats:
    """Points around a plate where it is now (n, 3), for the line from its name."""
    centre = plate.reference if plate.disc is None else plate.disc.centre
    normal = plate_normal(robot, plate)
    shape = plate.disc or Disc(centre, normal, 2 * max(plate_radius(robot, plate), 1e-9), 1.0)
    return pose.apply(0.97 * (_rim(shape) - shape.centre) + centre - plate.reference)


def _rim(shape: Disc) -> Floats:
    return shape.centre + 0.5 * shape.diameter * unit_circle(shape.axis)
