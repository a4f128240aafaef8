"""The routing of a cable between two of its via points: in the bore of a body that one of them is on, which moves with
the body.

A straight segment would leave the bore of a bending body, towards the inside of the bend, with a growing lever arm; a
soft body then folds between two via points as a column buckles under its own load. The via points themselves have their
supports by a robot's bodies: in a bore, by its wall all around.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats
from softcal.geometry.bore import wall_around
from softcal.geometry.centreline import Centreline, place_on_rod
from softcal.geometry.locate import mean_edges, nearest_places, nearest_tets, tets_holding
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import Attachment, attach_ball, attach_point, attach_rate
from softcal.twin.cables import Cable, ViaPoint
from softcal.twin.robot import Robot

SPACING = 0.25  # of an edge of the tets around: the spacing of the points that represent a bore
SKIN = 0.05  # of an edge: a line as near as that to the surface runs on it and is not guided


def bored(
    via_points: Sequence[ViaPoint],
    meshes: Mapping[str, TetMesh],
    centrelines: Mapping[str, Centreline] | None = None,
) -> tuple[ViaPoint, ...]:
    """The via points, with additional ones along the bore between two neighbours: wherever the line between them runs
    inside the material of a body that one of them is on, or inside a bore of its mesh; on one rod, at its nodes. Across
    a gap, and through other bodies, the cable runs straight.

    Parameters
    ----------
    via_points
        The via points of a cable, in their order.
    meshes
        Body -> its mesh [m].
    centrelines
        Rod -> its centreline [m].
    """
    lines = centrelines or {}
    out = list(via_points[:1])
    for start, end in pairwise(via_points):
        if start.on == end.on and start.on in lines:
            out += [_between(at, start.on, start, end) for at in _along(lines[start.on], start.at, end.at)]
        # In the bodies that the two are on; where these overlap, in the first.
        inside: list[ViaPoint] = []
        spacing = 0.0
        for on in dict.fromkeys((start.on, end.on)):
            if on in meshes:
                passage = _passage(meshes[on], start.at, end.at)
                taken = np.array([via.at for via in inside]).reshape(-1, 3)
                spacing = max(spacing, passage.spacing)
                points = [at for at in passage.inside if np.all(np.linalg.norm(taken - at, axis=1) > 0.5 * spacing)]
                inside += [_between(at, on, start, end) for at in points]
        out += [*sorted(inside, key=lambda via: float(via.share or 0.0)), end]
    return tuple(out)


class OffBore(NamedTuple):
    """Lengths [m] of a cable in a body that does not guide it along a bore.

    straight, in_bore: through the body's material, or in a bore or cavity of it, between via points that are on other
    parts. guided: through the material with the body, although the line is also in a bore. embedded: likewise where
    the line is in no bore.
    """

    straight: float = 0.0
    in_bore: float = 0.0
    guided: float = 0.0
    embedded: float = 0.0


def off_bore(cable: Cable, meshes: Mapping[str, TetMesh]) -> dict[str, OffBore]:
    """Bodies that a cable runs through without the guidance of a bore; guided, if longer than the bore is wide.

    meshes [m]: by body's name. What `route: straight` leaves straight between two points in one body is not counted.
    """
    lengths_of: dict[str, OffBore] = {}
    stated = [i for i, via in enumerate(cable.via_points) if via.share is None]
    for i, j in pairwise(stated):
        start, end = cable.via_points[i], cable.via_points[j]
        for name, mesh in meshes.items():
            passage = _passage(mesh, start.at, end.at)
            own = [via for via in (start, end) if via.on == name]
            if len(own) == 2 or (own and j > i + 1):
                more, beside = OffBore(), passage.in_material
                if beside:  # bores take long to find
                    bore = max(passage.bore, *(attach_point(mesh, via.at).bore for via in own))
                    more = OffBore(guided=beside * (bore < beside)) if bore else OffBore(embedded=beside)
            else:
                more = OffBore(passage.in_material, passage.spacing * int(passage.in_bore.sum()))
            lengths_of[name] = OffBore(*(a + b for a, b in zip(lengths_of.get(name, OffBore()), more, strict=True)))
    return {name: lengths for name, lengths in lengths_of.items() if any(lengths)}


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


@dataclass(frozen=True)
class _Passage:
    """A straight line past or through a body: points evenly spaced on it between its ends (n, 3) [m].

    in_tets, deep
        Which of them are in the mesh (n,), and which of these are not just below its surface.
    spacing
        Length [m] of the line for which each of them stands.
    """

    mesh: TetMesh
    points: Floats
    in_tets: NDArray[np.bool_]
    deep: NDArray[np.bool_]
    spacing: float

    @property
    def in_material(self) -> float:
        """Length [m] of the line in the material."""
        return self.spacing * int(self.deep.sum())

    @property
    def inside(self) -> Floats:
        """The points that material surrounds, or the wall of a bore (m, 3) [m]."""
        return self.points[self.deep | self.in_bore]

    @property
    def in_bore(self) -> NDArray[np.bool_]:
        """Whether the wall of a bore surrounds each point (n,)."""
        return self._bores > 0.0

    @property
    def bore(self) -> float:
        """The largest diameter [m] of the bores that surround points; 0 without."""
        return float(self._bores.max(initial=0.0))

    @cached_property
    def _bores(self) -> Floats:
        walls = [
            None if held else wall_around(self.mesh, at) for held, at in zip(self.in_tets, self.points, strict=True)
        ]
        return np.array([0.0 if wall is None else wall.diameter for wall in walls])


def _passage(mesh: TetMesh, start: Floats, end: Floats) -> _Passage:
    """The line from a point to another one (3,) [m]; without points where the boxes of line and mesh are apart."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    meets = np.all(low <= mesh.points.max(axis=0)) and np.all(high >= mesh.points.min(axis=0))
    edge = float(mean_edges(mesh, nearest_places(mesh, np.stack([start, end])).tets).mean())
    length = float(np.linalg.norm(end - start))
    pieces = max(1, int(np.ceil(length / (SPACING * edge)))) if meets else 1
    points = start + (end - start) * (np.arange(1, pieces) / pieces)[:, None]
    in_tets = tets_holding(mesh, points) >= 0
    return _Passage(mesh, points, in_tets, in_tets & (nearest_tets(mesh, points)[1] > SKIN * edge), length / pieces)


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
    # Both ends less their sections' centres, in the sections' axes.
    offsets = [
        sum((w * centreline.triads[i].T @ (at - centreline.nodes[i]) for i, w in place.weights), np.zeros(3))
        for place, at in ((first, start), (last, end))
    ]
    t = ((stations[between] - s0) / (s1 - s0))[:, None]
    local = (1.0 - t) * offsets[0] + t * offsets[1]
    return centreline.nodes[between] + np.einsum("nij,nj->ni", centreline.triads[between], local)


def supports(robot: Robot) -> dict[str, dict[int, Attachment]]:
    """Cable -> the numbers of its via points on bodies, from 0, with their attachment; only cables with such points."""
    meshes = {body.name: body.mesh for body in robot.bodies}
    attachments: dict[str, dict[int, Attachment]] = {}
    for cable in robot.cables:
        for i, via in enumerate(cable.via_points):
            if via.on in meshes:
                where = f"{cable.name}, via point {i + 1}"
                attachments.setdefault(cable.name, {})[i] = attach_ball(meshes[via.on], via.at, via.radius, where=where)
    return attachments


def bores(robot: Robot) -> dict[str, dict[int, float]]:
    """Cable -> the numbers of its via points in bores, from 0, with the bores' diameters [m]; only cables with such
    points.
    """
    wide = {
        cable: {i: held.bore for i, held in points.items() if held.bore > 0.0}
        for cable, points in supports(robot).items()
    }
    return {cable: points for cable, points in wide.items() if points}
