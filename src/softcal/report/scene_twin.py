"""Scenes of the twin at rest and bent: bodies and rods coloured by displacement, actuators, plates, markers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.geometry.fine_surface import fine_surface
from softcal.geometry.pose import Pose
from softcal.geometry.surface import boundary
from softcal.mechanics.actuator import NO_EFFORT
from softcal.report.robot_view import (
    AROUND,
    ROUTE,
    WALL,
    balls,
    material_colours,
    material_faces,
    name_of,
    on_walls,
    plate_parts,
    robot_points,
    rod_colours,
    rod_tube,
    routed,
    wall_labels,
)
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
from softcal.twin.actuated import effort_shares
from softcal.twin.facing import up_direction
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot

MANY_ROUTES = 3  # more than these are drawn thinner


@dataclass(frozen=True)
class TwinScenes:
    """Rest and bent shape in one projection; largest: the largest displacement [m], top of the colour scale."""

    scenes: tuple[Scene, Scene]
    camera: Projection
    largest: float


def twin_scenes(view: TwinView) -> TwinScenes:
    """The twin at rest in the colours of its materials, and bent in those of the displacement from rest.

    Cables, and other actuators with a route, are grey without an effort if any of their kind has one.
    """
    moved = displacements(view.rest, view.bent)
    largest = max(float(values.max()) for values in moved.values())
    rest = Scene(view.rest.label, *twin_parts(view, view.rest, None, largest))
    bent = Scene(view.bent.label, *twin_parts(view, view.bent, moved, largest))
    up, towards = bending_axes(view)
    pair = (rest, bent)
    return TwinScenes(pair, bending_camera(extent_points(pair), up, towards), largest)


def displacements(rest: Snapshot, bent: Snapshot) -> dict[str, Floats]:
    """Displacement magnitude of every node of each body and rod between two shapes [m]."""
    moved = {body: np.linalg.norm(points - rest.points[body], axis=1) for body, points in bent.points.items()}
    return moved | {rod: np.linalg.norm(nodes - rest.rods[rod], axis=1) for rod, nodes in bent.rods.items()}


def route_radius(robot: Robot, size: float) -> float:
    """Drawn radius [m] of the routes of actuators for a robot of that size [m]."""
    return (0.007 if len(routed(robot)) <= MANY_ROUTES else 0.0035) * size


def twin_parts(
    view: TwinView, snapshot: Snapshot, moved: Mapping[str, Floats] | None, largest: float, most: int | None = None
) -> tuple[tuple[Part, ...], tuple[Label, ...]]:
    """A shape of the twin and the labels of its parts.

    Parameters
    ----------
    view
        The twin, with the shape at rest.
    snapshot
        The shape.
    moved
        Part -> displacements of its nodes [m], its colours; None: the colours of the materials.
    largest
        Top of the colour scale [m].
    most
        Triangles of a body for which its surface is coarser; see `fine_surface`.
    """
    from softcal.report.style import BLUE, LOOP, MUTED, SKY

    robot = view.robot
    size = length_scale(robot_points(robot))
    colours = material_colours(robot)
    parts: list[Part] = []
    for body in robot.bodies:
        d = None if moved is None else moved[body.name]
        tets = view.tets[body.name]
        for material, faces in ({"": boundary(tets)} if d is not None else material_faces(body, tets)).items():
            fine = fine_surface(faces, most)
            at = fine.at(snapshot.points[body.name])
            is_wall = fine.by_triangle(on_walls(faces, body.name, view.walls))
            is_fixed = ~is_wall & fine.by_triangle(np.asarray(np.isin(faces[:, :3], body.fixed).all(axis=1)))
            hides = is_wall.any() or (material == body.name and len(body.materials) > 1)
            look = colours[material] if d is None else _shades(fine.at(d), largest)
            parts += [
                Surface(at, fine.triangles[chosen], colour=colour, opacity=opacity)
                for chosen, colour, opacity in (
                    (~is_fixed & ~is_wall, look, AROUND if hides else 1.0),
                    (is_fixed, MUTED, AROUND if hides else 1.0),
                    (is_wall, WALL, 1.0),
                )
                if chosen.any()
            ]
    labels = wall_labels(view.walls, snapshot.points)
    for rod in robot.rods:
        look = rod_colours(rod, colours) if moved is None else _shades(moved[rod.name], largest)
        parts.append(rod_tube(rod, snapshot.rods[rod.name], look))
    radius, lines = route_radius(robot, size), routed(robot)
    shares = effort_shares(lines, snapshot.efforts)
    pulled = {part.name for part in lines if view.bent.efforts.get(part.name)} or set(snapshot.routes)
    for part in lines:
        path, slack = snapshot.routes[part.name], shares.get(part.name, 1.0) <= NO_EFFORT
        colour = LOOP if slack else ROUTE
        parts.append(Tube(path, 0.5 * radius if slack else radius, colour=colour))
        parts += [Ball(path[k], 2 * radius, colour=colour) for k in balls(robot, part)]
        if not slack and (part.name in pulled or len(lines) <= MANY_ROUTES):
            labels.append(Label(name_of(robot, part), refined(path)))
    for plate in robot.plates:
        if plate.name not in snapshot.plates:
            continue
        position, rotation = snapshot.plates[plate.name]
        pose = Pose(rotation, position)
        colour, opacity = (MUTED, 1.0) if plate.fixed else (BLUE, 0.35)
        drawn, around = plate_parts(robot, plate, pose, colour, size, opacity=opacity)
        parts += drawn
        labels.append(Label(plate.name, around))
    parts += [Ball(at, 0.012 * size, colour=SKY) for at in snapshot.markers.values()]
    return tuple(parts), tuple(labels)


def _shades(moved: Floats, largest: float) -> Floats:
    """RGB (n, 3) of displacements (n,) [m]."""
    from matplotlib import colormaps

    from softcal.report.style import DISPLACEMENT

    return np.asarray(colormaps[DISPLACEMENT](moved / (largest or 1.0)))[:, :3]


def bending_axes(view: TwinView) -> tuple[Floats, Floats]:
    """The upward direction, and the direction in which the twin bends."""
    rest, bent = (
        np.concatenate([*(shape.points[body] for body in view.tets), *shape.rods.values()])
        for shape in (view.rest, view.bent)
    )
    return up_direction(view.robot), (bent - rest).mean(axis=0)
