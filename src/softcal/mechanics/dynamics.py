"""Motion in time by backward Euler: each step converged by Newton's method, or one linear solve as in SOFA.

A converged step is an equilibrium of the system with inertia (`time_step.py`), found like any other, with the cables'
forces at the step's end. One linear solve is the first Newton iteration from the step's start, with the cables applied
as constraints: their directions are those at the step's start, a prescribed tension adds its force along them, and a
prescribed length is satisfied to first order by the tensions that correct the free motion. That is SOFA's sequence of
free motion and correction, with one exception: no cable is ever in compression.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.cable import SLACK_LENGTH, cables_of
from softcal.mechanics.damping import Damping, Scheme
from softcal.mechanics.inertia import Inertia
from softcal.mechanics.node import pushing
from softcal.mechanics.state import State, moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Controls
from softcal.mechanics.time_step import Instant, after, coasting, in_step

# Controls by time: `is_held` marks the cables with prescribed tension; all others have a prescribed length.
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
        """Number in all steps so far."""
        return self._statics.n_factorisations

    def advance(self, now: Instant, step: float, drive: Drive) -> Instant:
        """The instant one step [s] later. A step that does not converge is halved, repeatedly.

        Raises
        ------
        SimulationError
            Where a step of 1/64 of the length does not converge either; at once with one linear solve, whose result
            depends on the step.
        """
        if self.scheme == "one-solve":
            return self._one_solve(now, step, drive(now.time + step))
        return self._halved(now, step, drive, MAX_HALVINGS)

    def release(self) -> None:
        """Release the factors' memory."""
        self._statics.release()

    def _begin(self, now: Instant, step: float) -> System:
        self._statics.system = in_step(self.system, self.inertia, self.damping, step, now, self.theta)
        return self._statics.system

    def _halved(self, now: Instant, step: float, drive: Drive, halvings: int) -> Instant:
        try:
            return self._converged(now, step, drive(now.time + step))
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
        """Equilibrium with inertia; cables of prescribed length switch between taut and slack until none is in
        compression or too long.
        """
        cables = cables_of(self.system)
        by_length = ~wanted.is_held
        slack = by_length & (self._excess(state, wanted) <= 0.0) & (state.effort <= 0.0)
        for _ in range(4 * cables.n_cables + 4):
            tension = np.where(by_length, 0.0, wanted.effort)
            controls = replace(wanted, is_held=wanted.is_held | slack, effort=tension)
            solved = self._statics.equilibrium(replace(state, effort=np.where(slack, 0.0, state.effort)), controls)
            if not solved.converged:
                raise SimulationError(f"{solved.status}.")
            state = solved.state
            pushes = by_length & ~slack & pushing(self.system, state)
            too_long = slack & (self._excess(state, wanted) > SLACK_LENGTH * cables.rest_length)
            if not pushes.any() and not too_long.any():
                return self._statics.system.advanced(state, controls, self.theta)
            slack = (slack | pushes) & ~too_long
        raise SimulationError("cables keep switching between taut and slack.")

    def _excess(self, state: State, wanted: Controls) -> Floats:
        """Excess of each cable's length over its prescribed length (n_cables,) [m]."""
        cables = cables_of(self.system)
        return cables.lengths(state.x) - cables.rest_length + wanted.coordinate

    def _one_solve(self, now: Instant, step: float, wanted: Controls) -> Instant:
        system = self._begin(now, step)
        statics, n_cables = self._statics, cables_of(system).n_cables
        free = Controls(np.ones(n_cables, dtype=bool), np.zeros(n_cables), wanted.coordinate, wanted.load)
        start = replace(now.state, effort=np.zeros(n_cables))
        at = system.linearise(start, free, self.theta)
        if not at.is_admissible:
            raise SimulationError(f"At {now.time:.6g} s the state cannot be: {at.why_not}. {ADVICE}")
        statics.factorise(at)
        acting = np.flatnonzero(~wanted.is_held | (wanted.effort != 0.0))
        columns = np.zeros((len(at.reduced), 1 + len(acting)))
        columns[:, 0] = at.reduced
        for k, i in enumerate(acting):
            columns[: system.layout.first_effort_unknown, 1 + k] = system.force_gradient(start, int(i), self.theta)
        solved = statics.solve(columns)
        dz, responses = -solved[:, 0], solved[:, 1:]
        tension = np.where(wanted.is_held, wanted.effort, 0.0)
        dz -= responses @ tension[acting]
        taut = ~wanted.is_held[acting]
        if taut.any():
            rows = np.stack([-system.coordinate_gradient(start, int(i)) for i in acting[taut]])
            rows = np.concatenate([rows, np.zeros((len(rows), n_cables))], axis=1)
            excess = self._excess(start, wanted)[acting[taut]] + rows @ dz
            pulls = pulls_without_push(rows @ responses[:, taut], excess)
            dz -= responses[:, taut] @ pulls
            tension[acting[taut]] = pulls
        dz[system.layout.first_effort_unknown :] = tension
        state = moved(system.layout, start, dz)
        time = now.time + step
        why_not = system.why_not(state) or ("" if np.isfinite(state.x).all() else "a point is nowhere")
        if why_not:
            raise SimulationError(f"One linear solve goes too far at {time:.6g} s: {why_not}. {ADVICE}")
        if system.free_way(start, state) < 1.0:
            raise SimulationError(f"One linear solve passes through a contact at {time:.6g} s. {ADVICE}")
        return after(now, system.advanced(state, free, self.theta), step)


def pulls_without_push(compliance: Floats, excess: Floats) -> Floats:
    """Tensions T >= 0 (n,) with C T >= e, and equal to it where T > 0: cables of prescribed length, taut or slack.

    Raises
    ------
    SimulationError
        Where none are found.
    """
    n = len(excess)
    taut = excess > 0.0
    for _ in range(4 * n + 4):
        T = np.zeros(n)
        T[taut] = np.linalg.solve(compliance[np.ix_(taut, taut)], excess[taut])
        left = excess - compliance @ T
        pushes, too_long = T < 0.0, ~taut & (left > 1e-12 * np.abs(excess).max(initial=0.0))
        if not pushes.any() and not too_long.any():
            return T
        taut = (taut & ~pushes) | too_long
    raise SimulationError("Cables keep switching between taut and slack.")
