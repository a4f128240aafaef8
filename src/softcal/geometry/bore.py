"""Detection of a bore's wall around a point, by intersecting rays from the point with the mesh's surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.locate import circles_around, nearest_tets
from softcal.geometry.mesh import TetMesh
from softcal.geometry.ring import across, ring_points
from softcal.geometry.surface import boundary_faces, boundary_owners

# Rays in all directions to find the bore's axis; rays across it, all of which must hit the wall; every how many of them
# one is a point of the ring.
PROBES, RAYS, EACH = 96, 32, 4
# At a bore's mouth the ring is searched at these offsets along the axis, as fractions of the distance to the wall.
ALONG = (0.0, 0.1, -0.1, 0.25, -0.25, 0.5, -0.5)
# Largest distance of the wall over the distance of its nearest part.
REACH = 20.0
# Rays are first intersected with what is within as many distances of the nearest triangle's centre.
NEARBY = 4.0
# Tolerance of barycentric coordinates for hits on an edge shared by two triangles.
EDGE = 1e-9


@dataclass(frozen=True)
class Wall:
    """Points of a bore's wall around a point.

    points (k, 3) [m]; tets (k,): the tet of each; diameter [m] of the circle through them.
    """

    points: Floats
    tets: Ints
    diameter: float


def wall_around(mesh: TetMesh, point: Floats) -> Wall | None:
    """The wall of the bore around a point outside the mesh (3,) [m], or None if no wall surrounds it.

    The bore's axis is the direction most nearly normal to the normals of the visible walls. The wall is found by rays
    across the axis, on one ring through the point, or on two adjacent rings if the point is in the bore's mouth.
    """
    triangles, owners = mesh.points[boundary_faces(mesh)[:, :3]], boundary_owners(mesh)
    centres, radii = circles_around(triangles)
    away = np.linalg.norm(centres - point, axis=1) - radii
    near = away <= REACH * nearest_tets(mesh, point[None])[1]
    triangles, owners = triangles[near], owners[near]
    distance, hit = _first_hits(triangles, point, _sphere(PROBES))
    seen = hit >= 0
    if not seen.any():
        return None
    chosen = triangles[hit[seen]]
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) * distance[seen][:, None]
    axis = np.linalg.eigh(normals.T @ normals)[1][:, 0]
    radius = float(distance[seen].min())
    for part in ALONG:
        ring = _ring(triangles, point + part * radius * axis, axis)
        if ring is None:
            continue
        points, faces = ring
        # The circle fitted to points across the axis.
        first = across(axis)
        flat = (points - points.mean(axis=0)) @ np.stack([first, np.cross(axis, first)], axis=1)
        solved = np.linalg.lstsq(np.column_stack([2.0 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None)[
            0
        ]
        diameter = float(2.0 * np.sqrt(solved[2] + solved[0] ** 2 + solved[1] ** 2))
        if part:
            second = _ring(triangles, point + (part + np.sign(part)) * radius * axis, axis)
            if second is None:
                continue
            points, faces = np.concatenate([points, second[0]]), np.concatenate([faces, second[1]])
        return Wall(points, owners[faces], diameter)
    return None


def _ring(triangles: Floats, centre: Floats, axis: Floats) -> tuple[Floats, Ints] | None:
    """First intersections of rays across the axis with the surface, and their triangles; None if a ray has none."""
    rays = ring_points(np.zeros(3), axis, across(axis), 1.0, RAYS)
    distance, hit = _first_hits(triangles, centre, rays)
    return None if (hit < 0).any() else ((centre + distance[:, None] * rays)[::EACH], hit[::EACH])


def _first_hits(triangles: Floats, origin: Floats, rays: Floats) -> tuple[Floats, Ints]:
    """Distance of the first intersection along each unit ray (k, 3) [m], and its triangle; -1 if there is none."""
    centres, radii = circles_around(triangles)
    to_centres = np.linalg.norm(centres - origin, axis=1)
    distance, hit = np.full(len(rays), np.inf), np.full(len(rays), -1, dtype=np.int64)
    left = np.arange(len(rays))
    for reach in (NEARBY * to_centres.min(), np.inf):  # all triangles only for rays without a hit nearby
        near = np.flatnonzero(to_centres - radii <= reach)
        t = _hits(triangles[near], origin, rays[left])
        first = np.argmin(t, axis=1)
        distance[left] = t[np.arange(len(left)), first]
        hit[left] = np.where(np.isfinite(distance[left]), near[first], -1)
        left = np.flatnonzero(distance > reach)
    return distance, hit


def _hits(triangles: Floats, origin: Floats, rays: Floats) -> Floats:
    """Distances (k, n) along unit rays (k, 3) to the triangles (n, 3, 3) [m]; infinite where a ray misses one.

    Intersection of a ray o + t d with a triangle a + u e1 + v e2 (Möller and Trumbore, 1997).
    """
    a, e1, e2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    s = origin - a
    q = np.cross(s, e1)
    p = np.cross(rays[:, None], e2)
    det = np.einsum("nj,knj->kn", e1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = np.einsum("nj,knj->kn", s, p) / det, rays @ q.T / det
        t = np.einsum("nj,nj->n", e2, q) / det
        meets = (u >= -EDGE) & (v >= -EDGE) & (u + v <= 1.0 + EDGE) & (t > 0.0)
    return np.where(meets, t, np.inf)


def _sphere(n: int) -> Floats:
    """Evenly distributed unit vectors (n, 3): points on a golden-angle spiral."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    r = np.sqrt(1.0 - z**2)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
