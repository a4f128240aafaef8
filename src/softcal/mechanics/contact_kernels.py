"""Energy, gradient and tangent of points that press on triangles, edges and vertices.

Of a point p and the nearest point of a simplex with corners a_1 .. a_k and weights w (sum one), the distance d has

    delta d    = n . u,                          u = delta p - sum w_i delta a_i,   n = (p - sum w_i a_i) / d
    delta^2 d  = (|u|^2 - (n . u)^2 - y^T G^-1 y) / d,
    y_j        = t_j . u + d n . (delta a_j - delta a_1),   t_j = a_j - a_1,   G_ij = t_i . t_j

since the weights are stationary: t_j . (p - sum w_i a_i) = 0.
"""

from __future__ import annotations

import numba
import numpy as np

from softcal.checks import Floats, Ints


@numba.njit(cache=True)
def _dot(a: Floats, b: Floats) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _on_segment(p: Floats, a: Floats, b: Floats) -> float:
    """Weight of b in the point of the segment nearest to p."""
    along = b - a
    length = _dot(along, along)
    return min(1.0, max(0.0, _dot(p - a, along) / length)) if length > 0.0 else 0.0


@numba.njit(cache=True)
def _on_triangle(p: Floats, a: Floats, b: Floats, c: Floats, w: Floats) -> None:
    """Weights of the corners in the point of the triangle nearest to p."""
    s, t, r = b - a, c - a, p - a
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
        off = p - (1.0 - u) * x - u * y
        if _dot(off, off) < best:
            best = _dot(off, off)
            w[:] = 0.0
            w[i], w[(i + 1) % 3] = 1.0 - u, u


@numba.njit(cache=True)
def nearest(V: Floats, point: int, corners: Ints, w: Floats, n: Floats) -> float:
    """Distance [m] of a vertex from the simplex with up to three corners (-1: none); its weights and the direction to
    the vertex are written to w (3,) and n (3,).
    """
    p = V[point]
    w[:] = 0.0
    if corners[1] < 0:
        w[0] = 1.0
    elif corners[2] < 0:
        w[1] = _on_segment(p, V[corners[0]], V[corners[1]])
        w[0] = 1.0 - w[1]
    else:
        _on_triangle(p, V[corners[0]], V[corners[1]], V[corners[2]], w)
    n[:] = p
    for i in range(3):
        if w[i] != 0.0:
            n -= w[i] * V[corners[i]]
    d = np.sqrt(_dot(n, n))
    if d > 0.0:
        n /= d
    return d


@numba.njit(cache=True)
def _is_far(V: Floats, point: int, corners: Ints, reach: float) -> bool:
    """Whether the vertex is further than `reach` [m] from the simplex along one axis."""
    for j in range(3):
        low = high = V[corners[0], j]
        for i in range(1, 3):
            if corners[i] >= 0:
                low, high = min(low, V[corners[i], j]), max(high, V[corners[i], j])
        if V[point, j] > high + reach or V[point, j] < low - reach:
            return True
    return False


@numba.njit(cache=True)
def distances(V: Floats, points: Ints, simplices: Ints) -> Floats:
    """Distances (m,) [m] of vertices from simplices (m, 3)."""
    w, n = np.empty(3), np.empty(3)
    out = np.empty(len(points))
    for k in range(len(points)):
        out[k] = nearest(V, points[k], simplices[k], w, n)
    return out


@numba.njit(cache=True)
def law(overlap: float, depth: float, onset: float) -> tuple[float, float, float]:
    """Energy, pressure and its slope, over the stiffness, at an overlap [m]: overlap / depth, smooth over `onset`."""
    if overlap <= 0.0:
        return 0.0, 0.0, 0.0
    if overlap < onset:
        return overlap**3 / (6.0 * onset * depth), overlap**2 / (2.0 * onset * depth), overlap / (onset * depth)
    past = overlap - 0.5 * onset
    return (0.5 * past**2 + onset**2 / 24.0) / depth, past / depth, 1.0 / depth


@numba.njit(cache=True)
def push(
    V: Floats, points: Ints, simplices: Ints, scale: Floats, reach: Floats, depth: float, onset: float, tangent: bool
) -> tuple[float, Floats, Ints, Floats]:
    """Energy [J], gradient (n, 3) [N], which of the simplices are pressed (k,), and their tangents (k, 12, 12) [N/m] by
    the vertex and the three corners; empty where not wanted.

    scale: of each energy (m,) [N], the area times the stiffness, and the share of the simplex; reach (m,) [m]: the
    distance from which on the simplex pushes.
    """
    w, n = np.empty(3), np.empty(3)
    gradient = np.zeros_like(V)
    pressed = np.empty(len(points), dtype=np.int64)
    count = 0
    energy = 0.0
    for k in range(len(points)):
        if _is_far(V, points[k], simplices[k], reach[k]):
            continue
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


@numba.njit(cache=True)
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
    g00, g01, g11 = _dot(T[0], T[0]), 0.0, 1.0
    if rank == 2:
        g01, g11 = _dot(T[0], T[1]), _dot(T[1], T[1])
    scale = force / d / (g00 * g11 - g01 * g01)
    for a in range(12):
        left, right = scale * (g11 * Y[0, a] - g01 * Y[1, a]), scale * (g00 * Y[1, a] - g01 * Y[0, a])
        if left != 0.0 or right != 0.0:
            for b in range(12):
                H[a, b] += left * Y[0, b] + right * Y[1, b]
