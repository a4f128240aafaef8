"""A tree of boxes around triangles whose vertices move along straight lines: which of them a moving point may meet.

A node's box is two boxes, around its triangles at the beginning and at the end: between them its sides move in
proportion to the time, so that it encloses whatever moves along straight lines. Such boxes stay small where a robot
moves far and neighbours move alike, unlike boxes around whole ways.

The tree is complete: node k of level l has the triangles [n k / 2^l, n (k + 1) / 2^l) of an order in which every node's
are sorted along the longest side of their box.
"""

from __future__ import annotations

import numba
import numpy as np

from softcal.checks import Floats, Ints

LEAF = 3  # triangles at most


@numba.njit(cache=True)
def order_of(centres: Floats) -> Ints:
    """The order of triangles in their tree, by their centres (n, 3) at rest."""
    n = len(centres)
    order = np.arange(n)
    for level in range(_depth(n)):
        for k in range(1 << level):
            a, b = n * k >> level, n * (k + 1) >> level
            part = order[a:b].copy()
            longest, axis = -1.0, 0
            for j in range(3):
                side = np.ptp(centres[part, j])
                if side > longest:
                    longest, axis = side, j
            order[a:b] = part[np.argsort(centres[part, axis])]
    return order


@numba.njit(cache=True)
def _depth(n: int) -> int:
    """The number of levels below the root of a tree of n triangles."""
    depth = 0
    while n > LEAF << depth:
        depth += 1
    return depth


@numba.njit(cache=True)
def boxes(before: Floats, after: Floats, faces: Ints, order: Ints) -> Floats:
    """Boxes (n_nodes, 12) [m] of the nodes of a tree of `faces` (n, 3) whose vertices move from `before`
    (n_vertices, 3) to `after`: their low corners at the beginning and at the end, and less their high ones.
    """
    n, depth = len(order), _depth(len(order))
    leaves = (1 << depth) - 1
    out = np.full((2 * leaves + 1, 12), np.inf)
    for k in range(leaves + 1):
        box = out[leaves + k]
        for i in range(n * k >> depth, n * (k + 1) >> depth):
            for v in faces[order[i]]:
                for j in range(3):
                    box[j], box[3 + j] = min(box[j], before[v, j]), min(box[3 + j], after[v, j])
                    box[6 + j], box[9 + j] = min(box[6 + j], -before[v, j]), min(box[9 + j], -after[v, j])
    for node in range(leaves - 1, -1, -1):
        for j in range(12):
            out[node, j] = min(out[2 * node + 1, j], out[2 * node + 2, j])
    return out


@numba.njit(cache=True)
def _meets(box: Floats, node: int, p: Floats, q: Floats) -> bool:
    """Whether a point that moves from p to q (3,) is at some time in the box of a node."""
    first, last = 0.0, 1.0
    for j in range(3):
        for side in range(2):
            # How far the point is from being inside of a side, at the beginning and at the end.
            x, y = (-p[j], -q[j]) if side else (p[j], q[j])
            a, b = box[node, 6 * side + j] - x, box[node, 6 * side + 3 + j] - y
            if a > 0.0 and b > 0.0:
                return False
            if a > 0.0:
                first = max(first, a / (a - b))
            elif b > 0.0:
                last = min(last, a / (a - b))
    return first <= last


@numba.njit(cache=True)
def faces_met(box: Floats, order: Ints, p: Floats, q: Floats, out: Ints) -> int:
    """The number of triangles in the leaves that a point meets on its way from p to q (3,). They are written to the
    front of out, which has room for all triangles and some more.
    """
    n, depth = len(order), _depth(len(order))
    leaves = (1 << depth) - 1
    count, top = 0, len(out) - 1  # the nodes to visit are at the back
    out[top] = 0
    while top < len(out):
        node = out[top]
        top += 1
        if not _meets(box, node, p, q):
            continue
        if node < leaves:
            top -= 2
            out[top], out[top + 1] = 2 * node + 1, 2 * node + 2
            continue
        k = node - leaves
        for i in range(n * k >> depth, n * (k + 1) >> depth):
            out[count] = order[i]
            count += 1
    return count
