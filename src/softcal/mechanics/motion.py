"""Motion of the points by the unknowns: dx = P dz, and the reduction of forces and tangents by P."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.state import State
from softcal.mechanics.term import BlockColumns, LowRank

WEIGHTS_OF_FRAME_LINK = 7  # its weight w, its arm s, and -s

# Half the memory of the default integers, and without a sign, which the loops need not look at.
Numbers = NDArray[np.uint32]


@dataclass(frozen=True)
class Motion:
    """Followers move as dx = sum of w dx_m + w_k dc_k + omega_k x s_k (see `Links`); all other points are free or
    fixed.

    Attributes
    ----------
    layout
        The layout.
    source, weight_a, weight_b, target
        data[target] += data[source] w[weight_a] w[weight_b] folds the side blocks of the tangent into its triangle,
        K_z = P^T K P; w: the nonzeros of P.
    frame_diagonal
        Places of the frames' rotation blocks (n_moving_frames, 3, 3) in `data`, upper triangle.
    """

    layout: Layout
    source: Numbers
    weight_a: Numbers
    weight_b: Numbers
    target: Numbers
    frame_diagonal: Ints

    def reduce_gradient(self, state: State, gradient: Floats) -> Floats:
        """P^T g for a gradient g on all entities (3 n_points + n_pressures,) -> (n_unknowns - n_actuators,)."""
        layout, links = self.layout, self.layout.links
        n = 3 * layout.n_points
        gradient = np.ascontiguousarray(gradient)  # one signature for the kernels: Numba's cache is not safe for two
        forces = gradient[:n].reshape(-1, 3)
        if len(links.follower):
            forces = forces.copy()
            _gather(forces, links.followers, links.follower, links.master, links.weight)
        out = np.empty(layout.first_effort_unknown)
        out[: layout.first_frame_unknown] = forces[layout.free_points].ravel()
        out[layout.first_frame_unknown : layout.first_pressure_unknown] = 0.0
        _gather_frames(
            out[layout.first_frame_unknown :],
            gradient,
            links.followers,
            links.frame_follower,
            links.frame,
            links.frame_weight,
            links.arms(state.rotation),
        )
        out[layout.first_pressure_unknown :] = gradient[n:]
        return out

    def reduce_columns(self, state: State, columns: BlockColumns, n: int) -> Floats:
        """P^T times columns: (n_unknowns - n_actuators, n).

        Parameters
        ----------
        state
            The state.
        columns
            The columns on all entities.
        n
            Number of them.
        """
        out = np.zeros((self.layout.first_effort_unknown, n))
        _reduce_columns(out, *columns, *self._rows, self._weights(state))
        return out

    def reduce_tangent(self, state: State, gradient: Floats, data: Floats) -> None:
        """Fold the side blocks of a tangent into the triangle, and add the change of the forces' moments as the frames
        turn.

        Parameters
        ----------
        state
            The state.
        gradient
            Gradient on all entities (3 n_points + n_pressures,).
        data
            Entries of the tangent, with side blocks, changed.
        """
        links = self.layout.links
        if len(links.followers) == 0:
            return
        _fold(data, self.source, self.weight_a, self.weight_b, self.target, self._weights(state))
        arms = links.arms(state.rotation)
        _turn(data, gradient, links.followers, links.frame_follower, links.frame, arms, self.frame_diagonal)

    def reduce_blocks(
        self, state: State, blocks: Floats, rows: Ints, columns: Ints
    ) -> tuple[Floats, tuple[Ints, Ints]]:
        """P^T K P of a symmetric K: entries (k,) of the upper triangle, and their rows and columns (k,).

        Parameters
        ----------
        state
            The state.
        blocks
            Blocks of K (n, 3, 3) [N/m].
        rows, columns
            Their points (n,), row <= column.
        """
        values, *places = _reduce_blocks(blocks, rows, columns, *self._rows, self._weights(state))
        return values, (places[0], places[1])

    def matrix(self, state: State) -> Any:
        """P itself, sparse, (3 n_points + n_pressures, n_unknowns - n_actuators)."""
        import scipy.sparse as sp

        ptr, unknown, weight = self._rows
        shape = (len(ptr) - 1, self.layout.first_effort_unknown)
        return sp.csr_matrix((self._weights(state)[weight], unknown, ptr), shape=shape)

    def rates(self, state: State, dz: Floats, matrix: Any) -> State:
        """The rates of a state's arrays (dx, dR, ...).

        Parameters
        ----------
        state
            The state.
        dz
            Rates of the unknowns (n_unknowns,).
        matrix
            P there.
        """
        layout, n = self.layout, self.layout.n_moving_frames
        frames = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        position, rotation = np.zeros_like(state.position), np.zeros_like(state.rotation)
        position[:n] = frames[:, :3]
        columns = np.swapaxes(state.rotation[:n], 1, 2)
        rotation[:n] = np.swapaxes(np.cross(frames[:, None, 3:], columns), 1, 2)
        moves = (matrix @ dz[: layout.first_effort_unknown])[: 3 * layout.n_points]
        pressure = dz[layout.first_pressure_unknown : layout.first_effort_unknown]
        return State(moves.reshape(-1, 3), position, rotation, pressure, dz[layout.first_effort_unknown :])

    def _weights(self, state: State) -> Floats:
        """The nonzeros of P: one, the ties' weights, then for every link to a frame its weight and its arm, +- ."""
        links = self.layout.links
        n, of_frames = 1 + len(links.weight), WEIGHTS_OF_FRAME_LINK * len(links.frame)
        weights = np.empty(n + of_frames)
        weights[0], weights[1:n] = 1.0, links.weight
        arms, each = links.arms(state.rotation), weights[n:].reshape(-1, WEIGHTS_OF_FRAME_LINK)
        each[:, 0], each[:, 1:4], each[:, 4:] = links.frame_weight, arms, -arms
        return weights

    @cached_property
    def _rows(self) -> tuple[Ints, Ints, Ints]:
        return _rows(self.layout)


