"""The sparsity of the tangent, planned once.

One long array `data` holds, one after the other: the upper triangle of the symmetric tangent on the unknowns z
(compressed rows, what the factorisation reads); *side* blocks for pairs of entities of which at least one rides on a
plate; and a waste slot for pairs with a fixed point. Terms add straight into `data`; `Motion.reduce` then folds the
side blocks into the triangle by the plates' present rotations. So nothing is sorted, searched or copied in a Newton
iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from softcal.checks import Ints
from softcal.mechanics.layout import FIXED, FREE, Layout


@dataclass(frozen=True)
class Pattern:
    """indptr, indices: upper triangle on the unknowns. keys, start: position in `data` of entity pairs.

    `start[k, i] + j` is the place of entry (i, j) of pair k's block, j >= i where the pair is an entity with itself.
    side_pairs: (n, 2) the entity pairs of the side blocks, in the order of their storage from nnz on.
    """

    indptr: Ints
    indices: Ints
    nnz: int
    size: int
    keys: Ints
    start: Ints
    side_pairs: Ints
    n_entities: int

    @cached_property
    def rows(self) -> Ints:
        """The row of every entry of the triangle (nnz,)."""
        return np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))

    def pair(self, a: Ints, b: Ints) -> Ints:
        """Start positions (..., 3) of the pairs (a, b), a <= b."""
        k = np.searchsorted(self.keys, a * np.int64(self.n_entities) + b)
        return self.start[k]

    def entry(self, alpha: Ints, beta: Ints) -> Ints:
        """Places in `data` of the tangent's entries (alpha, beta), alpha <= beta, by numbers of unknowns."""
        n = np.int64(len(self.indptr) - 1)
        return np.searchsorted(self.rows * n + self.indices, alpha * n + beta)


def build_pattern(layout: Layout, connectivities: list[Ints]) -> Pattern:
    """Plan the tangent for terms that connect entities as in `connectivities`, each (n, k), rows ascending."""
    n = np.int64(layout.n_entities)
    parts = []
    for conn in connectivities:
        i, j = np.triu_indices(conn.shape[1])
        parts.append(np.unique(conn[:, i] * n + conn[:, j]))
    keys = np.unique(np.concatenate([*parts, np.arange(n) * (n + 1)]))
    a, b = keys // n, keys % n

    # Entities of the reduced problem: free points, plates, scalars, in the order of their unknowns.
    free = layout.free_points
    n_free, n_plates = len(free), layout.n_plates
    reduced = np.full(n, -1, dtype=np.int64)
    reduced[free] = np.arange(n_free)
    rigid = layout.rigid_points
    reduced[rigid] = n_free + layout.rider[rigid]
    reduced[layout.n_points :] = n_free + n_plates + np.arange(layout.n_pressures)
    sizes = np.concatenate([np.full(n_free, 3), np.full(n_plates, 6), np.ones(layout.n_pressures, int)]).astype(
        np.int64
    )
    first = np.concatenate([[0], np.cumsum(sizes)])
    n_red = np.int64(len(sizes))

    ra, rb = reduced[a], reduced[b]
    moving = (ra >= 0) & (rb >= 0)
    low, high = np.minimum(ra, rb)[moving], np.maximum(ra, rb)[moving]
    red_keys = np.unique(np.concatenate([low * n_red + high, np.arange(n_red) * (n_red + 1)]))
    red_row, red_col = red_keys // n_red, red_keys % n_red
    red_ptr = np.searchsorted(red_row, np.arange(n_red + 1))
    indptr, indices, offset = _expand(red_ptr, red_col, sizes, first)
    nnz = int(indptr[-1])

    # Where each pair's rows start.
    on_plate = np.zeros(n, dtype=bool)
    on_plate[rigid] = True
    entity_size = np.ones(n, dtype=np.int64)
    entity_size[: layout.n_points] = 3
    side = moving & (on_plate[a] | on_plate[b])
    direct = moving & ~side
    start = np.zeros((len(keys), 3), dtype=np.int64)
    k = np.searchsorted(red_keys, ra[direct] * n_red + rb[direct])
    for i in range(3):
        row = first[ra[direct]] + np.minimum(i, entity_size[a[direct]] - 1)
        start[direct, i] = indptr[row] + offset[k] - np.minimum(i, entity_size[a[direct]] - 1)
    block = entity_size[a[side]] * entity_size[b[side]]
    side_start = nnz + np.concatenate([[0], np.cumsum(block)])
    for i in range(3):
        start[side, i] = side_start[:-1] + i * entity_size[b[side]]
    waste = int(side_start[-1])
    start[~moving] = waste
    return Pattern(
        indptr=indptr,
        indices=indices,
        nnz=nnz,
        size=waste + 3,
        keys=keys,
        start=start,
        side_pairs=np.stack([a[side], b[side]], axis=1),
        n_entities=int(n),
    )


