"""Scenes of the twin at rest and bent: bodies and rods coloured by displacement, cables, plates, markers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.geometry.pose import Pose
from softcal.geometry.surface import boundary_triangles
from softcal.report.robot_view import balls, plate_disc, plate_rim, robot_points, rod_tube
from softcal.report.scene import (
    Ball,
    Label,
    Part,
    Projection,
    Scene,
    Surface,
    Tube,
    bending_camera,
    extent_points,
    length_scale,
    refined,
)
from softcal.report.twin_view import TwinView
from softcal.twin.facing import up_direction
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot

TAUT = 1e-6  # of the largest tension: less is slack
MANY_CABLES = 3  # more than these are drawn thinner


@dataclass(frozen=True)
class TwinScenes:
    """Rest and bent shape in one projection; largest: the largest displacement [m], top of the colour scale."""

    scenes: tuple[Scene, Scene]
    camera: Projection
    largest: float


def twin_scenes(view: TwinView) -> TwinScenes:
    """The twin at rest and bent: bodies and rods coloured by displacement from rest, cables as tubes, plates as discs.

    Slack cables are grey if any cable is taut.
    """
    moved = displacements(view.rest, view.bent)
    largest = max(float(values.max()) for values in moved.values())
    scenes = [
        Scene(snapshot.label, *twin_parts(view, snapshot, {name: shift * d for name, d in moved.items()}, largest))
        for snapshot, shift in ((view.rest, 0.0), (view.bent, 1.0))
    ]
    up, towards = bending_axes(view)
    pair = (scenes[0], scenes[1])
    return TwinScenes(pair, bending_camera(extent_points(pair), up, towards), largest)


def displacements(rest: Snapshot, bent: Snapshot) -> dict[str, Floats]:
    """Displacement magnitude of every node of each body and rod between two shapes [m]."""
    moved = {body: np.linalg.norm(points - rest.points[body], axis=1) for body, points in bent.points.items()}
    return moved | {rod: np.linalg.norm(nodes - rest.rods[rod], axis=1) for rod, nodes in bent.rods.items()}


def cable_radius(robot: Robot, size: float) -> float:
    """Drawn radius [m] of cables for a robot of that size [m]."""
    return (0.007 if len(robot.cables) <= MANY_CABLES else 0.0035) * size


def twin_parts(
    view: TwinView, snapshot: Snapshot, moved: dict[str, Floats], largest: float
) -> tuple[tuple[Part, ...], tuple[Label, ...]]:
    """A shape of the twin and the labels of its parts; moved [m]: displacements that colour it, up to `largest`."""
    from matplotlib import colormaps

    from softcal.report.style import BLUE, DISPLACEMENT, LOOP, MUTED, ORANGE, SKY

    robot = view.robot
    size = length_scale(robot_points(robot))
    shades = {name: colormaps[DISPLACEMENT](d / (largest or 1.0))[:, :3] for name, d in moved.items()}
    parts: list[Part] = [
        surface for body in view.tets for surface in _body_surfaces(view, snapshot, body, shades[body], MUTED)
    ]
    labels: list[Label] = []
    parts += [rod_tube(rod, snapshot.rods[rod.name], shades[rod.name]) for rod in robot.rods]
    strongest = max(snapshot.tensions.values(), default=0.0)
    radius = cable_radius(robot, size)
    pulled = {name for name, tension in view.bent.tensions.items() if tension > 0.0} or set(snapshot.cables)
    for cable in robot.cables:
        path = snapshot.cables[cable.name]
        slack = strongest > 0.0 and snapshot.tensions.get(cable.name, strongest) <= TAUT * strongest
        colour = LOOP if slack else ORANGE
        parts.append(Tube(path, 0.5 * radius if slack else radius, colour=colour))
        parts += [Ball(path[k], 2 * radius, colour=colour) for k in balls(robot, cable)]
        if not slack and (cable.name in pulled or len(robot.cables) <= MANY_CABLES):
            labels.append(Label(cable.name, refined(path)))
    for plate in robot.plates:
        if plate.name not in snapshot.plates:
            continue
        position, rotation = snapshot.plates[plate.name]
        pose = Pose(rotation, position)
        look = (MUTED, 1.0) if plate.fixed else (BLUE, 0.35)
        disc = plate_disc(robot, plate, pose, look[0], opacity=look[1])
        parts += [] if disc is None else [disc]
        labels.append(Label(plate.name, plate_rim(robot, plate, pose)))
    parts += [Ball(at, 0.012 * size, colour=SKY) for at in snapshot.markers.values()]
    return tuple(parts), tuple(labels)


def _body_surfaces(view: TwinView, snapshot: Snapshot, name: str, shades: Floats, fixed: str) -> list[Surface]:
    """A body's surface, coloured by node; triangles whose nodes are all fixed in space have the colour `fixed`."""
    triangles = boundary_triangles(view.tets[name])
    body = next(body for body in view.robot.bodies if body.name == name)
    is_fixed = np.isin(triangles, body.fixed).all(axis=1)
    points = snapshot.points[name]
    surfaces = [Surface(points, triangles[~is_fixed], colour=shades)]
    if is_fixed.any():
        surfaces.append(Surface(points, triangles[is_fixed], colour=fixed))
    return surfaces


def bending_axes(view: TwinView) -> tuple[Floats, Floats]:
    """The upward direction, and the direction in which the twin bends."""
    rest, bent = (
        np.concatenate([*(shape.points[body] for body in view.tets), *shape.rods.values()])
        for shape in (view.rest, view.bent)
    )
    return up_direction(view.robot), (bent - rest).mean(axis=0)