def build_motion(layout: Layout, pattern: Pattern) -> Motion:
    """Plan the reduction for a layout and its pattern."""
    diagonal = np.zeros((layout.n_moving_frames, 3, 3), dtype=np.int64)
    omega = layout.first_frame_unknown + 6 * np.arange(layout.n_moving_frames) + 3
    for i in range(3):
        for j in range(i, 3):
            diagonal[:, i, j] = pattern.entry(omega + i, omega + j)
    source, weight_a, weight_b, target = (part.astype(np.uint32) for part in _folding(layout, pattern))
    return Motion(layout, source, weight_a, weight_b, target, diagonal)


def low_rank_product(motion: Motion, state: State, part: LowRank) -> tuple[Floats, Floats]:
    """Columns and rows (n_unknowns - n_actuators, k) of a product of low rank on the unknowns, by as few as it needs.

    Friction couples every segment of a cable with those before it: a column and a row for each. Of a thousand via
    points in one mesh there need not be as many, but one for each unknown that the cable touches.

    Parameters
    ----------
    motion
        Map from the unknowns to the points.
    state
        The state.
    part
        The product on all entities.
    """
    columns = motion.reduce_columns(state, part.columns, int(part.ptr[-1]))
    spans = [_span(columns[:, a:b]) for a, b in pairwise(part.ptr.tolist())]
    ends = np.cumsum([0, *(basis.shape[1] for basis, _ in spans)])
    mixed = np.zeros((columns.shape[1], np.diff(ends).max()))
    for (_, weights), a, b in zip(spans, part.ptr[:-1], part.ptr[1:], strict=True):
        mixed[a:b, : weights.shape[1]] = weights
    rows = motion.reduce_columns(state, part.rows(mixed, ends), int(ends[-1]))
    return np.hstack([basis for basis, _ in spans]), rows


def _span(columns: Floats) -> tuple[Floats, Floats]:
    """A basis (n, r) of columns (n, m), and the weights (m, r) with columns = basis weights^T: the columns themselves,
    or the unknowns that they touch where these are fewer.
    """
    touched = np.flatnonzero(columns.any(axis=1))
    if len(touched) >= columns.shape[1]:
        return columns, np.eye(columns.shape[1])
    basis = np.zeros((len(columns), len(touched)))
    basis[touched, np.arange(len(touched))] = 1.0
    return basis, columns[touched].T


