"""Matrices by weighted sums of points, as blocks by the points: W^T H W, row by row (Gustavson, 1978)."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel


@kernel()
def blocks_on_points(
    groups: Ints, blocks: Floats, ptr: Ints, points: Ints, weights: Floats, n_points: int
) -> tuple[Ints, Ints, Floats]:
    """The sum of matrices of groups of vertices by the points that the vertices are weighted sums of: rows and columns
    (k,), ascending, row <= column, and blocks (k, 3, 3).

    Parameters
    ----------
    groups
        Vertices of the groups (m, 4), -1: none.
    blocks
        Their symmetric matrices (m, 12, 12).
    ptr, points, weights
        Vertex v is the sum of points times weights (n,) from ptr[v] to ptr[v + 1].
    n_points
        Number of points.
    """
    begin, members = _members(groups, len(ptr) - 1)
    right, column, value = _times_weights(groups, blocks, begin, members, ptr, points, weights, n_points)
    left, vertex, share = _transposed(ptr, points, weights, right, n_points)
    total, last, here = np.zeros((n_points, 9)), np.full(n_points, -1), np.empty(n_points, dtype=np.int64)
    rows, columns = np.empty(1024, dtype=np.int64), np.empty(1024, dtype=np.int64)
    out = np.empty((1024, 9))
    count = 0
    for s in range(n_points):
        n = 0
        for q in range(left[s], left[s + 1]):
            for k in range(right[vertex[q]], right[vertex[q] + 1]):
                t = column[k]
                if t < s:
                    continue
                if last[t] != s:
                    last[t], here[n] = s, t
                    total[t] = 0.0
                    n += 1
                for i in range(9):
                    total[t, i] += share[q] * value[k, i]
        while count + n > len(rows):
            rows, columns = np.concatenate((rows, rows)), np.concatenate((columns, columns))
            out = np.concatenate((out, out))
        for t in np.sort(here[:n]):
            rows[count], columns[count] = s, t
            out[count] = total[t]
            count += 1
    return rows[:count], columns[:count], out[:count].reshape(-1, 3, 3)


@kernel()
def _members(groups: Ints, n: int) -> tuple[Ints, Ints]:
    """Of each of n vertices its places in the groups (m, 4), counted by rows: where they begin in a list (n + 1,), and
    the list.
    """
    begin = np.zeros(n + 1, dtype=np.int64)
    for group in groups:
        for v in group:
            if v >= 0:
                begin[v + 1] += 1
    begin = np.cumsum(begin)
    free, members = begin[:-1].copy(), np.empty(begin[-1], dtype=np.int64)
    for k in range(len(groups)):
        for c in range(4):
            v = groups[k, c]
            if v >= 0:
                members[free[v]] = 4 * k + c
                free[v] += 1
    return begin, members


@kernel()
def _times_weights(
    groups: Ints, blocks: Floats, begin: Ints, members: Ints, ptr: Ints, points: Ints, weights: Floats, n_points: int
) -> tuple[Ints, Ints, Floats]:
    """H W by rows: where those of each vertex begin (n_vertices + 1,), columns (k,), and blocks (k, 9)."""
    n = len(ptr) - 1
    of_vertex, last, those = np.zeros((n, 9)), np.full(n, -1), np.empty(n, dtype=np.int64)
    of_point, final, here = np.zeros((n_points, 9)), np.full(n_points, -1), np.empty(n_points, dtype=np.int64)
    right, column, value = np.zeros(n + 1, dtype=np.int64), np.empty(1024, dtype=np.int64), np.empty((1024, 9))
    count = 0
    for a in range(n):
        vertices = coupled = 0
        for member in members[begin[a] : begin[a + 1]]:
            k, c = member // 4, member % 4
            for d in range(4):
                b = groups[k, d]
                if b < 0:
                    continue
                if last[b] != a:
                    last[b], those[vertices] = a, b
                    of_vertex[b] = 0.0
                    vertices += 1
                for i in range(3):
                    for j in range(3):
                        of_vertex[b, 3 * i + j] += blocks[k, 3 * c + i, 3 * d + j]
        for b in those[:vertices]:
            for q in range(ptr[b], ptr[b + 1]):
                t = points[q]
                if final[t] != a:
                    final[t], here[coupled] = a, t
                    of_point[t] = 0.0
                    coupled += 1
                for i in range(9):
                    of_point[t, i] += weights[q] * of_vertex[b, i]
        while count + coupled > len(column):
            column, value = np.concatenate((column, column)), np.concatenate((value, value))
        for t in here[:coupled]:
            column[count] = t
            value[count] = of_point[t]
            count += 1
        right[a + 1] = count
    return right, column, value


@kernel()
def _transposed(ptr: Ints, points: Ints, weights: Floats, right: Ints, n_points: int) -> tuple[Ints, Ints, Floats]:
    """W^T by rows, of vertices with rows in `right`: where each point's begin (n_points + 1,), vertices, weights."""
    begin = np.zeros(n_points + 1, dtype=np.int64)
    for v in range(len(ptr) - 1):
        if right[v + 1] > right[v]:
            for q in range(ptr[v], ptr[v + 1]):
                begin[points[q] + 1] += 1
    begin = np.cumsum(begin)
    free, vertex, share = begin[:-1].copy(), np.empty(begin[-1], dtype=np.int64), np.empty(begin[-1])
    for v in range(len(ptr) - 1):
        if right[v + 1] > right[v]:
            for q in range(ptr[v], ptr[v + 1]):
                vertex[free[points[q]]], share[free[points[q]]] = v, weights[q]
                free[points[q]] += 1
    return begin, vertex, share
