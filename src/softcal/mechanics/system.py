"""The sum of terms: gradient and tangent of the total potential at a state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.actuator import ActuatorLimits, ActuatorTerm, Drives, numbered
from softcal.mechanics.contact import ContactTerm
from softcal.mechanics.frame_blocks import moving_pairs
from softcal.mechanics.layout import Layout
from softcal.mechanics.linearisation import NO_BORDER, Border, Linearisation
from softcal.mechanics.loads import Loads
from softcal.mechanics.memory import Memory
from softcal.mechanics.mirror import Mirror, mirrors_of
from softcal.mechanics.motion import Motion, build_motion, low_rank_product
from softcal.mechanics.neighbours import Neighbours
from softcal.mechanics.pattern import Pattern, add_products, build_pattern
from softcal.mechanics.scales import Sizes
from softcal.mechanics.state import State, rest_state
from softcal.mechanics.term import NOTHING, BlockColumns, Controls, Failing, Given, Sum, Term, Theta
from softcal.mechanics.wire_contact import WireContactTerm
from softcal.units import format_place

Kind = TypeVar("Kind", bound=Term)

NEAR = 3.0  # times its size: an element within that distance of a point on which a force acts fails by that force


@dataclass(frozen=True)
class System:
    """The discretised robot without its parameter values; parameters theta [SI] are arguments of each call.

    Attributes
    ----------
    layout
        Numbering of points, frames and unknowns.
    pattern
        Sparsity of the tangent.
    motion
        Map from the unknowns to the points.
    terms
        Summands of the total potential.
    neighbours
        By the name of each parameter of the undeformed shape, what has such a system at values next to its own.
    landmarks
        Points (3,) [m] at rest on which forces act, by what they are called.
    """

    layout: Layout
    pattern: Pattern
    motion: Motion
    terms: tuple[Term, ...]
    neighbours: Mapping[str, Neighbours] = field(default_factory=dict[str, Neighbours])
    landmarks: Mapping[str, Floats] = field(default_factory=dict[str, Floats])

    def of(self, kind: type[Kind]) -> tuple[Kind, ...]:
        """The terms of one kind, for callers that need that kind; the assembly does not."""
        return tuple(term for term in self.terms if isinstance(term, kind))

    @cached_property
    def actuated(self) -> tuple[ActuatorTerm, ...]:
        """The terms whose efforts are unknowns."""
        return tuple(term for term in self.of(ActuatorTerm) if term.actuators)

    @cached_property
    def actuators(self) -> tuple[ActuatorLimits, ...]:
        """All actuators, in the order of the efforts."""
        return tuple(actuator for term in self.actuated for actuator in term.actuators)

    def number(self, actuator: str) -> int:
        """The number of an actuator by its name, in the order of the efforts."""
        return self._numbers[actuator]

    @cached_property
    def _numbers(self) -> Mapping[str, int]:
        return {actuator.name: i for i, actuator in enumerate(self.actuators)}

    @cached_property
    def effort_limits(self) -> tuple[Floats, Floats]:
        """Lower and upper limit of each actuator's effort (n_actuators,)."""
        return (
            np.array([actuator.least_effort for actuator in self.actuators]),
            np.array([actuator.most_effort for actuator in self.actuators]),
        )

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names in theta of all parameters that an equilibrium depends on."""
        return frozenset(name for term in self.terms for name in term.parameters) | self.neighbours.keys()

    @cached_property
    def loads(self) -> Loads:
        """The dead loads."""
        return self.of(Loads)[0]

    @cached_property
    def contacts(self) -> tuple[ContactTerm | WireContactTerm, ...]:
        """The terms of surfaces and wires that may touch."""
        return (*self.of(ContactTerm), *self.of(WireContactTerm))

    def linearise(
        self, state: State, controls: Controls, theta: Theta, *, tangent: bool = True, convex: bool = False
    ) -> Linearisation:
        """Gradient and, on demand, tangent. Where the state is inadmissible they are empty.

        Parameters
        ----------
        state
            The state.
        controls
            The controls.
        theta
            Parameter values by dotted name [SI].
        tangent
            Whether the tangent is wanted.
        convex
            Whether ridges of contact count as flat, see `Sum`.
        """
        known = tuple(term.kinematics(state) for term in self.terms)
        if why_not := self._why_not(known):
            return Linearisation(controls, known, why_not)
        total = Sum(self.layout, self.pattern.size if tangent else None, convex=convex)
        try:
            for term, given in zip(self.terms, self.given(state, controls, theta, known), strict=True):
                term.add(total, given)
        except SimulationError as error:
            return Linearisation(controls, known, str(error))
        forces = float(np.sqrt(np.vdot(total.points, total.points) + total.squares))
        gradients = (total.full, self._on_unknowns(state, total), forces)
        if total.data is None:
            return Linearisation(controls, known, "", *gradients)
        self.motion.reduce_tangent(state, total.gradient, total.data)
        return Linearisation(
            controls,
            known,
            "",
            *gradients,
            data=total.data[: self.pattern.nnz],
            border=self._border(state, total),
            touch=self._outside(state, total.outside) if total.outside else None,
            near=cache(lambda: self._outside(state, [of() for of in total.near])),
            is_convex=convex,
        )

    def _outside(self, state: State, parts: Sequence[tuple[Floats, Ints, Ints]]) -> Any:
        """A sparse upper triangle on the unknowns by blocks outside the pattern, see `Sum`."""
        import scipy.sparse as sp

        nothing = (np.zeros((0, 3, 3)), np.zeros(0, np.int64), np.zeros(0, np.int64))
        blocks, rows, columns = (np.concatenate(each) for each in zip(nothing, *parts, strict=True))
        n = self.layout.first_effort_unknown
        return sp.csr_matrix(self.motion.reduce_blocks(state, blocks, rows, columns), shape=(n, n))

    def gradient_by_parameters(self, given: Sequence[Given], names: tuple[str, ...]) -> Floats:
        """d reduced gradient / d parameter, (n_unknowns, n_names), also through their memory; `given` to each term."""
        state = given[0].state
        sums = {name: Sum(self.layout) for name in names}
        remembered = {} if state.memory is None else state.memory.by_parameter
        for term, own_given, own in zip(self.terms, given, self._owned, strict=True):
            term.add_by_parameters(sums, own_given)
            for name in remembered.keys() & sums.keys():
                term.add_by_memory(sums[name], own_given, remembered[name][own])
        out = np.empty((self.layout.n_unknowns, len(names)))
        controls, theta = given[0].controls, given[0].theta
        for k, name in enumerate(names):
            out[:, k] = self._on_unknowns(state, sums[name])
            if name in self.neighbours:
                out[:, k] += self.neighbours[name].rate(
                    lambda one, at: one.system.linearise(at, controls, theta, tangent=False).reduced, state
                )
        return out

    def gradient_by_load(self, state: State, controls: Controls, theta: Theta) -> Floats:
        """d reduced gradient / d factor on the dead loads (n_unknowns,).

        Parameters
        ----------
        state
            The state.
        controls
            The controls.
        theta
            Parameter values by dotted name [SI].
        """
        total = Sum(self.layout)
        for term, given in zip(self.terms, self.given(state, controls, theta), strict=True):
            term.add_by_load(total, given)
        return self._on_unknowns(state, total)

    def is_loaded(self, theta: Theta) -> bool:
        """Whether a dead load acts."""
        none = np.zeros(self.layout.n_actuators)
        return bool(np.any(self.gradient_by_load(rest_state(self.layout), Controls(none == 0.0, none, none), theta)))

    @cached_property
    def mirrors(self) -> tuple[Mirror, ...]:
        """The planes by which its unknowns come in pairs."""
        return mirrors_of(self.layout, self.pattern)

    @cached_property
    def remembers(self) -> bool:
        """Whether any term has a memory: a protocol's samples then form a load path, and are solved in their order."""
        return len(self._first_memory) > 0

    def given(
        self, state: State, controls: Controls, theta: Theta, known: Sequence[Any] | None = None
    ) -> tuple[Given, ...]:
        """The arguments of each term.

        Parameters
        ----------
        state
            The state.
        controls
            The controls.
        theta
            Parameter values by dotted name [SI].
        known
            The terms' `kinematics`; None: they are computed.
        """
        known = [term.kinematics(state) for term in self.terms] if known is None else known
        memory = self._first_memory if state.memory is None else state.memory.values
        each = zip(known, self._owned, strict=True)
        return tuple(Given(state, controls, theta, at, memory[own]) for at, own in each)

    def advanced(
        self,
        state: State,
        controls: Controls,
        theta: Theta,
        by_parameter: Floats | None = None,
        names: tuple[str, ...] = (),
    ) -> State:
        """A converged sample's state with the memory that it leaves to the next one.

        Parameters
        ----------
        state
            The state.
        controls
            The controls.
        theta
            Parameter values by dotted name [SI].
        by_parameter
            dz/dtheta (n_unknowns, k) of the sample, by which the memory then has derivatives too.
        names
            Parameters (k,) by dotted name.
        """
        if not self.remembers:
            return state
        each = [*zip(self.terms, self.given(state, controls, theta), self._owned, strict=True)]
        values = np.concatenate([term.advance(given) for term, given, _ in each])
        before = {} if state.memory is None else state.memory.by_parameter
        rates, matrix = dict[str, Floats](), self.motion.matrix(state) if names else None
        for name, dz in zip(names, () if by_parameter is None else by_parameter.T, strict=True):
            rate, old = self.motion.rates(state, dz, matrix), before.get(name, np.zeros_like(values))
            rates[name] = np.concatenate([term.advance_rate(given, name, rate, old[own]) for term, given, own in each])
            if name in self.neighbours:
                rates[name] += self.neighbours[name].rate(
                    lambda one, at: one.system.advanced(at, controls, theta).memory.values, state
                )
        return replace(state, memory=Memory(values, rates))

    @cached_property
    def _first_memory(self) -> Floats:
        return np.concatenate([NOTHING, *(term.first_memory() for term in self.terms)])

    @cached_property
    def _owned(self) -> tuple[slice, ...]:
        """The place of each term's memory among that of all."""
        ends = np.cumsum([0, *(len(term.first_memory()) for term in self.terms)]).tolist()
        return tuple(slice(*ends) for ends in pairwise(ends))

    def why_not(self, state: State) -> str:
        """Why a state is inadmissible, as part of a sentence; "" where it is admissible."""
        return self._why_not([term.kinematics(state) for term in self.terms])

    def failing(self, state: State) -> Failing | None:
        """The element that fails first at a state; None where none is near to it."""
        each = (term.failing(term.kinematics(state), self.layout.X) for term in self.terms)
        return min((one for one in each if one is not None), key=lambda one: one.J, default=None)

    def place(self, failing: Failing) -> str:
        """The place of an element that fails, as part of a sentence."""
        away = {name: float(np.linalg.norm(at - failing.at)) for name, at in self.landmarks.items()}
        near = min((name for name in away if away[name] < NEAR * failing.size), key=lambda name: away[name], default="")
        beside = f", at {near} {format_place(self.landmarks[near], 2)}" if near else ""
        return (
            f"the elements of {failing.part} at {format_place(failing.at, 2)}{beside}, fail first: J = {failing.J:.2g}"
        )

    def remarks(self, state: State, theta: Theta) -> str:
        """Remarks on a solution for the user: sentences with a blank before each, or ""."""
        return "".join(term.remark(state, theta) for term in self.terms)

    def sizes(self, theta: Theta) -> Sizes:
        """The sizes by which the equations are scaled."""
        sizes = Sizes(self.layout)
        for term in self.terms:
            term.measure(sizes, theta)
        return sizes

    def free_way(self, state: State, to: State) -> float:
        """Fraction of the straight line between two states that is free of contact; one where all of it is."""
        return min((term.free_way(state.x, to.x) for term in self.terms), default=1.0)

    def tangent_times(self, at: Linearisation, dz: Floats) -> Floats:
        """The bordered tangent of a linearisation times rates dz (n_unknowns, k) of the unknowns.

        Raises
        ------
        SimulationError
            Where the state is inadmissible and has no tangent.
        """
        if at.data is None:
            raise SimulationError("There is no tangent.")
        n, driven = self.layout.first_effort_unknown, at.border.driven
        x, columns, rows = dz[:n], at.border.columns, at.border.rows
        each = np.ascontiguousarray(x.T)
        products = np.zeros_like(each)
        add_products(self.pattern.indptr, self.pattern.indices, at.data, each, products)
        if at.touch is not None:
            indptr, indices = (np.asarray(part, dtype=np.int64) for part in (at.touch.indptr, at.touch.indices))
            add_products(indptr, indices, at.touch.data, each, products)
        out = np.zeros_like(dz)
        out[:n] = products.T
        if len(at.border.corner):
            k = len(driven)
            out[:n] += columns[:, :k] @ dz[n + driven] + columns[:, k:] @ (rows[:, k:].T @ x)
            out[n + driven] = rows[:, :k].T @ x + at.border.corner[:k, :k] @ dz[n + driven]
        return out

    def coordinates(self, state: State, theta: Theta) -> Floats:
        """The coordinates of all actuators (n_actuators,) at a state, as their machines measure them."""
        each = [(term, self._given_to(term, state, theta)) for term in self.actuated]
        return np.concatenate([NOTHING, *(term.coordinates(given, term.transmission(given)) for term, given in each)])

    def commanded(self, state: State, theta: Theta) -> Floats:
        """The coordinates of all actuators (n_actuators,) as commands prescribe them: of what follows another one, less
        what that takes up.
        """
        out = self.coordinates(state, theta)
        for term in self._leading:
            out -= term.taken_up(self._given_to(term, state, theta))
        return out

    def engaged(self, is_held: np.ndarray, target: Controls) -> np.ndarray:
        """Which actuators (n_actuators,) are at prescribed efforts, less those that must be driven, see `ActuatorTerm`.

        Raises
        ------
        SimulationError
            Where none can be driven.
        """
        for term in self._leading:
            is_held = term.engaged(is_held, target)
        return is_held

    @cached_property
    def followers(self) -> Mapping[str, Ints]:
        """Actuator -> numbers of the actuators that follow its commands, such as the cables of a drive."""
        return {name: numbers for term in self.actuated for name, numbers in term.followers.items()}

    @cached_property
    def coupled(self) -> frozenset[int]:
        """Numbers of the actuators whose coordinates change by couplings alone."""
        return frozenset(i for term in self._leading for i in range(term.own.start, term.own.stop))

    @cached_property
    def _leading(self) -> tuple[ActuatorTerm, ...]:
        return tuple(term for term in self.actuated if term.followers)

    def coordinate_rates(self, state: State, theta: Theta, dz: Floats, names: Sequence[str]) -> Floats:
        """Rates (n_actuators, k) of the actuators' coordinates.

        Parameters
        ----------
        state
            The state.
        theta
            Parameter values by dotted name [SI].
        dz
            Rates of the unknowns (n_unknowns, k).
        names
            Names (k,) of the parameters by which `dz` has the derivatives, or "".
        """
        n, remembered = self.layout.first_effort_unknown, {} if state.memory is None else state.memory.by_parameter
        out = np.zeros((len(self.actuators), len(names)))
        for term in self.actuated:
            given = self._given_to(term, state, theta)
            own = self._drives(term, given, np.arange(len(term.actuators)))
            out[term.own] = -(own.rows.T @ dz[:n] + own.corner @ dz[n:][term.own])
            for i, j, rate in term.couplings(given):
                for row, column in {(i, j), (j, i)}:
                    if term.own.start <= row < term.own.stop:
                        out[row] -= rate * dz[n + column]
            sums = {name: Sum(self.layout) for name in {*names} & {*term.parameters, *remembered}}
            term.add_by_parameters(sums, given)
            for name in remembered.keys() & sums.keys():
                term.add_by_memory(sums[name], given, remembered[name][self._own(term)])
            for k, name in enumerate(names):
                if name in sums:
                    out[term.own, k] -= sums[name].efforts[term.own]
        for k, name in enumerate(names):
            if name in self.neighbours:
                out[:, k] += self.neighbours[name].rate(lambda one, at: one.system.coordinates(at, theta), state)
        return out

    def coordinate_tolerances(self, extent: float) -> Floats:
        """Errors of the actuators' coordinates (n_actuators,) below which they count as reached."""
        return np.concatenate([NOTHING, *(term.coordinate_tolerances(extent) for term in self.actuated)])

    def coordinate_spans(self, extent: float, theta: Mapping[str, float], effort: Floats) -> Floats:
        """Spans of the actuators' coordinates (n_actuators,) that are long on a load path.

        Parameters
        ----------
        extent
            Extent of the robot [m].
        theta
            Values of the parameters by dotted name [SI].
        effort
            Efforts (n_actuators,) at the end of the path, each in its own unit.
        """
        each = (term.coordinate_spans(extent, theta, effort[term.own]) for term in self.actuated)
        return np.concatenate([NOTHING, *each])

    def at_limit(self, x: Floats) -> str:
        """The obstacle to further motion of actuators, as part of a sentence; "" without one."""
        return ", ".join(filter(None, (term.at_limit(x) for term in self.actuated)))

    def drive(self, state: State, i: int, theta: Theta) -> Border:
        """The border of the tangent by an actuator whose coordinate is prescribed: one column and row.

        Parameters
        ----------
        state
            The state.
        i
            Number of the actuator.
        theta
            Parameter values by dotted name [SI].
        """
        term = next(term for term in self.actuated if term.own.start <= i < term.own.stop)
        return self._drives(term, self._given_to(term, state, theta), np.array([i - term.first]))

    def gradient_by_effort(self, state: State, i: int, controls: Controls, theta: Theta) -> Floats:
        """d gradient / d effort of an actuator (n_unknowns,).

        Parameters
        ----------
        state
            The state.
        i
            Number of the actuator.
        controls
            The controls.
        theta
            Parameter values by dotted name [SI].
        """
        first = self.layout.first_effort_unknown
        out = np.zeros(self.layout.n_unknowns)
        out[:first] = self.drive(state, i, theta).columns[:, 0]
        for term in self._leading:
            for j, k, rate in term.couplings(self._given_to(term, state, theta)):
                if j != k and i in (j, k):
                    out[first + j + k - i] += rate
        out[first:][controls.is_held] = 0.0
        return out

    def _drives(self, term: ActuatorTerm, given: Given, which: Ints) -> Border:
        """The border of some actuators of one term."""
        drives = term.drives(given, which, self.layout.n_components, term.transmission(given))
        return self._driven(given.state, term.first + which, drives)

    def _driven(self, state: State, which: Ints, drives: Drives) -> Border:
        columns = self._reduced(state, drives.columns, len(which))
        rows = columns if drives.rows is drives.columns else self._reduced(state, drives.rows, len(which))
        return Border(which, columns, rows, np.diag(drives.corner))

    def _reduced(self, state: State, columns: Floats | BlockColumns, k: int) -> Floats:
        """k columns on the unknowns but the efforts."""
        if isinstance(columns, BlockColumns):
            return self.motion.reduce_columns(state, columns, k)
        return np.stack([self.motion.reduce_gradient(state, column) for column in columns.T], axis=1)

    def _given_to(self, term: Term, state: State, theta: Theta) -> Given:
        """The arguments of one term, with every actuator driven by its coordinate."""
        none = np.zeros(self.layout.n_actuators)
        memory = self._first_memory if state.memory is None else state.memory.values
        controls = Controls(none != 0.0, none, none)
        return Given(state, controls, theta, term.kinematics(state), memory[self._own(term)])

    def _own(self, term: Term) -> slice:
        """The place of a term's memory among that of all."""
        return self._owned[next(k for k, one in enumerate(self.terms) if one is term)]

    def _why_not(self, known: Sequence[Any]) -> str:
        reasons = (term.why_not(own) for term, own in zip(self.terms, known, strict=True))
        return next(filter(None, reasons), "")

    def _on_unknowns(self, state: State, total: Sum) -> Floats:
        """The gradient (n_unknowns,) of a sum."""
        reduced = total.own.copy()
        reduced[: self.layout.first_effort_unknown] += self.motion.reduce_gradient(state, total.gradient)
        return reduced

    def _border(self, state: State, total: Sum) -> Border:
        if not total.driven and not total.low_rank and not total.rank_one_own:
            return NO_BORDER
        driven = [self._driven(state, which, drives) for which, drives in total.driven]
        parts = [(one.columns, one.rows) for one in driven]
        parts += [low_rank_product(self.motion, state, part) for part in total.low_rank]
        parts += [(column[:, None], row[:, None]) for column, row in total.rank_one_own]
        columns, rows = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        own = np.concatenate([NO_BORDER.driven, *(one.driven for one in driven)])
        corner = np.concatenate([NOTHING, *(one.corner for _, one in total.driven)])
        corner = np.diag(np.concatenate([corner, -np.ones(columns.shape[1] - len(corner))]))
        places = {number: k for k, number in enumerate(own.tolist())}
        for i, j, rate in total.couplings:
            for row, column in {(i, j), (j, i)}:
                if row in places and column in places:
                    corner[places[row], places[column]] += rate
        return Border(own, columns, rows, corner, has_moments=bool(total.rank_one_own))


def build_system(layout: Layout, terms: Sequence[Term], landmarks: Mapping[str, Floats] | None = None) -> System:
    """The system of some terms, with the pattern of all together.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    terms
        Summands of the potential.
    landmarks
        Points (3,) [m] at rest on which forces act, by what they are called.
    """
    terms = numbered(terms, layout)
    connected = [term.connectivity(layout) for term in terms]
    none = np.zeros((0, 2), dtype=np.int64)
    pairs = np.concatenate([none, *(moving_pairs(layout, frames) for one in connected for frames in one.frames)])
    pattern = build_pattern(layout, [conn for one in connected for conn in one.entities], pairs)
    planned = tuple(term.plan(layout, pattern) for term in terms)
    return System(layout, pattern, build_motion(layout, pattern), planned, landmarks=landmarks or {})
