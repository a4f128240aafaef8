"""Drawing data of a robot: extent, rods and plates. Lengths in m."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.geometry.ring import across, ring_points
from softcal.report.scene import RIM, FlatDisc, Tube
from softcal.twin.facing import plate_normal, plate_radius
from softcal.twin.robot import Cable, Disc, Plate, Robot, Rod

STEPS = 6  # between two nodes of a rod
MOST_BALLS = 8  # via points of a cable that have a ball each


def robot_points(robot: Robot) -> Floats:
    """Points (n, 3) of all bodies, rods and plates at rest."""
    found = [body.mesh.points for body in robot.bodies] + [rod.centreline.nodes for rod in robot.rods]
    for plate in robot.plates:
        found.append(plate.reference[None])
        if plate.disc is not None:
            found.append(_rim(plate.disc))
    return np.concatenate(found)


def rod_tube(rod: Rod, nodes: Floats, colour: str | Floats, *, opacity: float = 1.0) -> Tube:
    """A rod with current node positions (n, 3), as thick as its section; colour: a name, or RGB of each node (n, 3)."""
    from scipy.interpolate import CubicSpline

    stations = rod.centreline.stations
    fine = np.unique(np.concatenate([np.linspace(a, b, STEPS + 1) for a, b in pairwise(stations)]))
    path = CubicSpline(stations, nodes)(fine) if len(nodes) > 2 else _between(stations, nodes, fine)
    shades = colour if isinstance(colour, str) else _between(stations, colour, fine)
    at = (fine / stations[-1]).tolist()
    radius = 0.5 * np.array(
        [rod.section.at(share).outer_diameter for share in (at[:1] if rod.section.is_uniform else at)]
    )
    return Tube(
        path, float(radius[0]) if rod.section.is_uniform else radius, colour=shades, opacity=opacity, bulky=True
    )


def _between(stations: Floats, values: Floats, at: Floats) -> Floats:
    return np.stack([np.interp(at, stations, column) for column in values.T], axis=1)


def balls(robot: Robot, cable: Cable) -> list[int]:
    """Numbers of a cable's via points that are drawn as balls: those in no disc; of many, which hide it, the ends."""
    shaped = {plate.name for plate in robot.plates if plate.disc is not None}
    found = [k for k, via in enumerate(cable.via_points) if via.on not in shaped]
    return found if len(found) <= MOST_BALLS else [found[0], found[-1]]


def plate_disc(robot: Robot, plate: Plate, pose: Pose, colour: str, *, opacity: float) -> FlatDisc | None:
    """A plate at a pose: its own shape with open guide holes, or a thin disc if unknown; None if it has no extent.

    pose: of the plate's reference point.
    """
    disc = plate.disc
    if disc is None:
        radius = plate_radius(robot, plate)
        axis = pose.rotation @ plate_normal(robot, plate)
        thin = FlatDisc(pose.position, axis, radius, radius / 20, colour=colour, opacity=opacity)
        return thin if radius > 0.0 else None
    holes = np.array([*plate.holes.values()] if disc.hole_diameter > 0.0 else []).reshape(-1, 3)
    return FlatDisc(
        pose.apply(disc.centre - plate.reference),
        pose.rotation @ disc.axis,
        0.5 * disc.diameter,
        disc.thickness,
        holes=pose.apply(holes - plate.reference),
        hole_radius=0.5 * disc.hole_diameter,
        colour=colour,
        opacity=opacity,
    )


def plate_rim(robot: Robot, plate: Plate, pose: Pose) -> Floats:
    """Points around a plate at a pose (n, 3), for the line from its label."""
    centre = plate.reference if plate.disc is None else plate.disc.centre
    normal = plate_normal(robot, plate)
    shape = plate.disc or Disc(2 * max(plate_radius(robot, plate), 1e-9), 1.0, normal, centre)
    return pose.apply(0.97 * (_rim(shape) - shape.centre) + centre - plate.reference)


def _rim(shape: Disc) -> Floats:
    return ring_points(shape.centre, shape.axis, across(shape.axis), 0.5 * shape.diameter, RIM)