def triple_product(layout: Layout, pattern: Pattern, weight_of: Ints) -> tuple[Ints, Ints, Ints, Ints]:
    """Lists (source, weight_a, weight_b, target) with data[target] += data[source] w[weight_a] w[weight_b].

    They fold the side blocks into the triangle: K_z = P^T K P for a motion dx = P dz. weight_of: number of a rigid
    point's first weight; its six weights are its arm r and -r, weight 0 is one (see `Motion`).
    """
    source: list[Ints] = []
    wa: list[Ints] = []
    wb: list[Ints] = []
    alpha: list[Ints] = []
    beta: list[Ints] = []
    a, b = pattern.side_pairs.T
    if len(a) == 0:
        empty = np.zeros(0, dtype=np.int64)
        return empty, empty, empty, empty
    start = pattern.pair(a, b)
    for i in range(3):
        for j in range(3):
            same = a == b
            exists = ((b < layout.n_points) | (j == 0)) & (~same | (j >= i))
            for unknown_a, weight_a, has_a in _row(layout, weight_of, a, i):
                for unknown_b, weight_b, has_b in _row(layout, weight_of, b, j):
                    ok = exists & has_a & has_b
                    src = start[ok, i] + j
                    # An off-diagonal entry stands for its mirror image too.
                    mirrored = ~(same[ok] & (i == j))
                    ua, ub, pa, pb = unknown_a[ok], unknown_b[ok], weight_a[ok], weight_b[ok]
                    upper = ua <= ub
                    keep = mirrored | upper
                    low, high = np.minimum(ua, ub), np.maximum(ua, ub)
                    source.append(src[keep])
                    wa.append(pa[keep])
                    wb.append(pb[keep])
                    alpha.append(low[keep])
                    beta.append(high[keep])
                    twice = mirrored & (ua == ub)
                    source.append(src[twice])
                    wa.append(pa[twice])
                    wb.append(pb[twice])
                    alpha.append(low[twice])
                    beta.append(high[twice])
    target = pattern.entry(np.concatenate(alpha), np.concatenate(beta))
    lists = (np.concatenate(source), np.concatenate(wa), np.concatenate(wb), target)
    order = np.argsort(lists[3], kind="stable")
    return lists[0][order], lists[1][order], lists[2][order], lists[3][order]


def _row(layout: Layout, weight_of: Ints, entity: Ints, i: int) -> list[tuple[Ints, Ints, np.ndarray]]:
    """Nonzeros of row i of P for each entity: (unknown, weight number, exists)."""
    is_point = entity < layout.n_points
    point = np.where(is_point, entity, 0)
    rider = np.where(is_point, layout.rider[point], FREE)
    rigid = is_point & (rider >= 0)
    free_number = np.cumsum(layout.rider == FREE) - 1
    plate = layout.first_plate_unknown + 6 * np.maximum(rider, 0)
    scalar = layout.first_pressure_unknown + entity - layout.n_points
    own = np.where(is_point, np.where(rigid, plate + i, 3 * free_number[point] + i), scalar)
    one = np.zeros(len(entity), dtype=np.int64)
    everywhere = rider != FIXED
    # (omega x r)_i = omega_{i+1} r_{i+2} - omega_{i+2} r_{i+1}
    j, k = (i + 1) % 3, (i + 2) % 3
    weights = np.where(rigid, weight_of[point], 0)
    return [
        (own, one, everywhere),
        (plate + 3 + j, weights + k, rigid),
        (plate + 3 + k, weights + 3 + j, rigid),
    ]


@numba.njit(cache=True)
def _expand(red_ptr: Ints, red_col: Ints, sizes: Ints, first: Ints) -> tuple[Ints, Ints, Ints]:
    n_red = len(sizes)
    offset = np.zeros(len(red_col), dtype=np.int64)
    indptr = np.zeros(first[n_red] + 1, dtype=np.int64)
    for r in range(n_red):
        total = 0
        for k in range(red_ptr[r], red_ptr[r + 1]):
            offset[k] = total
            total += sizes[red_col[k]]
        for i in range(sizes[r]):
            indptr[first[r] + i + 1] = total - i
    for i in range(len(indptr) - 1):
        indptr[i + 1] += indptr[i]
    indices = np.empty(indptr[-1], dtype=np.int64)
    for r in range(n_red):
        for i in range(sizes[r]):
            at = indptr[first[r] + i]
            for k in range(red_ptr[r], red_ptr[r + 1]):
                c = red_col[k]
                for j in range(sizes[c]):
                    if c == r and j < i:
                        continue
                    indices[at] = first[c] + j
                    at += 1
    return indptr, indices, offset
