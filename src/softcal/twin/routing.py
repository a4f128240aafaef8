"""The routing of a cable between two of its via points in one body: in a bore, which moves with the body.

A straight segment would leave the bore of a bending body, towards the inside of the bend, with a growing lever arm; a
soft body then folds between two via points as a column buckles under its own load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.bore import wall_around
from softcal.geometry.centreline import Centreline
from softcal.geometry.locate import mean_edges, nearest_places, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import attach_rate
from softcal.mechanics.rod_points import RodPlace, place_on_rod
from softcal.twin.cables import Cable, ViaPoint

SPACING = 0.25  # of an edge of the tets around: the spacing of the points that represent a bore
SKIN = 0.05  # of an edge: a line as near as that to the surface runs on it and is not guided


def bored(
    via_points: Sequence[ViaPoint],
    meshes: Mapping[str, TetMesh],
    centrelines: Mapping[str, Centreline] | None = None,
) -> tuple[ViaPoint, ...]:
    """The via points, with additional ones along the bore between two neighbours in one body or on one rod: wherever
    the line between them runs inside the body's material, or inside a bore of its mesh; at the nodes of the rod.

    meshes, centrelines [m]: by the name of the body or rod. Across a gap of the body the cable runs straight.
    """
    lines = centrelines or {}
    out = list(via_points[:1])
    for start, end in pairwise(via_points):
        if start.on == end.on and start.on in meshes:
            out += [_between(at, start, end) for at in _inside(meshes[start.on], start.at, end.at)]
        elif start.on == end.on and start.on in lines:
            out += [_between(at, start, end) for at in _along(lines[start.on], start.at, end.at)]
        out.append(end)
    return tuple(out)


def _between(at: Floats, start: ViaPoint, end: ViaPoint) -> ViaPoint:
    """A point added between two; its share of the way is that of its distances from them."""
    from_start, to_end = (float(np.linalg.norm(at - one.at)) for one in (start, end))
    return ViaPoint(at, start.on, share=from_start / (from_start + to_end))


def offset_rate(mesh: TetMesh, via: ViaPoint, way: Floats, *, where: str = "") -> tuple[Ints, Floats]:
    """Nodes and rates [1/m] of the weights of a via point in a body that moves along a direction (3,).

    Raises
    ------
    MeshError
        Where it is spread over a ball, or lies outside the material (as in a bore) or in a curved element.
    """
    if via.radius > 0.0:
        raise MeshError(
            Fault(
                "a via point with a radius cannot be moved by an offset",
                where=where,
                got=f"radius {1e3 * via.radius:.4g} mm",
                allowed="via points without a radius",
            )
        )
    return attach_rate(mesh, via.at, way, where=where)


def require_movable(cable: Cable, meshes: Mapping[str, TetMesh]) -> None:
    """Refuse offsets of a cable's via points that cannot move them.

    meshes [m]: by body's name.

    Raises
    ------
    InputError
        For the first of them: in a bore, outside its body, or with a radius.
    """
    for ways in cable.ways().values():
        for via, way in zip(cable.via_points, ways, strict=True):
            if via.on in meshes and way.any():
                offset_rate(meshes[via.on], via, way)


def _inside(mesh: TetMesh, start: Floats, end: Floats) -> Floats:
    """Points between two others, evenly spaced, only those surrounded by material."""
    edge = float(mean_edges(mesh, nearest_places(mesh, np.stack([start, end])).tets).mean())
    pieces = max(1, int(np.ceil(float(np.linalg.norm(end - start)) / (SPACING * edge))))
    points = start + (end - start) * (np.arange(1, pieces) / pieces)[:, None]
    if len(points) == 0:
        return points
    in_tets = tets_holding(mesh, points) >= 0
    _, depth = nearest_tets(mesh, points)
    kept = [
        depth[i] > SKIN * edge if in_tets[i] else wall_around(mesh, points[i]) is not None for i in range(len(points))
    ]
    return points[np.array(kept)]


def _along(centreline: Centreline, start: Floats, end: Floats) -> Floats:
    """Points (n, 3) [m] between two others, one in the section of each node of a rod between theirs.

    Each keeps its place in the section as the line does that leads from the one to the other along the axis.
    """
    first, last = (place_on_rod(centreline, at) for at in (start, end))
    a, b = first.node + first.share, last.node + last.share
    between = np.arange(np.floor(min(a, b)) + 1.0, np.ceil(max(a, b))).astype(np.int64)
    between = between if a < b else between[::-1]
    if len(between) == 0:
        return np.zeros((0, 3))
    stations = centreline.stations
    s0, s1 = (np.interp(at, np.arange(len(stations)), stations) for at in (a, b))
    offsets = [_offset(centreline, place, at) for place, at in ((first, start), (last, end))]
    t = ((stations[between] - s0) / (s1 - s0))[:, None]
    local = (1.0 - t) * offsets[0] + t * offsets[1]
    return centreline.nodes[between] + np.einsum("nij,nj->ni", centreline.triads[between], local)


def _offset(centreline: Centreline, place: RodPlace, at: Floats) -> Floats:
    """A point less its section's centre, in the section's axes (3,) [m]."""
    return sum(
        (weight * centreline.triads[node].T @ (at - centreline.nodes[node]) for node, weight in place.weights),
        np.zeros(3),
    )
