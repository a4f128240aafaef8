"""The segments of polylines through weighted points, |sum_s sigma_s x_s|: lengths, with first and second derivatives.

A segment's ends may be points or weighted sums of points (a via point inside a tet), so a segment is a list of entities
with signed weights sigma_s.

Two neighbouring via points that the cable pulls onto each other have *met*: below the length `MET` the segment length
|v| is replaced by a smooth function with a minimum, so that they can transmit any force between them up to the tension.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.kernel import kernel
from softcal.mechanics.layout import FIXED, Layout
from softcal.mechanics.pattern import Pattern

MET = 1e-3  # of a segment's length at rest: below it the segment's ends have met


@dataclass(frozen=True)
class SegmentPlaces:
    """Places of the segments' blocks in the tangent's long array.

    Attributes
    ----------
    pairs
        Place of each row of each block (n_pairs, 3).
    pair_ptr
        The blocks of segment k are pairs[pair_ptr[k]:pair_ptr[k+1]] (n_segments + 1,).
    moves
        Whether a point of a segment can move (n_segments,).
    """

    pairs: Ints
    pair_ptr: Ints
    moves: np.ndarray


class SegmentShape(NamedTuple):
    """Segments at some positions.

    Attributes
    ----------
    v
        Vectors (n_segments, 3) [m].
    lengths
        Lengths (n_segments,) [m].
    slopes
        d length / d vector (n_segments, 3).
    first, second
        a, b (n_segments,) of the length's gradient a v and second derivative a I - b v v^T.
    """

    v: Floats
    lengths: Floats
    slopes: Floats
    first: Floats
    second: Floats


UNPLANNED = SegmentPlaces(np.zeros((0, 3), dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=bool))


@dataclass(frozen=True)
class EndMotion:
    """Rates of segments' vectors by a parameter that moves their ends on what carries them.

    Attributes
    ----------
    cable
        Number of the cable.
    segment, support, rate
        The segments, the points and the rates [1/m] of their weights in the segments' vectors (n_entries,).
    rest
        d length at rest / d parameter (n_segments,) [-].
    """

    cable: int
    segment: Ints
    support: Ints
    rate: Floats
    rest: Floats

    def vectors(self, x: Floats) -> Floats:
        """d segment vectors / d parameter (n_segments, 3), with the points at x (n_points, 3) [m] fixed."""
        out = np.zeros((len(self.rest), 3))
        _spread(out, self.segment, self.rate, x[self.support])
        return out


@dataclass(frozen=True)
class Segments:
    """Segments of polylines.

    Attributes
    ----------
    ptr
        The entries of segment k are ptr[k]:ptr[k+1] (n_segments + 1,).
    support
        Points of the segments (n_entries,), ascending in each.
    sigma
        Their signed weights (n_entries,) [-].
    met
        Length below which a segment's ends have met (n_segments,) [m].
    places
        Places of the blocks in the tangent.
    """

    ptr: Ints
    support: Ints
    sigma: Floats
    met: Floats
    places: SegmentPlaces = field(default=UNPLANNED)

    def __len__(self) -> int:
        return len(self.ptr) - 1

    @cached_property
    def of_entry(self) -> Ints:
        """The segment of each entry (n_entries,)."""
        return np.repeat(np.arange(len(self)), np.diff(self.ptr))

    @property
    def points(self) -> list[Ints]:
        """Points of each segment (1, k)."""
        return [self.support[None, self.ptr[k] : self.ptr[k + 1]] for k in range(len(self))]

    def plan(self, layout: Layout, pattern: Pattern) -> Segments:
        """The segments with the places of their blocks in the tangent."""
        blocks = [pattern.blocks(segment)[0] for segment in self.points]
        ptr = np.cumsum([0, *(len(pairs) for pairs in blocks)])
        can_move = (layout.rider != FIXED) & (layout.rider < layout.n_moving_frames)
        moves = np.array([can_move[segment].any() for segment in self.points], dtype=bool)
        return replace(self, places=SegmentPlaces(np.concatenate([UNPLANNED.pairs, *blocks]), ptr, moves))

    def vectors(self, x: Floats) -> Floats:
        """Segment vectors (n_segments, 3) [m]."""
        return self.shape(x).v

    def shape(self, x: Floats) -> SegmentShape:
        """Vectors and lengths at positions x, and how these change."""
        n = len(self)
        shape = SegmentShape(np.zeros((n, 3)), np.empty(n), np.empty((n, 3)), np.empty(n), np.empty(n))
        _shape(np.ascontiguousarray(x), self.ptr, self.support, self.sigma, self.met, *shape)
        return shape

    def lengths_by(self, motion: EndMotion, x: Floats, shape: SegmentShape) -> Floats:
        """d length / d parameter of a motion of the segments' ends (n_segments,).

        Parameters
        ----------
        motion
            The motion.
        x
            Positions of the points, which stay (n_points, 3) [m].
        shape
            Vectors and lengths there.
        """
        return (shape.slopes * motion.vectors(x)).sum(axis=1)

    def pull(self, shape: SegmentShape, tension: Floats, gradient: Floats, data: Floats | None) -> None:
        """Add the forces of tensions to the gradient, and on demand T times the lengths' second derivatives to the
        tangent.

        Parameters
        ----------
        shape
            Vectors and lengths.
        tension
            Tensions T of the segments (n_segments,) [N].
        gradient
            Gradient on all entities, changed.
        data
            Entries of the tangent, changed; None: not wanted.
        """
        if len(self) == 0:
            return
        _add(
            gradient,
            np.zeros(0) if data is None else data,
            data is not None,
            shape.v,
            shape.first,
            shape.second,
            self.ptr,
            self.support,
            self.sigma,
            tension,
            self.places.pairs,
            self.places.pair_ptr,
        )

    def gradient(self, shape: SegmentShape, weights: Floats, size: int) -> Floats:
        """Sum of the lengths' gradients with weights, on all entities (size,).

        Parameters
        ----------
        shape
            Vectors and lengths.
        weights
            Weights of the segments (n_segments,).
        size
            Number of the entities' components.
        """
        gradient = np.zeros(size)
        _spread(_of_points(gradient), self.support, self.sigma, (weights[:, None] * shape.slopes)[self.of_entry])
        return gradient

    def gradient_by(self, motion: EndMotion, x: Floats, shape: SegmentShape, tension: Floats, size: int) -> Floats:
        """d / d parameter of a motion of the gradient (size,) that tensions give.

        Parameters
        ----------
        motion
            The motion.
        x
            Positions of the points (n_points, 3) [m].
        shape
            Vectors and lengths there.
        tension
            Tensions of the segments (n_segments,) [N].
        size
            Number of the entities' components.
        """
        gradient = np.zeros(size)
        dv = motion.vectors(x)
        along = shape.second * (shape.v * dv).sum(axis=1)
        turned = shape.first[:, None] * dv - along[:, None] * shape.v
        points = _of_points(gradient)
        _spread(points, motion.support, motion.rate, (tension[:, None] * shape.slopes)[motion.segment])
        _spread(points, self.support, self.sigma, (tension[:, None] * turned)[self.of_entry])
        return gradient

    def basis(self, order: Ints) -> tuple[Ints, Ints, Floats]:
        """Component, basis column and weight (n_entries,) of the gradients of the vectors' components: column 3 j + i
        is that of component i of segment order[j]. Of segments that can move.
        """
        place = np.empty(len(order), dtype=np.int64)
        place[order] = np.arange(len(order))
        entry = np.flatnonzero(self.places.moves[self.of_entry])
        rows = 3 * self.support[entry, None] + np.arange(3)
        columns = 3 * place[self.of_entry[entry], None] + np.arange(3)
        return rows.ravel(), columns.ravel(), np.repeat(self.sigma[entry], 3)


def _of_points(gradient: Floats) -> Floats:
    """The entries of points in a gradient, by axis (n, 3)."""
    return gradient[: 3 * (len(gradient) // 3)].reshape(-1, 3)


@kernel(error_model="numpy")
def _spread(into: Floats, at: Ints, weights: Floats, vectors: Floats) -> None:
    """Add weights (n_entries,) times vectors (n_entries, 3) at rows of `into`."""
    for n in range(len(at)):
        for i in range(3):
            into[at[n], i] += weights[n] * vectors[n, i]


@kernel(error_model="numpy")
def _shape(
    x: Floats,
    ptr: Ints,
    support: Ints,
    sigma: Floats,
    met: Floats,
    v: Floats,
    lengths: Floats,
    slopes: Floats,
    first: Floats,
    second: Floats,
) -> None:
    """Write a `SegmentShape`."""
    for k in range(len(met)):
        for s in range(ptr[k], ptr[k + 1]):
            for i in range(3):
                v[k, i] += sigma[s] * x[support[s], i]
        square = v[k, 0] ** 2 + v[k, 1] ** 2 + v[k, 2] ** 2
        least = max(np.sqrt(square), met[k])
        part = square / least**2
        lengths[k] = least * (3.0 + part * (6.0 - part)) / 8.0
        first[k], second[k] = (1.5 - 0.5 * part) / least, 1.0 / least**3
        for i in range(3):
            slopes[k, i] = first[k] * v[k, i]


@kernel(error_model="numpy")
def _add(
    gradient: Floats,
    data: Floats,
    with_tangent: bool,
    v: Floats,
    first: Floats,
    second: Floats,
    ptr: Ints,
    support: Ints,
    sigma: Floats,
    tension: Floats,
    pairs: Ints,
    pair_ptr: Ints,
) -> None:
    B = np.empty((3, 3))
    for k in range(len(tension)):
        T = tension[k]
        n = first[k] * v[k]
        for s in range(ptr[k], ptr[k + 1]):
            for i in range(3):
                gradient[3 * support[s] + i] += T * sigma[s] * n[i]
        if not with_tangent:
            continue
        for i in range(3):
            for j in range(3):
                B[i, j] = ((first[k] if i == j else 0.0) - second[k] * v[k, i] * v[k, j]) * T
        m = pair_ptr[k]
        for s in range(ptr[k], ptr[k + 1]):
            for t in range(s, ptr[k + 1]):
                for i in range(3):
                    for j in range(i if s == t else 0, 3):
                        data[pairs[m, i] + j] += sigma[s] * sigma[t] * B[i, j]
                m += 1