def _rows(layout: Layout) -> tuple[Ints, Ints, Ints]:
    """P by rows: row 3 p + i of point p, then one per pressure: ptr, unknown, number of the weight."""
    links = layout.links
    n_free, n_points = len(layout.free_points), layout.n_points
    number = np.full(n_points, -1, dtype=np.int64)
    number[layout.free_points] = np.arange(n_free)
    row: list[Ints] = []
    unknown: list[Ints] = []
    weight: list[Ints] = []

    def add(rows: Ints, unknowns: Ints, weights: Ints) -> None:
        row.append(rows)
        unknown.append(unknowns)
        weight.append(weights)

    of_frame = 1 + len(links.follower) + WEIGHTS_OF_FRAME_LINK * np.arange(len(links.frame))
    at = layout.first_frame_unknown + 6 * links.frame
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3  # (omega x s)_i = omega_j s_k - omega_k s_j
        add(3 * layout.free_points + i, 3 * np.arange(n_free) + i, np.zeros(n_free, dtype=np.int64))
        add(
            3 * links.followers[links.follower] + i,
            3 * number[links.master] + i,
            1 + np.arange(len(links.follower)),
        )
        rows = 3 * links.followers[links.frame_follower] + i
        add(rows, at + i, of_frame)
        add(rows, at + 3 + j, of_frame + 1 + k)
        add(rows, at + 3 + k, of_frame + 4 + j)
    scalars = np.arange(layout.n_pressures)
    add(3 * n_points + scalars, layout.first_pressure_unknown + scalars, np.zeros_like(scalars))
    rows = np.concatenate(row)
    order = np.argsort(rows, kind="stable")
    ptr = np.searchsorted(rows[order], np.arange(3 * n_points + layout.n_pressures + 1))
    return ptr, np.concatenate(unknown)[order], np.concatenate(weight)[order]


def _folding(layout: Layout, pattern: Pattern) -> tuple[Ints, Ints, Ints, Ints]:
    """The lists (source, weight_a, weight_b, target) of `Motion`."""
    a, b = pattern.side_pairs.T
    if len(a) == 0:
        empty = np.zeros(0, dtype=np.int64)
        return empty, empty, empty, empty
    ptr, unknown, weight = _rows(layout)
    start = pattern.pair(a, b)
    n_points = layout.n_points
    parts: list[tuple[Ints, Ints, Ints, Ints]] = []
    for i in range(3):
        for j in range(3):
            same = a == b
            ok = ((a < n_points) | (i == 0)) & ((b < n_points) | (j == 0)) & (~same | (j >= i))
            row_a = np.where(a < n_points, 3 * a + i, 2 * n_points + a)[ok]
            row_b = np.where(b < n_points, 3 * b + j, 2 * n_points + b)[ok]
            n_b = ptr[row_b + 1] - ptr[row_b]
            count = (ptr[row_a + 1] - ptr[row_a]) * n_b
            pair = np.repeat(np.arange(len(count)), count)
            within = np.arange(len(pair)) - np.repeat(np.cumsum(count) - count, count)
            first, second = np.divmod(within, np.maximum(n_b[pair], 1))
            at_a, at_b = ptr[row_a][pair] + first, ptr[row_b][pair] + second
            ua, ub = unknown[at_a], unknown[at_b]
            source = (start[ok, i] + j)[pair]
            # An off-diagonal entry represents its mirror image too.
            mirrored = ~(same[ok][pair] & (i == j))
            low, high = np.minimum(ua, ub), np.maximum(ua, ub)
            target = pattern.entry(low, high)
            keep = mirrored | (ua <= ub)
            twice = mirrored & (ua == ub)
            parts += [(source[m], weight[at_a][m], weight[at_b][m], target[m]) for m in (keep, twice)]
    lists = [np.concatenate(part) for part in zip(*parts, strict=True)]
    order = np.argsort(lists[3], kind="stable")
    return lists[0][order], lists[1][order], lists[2][order], lists[3][order]


