"""Motion in time by backward Euler: each step converged by Newton's method, or one linear solve as in SOFA.

A converged step is an equilibrium of the system with inertia (`time_step.py`), found like any other, with the
actuators' forces at the step's end. One linear solve is the first Newton iteration from the step's start, with the
actuators applied as constraints: their directions are those at the step's start, a prescribed effort adds its force
along them, and a prescribed coordinate is satisfied to first order by the efforts that correct the free motion. That is
SOFA's sequence of free motion and correction, with one exception: no effort passes its limits, so that no cable is ever
in compression.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.actuator import SWITCHING
from softcal.mechanics.damping import Damping, Scheme
from softcal.mechanics.inertia import Inertia
from softcal.mechanics.node import pushing, returning
from softcal.mechanics.state import State, moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import Instant, after, coasting, in_step

# Controls by time: `is_held` marks the actuators with prescribed effort; all others have a prescribed coordinate.
Drive = Callable[[float], Controls]

MAX_HALVINGS = 6
ADVICE = "Try a shorter time step, a slower pull, or converged steps."


class Dynamics:
    """A system with mass and damping at parameters theta, and the factorisation kept from step to step."""

    def __init__(
        self,
        system: System,
        inertia: Inertia,
        theta: Mapping[str, float],
        damping: Damping,
        scheme: Scheme = "converged",
    ) -> None:
        self.system = system
        self.inertia = inertia
        self.damping = damping
        self.scheme: Scheme = scheme
        self.theta = dict(theta)
        self.n_halvings = 0
        self._statics = Statics(system, theta)

    @property
    def n_factorisations(self) -> int:
        """Number of factorisations in all steps so far."""
        return self._statics.n_factorisations

    def advance(self, now: Instant, step: float, drive: Drive) -> Instant:
        """The instant at the end of a step. A step that does not converge is halved, repeatedly.

        Parameters
        ----------
        now
            The instant at its start.
        step
            Its length [s].
        drive
            The controls by time [s].

        Raises
        ------
        SimulationError
            Where a step of 1/64 of the length does not converge either; at once with one linear solve, whose result
            depends on the step.
        """
        if self.scheme == "one-solve":
            return self._one_solve(now, step, replace(drive(now.time + step), elapsed=step))
        return self._halved(now, step, drive, MAX_HALVINGS)

    def release(self) -> None:
        """Release the factors' memory."""
        self._statics.release()

    def _begin(self, now: Instant, step: float) -> System:
        self._statics.system = in_step(self.system, self.inertia, self.damping, step, now, self.theta)
        return self._statics.system

    def _halved(self, now: Instant, step: float, drive: Drive, halvings: int) -> Instant:
        try:
            return self._converged(now, step, replace(drive(now.time + step), elapsed=step))
        except SimulationError as error:
            if halvings == 0:
                raise SimulationError(
                    f"No motion found from {now.time:.6g} s on: with a step of {step:.3g} s, {error}"
                ) from error
        self.n_halvings += 1
        middle = self._halved(now, 0.5 * step, drive, halvings - 1)
        return self._halved(middle, 0.5 * step, drive, halvings - 1)

    def _converged(self, now: Instant, step: float, wanted: Controls) -> Instant:
        """Newton's method from the state extrapolated by the velocities, or else from the step's start."""
        self._begin(now, step)
        try:
            ahead = self._statics.reachable(now.state, coasting(self.system.layout, now, step))
            return after(now, self._equilibrium(ahead, wanted), step)
        except SimulationError:
            return after(now, self._equilibrium(now.state, wanted), step)

    def _equilibrium(self, state: State, wanted: Controls) -> State:
        """Equilibrium with inertia; actuators of prescribed coordinate switch between that and a limit of their effort
        (cables: taut and slack) until no effort is beyond a limit, and no actuator at one has to be driven.
        """
        system, limits = self._statics.system, self._statics.system.effort_limits
        by_coordinate = ~wanted.is_held
        limited = np.clip(state.effort, *limits)
        at_limit = by_coordinate & np.where(
            state.effort <= limits[0], self._gap(state, wanted) <= 0.0, state.effort >= limits[1]
        )
        at_limit &= system.engaged(wanted.is_held | at_limit, wanted)
        for _ in range(4 * len(system.actuators) + 4):
            effort = np.where(by_coordinate, limited, wanted.effort)
            controls = replace(wanted, is_held=wanted.is_held | at_limit, effort=effort)
            solved = self._statics.equilibrium(
                replace(state, effort=np.where(at_limit, limited, state.effort)), controls
            )
            if not solved.converged:
                raise SimulationError(f"{solved.status}.")
            state = solved.state
            pushes = by_coordinate & ~at_limit & pushing(system, state)
            returns = at_limit & returning(self._statics, state.effort, self._gap(state, wanted))
            before, at_limit = at_limit, (at_limit | pushes) & ~returns
            at_limit &= system.engaged(wanted.is_held | at_limit, wanted)
            if np.all(at_limit == before):
                return system.advanced(state, controls, self.theta)
            limited = np.clip(state.effort, *limits)
        raise SimulationError(f"{SWITCHING}.")

    def _gap(self, state: State, wanted: Controls) -> Floats:
        """The prescribed coordinates less the present ones (n_actuators,): of a cable, the excess of its length [m]."""
        return wanted.coordinate - self.system.commanded(state, self.theta)

    def _one_solve(self, now: Instant, step: float, wanted: Controls) -> Instant:
        system = self._begin(now, step)
        statics, n = self._statics, len(system.actuators)
        free = Controls(np.ones(n, dtype=bool), np.zeros(n), wanted.coordinate, wanted.load, wanted.elapsed)
        start = replace(now.state, effort=np.zeros(n))
        at = system.linearise(start, free, self.theta)
        if not at.is_admissible:
            raise SimulationError(f"At {now.time:.6g} s the state is not admissible: {at.why_not}. {ADVICE}")
        statics.factorise(at)
        acting = np.flatnonzero(~wanted.is_held | (wanted.effort != 0.0))
        columns = np.zeros((len(at.reduced), 1 + len(acting)))
        columns[:, 0] = at.reduced
        for k, i in enumerate(acting):
            columns[: system.layout.first_effort_unknown, 1 + k] = system.drive(start, int(i), self.theta).columns[:, 0]
        solved = statics.solve(columns)
        dz, responses = -solved[:, 0], solved[:, 1:]
        effort = np.where(wanted.is_held, wanted.effort, 0.0)
        dz -= responses @ effort[acting]
        driven = ~wanted.is_held[acting]
        if driven.any():
            # A transmission, such as a gas, is linearised about its present effort; that of what only pulls is linear.
            present = np.where(system.effort_limits[0] == 0.0, 0.0, now.state.effort)
            about = replace(start, effort=present)
            drives = [system.drive(about, int(i), self.theta) for i in acting[driven]]
            corner = np.concatenate([drive.corner.diagonal() for drive in drives])
            rows = np.concatenate([drive.rows.T for drive in drives])
            rows = np.concatenate([rows, np.zeros((len(rows), n))], axis=1)
            gap = self._gap(about, wanted)[acting[driven]] + rows @ dz - corner * present[acting[driven]]
            least, most = (limit[acting[driven]] for limit in system.effort_limits)
            efforts = efforts_within(least, most, rows @ responses[:, driven] - np.diag(corner), gap)
            dz -= responses[:, driven] @ efforts
            effort[acting[driven]] = efforts
        dz[system.layout.first_effort_unknown :] = effort
        state = moved(system.layout, start, dz)
        time = now.time + step
        why_not = system.why_not(state) or ("" if np.isfinite(state.x).all() else "a position is not finite")
        if why_not:
            raise SimulationError(f"One linear solve overshoots at {time:.6g} s: {why_not}. {ADVICE}")
        if system.free_way(start, state) < 1.0:
            raise SimulationError(f"One linear solve passes through a contact at {time:.6g} s. {ADVICE}")
        return after(now, system.advanced(state, free, self.theta), step)


