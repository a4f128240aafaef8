"""An equilibrium on a line of controls, with its exact slope."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.actuator import NO_EFFORT
from softcal.mechanics.bordered import EXACT
from softcal.mechanics.free_modes import exclude_free_modes
from softcal.mechanics.mixed import mixed_derivatives
from softcal.mechanics.state import State
from softcal.mechanics.statics import NO_MODES, Statics
from softcal.mechanics.system import Controls, System


@dataclass(frozen=True)
class Line:
    """Controls along a straight line: at(c) = start + c * rate.

    Attributes
    ----------
    is_held
        Per actuator, whether its effort is prescribed (else its coordinate), along the whole line (n_actuators,).
    effort, effort_rate
        Effort at c = 0 (n_actuators,), each in its own unit, and its derivative by c.
    coordinate, coordinate_rate
        Coordinate at c = 0 (n_actuators,), each in its own unit, and its derivative by c.
    load, load_rate
        Factor on all dead loads at c = 0 [-], and its derivative by c.
    elapsed
        As of the controls, along the whole line.
    """

    is_held: np.ndarray
    effort: Floats
    coordinate: Floats
    effort_rate: Floats
    coordinate_rate: Floats
    load: float = 1.0
    load_rate: float = 0.0
    elapsed: float = np.inf

    @property
    def key(self) -> Hashable:
        """Equal for equal lines."""
        arrays = (self.is_held, self.effort, self.coordinate, self.effort_rate, self.coordinate_rate)
        return (*(array.tobytes() for array in arrays), self.load, self.load_rate, self.elapsed)

    def at(self, c: float) -> Controls:
        """Controls at the line's parameter c."""
        return Controls(
            self.is_held,
            self.effort + c * self.effort_rate,
            self.coordinate + c * self.coordinate_rate,
            self.load + c * self.load_rate,
            self.elapsed,
        )


@dataclass(frozen=True, eq=False)
class Node:
    """An equilibrium on the path; no two compare equal.

    Attributes
    ----------
    c
        Parameter of the line of controls.
    state
        The equilibrium.
    slope
        dz/dc (n_unknowns,).
    by_parameter
        dz/dtheta at fixed c (n_unknowns, k).
    mixed
        d2z/dc dtheta (n_unknowns, k).
    is_stable
        Whether its energy is a minimum; also True where an effort is outside its limits, such as of a cable in
        compression, which is no equilibrium anyway.
    is_snapped
        Whether the robot reached it by snap-through or buckling, from an unstable equilibrium.
    has_snapped
        Whether it did so before this node.
    free
        Modes (n_unknowns - n_actuators, k) of motion without force; slope and by_parameter have no part along them.
    """

    c: float
    state: State
    slope: Floats
    by_parameter: Floats
    mixed: Floats
    is_stable: bool = True
    is_snapped: bool = False
    has_snapped: bool = False
    free: Floats = field(default_factory=lambda: NO_MODES)

    def by(self, columns: list[int]) -> Node:
        """The node with the derivatives by some of its parameters, by their columns."""
        return replace(self, by_parameter=self.by_parameter[:, columns], mixed=self.mixed[:, columns])


