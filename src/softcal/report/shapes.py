"""Surface meshes for drawing: wires as tubes, discs as flat cylinders with holes. Lengths in m."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.ring import across, ring_points
from softcal.report.scene import Surface
from softcal.twin.robot import Disc, Plate, Rod

STEPS = 6  # between two nodes of a rod
SIDES = 20  # of a tube
CIRCLE = 64  # points of a circle
RIM, HOLE = 96, 16  # points on the rim of a disc, and on that of a hole


def rod_surface(rod: Rod, nodes: Floats, colours: Floats) -> Surface:
    """A rod with current node positions (n, 3), as a tube of its section's outer diameter.

    colours: RGB of each node (n, 3).
    """
    stations = rod.centreline.stations
    fine = np.unique(np.concatenate([np.linspace(a, b, STEPS + 1) for a, b in pairwise(stations)]))
    path = _spline(stations, nodes, fine) if len(nodes) > 2 else _between(stations, nodes, fine)
    return tube(path, rod.section.outer_diameter, _between(stations, colours, fine))


def tube(path: Floats, diameter: float, colours: Floats) -> Surface:
    """A round wire along a path (n, 3), closed at its ends; colours: RGB of each of the path's points (n, 3)."""
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = across(along[0])
    rings: list[Floats] = []
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    for point, tangent in zip(path, along, strict=True):
        side = side - (side @ tangent) * tangent  # parallel transport, no twist
        side /= np.linalg.norm(side)
        around = np.outer(np.cos(angle), side) + np.outer(np.sin(angle), np.cross(tangent, side))
        rings.append(point + 0.5 * diameter * around)
    n = len(path)
    one = np.arange(SIDES)
    two = np.roll(one, -1)
    triangles: list[Ints] = []
    for k in range(n - 1):
        a, b, c, d = SIDES * k + one, SIDES * k + two, SIDES * (k + 1) + one, SIDES * (k + 1) + two
        triangles += [np.stack([a, b, d], axis=1), np.stack([a, d, c], axis=1)]
    first, last = np.full(SIDES, SIDES * n), np.full(SIDES, SIDES * n + 1)
    triangles += [np.stack([two, one, first], axis=1)]
    triangles += [np.stack([SIDES * (n - 1) + one, SIDES * (n - 1) + two, last], axis=1)]
    points = np.concatenate([*rings, path[:1], path[-1:]])
    shades = np.concatenate([np.repeat(colours, SIDES, axis=0), colours[:1], colours[-1:]])
    return Surface(points, np.concatenate(triangles), shades)


def disc_surface(plate: Plate, shape: Disc, colour: str, *, opacity: float = 1.0) -> Surface:
    """A plate of known shape at rest, with open guide holes."""
    from matplotlib.colors import to_rgb
    from scipy.spatial import Delaunay  # pyright: ignore[reportUnknownVariableType, reportAttributeAccessIssue]

    side = across(shape.axis)
    other: Floats = np.asarray(np.cross(shape.axis, side), dtype=np.float64)
    radius, hole = 0.5 * shape.diameter, 0.5 * shape.hole_diameter
    offsets = [((at - shape.centre) @ side, (at - shape.centre) @ other) for at in plate.holes.values()]
    centres: Floats = np.array(offsets if hole > 0.0 else [], dtype=np.float64).reshape(-1, 2)
    outlines = [_circle(np.zeros(2), radius, RIM), *(_circle(centre, hole, HOLE) for centre in centres)]
    inner = np.concatenate([_circle(np.zeros(2), share * radius, 24) for share in (0.25, 0.5, 0.75)])
    clear = np.array([np.linalg.norm(centres - point, axis=1).min(initial=np.inf) > 1.5 * hole for point in inner])
    flat = np.concatenate([*outlines, inner[clear]])
    cells: Ints = np.asarray(Delaunay(flat).simplices, dtype=np.int64)
    middles = flat[cells].mean(axis=1)
    gaps = np.linalg.norm(middles[:, None] - centres[None], axis=2).min(axis=1, initial=np.inf)
    cells = _counter_clockwise(flat, cells[gaps > hole * np.cos(np.pi / HOLE) * 0.999])
    half = 0.5 * shape.thickness * shape.axis
    level: Floats = shape.centre + np.outer(flat[:, 0], side) + np.outer(flat[:, 1], other)
    n = len(flat)
    triangles = [cells, n + cells[:, ::-1]]
    first = 0
    for k, outline in enumerate(outlines):
        one = first + np.arange(len(outline))
        two = first + np.roll(np.arange(len(outline)), -1 if k == 0 else 1)  # a hole's wall faces its middle
        triangles += [np.stack([one, n + one, two], axis=1), np.stack([two, n + one, n + two], axis=1)]
        first += len(outline)
    corners = np.concatenate(triangles)
    return Surface(
        np.concatenate([level + half, level - half]), corners, np.tile(to_rgb(colour), (len(corners), 1)), opacity
    )


def flat_disc(centre: Floats, normal: Floats, radius: float, colour: str, *, opacity: float) -> Surface:
    """A flat cylinder for a plate of unknown shape; its thickness is a twentieth of its radius."""
    from matplotlib.colors import to_rgb

    ring = radius * unit_circle(normal)
    half = radius / 40 * normal
    points = np.concatenate([centre + half + ring, centre - half + ring, [centre + half, centre - half]])
    n = len(ring)
    one, two = np.arange(n), np.roll(np.arange(n), -1)
    top, bottom = np.full(n, 2 * n), np.full(n, 2 * n + 1)
    faces = [(one, two, top), (two + n, one + n, bottom), (one, one + n, two), (two, one + n, two + n)]
    triangles = np.concatenate([np.stack(face, axis=1) for face in faces])
    return Surface(points, triangles, np.tile(to_rgb(colour), (len(triangles), 1)), opacity)


def unit_circle(normal: Floats) -> Floats:
    """Points on the unit circle around a unit normal (64, 3)."""
    return ring_points(np.zeros(3), normal, across(normal), 1.0, CIRCLE)


def _circle(centre: Floats, radius: float, count: int) -> Floats:
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return centre + radius * np.column_stack([np.cos(angle), np.sin(angle)])


def _counter_clockwise(points: Floats, cells: Ints) -> Ints:
    a, b, c = (points[cells[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    return np.where((area > 0.0)[:, None], cells, cells[:, ::-1])


def _spline(stations: Floats, values: Floats, at: Floats) -> Floats:
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(stations, values)(at), dtype=np.float64)


def _between(stations: Floats, values: Floats, at: Floats) -> Floats:
    return np.stack([np.interp(at, stations, column) for column in values.T], axis=1)
