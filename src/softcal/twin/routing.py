"""The routing of a cable between two of its via points: in the bore of a body that one of them is on, which moves with
the body.

A straight segment would leave the bore of a bending body, towards the inside of the bend, with a growing lever arm; a
soft body then folds between two via points as a column buckles under its own load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.geometry.bore import wall_around
from softcal.geometry.centreline import Centreline
from softcal.geometry.locate import mean_edges, nearest_places, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import attach_point, attach_rate
from softcal.mechanics.rod_points import RodPlace, place_on_rod
from softcal.twin.cables import Cable, ViaPoint

SPACING = 0.25  # of an edge of the tets around: the spacing of the points that represent a bore
SKIN = 0.05  # of an edge: a line as near as that to the surface runs on it and is not guided


def bored(
    via_points: Sequence[ViaPoint],
    meshes: Mapping[str, TetMesh],
    centrelines: Mapping[str, Centreline] | None = None,
) -> tuple[ViaPoint, ...]:
    """The via points, with additional ones along the bore between two neighbours: wherever the line between them runs
    inside the material of a body that one of them is on, or inside a bore of its mesh; on one rod, at its nodes.

    meshes, centrelines [m]: by the name of the body or rod. Across a gap, and through other bodies, the cable runs
    straight.
    """
    lines = centrelines or {}
    out = list(via_points[:1])
    for start, end in pairwise(via_points):
        if start.on == end.on and start.on in lines:
            out += [_between(at, start.on, start, end) for at in _along(lines[start.on], start.at, end.at)]
        guided = [
            _between(at, on, start, end)
            for on in dict.fromkeys((start.on, end.on))
            if on in meshes
            for at in _Passage(meshes[on], start.at, end.at).inside
        ]
        out += sorted(guided, key=lambda via: float(via.share or 0.0))
        out.append(end)
    return tuple(out)


def unguided(cable: Cable, meshes: Mapping[str, TetMesh]) -> dict[str, float]:
    """Body -> length [m] over which the cable runs straight through its material, from via points that are on other
    parts; only bodies that it runs through. meshes [m]: by body's name.
    """
    found: dict[str, float] = {}
    for start, end in pairwise(cable.via_points):
        for name, mesh in meshes.items():
            length = _Passage(mesh, start.at, end.at).in_material
            if length > 0.0:
                found[name] = found.get(name, 0.0) + length
    return found


def off_bore(cable: Cable, meshes: Mapping[str, TetMesh]) -> dict[str, float]:
    """Body -> length [m] over which the cable runs through the body's material between two of its stated via points of
    which one is in a bore; only what is longer than a bore is wide. meshes [m]: by body's name.
    """
    found: dict[str, float] = {}
    stated = [via for via in cable.via_points if via.share is None]
    for start, end in pairwise(stated):
        for name in {start.on, end.on} & meshes.keys():
            bores = [attach_point(meshes[name], via.at).bore for via in (start, end) if via.on == name]
            length = _Passage(meshes[name], start.at, end.at).in_material if any(bores) else 0.0
            if length > max(bores):
                found[name] = found.get(name, 0.0) + length
    return found


def _between(at: Floats, on: str, start: ViaPoint, end: ViaPoint) -> ViaPoint:
    """A point added between two; its share of the way is that of its distances from them."""
    from_start, to_end = (float(np.linalg.norm(at - one.at)) for one in (start, end))
    return ViaPoint(at, on, 0.0, share=from_start / (from_start + to_end))


def require_movable(cable: Cable, meshes: Mapping[str, TetMesh]) -> None:
    """Refuse offsets of a cable's via points that cannot move them.

    meshes [m]: by body's name.

    Raises
    ------
    InputError
        For the first of them: in a bore, or outside its body.
    """
    for ways in cable.ways().values():
        for via, way in zip(cable.via_points, ways, strict=True):
            if via.on in meshes and way.any():
                attach_rate(meshes[via.on], via.at, way, via.radius)


class _Passage:
    """A straight line past or through a body: points evenly spaced on it between its ends.

    Attributes
    ----------
    inside
        Those that material surrounds, or the wall of a bore (n, 3) [m].
    in_material
        Length [m] of the line for which those in the material stand.
    """

    def __init__(self, mesh: TetMesh, start: Floats, end: Floats) -> None:
        edge = float(mean_edges(mesh, nearest_places(mesh, np.stack([start, end])).tets).mean())
        length = float(np.linalg.norm(end - start))
        pieces = max(1, int(np.ceil(length / (SPACING * edge))))
        points = start + (end - start) * (np.arange(1, pieces) / pieces)[:, None]
        in_tets = tets_holding(mesh, points) >= 0
        deep = in_tets & (nearest_tets(mesh, points)[1] > SKIN * edge)
        kept = [deep[i] if in_tets[i] else wall_around(mesh, at) is not None for i, at in enumerate(points)]
        self.inside: Floats = points[np.array(kept, dtype=bool)]
        self.in_material = length * int(deep.sum()) / pieces


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
