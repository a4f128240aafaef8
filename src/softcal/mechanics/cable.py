"""Cables: polylines through points, with a tension as multiplier of a prescribed length.

    Pi_c = -T (q - d),   q = L0 - L + stretch,   L = sum over segments of |sum_s sigma_s x_s|

As an actuator a cable's coordinate is its shortening q, its effort the tension T at its pulled end. A line that
stretches, and a machine that gives way, lengthen the cable in proportion to their tensions:

    q = L0 - L + sum_k c_k (T_k - T0) + c (T - T0),   c_k = l0_k / EA

with the pretension T0 that is there at q = 0 while the robot is at rest. T_k of segment k: see `tensions.py`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.actuator import NO_GAP, ActuatorLimits, ActuatorTerm, Drives
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.segments import MET, EndMotion, Segments, SegmentShape
from softcal.mechanics.state import State
from softcal.mechanics.tensions import BY_LENGTH, KINDS, Course, Lines, Tensions, Viscous, tensions, turns
from softcal.mechanics.term import NOTHING, BlockColumns, ByTheta, Connectivity, Given, LowRank, Sum, Term, Theta

if TYPE_CHECKING:
    from softcal.mechanics.system import System


@dataclass
class Once:
    """The segments at a state, and the tensions at a theta too, found once for all that need them there."""

    state: State
    shape: SegmentShape
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
    stated
        Names of the parameters of lines that are not as by default, such as `front.stiffness`.
    end_motions
        How the segments follow the parameters that move via points on what carries them, by name.
    slowness
        1 / v, with the speed of the slip at which friction is twice as large (n_cables,) [s/m]; None: friction does not
        depend on the speed.
    viscous
        What the speed adds, within a time step; None outside of one.
    """

    names: tuple[str, ...]
    segments: Segments
    cable: Ints
    order: Ints
    rest: Floats
    stated: tuple[str, ...] = ()
    end_motions: Mapping[str, EndMotion] = field(default_factory=dict[str, EndMotion])
    slowness: Floats | None = None
    viscous: Viscous | None = None

    @property
    def n_cables(self) -> int:
        return len(self.names)

    @cached_property
    def rest_length(self) -> Floats:
        """Length of each cable at rest (n_cables,) [m]."""
        return self._per_cable(self.rest)

    @cached_property
    def lines(self) -> ByTheta[Lines]:
        """The properties of the lines by the parameters' values."""
        return ByTheta(self._lines)

    def _lines(self, theta: Theta) -> Lines:
        mu, stiffness, compliance, pretension, presliding, preload, rate, unstretched = (
            np.array([theta.get(f"{name}.{kind}", otherwise) for name in self.names], dtype=np.float64)
            for kind, otherwise in (KINDS | BY_LENGTH).items()
        )
        length = self.rest_length
        stiffness = np.where(np.isnan(rate), stiffness, rate * length)
        soft = np.where(np.isnan(unstretched), 1.0, length / stiffness + compliance)
        pretension = np.where(np.isnan(unstretched), pretension, (length - unstretched) / soft)
        return Lines(
            names=self.names,
            mu=mu,
            softness=1.0 / stiffness,
            compliance=compliance,
            pretension=pretension,
            presliding=presliding,
            preload=preload,
            remembers=self.remembers,
        )

    @cached_property
    def _of_lines(self) -> dict[str, tuple[int, str]]:
        """Parameter of a line -> the number of its cable, and the property."""
        return {f"{name}.{kind}": (i, kind) for i, name in enumerate(self.names) for kind in KINDS | BY_LENGTH}

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*(f"{name}.friction_coefficient" for name in self.names), *self.end_motions, *self.stated)

    def connectivity(self, layout: Layout) -> Connectivity:
        """The points of each segment."""
        return Connectivity(self.segments.points)

    def plan(self, layout: Layout, pattern: Pattern) -> CableTerm:
        return replace(self, segments=self.segments.plan(layout, pattern))

    @property
    def actuators(self) -> tuple[ActuatorLimits, ...]:
        return tuple(ActuatorLimits(name, "shortening", "tension", least_effort=0.0) for name in self.names)

    def kinematics(self, state: State) -> Once:
        return Once(state, self.segments.shape(state.x))

    def _at(self, given: Given) -> Once:
        known = given.known
        return known if isinstance(known, Once) and known.state is given.state else self.kinematics(given.state)

    def shape_coordinates(self, x: Floats) -> Floats:
        """The shortening of each cable without stretch (n_cables,) [m]."""
        return self.rest_length - self.lengths(x)

    def shape_gradient(self, x: Floats, i: int, size: int) -> Floats:
        """Gradient of a cable's shortening without stretch, on all entities (size,) [-]."""
        return -self.segments.gradient(self.segments.shape(x), (self.cable == i).astype(np.float64), size)

    def transmission(self, given: Given) -> Tensions | None:
        if self.lines(given.theta).are_ideal:
            return None
        return self.tensions(given)

    def coordinates(self, given: Given, transmission: Tensions | None) -> Floats:
        geometric = self.rest_length - self._per_cable(self._at(given).shape.lengths)
        return geometric if transmission is None else geometric + transmission.stretch

    def add_forces(self, given: Given, effort: Floats, into: Sum, transmission: Tensions | None) -> None:
        """Add the forces of the segments and, where `into` has `data`, their tangent at fixed tensions."""
        tension = effort[self.cable] if transmission is None else self._by_segment(transmission.segments)
        self.segments.pull(self._at(given).shape, tension, into.full, into.data)

    def drives(self, given: Given, which: Ints, size: int, transmission: Tensions | None) -> Drives:
        """The borders of some cables: d gradient / d tension, less d shortening / d the unknowns and / d tension."""
        number = np.zeros(self.n_cables, dtype=np.int64)
        number[which] = np.arange(len(which))
        ends = number.copy()
        ends[which] += 1
        if transmission is None:
            columns = self._columns(self._at(given).shape.slopes[self.order][:, :, None], number, ends)
            return Drives(columns, columns, np.zeros(len(which)))
        along, slopes = transmission, transmission.course.slopes
        by_tension = along.factor + along.by_rho * along.by_pull
        rows = slopes
        if along.softness.any():
            rows = slopes - along.by_shape((along.softness * along.by_rho)[:, None])[:, :, 0]
        softness = along.per_cable(along.softness * by_tension) + along.lines.compliance
        return Drives(
            self._columns((by_tension[:, None] * slopes)[:, :, None], number, ends),
            self._columns(rows[:, :, None], number, ends),
            -softness[which],
        )

    def add_transmission(self, into: Sum, given: Given, transmission: Tensions) -> None:
        """The tensions change with the angles and slips at the via points: for each segment that moves a column, its
        force, and a row, the gradient of the logarithm of its tension.
        """
        along = transmission
        if len(changing := along.changing) == 0:
            return
        ptr = np.searchsorted(changing, self._ptr)
        n, number = len(self.segments), np.zeros(len(self.segments), dtype=np.int64)
        number[changing] = np.arange(len(changing))
        forces = np.zeros((n, 3, 1))
        forces[changing, :, 0] = along.by_rho[changing, None] * along.course.slopes[changing]
        rows, basis, values = self._basis
        first = np.repeat(number, 3)
        columns = BlockColumns(
            rows, basis, values, forces.reshape(-1, 1), first, first + np.repeat(forces.any(axis=1), 3)
        )

        def mixed_rows(mixed: Floats, ends: Ints) -> BlockColumns:
            weights = np.zeros((n, mixed.shape[1]))
            weights[changing] = mixed
            return self._columns(along.by_shape(weights), ends[:-1], ends[1:])

        into.low_rank.append(LowRank(columns, ptr, mixed_rows))

    def _columns(self, by_vector: Floats, first: Ints, end: Ints) -> BlockColumns:
        """Columns first:end (n_cables,) for each cable: gradients of functions with these slopes (n_segments, 3, k) by
        the segments' vectors.
        """
        weights = np.ascontiguousarray(by_vector).reshape(-1, by_vector.shape[2])
        return BlockColumns(*self._basis, weights, first[self._of_basis], end[self._of_basis])

    @cached_property
    def _basis(self) -> tuple[Ints, Ints, Floats]:
        return self.segments.basis(self.order)

    @cached_property
    def _of_basis(self) -> Ints:
        """The cable of each basis column."""
        return np.repeat(np.arange(self.n_cables), 3 * np.diff(self._ptr))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if into.keys().isdisjoint(self.parameters):
            return
        x, shape, along = given.state.x, self._at(given).shape, self.tensions(given)
        for name in into.keys() & {*self.parameters}:
            one, (i, r, _, travel) = into[name], self._by_parameter(name, x, shape, along)
            direct = along.by_preload(i) if name.endswith(".friction_preload") else 0.0
            self._add_rates(one, given, along, along.respond(r[:, None])[:, 0], i, travel, direct)
            if (motion := self.end_motions.get(name)) is not None:
                tension = self._by_segment(along.segments)
                one.full += self.segments.gradient_by(motion, x, shape, tension, len(one.full))

    def _add_rates(
        self,
        one: Sum,
        given: Given,
        along: Tensions,
        rho: Floats,
        i: int,
        travel: float,
        direct: Floats | float = 0.0,
    ) -> None:
        """Add the rates of the gradient at rates of rho (n_segments,) and, at fixed rho, of the tensions (n_segments,)
        and of the travel of cable i.
        """
        tensions = self._by_segment(along.by_rho * rho + direct)
        one.full += self.segments.gradient(self._at(given).shape, tensions, len(one.full))
        changes = along.stretch_rates(rho, np.zeros(self.n_cables))
        changes[i] += travel
        one.efforts[self.own] -= np.where(given.controls.is_held[self.own], 0.0, changes)

    def _by_parameter(
        self, name: str, x: Floats, shape: SegmentShape, along: Tensions
    ) -> tuple[int, Floats, Floats, float]:
        """The cable of a parameter, and derivatives at fixed rho by it: of r and of the slips (n_segments,), and of the
        cable's shortening or stretch.
        """
        motion, longer = self.end_motions.get(name), 0.0
        i, key = self._of_lines[name] if motion is None else (motion.cable, "")
        r, slip, travel = np.zeros(len(self.segments)), np.zeros(len(self.segments)), 0.0
        if motion is not None:
            of_rest = motion.rest[self.order]
            more = self.segments.lengths_by(motion, x, shape)[self.order] - of_rest
            slip, travel = along.by_softness(of_rest * along.lines.softness[i])
            slip += along.beyond(more)
            r = along.by_angle * along.course.turns.rates(motion.vectors(x)[self.order]) + along.by_slip * slip
            travel, longer = travel - float(more.sum()), float(of_rest.sum())
        by_length = [key for key in BY_LENGTH if f"{self.names[i]}.{key}" in self.stated]
        rates = along.lines.rates(i, key, float(self.rest_length[i]), longer, by_length)
        for kind, rate in rates.items():
            by, of_slip, stretch = along.by_property(kind, i)
            r, slip, travel = r + rate * by, slip + rate * of_slip, travel + rate * stretch
        return i, r, slip, travel

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
        """Add d gradient / d memory times a rate of the memory; nothing where no friction has one."""
        if self.remembers.any():
            along = self.tensions(given)
            rho = along.respond(-(along.by_slip * self._slips(rate))[:, None])[:, 0]
            self._add_rates(into, given, along, rho, 0, 0.0)

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        """The derivative of the plastic slips that the state leaves (n_inner,), by a parameter."""
        if not self.remembers.any():
            return memory_rate
        x, along, order, before = given.state.x, self.tensions(given), self.order, self._slips(memory_rate)
        v_rates = self.segments.vectors(rate.x)[order]
        pull = rate.effort[self.own]
        pulled = np.where(along.pull > 0.0, pull, 0.0)[along.cable] * along.softness * along.factor
        slip = along.beyond((along.course.slopes * v_rates).sum(axis=1) - pulled)
        r = along.by_angle * along.course.turns.rates(v_rates) + along.by_slip * (slip - before)
        presliding = np.array([parameter == f"{name}.presliding" for name in self.names], dtype=np.float64)
        if parameter in self.parameters:
            _, by, of_slip, _ = self._by_parameter(parameter, x, self._at(given).shape, along)
            r, slip = r + by, slip + of_slip
        rho = along.respond(r[:, None])[:, 0]
        slip -= along.beyond(along.stretched * rho)
        return along.plastic_slip_rates(slip, before, presliding)[self._inner]

    def tensions(self, given: Given) -> Tensions:
        """The tensions along the cables."""
        once = self._at(given)
        if once.found is None or once.theta is not given.theta:
            order, shape = self.order, once.shape
            course = Course(
                ptr=self._ptr,
                rest=self.rest[order],
                longer=(shape.lengths - self.rest)[order],
                slopes=shape.slopes[order],
                moves=self.segments.places.moves[order],
                turns=turns(shape.v[order], self._ptr),
            )
            viscous = self.viscous or Viscous(np.zeros(self.n_cables), np.zeros(len(order)))
            pull, memory = given.state.effort[self.own], self._slips(given.memory)
            once.found = tensions(self.lines(given.theta), course, pull, memory, viscous)
            once.theta = given.theta
        return once.found

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """With friction that increases with the speed, where it does."""
        if self.slowness is None:
            return (self,)
        return (replace(self, viscous=Viscous(self.slowness / step.length, self.tensions(before).slip)),)

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
        return self._per_cable(self.segments.shape(x).lengths)

    def coordinate_spans(self, extent: float, theta: Mapping[str, float], effort: Floats) -> Floats:
        return self.rest_length

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
