"""The sparsity of the tangent, planned once.

One long array `data` holds, one after the other: the upper triangle of the symmetric tangent on the unknowns z
(compressed rows, input of the factorisation); *side* blocks for pairs of entities of which at least one follows others;
and a waste slot for pairs with a fixed point. Terms add straight into `data`; `Motion.reduce` then folds the side
blocks into the triangle by the frames' present rotations. So nothing is sorted, searched or copied in a Newton
iteration.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout


@dataclass(frozen=True)
class Triangle:
    """Upper triangle of a symmetric matrix on unknowns, in compressed rows.

    Attributes
    ----------
    indptr, indices
        Where the rows begin (n_unknowns + 1,), and the columns, ascending (nnz,).
    """

    indptr: Ints
    indices: Ints

    @cached_property
    def rows(self) -> Ints:
        """The row of every entry (nnz,)."""
        return np.repeat(np.arange(len(self.indptr) - 1), np.diff(self.indptr))

    @cached_property
    def entries(self) -> Ints:
        """Row times the number of unknowns, plus column, of every entry (nnz,), ascending."""
        return self.rows * np.int64(len(self.indptr) - 1) + self.indices


@dataclass(frozen=True)
class Pattern(Triangle):
    """Places of the tangent's entries in the long array `data`.

    Attributes
    ----------
    nnz, size
        Number of entries of the triangle, and of the whole array.
    keys
        Pairs of entities (a, b), a <= b, as a * n_entities + b, ascending (n_pairs,).
    start
        `start[k, i] + j` is the place of entry (i, j) of pair k's block (n_pairs, 3), j >= i where the pair is an
        entity with itself.
    side_pairs
        Pairs of entities of the side blocks (n, 2), in the order of their storage from nnz on.
    n_entities
        Number of entities.
    """

    nnz: int
    size: int
    keys: Ints
    start: Ints
    side_pairs: Ints
    n_entities: int

    def pair(self, a: Ints, b: Ints) -> Ints:
        """Start positions (..., 3) of the pairs (a, b), a <= b.

        Raises
        ------
        LookupError
            Where the pattern was planned without such a pair.
        """
        return self.start[_found(self.keys, a * np.int64(self.n_entities) + b)]

    def blocks(self, conn: Ints) -> Ints:
        """Start positions (n, k (k + 1) / 2, 3) of the pairs within groups of entities (n, k), rows ascending."""
        i, j = np.triu_indices(conn.shape[1])
        return self.pair(conn[:, i], conn[:, j])

    def entry(self, alpha: Ints, beta: Ints) -> Ints:
        """Places in `data` of the tangent's entries (alpha, beta), alpha <= beta, by numbers of unknowns."""
        return _found(self.entries, alpha * np.int64(len(self.indptr) - 1) + beta)


