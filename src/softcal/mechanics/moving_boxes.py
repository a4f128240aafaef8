"""Trees of boxes around cells, such as triangles, whose vertices move along straight lines: which cells may meet.

A node's box is two boxes, around its cells at the beginning and at the end: between them its sides move in proportion
to the time, so that it encloses whatever moves along straight lines. Such boxes stay small where a robot moves far and
neighbours move alike, unlike boxes around whole ways.

A tree is complete: node k of level l has the cells [n k / 2^l, n (k + 1) / 2^l) of an order in which every node's are
sorted along the longest side of their box.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel

LEAF = 5  # cells at most


@kernel()
def depth_of(n: int) -> int:
    """The number of levels below the root of a tree of n cells."""
    depth = 0
    while n > LEAF << depth:
        depth += 1
    return depth


@kernel()
def order_of(centres: Floats) -> Ints:
    """The order of cells in their tree, by their centres (n, 3) at rest."""
    n = len(centres)
    order = np.arange(n)
    for level in range(depth_of(n)):
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


@kernel()
def boxes(before: Floats, after: Floats, cells: Ints, order: Ints, around: Floats, depth: int) -> Floats:
    """Boxes (n_nodes + n, 12) [m] of the nodes of a tree and of its cells in their order.

    Parameters
    ----------
    before, after
        Vertices at the begin and at the end (n_vertices, 3) [m].
    cells
        Vertices of the cells (n, k).
    order
        Order of the cells in the tree (n,).
    around
        By how much each cell's box is wider on every side (n,) [m].
    depth
        Depth of the tree; at least `depth_of`.
    """
    n, inner = len(order), (1 << depth) - 1
    first = 2 * inner + 1  # of the cells
    out = np.full((first + n, 12), np.inf)
    for k in range(n):
        enclose(out[first + k], before, after, cells[order[k]], float(around[order[k]]))
    for node in range(first - 1, -1, -1):
        parts = (2 * node + 1, 2 * node + 3) if node < inner else _cells_of(node, n, inner, depth)
        for part in range(parts[0], parts[1]):
            for j in range(12):
                out[node, j] = min(out[node, j], out[part, j])
    return out


@kernel()
def _cells_of(leaf: int, n: int, inner: int, depth: int) -> tuple[int, int]:
    """The range of a leaf's cells among the boxes."""
    k, first = leaf - inner, 2 * inner + 1
    return first + (n * k >> depth), first + (n * (k + 1) >> depth)


@kernel()
def enclose(box: Floats, before: Floats, after: Floats, cell: Ints, around: float) -> None:
    """Write the box of a moving cell: its low corners at the begin and at the end, and less its high ones; infinity
    where no vertex is a number.

    Parameters
    ----------
    box
        The box (12,) [m], written.
    before, after
        Vertices at the begin and at the end (n_vertices, 3) [m].
    cell
        Vertices of the cell (k,).
    around
        By how much the box is wider on every side [m].
    """
    box[:] = np.inf
    for v in cell:
        for j in range(3):
            at, to = before[v, j], after[v, j]
            for k, value in ((j, at), (3 + j, to), (6 + j, -at), (9 + j, -to)):
                if value < box[k]:  # not where it is no number
                    box[k] = value
    box -= around


@kernel(error_model="numpy")
def separate(a: Floats, i: int, b: Floats, j: int) -> bool:
    """Whether two boxes are apart along an axis at the begin and at the end: then they always are.

    Parameters
    ----------
    a, b
        Boxes (n, 12), (m, 12) [m].
    i, j
        Numbers of the two.
    """
    for k in range(3):
        if a[i, k] + b[j, 6 + k] > 0.0 and a[i, 3 + k] + b[j, 9 + k] > 0.0:
            return True
        if a[i, 6 + k] + b[j, k] > 0.0 and a[i, 9 + k] + b[j, 3 + k] > 0.0:
            return True
    return False


@kernel(error_model="numpy")
def meet(a: Floats, b: Floats) -> bool:
    """Whether two boxes (12,) have at some time a common point."""
    first, last = 0.0, 1.0
    for k in range(3):
        for side in (0, 6):
            # How far a side of one is beyond the opposite one of the other, at the beginning and at the end.
            off, away = a[side + k] + b[6 - side + k], a[side + 3 + k] + b[9 - side + k]
            if not (off <= 0.0 or away <= 0.0):  # also where neither is a number
                return False
            if off > 0.0:
                first = max(first, off / (off - away))
            elif away > 0.0:
                last = min(last, off / (off - away))
    return first <= last


@kernel()
def pairs_beside(a: Floats, b: Floats, a_order: Ints, b_order: Ints, depth: int) -> tuple[Ints, Ints]:
    """Cells of one tree (m,) and of another of the same depth (m,) whose boxes are not `separate`.

    Parameters
    ----------
    a, b
        Boxes of the trees (n, 12), (m, 12) [m].
    a_order, b_order
        Orders of their cells.
    depth
        Depth of both trees.
    """
    n, m, inner = len(a_order), len(b_order), (1 << depth) - 1
    first = 2 * inner + 1
    nodes = np.zeros((3 * depth + 1, 2), dtype=np.int64)  # to visit
    one, other = np.empty(1024, dtype=np.int64), np.empty(1024, dtype=np.int64)
    count, left = 0, 1
    while left > 0:
        left -= 1
        i, j = nodes[left, 0], nodes[left, 1]
        if separate(a, i, b, j):
            continue
        if i < inner:
            for k in range(4):
                nodes[left, 0], nodes[left, 1] = 2 * i + 1 + k // 2, 2 * j + 1 + k % 2
                left += 1
            continue
        (start, end), (b_start, b_end) = _cells_of(i, n, inner, depth), _cells_of(j, m, inner, depth)
        while count + (end - start) * (b_end - b_start) > len(one):
            one, other = np.concatenate((one, one)), np.concatenate((other, other))
        for x in range(start, end):
            for y in range(b_start, b_end):
                if not separate(a, x, b, y):
                    one[count], other[count] = a_order[x - first], b_order[y - first]
                    count += 1
    return one[:count], other[:count]
