"""Cables: polylines through points, with a tension as multiplier of a prescribed length.

    Pi_c = -T (q - d),   q = L0 - L,   L = sum over segments of |sum_s sigma_s x_s|

A segment's ends may be points or weighted sums of points (a via point inside a tet), so a segment is a list of entities
with signed weights sigma_s. As an actuator its coordinate is its shortening q, its effort the tension T.

Two neighbouring via points that the cable pulls onto each other have *met*: below the length `MET` the segment length
|v| is replaced by a smooth function with a minimum, so that they can transmit any force between them up to the tension.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numba
import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.actuator import NO_GAP, Actuator, ActuatorTerm
from softcal.mechanics.cable_friction import CapstanLoss, factor_rates, friction_loss, loss_border
from softcal.mechanics.layout import FIXED, Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.term import Connectivity, Given, Sum, Theta

if TYPE_CHECKING:
    from softcal.mechanics.system import System

MET = 1e-3  # of a segment's length at rest: below it the segment's ends have met


@dataclass(frozen=True)
class CablePlaces:
    """Places of the segments' blocks in the tangent's long array.

    Attributes
    ----------
    pairs
        Place of each row of each block (n_pairs, 3).
    pair_ptr
        The blocks of segment k are pairs[pair_ptr[k]:pair_ptr[k+1]] (n_segments + 1,).
    moves
        Whether a point can move (n_points,).
    """

    pairs: Ints
    pair_ptr: Ints
    moves: np.ndarray


UNPLANNED = CablePlaces(np.zeros((0, 3), dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(0, dtype=bool))


@dataclass(frozen=True)
class CableTerm(ActuatorTerm):
    """Segments of all cables.

    Attributes
    ----------
    names
        Names of the cables (n_cables,).
    ptr
        The entries of segment k are ptr[k]:ptr[k+1] (n_segments + 1,).
    support
        Points of the segments (n_entries,), ascending in each.
    sigma
        Their signed weights (n_entries,) [-].
    cable
        Cable of each segment (n_segments,).
    rest_length
        Length of each cable at rest (n_cables,) [m].
    pulled_last
        Whether the tension is that of the last segment, or else of the first (n_cables,): matters with friction.
    met
        Length below which a segment's ends have met (n_segments,) [m].
    by_offset
        d sigma / d routing offset of the own cable (n_entries,) [1/m].
    rest_by_offset
        d rest_length / d routing offset (n_cables,) [-].
    places
        Places of the blocks in the tangent.
    """

    names: tuple[str, ...]
    ptr: Ints
    support: Ints
    sigma: Floats
    cable: Ints
    rest_length: Floats
    pulled_last: np.ndarray
    met: Floats
    by_offset: Floats
    rest_by_offset: Floats
    places: CablePlaces = UNPLANNED

    @property
    def n_cables(self) -> int:
        return len(self.rest_length)

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(f"{name}.{of}" for name in self.names for of in ("friction_coefficient", "routing_offset"))

    def connectivity(self, layout: Layout) -> Connectivity:
        """The points of each segment."""
        return Connectivity(self._segments())

    def plan(self, layout: Layout, pattern: Pattern) -> CableTerm:
        blocks = [pattern.blocks(segment)[0] for segment in self._segments()]
        ptr = np.cumsum([0, *(len(pairs) for pairs in blocks)])
        moves = (layout.rider != FIXED) & (layout.rider < layout.n_moving_frames)
        return replace(self, places=CablePlaces(np.concatenate([UNPLANNED.pairs, *blocks]), ptr, moves))

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        return tuple(Actuator(name, "shortening", "tension", least_effort=0.0) for name in self.names)

    def coordinates(self, x: Floats) -> Floats:
        """The shortening of each cable (n_cables,) [m]."""
        return self.rest_length - self.lengths(x)

    def coordinate_gradient(self, x: Floats, i: int, size: int) -> Floats:
        return -self.length_gradient(x, i, size)

    def losses(self, x: Floats, theta: Theta) -> CapstanLoss | None:
        loss = self.loss(x, theta)
        return loss if len(loss.mu) else None

    def add_forces(self, x: Floats, effort: Floats, into: Sum, lost: CapstanLoss | None) -> None:
        self.pull(x, effort[self.cable] * (1.0 if lost is None else lost.factor), into.full, into.data)

    def force_gradient(self, x: Floats, i: int, size: int, lost: CapstanLoss | None) -> Floats:
        return self.length_gradient(x, i, size, 1.0 if lost is None else lost.factor)

    def add_losses(self, into: Sum, given: Given, lost: CapstanLoss) -> None:
        x, tension = given.state.x, given.state.effort[self.own]
        columns, rows = loss_border(self, x, lost, tension, self.places.moves, len(into.full))
        into.rank_one.extend(zip(columns.T, rows.T, strict=True))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if into.keys().isdisjoint(self.parameters):
            return
        x, loss = given.state.x, self.loss(given.state.x, given.theta, by_all=True)
        for i, name in enumerate(self.names):
            tension = np.where(self.cable == i, given.state.effort[self.first + i], 0.0)
            if (one := into.get(f"{name}.friction_coefficient")) is not None:
                one.full += self.segment_gradient(x, tension * loss.by_mu, len(one.full))
            if (one := into.get(f"{name}.routing_offset")) is not None:
                rates = factor_rates(loss, self.vectors_by_offset(x))
                one.full += self.gradient_by_offset(x, tension * loss.factor, tension * rates, len(one.full))
                if not given.controls.is_held[self.first + i]:
                    one.efforts[self.first + i] -= self.shortening_by_offset(x)[i]

    def vectors(self, x: Floats) -> Floats:
        """Segment vectors (n_segments, 3) [m]."""
        return np.add.reduceat(self.sigma[:, None] * x[self.support], self.ptr[:-1], axis=0)

    def vectors_by_offset(self, x: Floats) -> Floats:
        """d segment vectors / d routing offset of their cable (n_segments, 3), with the supporting points fixed."""
        return np.add.reduceat(self.by_offset[:, None] * x[self.support], self.ptr[:-1], axis=0)

    def lengths_by_offset(self, x: Floats) -> Floats:
        """d length of each cable / d its routing offset (n_cables,), with the supporting points fixed."""
        by_offset = np.zeros(self.n_cables)
        if len(self.cable):
            v = self.vectors(x)
            first, _ = _rates(v, self.met)
            np.add.at(by_offset, self.cable, first * (v * self.vectors_by_offset(x)).sum(axis=1))
        return by_offset

    def shortening_by_offset(self, x: Floats) -> Floats:
        """d shortening of each cable / d its routing offset (n_cables,), at fixed unknowns."""
        return self.rest_by_offset - self.lengths_by_offset(x)

    def lengths(self, x: Floats) -> Floats:
        """Length of each cable (n_cables,) [m]."""
        if len(self.cable) == 0:
            return np.zeros(self.n_cables)
        lengths: Floats = np.zeros(self.n_cables)
        apart = np.linalg.norm(self.vectors(x), axis=1)
        least = np.maximum(apart, self.met)
        square = (apart / least) ** 2
        np.add.at(lengths, self.cable, least * (3.0 + square * (6.0 - square)) / 8.0)
        return lengths

    def coordinate_tolerances(self, extent: float) -> Floats:
        return NO_GAP * self.rest_length

    def is_reversed(self, before: Floats, x: Floats) -> bool:
        """Whether one of the segments is."""
        return len(self.cable) > 0 and bool(np.any((self.vectors(before) * self.vectors(x)).sum(axis=1) < 0.0))

    def at_limit(self, x: Floats) -> str:
        """The via points that have met, as part of a sentence; "" where none have."""
        if len(self.cable) == 0:
            return ""
        now = np.linalg.norm(self.vectors(x), axis=1)
        pairs = [
            f"via points {number} and {number + 1} of {self.names[self.cable[k]]} have met "
            f"({1e3 * now[k]:.2g} mm apart, {1e3 * self.met[k] / MET:.4g} mm at rest)"
            for k in np.flatnonzero(now < 1.5 * self.met)
            for number in [k - int(np.searchsorted(self.cable, self.cable[k])) + 1]
        ]
        return ", ".join(pairs)

    def pull(self, x: Floats, segment_tension: Floats, gradient: Floats, data: Floats | None) -> None:
        """Add the forces of the tensions to the gradient and, where `data` is given, T times the length's second
        derivative.
        """
        if len(self.cable) == 0:
            return
        v = self.vectors(x)
        _add(
            gradient,
            np.zeros(0) if data is None else data,
            data is not None,
            v,
            *_rates(v, self.met),
            self.ptr,
            self.support,
            self.sigma,
            segment_tension,
            self.places.pairs,
            self.places.pair_ptr,
        )

    def length_gradient(self, x: Floats, i_cable: int, size: int, factor: Floats | float = 1.0) -> Floats:
        """dL/dx of one cable on all entities (size,); factor (n_segments,): of the tension along it."""
        return self.segment_gradient(x, np.where(self.cable == i_cable, factor, 0.0), size)

    def segment_gradient(self, x: Floats, weights: Floats, size: int) -> Floats:
        """Sum of weights (n_segments,) times the segments' length gradients, on all entities (size,)."""
        gradient = np.zeros(size)
        v = self.vectors(x)
        first, _ = _rates(v, self.met)
        for k in np.flatnonzero(weights):
            n = weights[k] * first[k] * v[k]
            for s in range(self.ptr[k], self.ptr[k + 1]):
                at = 3 * self.support[s]
                gradient[at : at + 3] += self.sigma[s] * n
        return gradient

    def gradient_by_offset(self, x: Floats, tension: Floats, tension_rate: Floats, size: int) -> Floats:
        """d / d routing offset of the gradient (size,) that segment tensions (n_segments,) [N] give.

        tension_rate (n_segments,) [N/m]: the tensions' own derivative.
        """
        gradient = np.zeros(size)
        v, dv = self.vectors(x), self.vectors_by_offset(x)
        first, second = _rates(v, self.met)
        for k in np.flatnonzero((tension != 0.0) | (tension_rate != 0.0)):
            n = first[k] * v[k]
            turned = first[k] * dv[k] - second[k] * (v[k] @ dv[k]) * v[k]
            for s in range(self.ptr[k], self.ptr[k + 1]):
                at = 3 * self.support[s]
                gradient[at : at + 3] += self.by_offset[s] * tension[k] * n
                gradient[at : at + 3] += self.sigma[s] * (tension[k] * turned + tension_rate[k] * n)
        return gradient

    def loss(self, x: Floats, theta: Theta, *, by_all: bool = False) -> CapstanLoss:
        """The friction losses of the tensions."""
        mu = np.array([theta[f"{name}.friction_coefficient"] for name in self.names])
        return friction_loss(self, x, mu, by_all=by_all)

    def _segments(self) -> list[Ints]:
        """Points of each segment (1, k)."""
        return [self.support[None, self.ptr[k] : self.ptr[k + 1]] for k in range(len(self.cable))]