@kernel(error_model="numpy")
def _fold(data: Floats, source: Numbers, weight_a: Numbers, weight_b: Numbers, target: Numbers, w: Floats) -> None:
    k = 0
    while k < len(target):  # sorted: the sum at each one is kept in a register
        at, total = target[k], data[target[k]]
        while k < len(target) and target[k] == at:
            total += data[source[k]] * w[weight_a[k]] * w[weight_b[k]]
            k += 1
        data[at] = total


@kernel(error_model="numpy")
def _reduce_columns(  # noqa: PLR0913 (a kernel takes arrays)
    out: Floats,
    rows: Ints,
    basis: Ints,
    values: Floats,
    weights: Floats,
    first: Ints,
    end: Ints,
    ptr: Ints,
    unknown: Ints,
    weight: Ints,
    w: Floats,
) -> None:
    for n in range(len(rows)):
        j = basis[n]
        for k in range(ptr[rows[n]], ptr[rows[n] + 1]):
            value = values[n] * w[weight[k]]
            for i in range(end[j] - first[j]):
                out[unknown[k], first[j] + i] += value * weights[j, i]


@kernel(error_model="numpy")
def _reduce_blocks(
    blocks: Floats, rows: Ints, columns: Ints, ptr: Ints, unknown: Ints, weight: Ints, w: Floats
) -> tuple[Floats, Ints, Ints]:
    """See `Motion.reduce_blocks`."""
    size = 0
    for n in range(len(rows)):
        p, q = 3 * rows[n], 3 * columns[n]
        size += (ptr[p + 3] - ptr[p]) * (ptr[q + 3] - ptr[q])
    values, row, column = np.empty(size), np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    count = 0
    for n in range(len(rows)):
        for i in range(3):
            for a in range(ptr[3 * rows[n] + i], ptr[3 * rows[n] + i + 1]):
                for j in range(3):
                    for b in range(ptr[3 * columns[n] + j], ptr[3 * columns[n] + j + 1]):
                        u, v = unknown[a], unknown[b]
                        value = blocks[n, i, j] * w[weight[a]] * w[weight[b]]
                        if rows[n] == columns[n]:
                            if u > v:
                                continue
                        elif u == v:  # a block represents its mirror image too
                            value *= 2.0
                        values[count], row[count], column[count] = value, min(u, v), max(u, v)
                        count += 1
    return values[:count], row[:count], column[:count]


@kernel(error_model="numpy")
def _gather(forces: Floats, followers: Ints, follower: Ints, master: Ints, weight: Floats) -> None:
    """Forces of tied points on their masters."""
    for n in range(len(follower)):
        p, m = followers[follower[n]], master[n]
        for i in range(3):
            forces[m, i] += weight[n] * forces[p, i]


@kernel(error_model="numpy")
def _gather_frames(
    out: Floats, gradient: Floats, followers: Ints, follower: Ints, frame: Ints, weight: Floats, arms: Floats
) -> None:
    """Forces and moments of the followers on their frames."""
    for n in range(len(frame)):
        p, k, w = followers[follower[n]], frame[n], weight[n]
        f0, f1, f2 = gradient[3 * p], gradient[3 * p + 1], gradient[3 * p + 2]
        r0, r1, r2 = arms[n, 0], arms[n, 1], arms[n, 2]
        out[6 * k] += w * f0
        out[6 * k + 1] += w * f1
        out[6 * k + 2] += w * f2
        out[6 * k + 3] += r1 * f2 - r2 * f1
        out[6 * k + 4] += r2 * f0 - r0 * f2
        out[6 * k + 5] += r0 * f1 - r1 * f0


@kernel(error_model="numpy")
def _turn(
    data: Floats, gradient: Floats, followers: Ints, follower: Ints, frame: Ints, arms: Floats, diagonal: Ints
) -> None:
    """d2/domega2 of f . exp(omega) s at zero: (s f^T + f s^T)/2 - (f . s) I."""
    for n in range(len(frame)):
        p, k = followers[follower[n]], frame[n]
        fs = 0.0
        for i in range(3):
            fs += gradient[3 * p + i] * arms[n, i]
        for i in range(3):
            for j in range(i, 3):
                h = 0.5 * (arms[n, i] * gradient[3 * p + j] + gradient[3 * p + i] * arms[n, j])
                data[diagonal[k, i, j]] += h - fs if i == j else h
