"""Cables: polylines through points, with a tension as multiplier of a prescribed length.

    Pi_c = -T (q - d),   q = L0 - L + stretch,   L = sum over segments of |sum_s sigma_s x_s|

As an actuator a cable's coordinate is its shortening q, its effort the tension T at its pulled end. A line that
stretches, and a machine that gives way, lengthen the cable in proportion to their tensions:

    q = L0 - L + sum_k c_k (T_k - T0) + c (T - T0),   c_k = l0_k / EA

with the pretension T0 that is there at q = 0 while the robot is at rest. T_k of segment k: see `tensions.py`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.actuator import NO_GAP, Actuator, ActuatorTerm, Drive
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.segments import MET, Segments
from softcal.mechanics.state import State
from softcal.mechanics.tensions import KINDS, Course, Lines, ShapeRates, Tensions, tensions, turns
from softcal.mechanics.term import NOTHING, Connectivity, Entries, Given, LowRank, Sum, Theta

if TYPE_CHECKING:
    from softcal.mechanics.system import System


# How the via points of a cable are moved: the last parts of the names of the parameters.
ROUTING = ("routing_offset", "routing_angle")


@dataclass
class Once:
    """The tensions at a state and theta, found once for all that need them there."""

    state: State
    theta: Theta | None = None
    found: Tensions | None = None


@dataclass(frozen=True)
class CableTerm(ActuatorTerm):
    """Segments of all cables.

    Attributes
    ----------
    names
        Names of the cables (n_cables,).
    segments
        Their segments, in the order of the via points.
    cable
        Cable of each segment (n_segments,).
    order
        The segments of one cable after the other, each cable's from its pulled end on (n_segments,).
    rest
        Length of each segment at rest (n_segments,) [m].
    rest_by_routing
        Derivatives of rest by the routing of the own cable (n_segments,).
    stated
        Names of the parameters of lines that are not as by default, such as `front.stiffness`.
    """

    names: tuple[str, ...]
    segments: Segments
    cable: Ints
    order: Ints
    rest: Floats
    rest_by_routing: Mapping[str, Floats]
    stated: tuple[str, ...] = ()

    @property
    def n_cables(self) -> int:
        return len(self.names)

    @cached_property
    def rest_length(self) -> Floats:
        """Length of each cable at rest (n_cables,) [m]."""
        return self._per_cable(self.rest)

    def lines(self, theta: Theta) -> Lines:
        """The properties of the lines by the parameters' values."""
        mu, stiffness, compliance, pretension, presliding = (
            np.array([theta.get(f"{name}.{kind}", otherwise) for name in self.names], dtype=np.float64)
            for kind, otherwise in KINDS.items()
        )
        return Lines(self.names, mu, 1.0 / stiffness, compliance, pretension, presliding, self.remembers)

    @property
    def parameters(self) -> tuple[str, ...]:
        own = tuple(f"{name}.{of}" for name in self.names for of in ("friction_coefficient", *ROUTING))
        return (*own, *self.stated)

    def connectivity(self, layout: Layout) -> Connectivity:
        """The points of each segment."""
        return Connectivity(self.segments.points)

    def plan(self, layout: Layout, pattern: Pattern) -> CableTerm:
        return replace(self, segments=self.segments.plan(layout, pattern))

    @property
    def actuators(self) -> tuple[Actuator, ...]:
        return tuple(Actuator(name, "shortening", "tension", least_effort=0.0) for name in self.names)

    def kinematics(self, state: State) -> Once:
        return Once(state)

    def shape_coordinates(self, x: Floats) -> Floats:
        """The shortening of each cable without stretch (n_cables,) [m]."""
        return self.rest_length - self.lengths(x)

    def shape_gradient(self, x: Floats, i: int, size: int) -> Floats:
        return -self.segments.gradient(x, (self.cable == i).astype(np.float64), size)

    def transmission(self, given: Given) -> Tensions | None:
        if self.lines(given.theta).are_ideal:
            return None
        return self.tensions(given)

    def coordinates(self, given: Given, transmission: Tensions | None) -> Floats:
        geometric = self.shape_coordinates(given.state.x)
        return geometric if transmission is None else geometric + transmission.stretch

    def add_forces(self, x: Floats, effort: Floats, into: Sum, transmission: Tensions | None) -> None:
        tension = effort[self.cable] if transmission is None else self._by_segment(transmission.segments)
        self.segments.pull(x, tension, into.full, into.data)

    def drive(self, given: Given, i: int, size: int, transmission: Tensions | None) -> Drive:
        if transmission is None:
            return super().drive(given, i, size, None)
        along, own = transmission, slice(self._ptr[i], self._ptr[i + 1])
        by_tension = along.factor[own] + along.segments[own] * along.by_pull[own]
        column, row = np.zeros(size), np.zeros(size)
        gradient = self.segments.entries(self.order[own], along.course.slopes[own])
        np.add.at(column, gradient.rows, gradient.values * by_tension[gradient.columns])
        np.add.at(row, gradient.rows, gradient.values)
        softness = along.softness[own]
        for shape in along.by_shape if softness.any() else ():
            if shape.own == own:
                weights, basis = (softness * along.segments[own]) @ shape.rates, self._basis(along, shape)
                np.subtract.at(row, basis.rows, basis.values * weights[basis.columns])
        return Drive(column, row, -float(softness @ by_tension + along.lines.compliance[i]))

    def add_transmission(self, into: Sum, given: Given, transmission: Tensions) -> None:
        """The tensions change with the angles and slips at the via points: for each segment that moves a column, its
        force, and a row, the gradient of the logarithm of its tension.
        """
        along = transmission
        for shape in along.by_shape:
            acts = along.course.moves[shape.own] & (along.segments[shape.own] != 0.0) & shape.rates.any(axis=1)
            which = shape.own.start + np.flatnonzero(acts)
            if len(which):
                slopes = along.segments[which, None] * along.course.slopes[which]
                columns = self.segments.entries(self.order[which], slopes)
                into.low_rank.append(LowRank(columns, self._basis(along, shape), shape.rates[acts].T))

    def _basis(self, along: Tensions, shape: ShapeRates) -> Entries:
        """Gradients of the lengths and angles by which a cable's tensions change."""
        longer, turned, order, by = shape.longer, shape.turned, self.order, along.course.turns
        of_lengths = self.segments.entries(order[longer], along.course.slopes[longer])
        of_turns = self.segments.entries(order[turned], by.by_far[turned]).joined(
            self.segments.entries(order[turned - 1], by.by_near[turned])
        )
        return of_lengths.joined(of_turns, shift=len(longer))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if into.keys().isdisjoint(self.parameters):
            return
        x, along = given.state.x, self.tensions(given)
        for i, name in enumerate(self.names):
            for kind in KINDS:
                if (one := into.get(f"{name}.{kind}")) is not None:
                    r, _, stretch = along.by_property(kind, i)
                    self._add_rates(one, given, along, along.respond(r[:, None])[:, 0], i, stretch)
            for kind in ROUTING:
                if (one := into.get(f"{name}.{kind}")) is not None:
                    r, _, travel = self._by_routing(x, along, i, kind)
                    self._add_rates(one, given, along, along.respond(r[:, None])[:, 0], i, travel)
                    tension = np.where(self.cable == i, self._by_segment(along.segments), 0.0)
                    one.full += self.segments.gradient_by_routing(x, tension, len(one.full), kind)

    def _add_rates(self, one: Sum, given: Given, along: Tensions, rho: Floats, i: int, travel: float) -> None:
        """Add the rates of the gradient at rates of rho (n_segments,) and, of cable i, of its travel at fixed rho."""
        one.full += self.segments.gradient(given.state.x, self._by_segment(along.segments * rho), len(one.full))
        changes = along.stretch_rates(rho, np.zeros(self.n_cables))
        changes[i] += travel
        one.efforts[self.own] -= np.where(given.controls.is_held[self.own], 0.0, changes)

    def _by_routing(self, x: Floats, along: Tensions, i: int, kind: str) -> tuple[Floats, Floats, float]:
        """Derivatives at fixed rho by the routing of cable i: of r and of the slips (n_segments,), and of the
        shortening.
        """
        own, order = self.cable == i, self.order
        v_rates = np.where(own[:, None], self.segments.vectors_by_routing(x, kind), 0.0)[order]
        by_rest = self.rest_by_routing[kind]
        longer = np.where(own, self.segments.lengths_by_routing(x, kind) - by_rest, 0.0)[order]
        of_rest = np.where(own, by_rest, 0.0)[order]
        slip, stretch = along.by_softness(of_rest * along.lines.softness[i])
        slip += along.beyond(longer)
        r = along.by_angle * along.course.turns.rates(v_rates) + along.by_slip * slip
        return r, slip, stretch - float(longer.sum())

    # Friction with a memory: the plastic slips at the inner via points, in the order of the tensions.

    @cached_property
    def _inner(self) -> Ints:
        return np.setdiff1d(np.arange(len(self.segments)), self._ptr[:-1])

    def _slips(self, memory: Floats) -> Floats:
        """The memory by segment (n_segments,): that of the via point before it."""
        slips = np.zeros(len(self.segments))
        if len(memory):
            slips[self._inner] = memory
        return slips

    @cached_property
    def remembers(self) -> np.ndarray:
        """Whether the friction of each cable has a memory (n_cables,)."""
        return np.array([f"{name}.presliding" in self.stated for name in self.names], dtype=bool)

    def first_memory(self) -> Floats:
        return np.zeros(len(self._inner)) if self.remembers.any() else NOTHING

    def advance(self, given: Given) -> Floats:
        return self.tensions(given).plastic_slip[self._inner] if self.remembers.any() else given.memory

    def add_by_memory(self, into: Sum, given: Given, rate: Floats) -> None:
        if self.remembers.any():
            along = self.tensions(given)
            rho = along.respond(-(along.by_slip * self._slips(rate))[:, None])[:, 0]
            self._add_rates(into, given, along, rho, 0, 0.0)

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        if not self.remembers.any():
            return memory_rate
        x, along, order, before = given.state.x, self.tensions(given), self.order, self._slips(memory_rate)
        v_rates = self.segments.vectors(rate.x)[order]
        pull = rate.effort[self.own]
        pulled = np.where(along.pull > 0.0, pull, 0.0)[along.cable] * along.softness * along.factor
        slip = along.beyond((self.segments.length_slopes(x)[order] * v_rates).sum(axis=1) - pulled)
        r = along.by_angle * along.course.turns.rates(v_rates) + along.by_slip * (slip - before)
        presliding = np.zeros(self.n_cables)
        for i, name in enumerate(self.names):
            for kind in (*ROUTING, *KINDS):
                if parameter == f"{name}.{kind}":
                    routed = kind in ROUTING
                    by, of_slip, _ = self._by_routing(x, along, i, kind) if routed else along.by_property(kind, i)
                    r, slip = r + by, slip + of_slip
                    presliding[i] = kind == "presliding"
        rho = along.respond(r[:, None])[:, 0]
        slip -= along.beyond(along.stretched * rho)
        return along.plastic_slip_rates(slip, before, presliding)[self._inner]

    def tensions(self, given: Given) -> Tensions:
        """The tensions along the cables."""
        once = given.known if isinstance(given.known, Once) else Once(given.state)
        if once.found is None or once.state is not given.state or once.theta is not given.theta:
            once.state, once.theta, once.found = given.state, given.theta, self._tensions(given)
        return once.found

    def _tensions(self, given: Given) -> Tensions:
        x, order = given.state.x, self.order
        course = Course(
            self._ptr,
            self.rest[order],
            (self.segments.lengths(x) - self.rest)[order],
            self.segments.length_slopes(x)[order],
            self.segments.places.moves[order],
            turns(self.segments.vectors(x)[order], self._ptr),
        )
        return tensions(self.lines(given.theta), course, given.state.effort[self.own], self._slips(given.memory))

    @cached_property
    def _ptr(self) -> Ints:
        return np.concatenate([[0], np.cumsum(np.bincount(self.cable, minlength=self.n_cables))]).astype(np.int64)

    def _by_segment(self, values: Floats) -> Floats:
        """Values in the order of the tensions, in that of the segments."""
        out = np.empty_like(values)
        out[self.order] = values
        return out

    def _per_cable(self, values: Floats) -> Floats:
        return np.bincount(self.cable, weights=values, minlength=self.n_cables).astype(np.float64)

    def energy(self, given: Given) -> float:
        """Of stretched lines that energy less, which the tensions take from the shortening."""
        lines, effort = self.lines(given.theta), given.state.effort[self.own]
        soft = self.rest_length * lines.softness + lines.compliance
        return super().energy(given) - float(effort @ (soft * (0.5 * effort - lines.pretension)))

    def lengths(self, x: Floats) -> Floats:
        """Length of each cable (n_cables,) [m]."""
        return self._per_cable(self.segments.lengths(x))

    def coordinate_tolerances(self, extent: float) -> Floats:
        return NO_GAP * self.rest_length

    def is_reversed(self, before: Floats, x: Floats) -> bool:
        """Whether one of the segments is."""
        return bool(np.any((self.segments.vectors(before) * self.segments.vectors(x)).sum(axis=1) < 0.0))

    def at_limit(self, x: Floats) -> str:
        """The via points that have met, as part of a sentence; "" where none have."""
        met = self.segments.met
        now = np.linalg.norm(self.segments.vectors(x), axis=1)
        pairs = [
            f"via points {number} and {number + 1} of {self.names[self.cable[k]]} have met "
            f"({1e3 * now[k]:.2g} mm apart, {1e3 * met[k] / MET:.4g} mm at rest)"
            for k in np.flatnonzero(now < 1.5 * met)
            for number in [k - int(np.searchsorted(self.cable, self.cable[k])) + 1]
        ]
        return ", ".join(pairs)