def cables_of(system: System) -> CableTerm:
    """The cables of a system, for callers that need cables."""
    return system.of(CableTerm)[0]


Weights = list[tuple[int, float]]


def build_cables(
    X: Floats,
    supports: dict[str, list[Weights]],
    pulled_last: np.ndarray,
    by_offset: dict[str, list[Weights]] | None = None,
) -> CableTerm:
    """The term of cables given, by name and via point, as weighted points [(point, weight), ...].

    The rest length is the polyline's on the undeformed robot, X (n_points, 3) [m]. by_offset, of cables that have a
    routing offset: its via points' derivatives by that, as points with weights [1/m] whose sum is zero.
    """
    ptr, support, sigma, rates, cable = [0], [], [], [], []
    for c, (name, via) in enumerate(supports.items()):
        moves = (by_offset or {}).get(name) or [[] for _ in via]
        for ends, ways in zip(pairwise(via), pairwise(moves), strict=True):
            weights, changes = _difference(*ends), _difference(*ways)
            points = sorted(weights | changes)
            support.extend(points)
            sigma.extend(weights.get(p, 0.0) for p in points)
            rates.extend(changes.get(p, 0.0) for p in points)
            ptr.append(len(support))
            cable.append(c)
    term = CableTerm(
        tuple(supports),
        np.array(ptr, dtype=np.int64),
        np.array(support, dtype=np.int64),
        np.array(sigma, dtype=np.float64),
        np.array(cable, dtype=np.int64),
        np.zeros(len(supports)),
        pulled_last,
        np.zeros(len(cable)),
        np.array(rates, dtype=np.float64),
        np.zeros(len(supports)),
    )
    met = MET * np.linalg.norm(term.vectors(X), axis=1) if cable else term.met
    return replace(term, rest_length=term.lengths(X), met=met, rest_by_offset=term.lengths_by_offset(X))


def _difference(start: Weights, end: Weights) -> dict[int, float]:
    """The weights of the vector from one weighted point to another."""
    weights: dict[int, float] = {}
    for sign, place in ((-1.0, start), (1.0, end)):
        for point, weight in place:
            weights[point] = weights.get(point, 0.0) + sign * weight
    return weights


def _rates(v: Floats, met: Floats) -> tuple[Floats, Floats]:
    """a, b (n_segments,) with which a segment's length has the gradient a v and the second derivative a I - b v v^T."""
    square = (v * v).sum(axis=1)
    m = np.maximum(np.sqrt(square), met)
    return (1.5 - 0.5 * square / m**2) / m, 1.0 / m**3


@numba.njit(cache=True, error_model="numpy")
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