def build_pattern(layout: Layout, connectivities: list[Ints], frame_pairs: Ints) -> Pattern:
    """The pattern of the tangent of several terms.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    connectivities
        Entities that terms connect (n, k), each with ascending rows.
    frame_pairs
        Moving frames that terms connect with each other (n, 2).
    """
    n = np.int64(layout.n_entities)
    parts = []
    for conn in connectivities:
        i, j = np.triu_indices(conn.shape[1])
        parts.append(ascending((conn[:, i] * n + conn[:, j]).ravel()))
    keys = ascending(np.concatenate([*parts, np.arange(n) * (n + 1)]))
    a, b = keys // n, keys % n

    # Entities of the reduced problem: free points, frames, scalars, in the order of their unknowns.
    free = layout.free_points
    n_free, n_frames = len(free), layout.n_moving_frames
    sizes = np.concatenate([np.full(n_free, 3), np.full(n_frames, 6), np.ones(layout.n_pressures, int)])
    sizes = sizes.astype(np.int64)
    first = np.concatenate([[0], np.cumsum(sizes)])
    n_red = np.int64(len(sizes))
    reduced = np.full(n, -1, dtype=np.int64)
    reduced[free] = np.arange(n_free)
    reduced[layout.n_points :] = n_free + n_frames + np.arange(layout.n_pressures)

    links = layout.links
    follows = np.zeros(n, dtype=bool)
    follows[links.followers[np.concatenate([links.follower, links.frame_follower])]] = True
    moving = ((reduced[a] >= 0) | follows[a]) & ((reduced[b] >= 0) | follows[b])
    side = moving & (follows[a] | follows[b])
    direct = moving & ~side
    red_keys = ascending(
        np.concatenate(
            [
                reduced[a[direct]] * n_red + reduced[b[direct]],
                _side_keys(layout, reduced, a[side], b[side], n_red),
                n_free * (n_red + 1) + frame_pairs.min(axis=1) * n_red + frame_pairs.max(axis=1),
                np.arange(n_red) * (n_red + 1),
            ]
        )
    )
    red_row, red_col = red_keys // n_red, red_keys % n_red
    red_ptr = np.searchsorted(red_row, np.arange(n_red + 1))
    indptr, indices, offset = _expand(red_ptr, red_col, sizes, first)
    nnz = int(indptr[-1])

    # Where each pair's rows start.
    entity_size = np.ones(n, dtype=np.int64)
    entity_size[: layout.n_points] = 3
    start = np.zeros((len(keys), 3), dtype=np.int64)
    k = np.searchsorted(red_keys, reduced[a[direct]] * n_red + reduced[b[direct]])
    for i in range(3):
        row = first[reduced[a[direct]]] + np.minimum(i, entity_size[a[direct]] - 1)
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


def ascending(keys: Ints) -> Ints:
    """The distinct keys, ascending; `np.unique` hashes them, which takes a hundred times as long."""
    ordered = np.sort(keys, kind="stable")  # four to twenty times as fast, of keys that ascend for the most part
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if len(keys) else ordered


def _side_keys(layout: Layout, reduced: Ints, a: Ints, b: Ints, n_red: np.int64) -> Ints:
    """Keys of the reduced pairs that pairs (a, b) of entities, at least one of which follows, spread over."""
    import scipy.sparse as sp

    links = layout.links
    n, n_free = layout.n_entities, len(layout.free_points)
    own = np.flatnonzero(reduced >= 0)
    rows = np.concatenate([own, links.followers[links.follower], links.followers[links.frame_follower]])
    columns = np.concatenate([reduced[own], reduced[links.master], n_free + links.frame])
    spread = sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, int(n_red)))
    pairs = sp.csr_matrix((np.ones(len(a)), (a, b)), shape=(n, n))
    reached = (spread.T @ pairs @ spread).tocoo()
    low, high = np.minimum(reached.row, reached.col), np.maximum(reached.row, reached.col)
    return low.astype(np.int64) * n_red + high


def _found(keys: Ints, wanted: Ints) -> Ints:
    """Places in ascending keys."""
    k = np.searchsorted(keys, wanted)
    if not np.array_equal(keys[np.minimum(k, len(keys) - 1)], wanted):
        raise LookupError("No term of this pattern connects what is looked up.")
    return k


@kernel()
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


@kernel(error_model="numpy")
def add_products(indptr: Ints, indices: Ints, data: Floats, x: Floats, out: Floats) -> None:
    """Add to rows of `out` the products of a symmetric matrix with rows of x.

    Parameters
    ----------
    indptr, indices, data
        The upper triangle of the matrix in compressed rows (n + 1,), (nnz,), (nnz,).
    x
        Rows (k, n).
    out
        Rows (k, n), changed.
    """
    for k in range(len(x)):
        for i in range(len(indptr) - 1):
            x_i, own = x[k, i], 0.0
            for place in range(indptr[i], indptr[i + 1]):
                j, value = indices[place], data[place]
                own += value * x[k, j]
                if j != i:
                    out[k, j] += value * x_i
            out[k, i] += own