def node_at(
    statics: Statics,
    line: Line,
    c: float,
    state: State,
    names: tuple[str, ...],
    *,
    mixed: bool = True,
    judged: bool = True,
    accuracy: float = EXACT,
) -> Node:
    """The node of an equilibrium: one factorisation, then a substitution for the slope and two per parameter. Two more
    factorisations where surfaces touch on ridges, which count as flat for its stability, but not for derivatives.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    line
        The controls by c.
    c
        Parameter of the line of controls.
    state
        The equilibrium there.
    names
        Parameters (k,) of the derivatives.
    mixed
        Whether the mixed derivatives are computed, to interpolate between this node and the next; zero otherwise.
    judged
        Whether its stability is judged; else it counts as stable, and the tangent is not factorised where earlier
        factors serve.
    accuracy
        Relative error of the slope, where it is solved by iteration [-].

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    controls, free, stable = line.at(c), NO_MODES, True
    by_control = _rate_of_gradient(statics, line, state)
    if judged:
        at = statics.tangent_at(state, controls)
        if statics.seeks_free_modes or statics.n_unstable() != 0:
            free = exclude_free_modes(statics, at)
        stable = bool(pushing(statics.system, state).any()) or statics.n_unstable() == 0
        if stable and at.is_convex:
            statics.factorise(statics.system.linearise(state, controls, statics.theta), free=free)
    else:
        at = statics.system.linearise(state, controls, statics.theta)
        statics.take(at)
    moving = _moving(statics, state, names)
    moved = tuple(names[k] for k in moving)
    given = statics.system.given(state, controls, statics.theta, at.known)
    by_theta = statics.system.gradient_by_parameters(given, moved)
    dz = -statics.solve(np.column_stack([by_control, by_theta]), accuracy)
    # The effort of a held actuator is prescribed: its rate is the line's.
    efforts = dz[statics.system.layout.first_effort_unknown :]
    efforts[line.is_held, 0] = line.effort_rate[line.is_held]
    slope, by_parameter = dz[:, 0], dz[:, 1:]
    of_both = mixed_derivatives(statics, controls, state, slope, by_parameter, moved if mixed else ())
    by_parameter, of_both = (_at(moving, values, len(names)) for values in (by_parameter, of_both))
    return Node(c, state, slope, by_parameter, of_both, stable, free=free)


def by_parameters(statics: Statics, state: State, controls: Controls, names: tuple[str, ...]) -> Floats:
    """dz/dtheta at fixed controls (n_unknowns, k), by the tangent factorised last.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    state
        The equilibrium.
    controls
        Its controls.
    names
        Parameters (k,) by dotted name.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    moving = _moving(statics, state, names)
    if not moving:
        return np.zeros((statics.system.layout.n_unknowns, len(names)))
    moved = tuple(names[k] for k in moving)
    by_theta = statics.system.gradient_by_parameters(statics.system.given(state, controls, statics.theta), moved)
    return _at(moving, -statics.solve(by_theta), len(names))


def _moving(statics: Statics, state: State, names: tuple[str, ...]) -> list[int]:
    """The columns of the parameters that an equilibrium depends on; the offset of a marker leaves it as it is."""
    remembered = () if state.memory is None else state.memory.by_parameter
    return [k for k, name in enumerate(names) if name in statics.system.parameters or name in remembered]


def _at(columns: list[int], values: Floats, n: int) -> Floats:
    """An array (n_unknowns, n) with values in some columns, zero in the others."""
    if len(columns) == n:
        return values
    out = np.zeros((len(values), n))
    out[:, columns] = values
    return out


def pushing(system: System, state: State) -> np.ndarray:
    """Mask (n_actuators,) of the efforts outside their limits, as of a cable in compression: such a state is
    at most an intermediate one.
    """
    (least, most), none = system.effort_limits, np.zeros_like(state.effort)
    for term in system.actuated:  # efforts of one kind have one unit
        none[term.own] = NO_EFFORT * np.abs(state.effort[term.own]).max(initial=0.0)
    return (state.effort < least - none) | (state.effort > most + none)


def returning(statics: Statics, effort: Floats, gap: Floats) -> np.ndarray:
    """Which actuators (n_actuators,) at a prescribed effort must be driven again: those whose effort is not at a limit,
    or that could close a gap of their coordinate to the prescribed one by leaving it, as a slack cable that is too
    long.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    effort
        Efforts (n_actuators,), each in its own unit.
    gap
        Prescribed coordinates less the present ones (n_actuators,).
    """
    least, most = statics.system.effort_limits
    tolerance = statics.system.coordinate_tolerances(statics.length)
    return np.where(effort <= least, gap > tolerance, (effort < most) | (gap < -tolerance))


def _rate_of_gradient(statics: Statics, line: Line, state: State) -> Floats:
    """d reduced gradient / dc at fixed z."""
    system = statics.system
    layout = system.layout
    rate = np.zeros(layout.n_unknowns)
    rate[layout.first_effort_unknown :] = np.where(line.is_held, 0.0, line.coordinate_rate)
    inner = rate[: layout.first_effort_unknown]
    if line.load_rate != 0.0:
        by_load = system.gradient_by_load(state, line.at(0.0), statics.theta)
        inner += line.load_rate * by_load[: layout.first_effort_unknown]
    for i in np.flatnonzero(line.is_held & (line.effort_rate != 0.0)):
        rate += line.effort_rate[i] * system.gradient_by_effort(state, int(i), line.at(0.0), statics.theta)
    return rate
