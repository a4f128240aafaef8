"""Drawing data of a robot: extent and plate surfaces. Lengths in m."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.report.scene import Surface
from softcal.report.shapes import disc_surface, flat_disc, unit_circle
from softcal.twin.facing import plate_normal, plate_radius
from softcal.twin.robot import Disc, Plate, Robot


def robot_points(robot: Robot) -> Floats:
    """Points (n, 3) of all bodies, rods and plates at rest."""
    found = [body.mesh.points for body in robot.bodies] + [rod.centreline.nodes for rod in robot.rods]
    for plate in robot.plates:
        found.append(plate.reference[None])
        if plate.disc is not None:
            found.append(_rim(plate.disc))
    return np.concatenate(found)


def plate_surface(robot: Robot, plate: Plate, pose: Pose, colour: str, *, opacity: float) -> Surface | None:
    """A plate at a pose: its own shape, or a flat disc if unknown; None if it has no extent.

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
    """Points around a plate at a pose (n, 3), for the line from its label."""
    centre = plate.reference if plate.disc is None else plate.disc.centre
    normal = plate_normal(robot, plate)
    shape = plate.disc or Disc(centre, normal, 2 * max(plate_radius(robot, plate), 1e-9), 1.0)
    return pose.apply(0.97 * (_rim(shape) - shape.centre) + centre - plate.reference)


def _rim(shape: Disc) -> Floats:
    return shape.centre + 0.5 * shape.diameter * unit_circle(shape.axis)
