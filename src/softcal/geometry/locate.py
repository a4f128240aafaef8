"""Location of points in a mesh: tet and barycentric coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from softcal.checks import Floats, Ints, frozen_floats
from softcal.errors import Fault, MeshError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.surface import boundary_faces, boundary_owners
from softcal.units import format_quantity, format_range

# Allowed distance outside the mesh, as a fraction of the mean edge of the nearest tet: a point on a curved surface is
# outside the straight-sided tets that approximate it.
OUTSIDE = 0.25
# Rounding tolerance of negative barycentric coordinates.
INSIDE = 1e-9


def extents(mesh: TetMesh) -> str:
    """Text such as "x 0 to 60 mm, y …" for messages: between which coordinates a mesh is, to 0.1 um."""
    low, high = ((np.round(ends, 7) + 0.0).tolist() for ends in (mesh.points.min(axis=0), mesh.points.max(axis=0)))
    return ", ".join(f"{axis} {format_range(a, b, 'm')}" for axis, a, b in zip("xyz", low, high, strict=True))


def locate_points(
    mesh: TetMesh, points: ArrayLike, *, tolerance: float | None = None, where: str = ""
) -> tuple[Ints, Floats]:
    """Tets of points and their barycentric coordinates there, by the straight-sided tets between the corners.

    Parameters
    ----------
    points
        Shape (k, 3) [m].
    tolerance
        Allowed distance outside the mesh [m]; by default a quarter of the mean edge of the nearest tet. Such a point is
        extrapolated from that tet: one of its coordinates is negative.

    Returns
    -------
    tets, weights
        Numbers, shape (k,), and barycentric coordinates [-], shape (k, 4), which sum to one.

    Raises
    ------
    MeshError
        If points are outside the mesh by more than the tolerance; names each with its distance.
    """
    points = frozen_floats(points, name=where or "points", shape=(None, 3))
    found = nearest_places(mesh, points, tolerance=tolerance)
    if found.is_off.any():
        spans = extents(mesh)
        off = (values[found.is_off] for values in (points, found.distances, found.allowed))
        raise MeshError(
            [
                Fault(
                    f"the point lies outside its body by {format_quantity(float(distance), 'm')}",
                    where=where,
                    got="(" + ", ".join(f"{x:.6g}" for x in point) + ") m",
                    allowed=f"at most {format_quantity(float(limit), 'm')} outside the body, which spans {spans}",
                )
                for point, distance, limit in zip(*off, strict=True)
            ]
        )
    return found.tets, found.weights


@dataclass(frozen=True)
class Places:
    """Containing or nearest tets (n,) of points (n, 3), and their barycentric coordinates (n, 4).

    distances, allowed (n,) [m]: distances outside the mesh, and their limits.
    """

    tets: Ints
    weights: Floats
    distances: Floats
    allowed: Floats

    @property
    def is_off(self) -> NDArray[np.bool_]:
        """Points outside the mesh beyond their limit (n,)."""
        return self.distances > self.allowed


def nearest_places(mesh: TetMesh, points: Floats, *, tolerance: float | None = None) -> Places:
    """Tets and weights of points, as `locate_points`, also for points outside the mesh, at any distance.

    Parameters
    ----------
    mesh
        The mesh [m].
    points
        The points (n, 3) [m].
    tolerance
        Distance outside the mesh that is allowed [m]; by default from the size of the nearest tet.
    """
    tets, weights = _containing(mesh, points)
    distances, allowed = np.zeros(len(points)), np.zeros(len(points))
    outside = np.flatnonzero(tets < 0)
    if len(outside):
        nearest, distances[outside] = nearest_tets(mesh, points[outside])
        allowed[outside] = OUTSIDE * mean_edges(mesh, nearest) if tolerance is None else tolerance
        tets[outside] = nearest
        for i, tet in zip(outside, nearest, strict=True):
            weights[i] = barycentric_in(mesh, tet, points[i])
    return Places(tets, weights, distances, allowed)


def barycentric_in(mesh: TetMesh, tet: int, point: Floats) -> Floats:
    """Barycentric coordinates (4,) of a point in the straight-sided tet between the corners.

    Parameters
    ----------
    mesh
        The mesh [m].
    tet
        Number of the tet.
    point
        The point (3,) [m].
    """
    return _barycentric(point, mesh.points[mesh.tets[tet, :1]], mesh.to_barycentric[tet][None])[0]


def tets_holding(mesh: TetMesh, points: Floats) -> Ints:
    """Containing tet of each point (n, 3), -1 outside, by the straight-sided tets between the corners."""
    return _containing(mesh, points)[0]


def mean_edges(mesh: TetMesh, tets: Ints) -> Floats:
    """Mean of four edge lengths of each tet [m]."""
    corners = mesh.points[mesh.tets[tets, :4]]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean(axis=1)


def nearest_tets(mesh: TetMesh, points: Floats) -> tuple[Ints, Floats]:
    """Tet of the surface triangle nearest to each point (n, 3), and the distance to it [m]."""
    triangles = mesh.points[boundary_faces(mesh)[:, :3]]
    owners = boundary_owners(mesh)
    centres, radii = circles_around(triangles)
    nearest = np.zeros(len(points), dtype=np.int64)
    distances = np.zeros(len(points))
    for i, point in enumerate(points):
        to_centres = np.linalg.norm(centres - point, axis=1)
        near = np.flatnonzero(to_centres - radii <= to_centres.min())
        to_faces = distances_to_triangles(point, triangles[near])
        closest = int(np.argmin(to_faces))
        nearest[i], distances[i] = owners[near[closest]], to_faces[closest]
    return nearest, distances


def circles_around(triangles: Floats) -> tuple[Floats, Floats]:
    """Centres (n, 3) and radii (n,) of spheres around triangles (n, 3, 3) [m]."""
    centres = triangles.mean(axis=1)
    return centres, (1.0 + INSIDE) * np.linalg.norm(triangles - centres[:, None], axis=2).max(axis=1)


def _containing(mesh: TetMesh, points: Floats) -> tuple[Ints, Floats]:
    """The tet that contains each point (n, 3), by its least barycentric coordinate the furthest, and the coordinates
    (n, 4); -1 and zeros outside.
    """
    origins, (lower, upper) = mesh.points[mesh.tets[:, 0]], mesh.boxes
    tets, weights = np.full(len(points), -1, dtype=np.int64), np.zeros((len(points), 4))
    for i, point in enumerate(points):
        near = np.flatnonzero(((lower <= point) & (point <= upper)).all(axis=1))
        coordinates = _barycentric(point, origins[near], mesh.to_barycentric[near])
        least = coordinates.min(axis=1)
        if least.max(initial=-np.inf) >= -INSIDE:
            best = int(np.argmax(least))
            tets[i], weights[i] = near[best], coordinates[best]
    return tets, weights


def _barycentric(point: Floats, origins: Floats, inverse: Floats) -> Floats:
    last = np.einsum("eij,ej->ei", inverse, point - origins)
    return np.column_stack([1.0 - last.sum(axis=1), last])


def distances_to_triangles(point: Floats, triangles: Floats) -> Floats:
    """Distances of a point (3,) from triangles (n, 3, 3) [m]."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    height = np.einsum("ij,ij->i", point - triangles[:, 0], normals)
    foot = point - height[:, None] * normals
    above = np.ones(len(triangles), dtype=bool)
    to_edges = np.full(len(triangles), np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        start, edge = triangles[:, a], triangles[:, b] - triangles[:, a]
        above &= np.einsum("ij,ij->i", np.cross(edge, foot - start), normals) >= 0.0
        along = np.clip(np.einsum("ij,ij->i", point - start, edge) / np.einsum("ij,ij->i", edge, edge), 0.0, 1.0)
        to_edges = np.minimum(to_edges, np.linalg.norm(start + along[:, None] * edge - point, axis=1))
    return np.where(above, np.abs(height), to_edges)


def distances_outside(mesh: TetMesh, points: Floats) -> tuple[Floats, Floats]:
    """Distances of points (n, 3) outside a mesh, 0 for points inside, and the default tolerances there [m]."""
    outside = tets_holding(mesh, points) < 0
    distance, allowed = np.zeros(len(points)), np.zeros(len(points))
    if outside.any():
        tets, distance[outside] = nearest_tets(mesh, points[outside])
        allowed[outside] = OUTSIDE * mean_edges(mesh, tets)
    return distance, allowed


def depths_inside(mesh: TetMesh, points: Floats) -> tuple[Floats, Floats]:
    """Depths of points (n, 3) in a mesh, 0 for points outside, and the element sizes there [m]."""
    depth, allowed = np.zeros(len(points)), np.zeros(len(points))
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
    inside = near[tets_holding(mesh, points[near]) >= 0]
    if len(inside):
        tets, depth[inside] = nearest_tets(mesh, points[inside])
        allowed[inside] = OUTSIDE * mean_edges(mesh, tets)
    return depth, allowed
