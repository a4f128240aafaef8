"""Points that press on triangles, edges and vertices: which, and their energy, gradient and tangent.

Of a point p and the nearest point of a simplex with corners a_1 .. a_k and weights w (sum one), the distance d has

    delta d    = n . u,                          u = delta p - sum w_i delta a_i,   n = (p - sum w_i a_i) / d
    delta^2 d  = (|u|^2 - (n . u)^2 - y^T G^-1 y) / d,
    y_j        = t_j . u + d n . (delta a_j - delta a_1),   t_j = a_j - a_1,   G_ij = t_i . t_j

since the weights are stationary: t_j . (p - sum w_i a_i) = 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.moving_boxes import boxes, depth_of, enclose, meet, pairs_beside

Point = tuple[float, float, float]
ALIKE = 1e-9  # relative difference of distances that count as equal
NEAREST = 0.1  # of a distance, below which a point is taken for one that touches


class Meeting(NamedTuple):
    """Candidates for contact: the first vertices as points, and triangles.

    Attributes
    ----------
    faces
        The triangles' vertices (k, 3).
    point_order, face_order
        Of the points (n_points,) and of the triangles (k,) in their trees, see `moving_boxes`.
    begin, apart
        Sorted vertices that each point never touches: where they begin (n_points + 1,) in a list, and the list. A
        triangle of three such it never touches.
    group
        Vertices of one group never move relative to each other (n_vertices,), so a point and a triangle of one group
        never touch; -1: of none.
    """

    faces: Ints
    point_order: Ints
    face_order: Ints
    begin: Ints
    apart: Ints
    group: Ints


@kernel()
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel()
def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel()
def _at(V: Floats, i: int) -> Point:
    return V[i, 0], V[i, 1], V[i, 2]


@kernel()
def _on_segment(p: Point, a: Point, b: Point) -> float:
    """Weight of b in the point of the segment nearest to p."""
    along = _minus(b, a)
    length = _dot(along, along)
    return min(1.0, max(0.0, _dot(_minus(p, a), along) / length)) if length > 0.0 else 0.0


@kernel()
def _on_triangle(p: Point, a: Point, b: Point, c: Point, w: Floats) -> None:
    """Weights of the corners in the point of the triangle nearest to p."""
    s, t, r = _minus(b, a), _minus(c, a), _minus(p, a)
    ss, st, tt = _dot(s, s), _dot(s, t), _dot(t, t)
    sr, tr = _dot(s, r), _dot(t, r)
    det = ss * tt - st * st
    if det > 0.0:
        u, v = (tt * sr - st * tr) / det, (ss * tr - st * sr) / det
        if u > 0.0 and v > 0.0 and u + v < 1.0:
            w[0], w[1], w[2] = 1.0 - u - v, u, v
            return
    best = np.inf
    for i in range(3):
        x, y = (a, b) if i == 0 else ((b, c) if i == 1 else (c, a))
        u = _on_segment(p, x, y)
        off, along = _minus(p, x), _minus(y, x)
        square = _dot(off, off) - u * (2.0 * _dot(off, along) - u * _dot(along, along))
        if square < best:
            best = square
            w[:] = 0.0
            w[i], w[(i + 1) % 3] = 1.0 - u, u


@kernel()
def nearest(V: Floats, point: int, corners: Ints, w: Floats, n: Floats) -> float:
    """Distance [m] of a vertex from a simplex.

    Parameters
    ----------
    V
        Vertices (n_vertices, 3) [m].
    point
        Number of the vertex.
    corners
        Vertices of the simplex (3,), -1 beyond its last corner.
    w
        Weights of the corners in the nearest point (3,), written.
    n
        Unit vector from there to the vertex (3,), written.
    """
    p = _at(V, point)
    w[:] = 0.0
    if corners[1] < 0:
        w[0] = 1.0
    elif corners[2] < 0:
        w[1] = _on_segment(p, _at(V, corners[0]), _at(V, corners[1]))
        w[0] = 1.0 - w[1]
    else:
        _on_triangle(p, _at(V, corners[0]), _at(V, corners[1]), _at(V, corners[2]), w)
    n[0], n[1], n[2] = p
    for i in range(3):
        if w[i] != 0.0:
            for j in range(3):
                n[j] -= w[i] * V[corners[i], j]
    d = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    if d > 0.0:
        for j in range(3):
            n[j] /= d
    return d


@kernel()
def near(V: Floats, to: Floats, meeting: Meeting, around: Floats) -> tuple[Ints, Ints]:
    """Points (m,), and triangles (m,) that they may touch, whose boxes may meet on straight lines.

    Parameters
    ----------
    V, to
        Vertices at the begin and at the end of the lines (n_vertices, 3) [m].
    meeting
        What may touch.
    around
        By how much the boxes of points are wider on every side (n_points,) [m].
    """
    n, faces = len(around), meeting.faces
    depth = depth_of(max(n, len(faces)))
    of_points = boxes(V, to, np.arange(n).reshape(-1, 1), meeting.point_order, around, depth)
    of_faces = boxes(V, to, faces, meeting.face_order, np.zeros(len(faces)), depth)
    points, triangles = pairs_beside(of_points, of_faces, meeting.point_order, meeting.face_order, depth)
    count = 0
    for k in range(len(points)):
        if _may_touch(meeting, points[k], faces[triangles[k]]):
            points[count], triangles[count] = points[k], triangles[k]
            count += 1
    return points[:count], triangles[:count]


@kernel()
def touching(V: Floats, faces: Ints, reach: Floats, points: Ints, triangles: Ints) -> tuple[Ints, Ints, Floats]:
    """Of each pressing point the triangles nearer than its reach, their edges and their vertices: the points (m,), the
    simplices (m, 3), -1 beyond the last corner, and shares (m,) that are not zero. Triangles count once, edges once
    less their triangles, vertices once less their triangles and edges.

    Parameters
    ----------
    V
        Vertices (n_vertices, 3) [m].
    faces
        Vertices of the triangles (n_faces, 3).
    reach
        Reach of each point (n_points,) [m].
    points, triangles
        The pairs near (k,), the points ascending.
    """
    begin = np.searchsorted(points, np.arange(len(reach) + 1))
    most = np.diff(begin).max() if len(reach) else 0
    mine = np.empty(most, dtype=np.int64)
    ends, of_end = np.empty((3 * most, 2), dtype=np.int64), np.empty(3 * most)
    vertices, of_vertex = np.empty(3 * most, dtype=np.int64), np.empty(3 * most)
    w, n = np.empty(3), np.empty(3)
    pressed, simplices, shares = np.empty(64, dtype=np.int64), np.empty((64, 3), dtype=np.int64), np.empty(64)
    count = 0
    for p in range(len(reach)):
        m = 0
        for f in triangles[begin[p] : begin[p + 1]]:
            if nearest(V, p, faces[f], w, n) < reach[p]:
                mine[m] = f
                m += 1
        if m == 0:
            continue
        while count + 7 * m > len(pressed):
            pressed, shares = np.concatenate((pressed, pressed)), np.concatenate((shares, shares))
            simplices = np.concatenate((simplices, simplices))
        n_ends = n_vertices = 0
        for t in range(m):
            for k in range(3):
                a, b = faces[mine[t], k], faces[mine[t], (k + 1) % 3]
                e = v = 0
                while e < n_ends and not (ends[e, 0] == min(a, b) and ends[e, 1] == max(a, b)):
                    e += 1
                if e == n_ends:
                    ends[e, 0], ends[e, 1], of_end[e] = min(a, b), max(a, b), 1.0
                    n_ends += 1
                of_end[e] -= 1.0
                while v < n_vertices and vertices[v] != a:
                    v += 1
                if v == n_vertices:
                    vertices[v], of_vertex[v] = a, 1.0
                    n_vertices += 1
                of_vertex[v] -= 1.0
            pressed[count], simplices[count], shares[count] = p, faces[mine[t]], 1.0
            count += 1
        for e in range(n_ends):
            if of_end[e] != 0.0:
                pressed[count], shares[count] = p, of_end[e]
                simplices[count, 0], simplices[count, 1], simplices[count, 2] = ends[e, 0], ends[e, 1], -1
                count += 1
        for v in range(n_vertices):
            for e in range(n_ends):
                if ends[e, 0] == vertices[v] or ends[e, 1] == vertices[v]:
                    of_vertex[v] -= of_end[e]
            if of_vertex[v] != 0.0:
                pressed[count], shares[count] = p, of_vertex[v]
                simplices[count, 0], simplices[count, 1], simplices[count, 2] = vertices[v], -1, -1
                count += 1
    return pressed[:count], simplices[:count], shares[:count]


@kernel()
def free_part(V: Floats, to: Floats, faces: Ints, points: Ints, triangles: Ints) -> float:
    """The part of straight lines on which none of the points passes through its triangle: one where none does, else
    until its distance is some tenth of what it was.

    Conservative: a point gets on by no more than its distance over the largest relative motion (additive continuous
    collision detection: Li et al., 2021, Codimensional incremental potential contact, algorithm 1).

    Parameters
    ----------
    V, to
        Vertices at the begin and at the end of the lines (n_vertices, 3) [m].
    faces
        Vertices of the triangles (n_faces, 3).
    points, triangles
        The pairs (m,).
    """
    w, n, four = np.empty(3), np.empty(3), np.empty((4, 3))
    box, other = np.empty(12), np.empty(12)
    part = 1.0
    for k in range(len(points)):
        p, face = points[k], faces[triangles[k]]
        enclose(box, V, to, points[k : k + 1], 0.0)
        enclose(other, V, to, face, 0.0)
        if meet(box, other):
            part = min(part, _free_part(V, to, p, face, part, four, w, n))
    return part


@kernel()
def _free_part(V: Floats, to: Floats, p: int, face: Ints, most: float, four: Floats, w: Floats, n: Floats) -> float:
    """See `free_part`, of one point and triangle, at most `most`; four (4, 3), w (3,), n (3,): room."""
    fastest = 0.0
    for k in range(3):
        square = 0.0
        for j in range(3):
            square += (to[p, j] - V[p, j] - to[face[k], j] + V[face[k], j]) ** 2
        fastest = max(fastest, np.sqrt(square))
    t, first = 0.0, -1.0
    corners = np.arange(4)
    while fastest > 0.0:
        for j in range(3):
            four[0, j] = (1.0 - t) * V[p, j] + t * to[p, j]
            for k in range(3):
                four[k + 1, j] = (1.0 - t) * V[face[k], j] + t * to[face[k], j]
        d = nearest(four, corners[0], corners[1:], w, n)
        first = d if first < 0.0 else first
        if d <= NEAREST * first:
            return t
        t += (1.0 - NEAREST) * d / fastest
        if not t < most:  # also where no motion is a number
            break
    return most


@kernel()
def _may_touch(meeting: Meeting, point: int, face: Ints) -> bool:
    """Whether a point may touch a triangle."""
    together, separate = meeting.group[point] >= 0, True
    for k in range(3):
        together = together and meeting.group[face[k]] == meeting.group[point]
        low, end = meeting.begin[point], meeting.begin[point + 1]
        high = end if separate else low
        while low < high:
            middle = (low + high) // 2
            low, high = (middle + 1, high) if meeting.apart[middle] < face[k] else (low, middle)
        separate = separate and low < end and meeting.apart[low] == face[k]
    return not (together or separate)


@kernel()
def distances(V: Floats, points: Ints, simplices: Ints) -> Floats:
    """Distances (m,) [m] of vertices from simplices.

    Parameters
    ----------
    V
        Vertices (n_vertices, 3) [m].
    points
        Numbers of the vertices (m,).
    simplices
        Vertices of the simplices (m, 3), -1 beyond the last corner.
    """
    w, n = np.empty(3), np.empty(3)
    out = np.empty(len(points))
    for k in range(len(points)):
        out[k] = nearest(V, points[k], simplices[k], w, n)
    return out


@kernel()
def law(overlap: float, depth: float, onset: float) -> tuple[float, float, float]:
    """Energy [m], pressure [-] and its slope [1/m], over the stiffness: overlap / depth, smooth at its begin.

    Parameters
    ----------
    overlap
        How far the point is within the reach [m].
    depth
        Depth of the core below its surface [m].
    onset
        Overlap over which the slope rises [m].
    """
    if overlap <= 0.0:
        return 0.0, 0.0, 0.0
    if overlap < onset:
        return overlap**3 / (6.0 * onset * depth), overlap**2 / (2.0 * onset * depth), overlap / (onset * depth)
    past = overlap - 0.5 * onset
    return (0.5 * past**2 + onset**2 / 24.0) / depth, past / depth, 1.0 / depth


@kernel()
def push(
    V: Floats, points: Ints, simplices: Ints, scale: Floats, reach: Floats, depth: float, onset: float, tangent: bool
) -> tuple[float, Floats, Ints, Floats]:
    """Energy [J], gradient (n, 3) [N], which of the simplices are pressed (k,), and their tangents (k, 12, 12) [N/m] by
    the vertex and the three corners; empty where not wanted.

    Parameters
    ----------
    V
        Vertices (n_vertices, 3) [m].
    points
        Numbers of the vertices (m,).
    simplices
        Vertices of the simplices (m, 3), -1 beyond the last corner.
    scale
        Of each energy (m,) [N]: the area times the stiffness and the share of the simplex.
    reach
        Distance from which on the simplex pushes (m,) [m].
    depth, onset
        As in `law` [m].
    tangent
        Whether tangents are wanted.
    """
    w, n = np.empty(3), np.empty(3)
    gradient = np.zeros_like(V)
    pressed = np.empty(len(points), dtype=np.int64)
    count = 0
    energy = 0.0
    for k in range(len(points)):
        d = nearest(V, points[k], simplices[k], w, n)
        if d >= reach[k] or d == 0.0:
            continue
        e, pressure, _ = law(reach[k] - d, depth, onset)
        energy += scale[k] * e
        force = scale[k] * pressure
        gradient[points[k]] -= force * n
        for i in range(3):
            if w[i] != 0.0:
                gradient[simplices[k, i]] += force * w[i] * n
        pressed[count] = k
        count += 1
    if not tangent:
        return energy, gradient, pressed[:count], np.zeros((0, 12, 12))
    blocks = np.zeros((count, 12, 12))
    for m in range(count):
        k = int(pressed[m])
        d = nearest(V, points[k], simplices[k], w, n)
        _, pressure, slope = law(float(reach[k] - d), depth, onset)
        _tangent(V, simplices[k], w, n, d, float(scale[k] * pressure), float(scale[k] * slope), blocks[m])
    return energy, gradient, pressed[:count], blocks


@kernel()
def make_convex(V: Floats, points: Ints, simplices: Ints, pressed: Ints, blocks: Floats) -> None:
    """Add to tangents what makes those by each point's own motion positive semidefinite: on a ridge between triangles
    any motion across relieves a point, until it is on one of them.

    Parameters
    ----------
    V
        Vertices (n_vertices, 3) [m].
    points
        Numbers of the vertices (m,).
    simplices
        Vertices of the simplices (m, 3), -1 beyond the last corner.
    pressed
        Which of the simplices are pressed (k,).
    blocks
        Their tangents (k, 12, 12) [N/m], changed.
    """
    w, n, d = np.empty(3), np.empty(3), np.empty(len(pressed))
    begin = 0
    while begin < len(pressed):
        end, own = begin, np.zeros((3, 3))
        while end < len(pressed) and points[pressed[end]] == points[pressed[begin]]:
            own += blocks[end, :3, :3]
            end += 1
        values, ways = np.linalg.eigh(own)
        if values[0] < 0.0:
            for m in range(begin, end):
                d[m] = nearest(V, int(points[pressed[m]]), simplices[pressed[m]], w, n)
            # On all that are nearest alike: in a symmetric mesh rounding must not choose.
            equal = np.flatnonzero(d[begin:end] <= (1.0 + ALIKE) * d[begin:end].min()) + begin
            for m in equal:
                nearest(V, int(points[pressed[m]]), simplices[pressed[m]], w, n)
                B = np.array([1.0, -w[0], -w[1], -w[2]])
                for i in range(2):
                    if values[i] < 0.0:
                        less = values[i] / len(equal)
                        for a in range(12):
                            for b in range(12):
                                blocks[m, a, b] -= less * B[a // 3] * B[b // 3] * ways[a % 3, i] * ways[b % 3, i]
        begin = end


@kernel()
def _tangent(V: Floats, corners: Ints, w: Floats, n: Floats, d: float, force: float, slope: float, H: Floats) -> None:
    """slope (delta d)^2 - force delta^2 d, into H (12, 12)."""
    first, rank = -1, 0
    B, T, at = np.empty(4), np.empty((2, 3)), np.empty(2, dtype=np.int64)
    B[0] = 1.0
    for i in range(3):
        B[i + 1] = -w[i]
        if w[i] != 0.0:
            if first < 0:
                first = i
            else:
                T[rank] = V[corners[i]] - V[corners[first]]
                at[rank] = i + 1
                rank += 1
    across = slope + force / d
    for a in range(4):
        for b in range(4):
            if B[a] != 0.0 and B[b] != 0.0:
                for i in range(3):
                    for j in range(3):
                        H[3 * a + i, 3 * b + j] = B[a] * B[b] * across * n[i] * n[j]
                    H[3 * a + i, 3 * b + i] -= B[a] * B[b] * force / d
    if rank == 0:
        return
    Y = np.zeros((2, 12))
    for j in range(rank):
        for a in range(4):
            for i in range(3):
                Y[j, 3 * a + i] = B[a] * T[j, i]
        for i in range(3):
            Y[j, 3 * at[j] + i] += d * n[i]
            Y[j, 3 * (first + 1) + i] -= d * n[i]
    g00, g01, g11 = T[0] @ T[0], 0.0, 1.0
    if rank == 2:
        g01, g11 = T[0] @ T[1], T[1] @ T[1]
    scale = force / d / (g00 * g11 - g01 * g01)
    for a in range(12):
        left, right = scale * (g11 * Y[0, a] - g01 * Y[1, a]), scale * (g00 * Y[1, a] - g01 * Y[0, a])
        if left != 0.0 or right != 0.0:
            for b in range(12):
                H[a, b] += left * Y[0, b] + right * Y[1, b]
