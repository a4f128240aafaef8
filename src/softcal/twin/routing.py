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
from softcal.geometry.locate import mean_edges, nearest_places, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import attach_rate
from softcal.twin.cables import RoutingAxis, ViaPoint

SPACING = 0.25  # of an edge of the tets around: the spacing of the points that represent a bore
SKIN = 0.05  # of an edge: a line as near as that to the surface runs on it and is not guided


def bored(via_points: Sequence[ViaPoint], meshes: Mapping[str, TetMesh]) -> tuple[ViaPoint, ...]:
    """The via points, with additional ones along the bore between two neighbours in one body: wherever the line between
    them runs inside the body's material, or inside a bore of its mesh.

    meshes [m]: by body's name. Across a gap of the body the cable runs straight.
    """
    out = list(via_points[:1])
    for start, end in pairwise(via_points):
        if start.on == end.on and start.on in meshes:
            out += [ViaPoint(at, start.on) for at in _inside(meshes[start.on], start.at, end.at)]
        out.append(end)
    return tuple(out)


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
                "a via point with a radius cannot be moved by a routing offset",
                where=where,
                got=f"radius {1e3 * via.radius:.4g} mm",
                allowed="via points without a radius",
            )
        )
    return attach_rate(mesh, via.at, way, where=where)


def require_movable(via_points: Sequence[ViaPoint], axis: RoutingAxis, meshes: Mapping[str, TetMesh]) -> None:
    """Refuse a routing offset of via points that it cannot move.

    meshes [m]: by body's name.

    Raises
    ------
    InputError
        For the first of them: on the axis, in a bore, outside its body, or with a radius.
    """
    ways, _ = axis.away(np.array([via.at for via in via_points]))
    for via, way in zip(via_points, ways, strict=True):
        if via.on in meshes:
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