def cables_of(system: System) -> CableTerm:
    """The cables of a system, for callers that need cables."""
    return system.of(CableTerm)[0]


Weights = list[tuple[int, float]]


def build_cables(
    X: Floats,
    supports: dict[str, list[Weights]],
    pulled_last: np.ndarray,
    by_routing: Mapping[str, Mapping[str, list[Weights]]] | None = None,
    stated: tuple[str, ...] = (),
) -> CableTerm:
    """The term of cables given, by name and via point, as weighted points [(point, weight), ...].

    The rest length is the polyline's on the undeformed robot, X (n_points, 3) [m]. pulled_last (n_cables,): whether a
    cable is pulled at its last via point, or else at its first. by_routing, of cables that have a routing axis: their
    via points' derivatives by each of `ROUTING`, as points with weights whose sum is zero. stated: see `CableTerm`.
    """
    ptr, support, sigma, cable, order = [0], [], [], [], list[int]()
    rates: dict[str, list[float]] = {kind: [] for kind in ROUTING}
    for c, (name, via) in enumerate(supports.items()):
        first = len(cable)
        moves = (by_routing or {}).get(name, {})
        for k, ends in enumerate(pairwise(via)):
            weights = _difference(*ends)
            changes = {kind: _difference(*ways[k : k + 2]) for kind, ways in moves.items()}
            points = sorted(set(weights).union(*changes.values()))
            support.extend(points)
            sigma.extend(weights.get(p, 0.0) for p in points)
            for kind, rate in rates.items():
                rate.extend(changes.get(kind, {}).get(p, 0.0) for p in points)
            ptr.append(len(support))
            cable.append(c)
        own = range(first, len(cable))
        order.extend(reversed(own) if pulled_last[c] else own)
    segments = Segments(
        np.array(ptr, dtype=np.int64),
        np.array(support, dtype=np.int64),
        np.array(sigma, dtype=np.float64),
        {kind: np.array(rate, dtype=np.float64) for kind, rate in rates.items()},
        np.zeros(len(cable)),
    )
    segments = replace(segments, met=MET * np.linalg.norm(segments.vectors(X), axis=1))
    return CableTerm(
        tuple(supports),
        segments,
        np.array(cable, dtype=np.int64),
        np.array(order, dtype=np.int64),
        segments.lengths(X),
        {kind: segments.lengths_by_routing(X, kind) for kind in ROUTING},
        stated,
    )


def _difference(start: Weights, end: Weights) -> dict[int, float]:
    """The weights of the vector from one weighted point to another."""
    weights: dict[int, float] = {}
    for sign, place in ((-1.0, start), (1.0, end)):
        for point, weight in place:
            weights[point] = weights.get(point, 0.0) + sign * weight
    return weights
