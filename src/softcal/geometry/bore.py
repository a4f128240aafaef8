"""Detection of bores, by intersecting rays from a point with the mesh's surface: the wall around it, the whole bore."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats, Ints
from softcal.geometry.locate import circles_around, nearest_tets
from softcal.geometry.mesh import TetMesh
from softcal.geometry.ring import across, ring_points
from softcal.geometry.surface import boundary_faces, boundary_owners, nearest_triangle

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
# Of a bore along its axis: a cross-section is in it where the wall is within so many radii all around. Cross-sections
# are tried every so many radii, and the ends are bisected so often.
ROUND, STEP, BISECTIONS = 1.5, 0.2, 12
STRAIGHTENINGS, INNER = 2, 0.9  # of the axis, by cross-sections so far from the middle of a stretch to its end
CENTRINGS = 4  # each from a point that is nearer to the axis
LIFT = 1e-6  # of a triangle: from its surface, before a ray starts there


@dataclass(frozen=True)
class Wall:
    """Points of a bore's wall around a point.

    points (k, 3) [m]; tets (k,): the tet of each; diameter [m] of the circle through them.
    """

    points: Floats
    tets: Ints
    diameter: float


@dataclass(frozen=True)
class Bore:
    """A straight bore, with the grooves that it crosses.

    axis (3,): unit vector; diameter [m]; stretches (k, 2, 3) [m]: centres of both ends of each stretch with a wall all
    around, in the axis' direction; is_blind (k, 2): whether there is material behind an end.
    """

    axis: Floats
    diameter: float
    stretches: Floats
    is_blind: NDArray[np.bool_]


def bore_at(triangles: Floats, point: Floats) -> Bore | None:
    """The straight bore whose wall is at a point of a surface; None where there is none.

    Its stretches are all those on one axis: a tendon's channel goes on beyond a groove.

    Parameters
    ----------
    triangles
        The surface of a part (n, 3, 3) [m], its corners ordered so that normals are outwards.
    point
        A point of it (3,) [m].
    """
    triangle = triangles[nearest_triangle(triangles, point)]
    outward = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    outward /= np.linalg.norm(outward)
    lifted = LIFT * float(np.linalg.norm(np.ptp(triangle, axis=0))) - (point - triangle[0]) @ outward
    across_it, hit = _first_hits(triangles, point + lifted * outward, outward[None])
    if hit[0] < 0:
        return None
    centre, axis, radius = point + 0.5 * across_it[0] * outward, np.zeros(3), 0.0
    for _ in range(CENTRINGS):
        seen = _axis(triangles, centre)
        ring = None if seen is None else _ring(triangles, centre, seen[0])
        if seen is None or ring is None:
            return None
        axis = seen[0] * np.sign(seen[0][np.argmax(np.abs(seen[0]))])
        centre, radius = _circle(ring[0], axis)
    stretches = _stretches(triangles, centre, axis, radius)
    for _ in range(STRAIGHTENINGS if len(stretches) else 0):
        # The walls of one stretch say little of the axis; the centres of all cross-sections are on one line.
        inner = stretches.mean(axis=1)[:, None] + INNER * (stretches - stretches.mean(axis=1)[:, None])
        circles = [_circle(ring[0], axis) for at in inner.reshape(-1, 3) if (ring := _ring(triangles, at, axis))]
        middles = np.array([middle for middle, _ in circles])
        centre, radius = middles.mean(axis=0), float(np.median([r for _, r in circles]))
        along = np.linalg.svd(middles - centre)[2][0]
        axis = along * np.sign(along @ axis)
        stretches = _stretches(triangles, centre, axis, radius)
    if not len(stretches):
        return None
    outwards = axis * np.array([[-1.0], [1.0]])
    behind = [
        _first_hits(triangles, end - 0.5 * radius * way, way[None])[0][0]
        for stretch in stretches
        for end, way in zip(stretch, outwards, strict=True)
    ]
    return Bore(axis, 2.0 * radius, stretches, np.reshape(behind, (-1, 2)) < radius)


def _stretches(triangles: Floats, centre: Floats, axis: Floats, radius: float) -> Floats:
    """Both ends (k, 2, 3) of every segment of an axis that the wall of a bore surrounds."""
    along = (triangles - centre) @ axis
    low, high = along.min(axis=1), along.max(axis=1)

    def is_bore(t: float) -> bool:
        at, reached = centre + t * axis, (low <= t) & (t <= high)
        ring = _ring(triangles[reached], at, axis) if reached.any() else None
        return ring is not None and float(np.linalg.norm(ring[0] - at, axis=1).max()) <= ROUND * radius

    tried = np.arange(low.min() - STEP * radius, high.max() + 2.0 * STEP * radius, STEP * radius)
    inside = np.array([is_bore(t) for t in tried])
    ends: list[float] = []
    for k in np.flatnonzero(inside[1:] != inside[:-1]):
        t_in, t_out = (tried[k], tried[k + 1]) if inside[k] else (tried[k + 1], tried[k])
        for _ in range(BISECTIONS):
            middle = 0.5 * (t_in + t_out)
            t_in, t_out = (middle, t_out) if is_bore(middle) else (t_in, middle)
        ends.append(t_in)
    return centre + np.array(ends).reshape(-1, 2)[..., None] * axis


def wall_around(mesh: TetMesh, point: Floats) -> Wall | None:
    """The wall of the bore around a point outside the mesh (3,) [m], or None if no wall surrounds it.

    The wall is found by rays across the bore's axis, on one ring through the point, or on two adjacent rings if the
    point is in the bore's mouth.
    """
    triangles, owners = mesh.points[boundary_faces(mesh)[:, :3]], boundary_owners(mesh)
    centres, radii = circles_around(triangles)
    away = np.linalg.norm(centres - point, axis=1) - radii
    near = away <= REACH * nearest_tets(mesh, point[None])[1]
    triangles, owners = triangles[near], owners[near]
    seen = _axis(triangles, point)
    if seen is None:
        return None
    axis, radius = seen
    for part in ALONG:
        ring = _ring(triangles, point + part * radius * axis, axis)
        if ring is None:
            continue
        points, faces = ring
        diameter = 2.0 * _circle(points, axis)[1]
        if part:
            second = _ring(triangles, point + (part + np.sign(part)) * radius * axis, axis)
            if second is None:
                continue
            points, faces = np.concatenate([points, second[0]]), np.concatenate([faces, second[1]])
        return Wall(points, owners[faces], diameter)
    return None


def _axis(triangles: Floats, point: Floats) -> tuple[Floats, float] | None:
    """A bore's axis by a point in it, and the distance of the nearest wall.

    The axis is the direction most nearly normal to the normals of the visible walls.
    """
    # Evenly distributed rays: points on a golden-angle spiral.
    z = 1.0 - (2.0 * np.arange(PROBES) + 1.0) / PROBES
    angle, r = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(PROBES), np.sqrt(1.0 - z**2)
    distance, hit = _first_hits(triangles, point, np.column_stack([r * np.cos(angle), r * np.sin(angle), z]))
    seen = hit >= 0
    if not seen.any():
        return None
    chosen = triangles[hit[seen]]
    normals = np.cross(chosen[:, 1] - chosen[:, 0], chosen[:, 2] - chosen[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) * distance[seen][:, None]
    return np.linalg.eigh(normals.T @ normals)[1][:, 0], float(distance[seen].min())


def _circle(points: Floats, axis: Floats) -> tuple[Floats, float]:
    """Centre and radius of the circle fitted to points (k, 3) across an axis."""
    first, middle = across(axis), points.mean(axis=0)
    basis = np.stack([first, np.cross(axis, first)])
    flat = (points - middle) @ basis.T
    solved = np.linalg.lstsq(np.column_stack([2.0 * flat, np.ones(len(flat))]), (flat**2).sum(axis=1), rcond=None)[0]
    return middle + solved[:2] @ basis, float(np.sqrt(solved[2] + solved[0] ** 2 + solved[1] ** 2))


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
