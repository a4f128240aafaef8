"""Regions of a mesh by name or by shape, and what they select."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats, Ints
from softcal.declare import Declared
from softcal.errors import Fault, MeshError, nearest
from softcal.geometry.locate import extents
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, matching_faces, nearest_triangle
from softcal.quantities import Clearance, Direction, Point, Size
from softcal.units import AS_WRITTEN, format_quantity

Mask = NDArray[np.bool_]
Side = Literal["on", "above", "below"]

# Coordinates in files are rounded: a point this near to a region, relative to the mesh's diagonal, is in it.
ROUNDING = 1e-6
SHARP = 35.0  # [deg]


@dataclass(frozen=True)
class Named:
    """A named group of the mesh: node set, face set or element set."""

    name: str


@dataclass(frozen=True)
class Box(Declared):
    """Between two corners [m]; an infinite coordinate leaves that side open."""

    lower: Point
    upper: Point

    def __post_init__(self) -> None:
        if any(not low <= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise MeshError(
                Fault("a box is turned inside out", got=f"{self.lower} to {self.upper}", allowed="lower <= upper")
            )

    def contains(self, points: Floats, slack: float) -> Mask:
        """Mask (n,) of the points (n, 3) [m] between the corners, give or take `slack` [m]."""
        low, high = np.asarray(self.lower) - slack, np.asarray(self.upper) + slack
        return np.all((points >= low) & (points <= high), axis=1)


@dataclass(frozen=True)
class Plane(Declared):
    """A plane through a point [m]; what lies on it (within tolerance [m]), or above or below it by its normal."""

    point: Point
    normal: Direction
    tolerance: Clearance = 0.0
    side: Side = "on"

    def contains(self, points: Floats, slack: float) -> Mask:
        """Mask (n,) of the points (n, 3) [m] on the plane or on the side that it selects, give or take `slack` [m]."""
        normal = np.asarray(self.normal) / np.linalg.norm(self.normal)
        height = (points - np.asarray(self.point)) @ normal
        reach = self.tolerance + slack
        if self.side == "on":
            return np.abs(height) <= reach
        above = height if self.side == "above" else -height
        return above >= -reach


@dataclass(frozen=True)
class Cylinder(Declared):
    """A solid cylinder between the centres of its two ends [m], with its radius [m]."""

    start: Point
    end: Point
    radius: Size

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start == self.end:
            raise MeshError(Fault("a cylinder has no length", got=f"{self.start} to {self.end}"))

    def contains(self, points: Floats, slack: float) -> Mask:
        """Mask (n,) of the points (n, 3) [m] inside, give or take `slack` [m]."""
        axis = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(axis))
        axis = axis / length
        away = points - np.asarray(self.start)
        along = away @ axis
        distance = np.linalg.norm(away - along[:, None] * axis, axis=1)
        return (along >= -slack) & (along <= length + slack) & (distance <= self.radius + slack)


@dataclass(frozen=True)
class Sphere(Declared):
    """A ball: centre [m], radius [m]."""

    centre: Point
    radius: Size

    def contains(self, points: Floats, slack: float) -> Mask:
        """Mask (n,) of the points (n, 3) [m] inside, give or take `slack` [m]."""
        return np.linalg.norm(points - np.asarray(self.centre), axis=1) <= self.radius + slack


@dataclass(frozen=True)
class Cavity(Declared):
    """The wall of a cavity: the surface around a point [m], up to the planes of its openings, where there are any.

    The point is in the cavity or on its wall. Edges that lie in the plane of an opening border the wall.
    """

    at: Point
    openings: tuple[Plane, ...] = ()

    def faces(self, mesh: TetMesh) -> Ints:
        """The faces (n, 3 or 6) of the wall, outwards from the material."""
        import scipy.sparse as sp
        from scipy.sparse.csgraph import connected_components

        faces = boundary_faces(mesh)
        corners, slack = faces[:, :3], _slack(mesh)
        edges = np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
        at_opening = np.zeros(len(edges), dtype=bool)
        for plane in self.openings:
            at_opening |= plane.contains(mesh.points[edges].reshape(-1, 3), slack).reshape(-1, 2).all(axis=1)
        order = np.lexsort(edges.T)
        joined = (np.diff(edges[order], axis=0) == 0).all(axis=1) & ~at_opening[order[:-1]]
        one, other = order[:-1][joined] % len(faces), order[1:][joined] % len(faces)
        links = sp.coo_matrix((np.ones(len(one)), (one, other)), shape=(len(faces), len(faces)))
        _, part = connected_components(links, directed=False)
        return faces[part == part[nearest_triangle(mesh.points[corners], np.asarray(self.at))]]


Shape = Box | Plane | Cylinder | Sphere
Region = Named | Shape | Cavity


def plane_at(triangles: Floats, point: Floats) -> Plane | None:
    """The plane of the flat face at a point of a surface, its normal outwards; None where the surface is curved.

    A face is curved where most of its border bends by less than `SHARP` into the next one.

    Parameters
    ----------
    triangles
        The surface of a part (n, 3, 3) [m], its corners ordered so that normals are outwards.
    point
        A point of it (3,) [m].
    """
    corners, numbers = np.unique(np.round(triangles.reshape(-1, 3), 9), axis=0, return_inverse=True)
    faces = numbers.reshape(-1, 3)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near = nearest_triangle(triangles, point)
    normal = np.round(normals[near], 6) + 0.0
    plane = Plane(tuple(np.round(triangles[near].mean(axis=0), 7) + 0.0), tuple(normal))
    rounding = ROUNDING * float(np.linalg.norm(np.ptp(corners, axis=0)))
    on = plane.contains(corners, rounding)[faces].all(axis=1) & (normals @ normal > 0.0)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T)
    is_pair = (np.diff(edges[order], axis=0) == 0).all(axis=1)
    first, second = order[:-1][is_pair] % len(faces), order[1:][is_pair] % len(faces)  # on both sides of an edge
    border = on[first] != on[second]
    bend = np.degrees(np.arccos(np.clip((normals[first] * normals[second]).sum(axis=1)[border], -1.0, 1.0)))
    return plane if len(bend) and np.median(bend) >= SHARP else None


def select_nodes(mesh: TetMesh, region: Region, *, where: str = "") -> Ints:
    """Numbers of the nodes in a region, ascending; of a face or element set, all its nodes.

    Parameters
    ----------
    mesh
        The mesh [m].
    region
        The region: a shape, or the name of a group of the mesh.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where the region selects nothing or its name is not known.
    """
    if isinstance(region, Named):
        name = region.name
        if name in mesh.node_sets:
            nodes = mesh.node_sets[name]
        elif name in mesh.face_sets:
            nodes = mesh.face_sets[name]
        elif name in mesh.element_sets:
            nodes = mesh.tets[mesh.element_sets[name]]
        else:
            known = sorted({*mesh.node_sets, *mesh.face_sets, *mesh.element_sets})
            raise MeshError(
                Fault(
                    "the mesh has no group of this name",
                    where=where,
                    got=f"'{name}'",
                    allowed=", ".join(known)
                    if known
                    else "nothing: the mesh has no named groups; use a box, plane, cylinder or sphere",
                    attempt=nearest(name, known),
                )
            )
        return _something(np.unique(nodes), mesh, region, "nodes", where)
    if isinstance(region, Cavity):
        return np.unique(region.faces(mesh))
    return _something(np.flatnonzero(region.contains(mesh.points, _slack(mesh))), mesh, region, "nodes", where)


def select_faces(mesh: TetMesh, region: Region, *, where: str = "") -> Ints:
    """Boundary triangles all of whose nodes are in a region, outwards; of a face set, its own triangles.

    Parameters
    ----------
    mesh
        The mesh [m].
    region
        The region: a shape, or the name of a group of the mesh.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where the region selects nothing or its name is not known.
    """
    if isinstance(region, Named) and region.name in mesh.face_sets:
        return _something(matching_faces(mesh, mesh.face_sets[region.name], where=where), mesh, region, "faces", where)
    if isinstance(region, Cavity):
        return region.faces(mesh)
    inside = np.zeros(mesh.n_points, dtype=bool)
    inside[select_nodes(mesh, region, where=where)] = True
    faces = boundary_faces(mesh)
    return _something(faces[inside[faces].all(axis=1)], mesh, region, "faces", where)


def select_elements(mesh: TetMesh, region: Region, *, where: str = "") -> Ints:
    """Numbers of the tets in a region: by their centroid in a shape; of a node or face set, with all corners in it.

    Parameters
    ----------
    mesh
        The mesh [m].
    region
        The region: a shape, or the name of a group of the mesh.
    where
        Place for error messages.

    Raises
    ------
    MeshError
        Where the region selects nothing or its name is not known.
    """
    if isinstance(region, Named | Cavity):
        if isinstance(region, Named) and region.name in mesh.element_sets:
            return _something(np.unique(mesh.element_sets[region.name]), mesh, region, "elements", where)
        inside = np.zeros(mesh.n_points, dtype=bool)
        inside[select_nodes(mesh, region, where=where)] = True
        chosen = inside[mesh.tets[:, :4]].all(axis=1)
    else:
        chosen = region.contains(mesh.points[mesh.tets[:, :4]].mean(axis=1), _slack(mesh))
    return _something(np.flatnonzero(chosen), mesh, region, "elements", where)


def _slack(mesh: TetMesh) -> float:
    return ROUNDING * float(np.linalg.norm(np.ptp(mesh.points, axis=0)))


def _something(chosen: Ints, mesh: TetMesh, region: Region, kind: str, where: str) -> Ints:
    if len(chosen):
        return chosen
    stated: list[str] = []  # as in a project file: point: [61 mm, 0 mm, 0 mm]
    for one in fields(region):
        value, unit = getattr(region, one.name), "1" if one.name == "normal" else "m"
        if isinstance(value, tuple):
            stated.append(f"{one.name}: [{', '.join(format_quantity(x, unit, digits=AS_WRITTEN) for x in value)}]")
        elif value != one.default:
            stated.append(f"{one.name}: {value if isinstance(value, str) else format_quantity(value, unit)}")
    raise MeshError(
        Fault(
            f"the region selects no {kind}",
            where=where,
            got=f"group: {region.name}"
            if isinstance(region, Named)
            else f"{type(region).__name__.lower()}: {{{', '.join(stated)}}}",
            allowed=f"a region that meets the mesh, which spans {extents(mesh)}",
            attempt="check the unit of the region and of the mesh" if not isinstance(region, Named) else "",
        )
    )