def efforts_within(least: Floats, most: Floats, compliance: Floats, gap: Floats) -> Floats:
    """Efforts e (n,) that close the gaps g of prescribed coordinates: C e = g, but for C e > g where an effort is at
    its lower limit (a slack cable), and C e < g at an upper one.

    Parameters
    ----------
    least, most
        Limits of the efforts (n,), each in its own unit.
    compliance
        C (n, n): coordinates by efforts.
    gap
        g (n,), each in its own unit.

    Raises
    ------
    SimulationError
        Where none are found.
    """
    n = len(gap)
    e = np.where(np.isfinite(least), least, np.clip(0.0, None, most))
    driven = np.isinf(least) | (gap > 0.0)
    for _ in range(4 * n + 4):
        free, held = np.flatnonzero(driven), np.flatnonzero(~driven)
        e[free] = np.linalg.solve(compliance[np.ix_(free, free)], gap[free] - compliance[np.ix_(free, held)] @ e[held])
        left, close = gap - compliance @ e, 1e-12 * np.abs(gap).max(initial=0.0)
        passes = driven & ((e < least) | (e > most))
        returns = ~driven & np.where(e >= most, left < -close, left > close)
        if not passes.any() and not returns.any():
            return e
        e, driven = np.clip(e, least, most), (driven & ~passes) | returns
    raise SimulationError(f"{SWITCHING}.")
