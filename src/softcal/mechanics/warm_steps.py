"""Steps from equilibrium to equilibrium in a loop, at the cost of substitutions: one factorisation serves many of them.

Where commands change little, so does the tangent. The chord method with a kept tangent K0,

    z <- z - K0^-1 r(z),    |r| -> q |r| with q about |1 - K0^-1 K|,

shrinks the residual by about the relative change of the tangent in each iteration, and an iteration needs neither a
tangent nor a factorisation. A step from commands u_n to u (`WarmSteps._warm`):

1. *Tangent.* The kept K0, if it is still the one factorised last and the same actuators are driven; else that of the
   last equilibrium, factorised, judged and kept with dz/du (`_judged`). If that is unstable, the march does the step.
2. *Prediction* (`_ahead`). Along the tangent, dz = (dz/du) (u - u_n); or, from the polynomial through the last
   equilibria (`trail.py`), if it is off that by at most `BENT` of its way: a kink is no polynomial, and the trail
   begins anew there.
3. *Chord iterations* (`_solved`), until |r| < `ACCURATE` * `TOLERANCE`, or, where it shrinks no further, `TOLERANCE`:
   so a state does not depend on the step to it. If two iterations do not shrink it to `SLOW`, or after `KEPT` of them,
   the tangent of the iterate is factorised, once in a step; if that is slow too, or after `MOST`, the march does it.
4. *Branch.* As on a path, the corrections together must be no longer than the prediction, and no actuator reversed.
5. *Taut and slack* (`_switches`). Efforts stay within their limits, and an actuator at a limit does not return; if one
   must switch, the march does the step, with its active set.
6. *Stability* is judged, by a new factorisation, where the robot moved by more than `JUDGED` of its extent since it
   was last, where the step took more than `MANY` iterations or replaced the tangent, and where derivatives are carried
   along.
7. *dz/du* (`by_command`) at the last equilibrium: predicted with the same weights from those of the equilibria before,
   and corrected by GMRES on its own tangent, with K0 as preconditioner, to `DERIVATIVES`.

The march (`march.py`) follows the load path from the last equilibrium or, where that line passes commands without an
equilibrium, from the beginning; a warm step to the same commands then makes the result as accurate as others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from threading import RLock

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.march import Reached, Target, by_command, held_at, reach, remembered
from softcal.mechanics.node import pushing, returning
from softcal.mechanics.path import SAME
from softcal.mechanics.state import State, difference
from softcal.mechanics.statics import TOLERANCE, Statics
from softcal.mechanics.system import Controls
from softcal.mechanics.trail import Trail, prescribed

SLOW = 0.3  # a residual that shrinks by less in two iterations needs another tangent; of forces and coordinates in turn
ACCURATE = 0.01  # of the tolerance, where rounding admits it: so a state does not depend on the step to it
MOST = 12  # iterations of a step in all
MANY = 6  # iterations: a step that needs more leaves a new factorisation to the next one
KEPT = 8  # iterations with a kept tangent at most; then follow some with that of the last iterate
DERIVATIVES = 1e-9  # relative error of dz/dcommand by a kept tangent
BENT = 0.5  # of a step, by which at most a prediction is off the tangent; a kink is no polynomial
JUDGED = 0.05  # of the robot's extent: the longest way on which its stability is not judged


@dataclass
class _Kept:
    """A factorised tangent at a stable state, for the steps near it.

    number: of the factorisation among those of the statics; by_command (n_unknowns, n_actuators): dz / d command there;
    way: how far the robot moved since then [m].
    """

    state: State
    is_held: np.ndarray
    number: int
    by_command: Floats
    way: float = 0.0


class WarmSteps:
    """A robot's equilibrium, moved from commands to commands.

    Attributes
    ----------
    statics
        The statics; a factorisation for other solutions leaves the next step without a kept tangent.
    begin
        The equilibrium to which `reset` returns.
    last
        The last equilibrium, from which the next step starts.
    n_iterations
        Number of iterations of the last step; 0 where the march was needed.
    turn
        Of the threads that use it, one at a time.
    """

    def __init__(self, statics: Statics, begin: Reached) -> None:
        self.statics, self.begin, self.turn = statics, begin, RLock()
        self.reset()

    def reset(self) -> None:
        """Return to the equilibrium of the beginning."""
        self.return_to(self.begin)

    def return_to(self, reached: Reached) -> None:
        """Return to an equilibrium that was reached before, with its memory."""
        self.last, self.n_iterations = reached, 0
        self._trail = self._begun(reached)
        self._rates: Floats | None = None  # dz/dcommand at the last step, predicted or as computed
        # Whether dz/dcommand of the last equilibrium was asked for; if so, the next one comes with its tangent.
        self._is_asked, self._tangent = False, (reached.state, None)
        self._kept: _Kept | None = None

    def to(self, aim: Target) -> Reached:
        """The equilibrium at other commands; the last one stays where this raises.

        Raises
        ------
        SimulationError
            Where there is no equilibrium, or none was found.
        """
        # Actuators that are commanded by their effort from now on begin at their present one.
        state, controls = self.last.state, self.last.controls
        released = aim.controls.is_held & ~controls.is_held
        if released.any():
            effort = np.where(released, state.effort, controls.effort)
            controls = replace(controls, is_held=controls.is_held | released, effort=effort)
            self.last = replace(self.last, controls=controls, commanded=None)
            self._trail = self._begun(self.last)
        try:
            reached = self._warm(aim)
        except SimulationError:
            reached = None
        if reached is None:
            reached = self._marched(aim)
            self.n_iterations = 0
        self.last = reached
        # The trail begins anew where the robot snapped, where other actuators are driven, or where it has turned far.
        leads_here = not reached.snaps and self._trail.leads_to(reached.controls)
        if not leads_here or self.statics.limited(self._trail.add(reached.controls, reached.state)) < 1.0:
            self._trail = self._begun(reached)
        return reached

    def factorise(self, state: State, controls: Controls) -> None:
        """The tangent of an equilibrium, for derivatives, unless it is the one factorised last.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        kept = self._serving(controls)
        if kept is not None and kept.state is state and self.statics.tangent.is_factorised:
            return
        if state is self.last.state:
            self._judged(state, controls)
        else:
            self.statics.factorise(self.statics.system.linearise(state, controls, self.statics.theta))

    def by_command(self, state: State, now: Controls, target: Controls, which: Ints) -> Floats:
        """dz / d command (n_unknowns, k) of some actuators at an equilibrium, by the kept tangent where that serves.

        Parameters
        ----------
        state, now, target, which
            See `march.by_command`.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        statics, kept = self.statics, self._serving(now)
        if kept is None or kept.state is state or state is not self.last.state:
            self.factorise(state, now)
            rates = by_command(statics, state, now, target, which)
        else:
            at = self._tangent[1] if self._tangent[0] is state else None
            statics.tangent.follow(at or statics.system.linearise(state, now, statics.theta))
            rates = by_command(statics, state, now, target, which, DERIVATIVES, self._rates)
            if statics.n_factorisations != kept.number:
                self._keep(state, now)
        if state is self.last.state:
            self._trail.add_rates(rates)
            self._rates, self._is_asked = rates, True
        return rates

    def _warm(self, aim: Target) -> Reached | None:
        """The step with a kept tangent, or with that of the last equilibrium; None where the march must do it."""
        statics, last, target = self.statics, self.last, aim.controls
        controls = held_at(target, last.controls.is_held, last.controls.effort)
        before = replace(last.controls, elapsed=target.elapsed)
        kept = self._serving(controls) or self._judged(last.state, before)
        solved = None if kept is None else self._solved(kept, controls)
        if kept is None or solved is None:
            return None
        state, self.n_iterations = solved
        if self._switches(state, controls, target):
            return None
        is_due = self.n_iterations > MANY or kept.way > JUDGED * statics.length or aim.names
        if (is_due or self._serving(controls) is None) and self._judged(state, controls) is None:
            return None
        return remembered(statics, state, controls, aim, (False, last.has_snapped))

    def _marched(self, aim: Target) -> Reached:
        """The step along a load path: from the last equilibrium, or from the beginning where its line passes commands
        without one. What remembers has no second way.
        """
        self._kept = None
        remembers = self.statics.system.remembers
        try:
            reached = reach(self.statics, self.last, aim)
        except SimulationError:
            if remembers or self.last is self.begin:
                raise
            reached = reach(self.statics, self.begin, aim)
        if remembers:
            return reached
        # A warm step to the same commands makes it as accurate as others, and leaves its factorisation to the next one.
        before, self.last = self.last, reached
        try:
            again = self._warm(aim)
        except SimulationError:
            again = None
        finally:
            self.last = before
        return reached if again is None else replace(again, snaps=reached.snaps, has_snapped=reached.has_snapped)

    def _serving(self, controls: Controls) -> _Kept | None:
        """The kept tangent, where it is factorised still and has the same actuators driven."""
        kept = self._kept
        if kept is None or kept.number != self.statics.n_factorisations:
            return None
        return kept if np.all(kept.is_held == controls.is_held) else None

    def _judged(self, state: State, controls: Controls) -> _Kept | None:
        """The tangent of an equilibrium, factorised and kept; None where that is unstable.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        statics = self.statics
        statics.factorise(statics.system.linearise(state, controls, statics.theta))
        return self._keep(state, controls)

    def _keep(self, state: State, controls: Controls) -> _Kept | None:
        """Keep the tangent factorised last, of a state; None where that is unstable."""
        statics = self.statics
        self._kept = None
        if statics.n_unstable() == 0:
            every = np.arange(len(controls.is_held))
            rates = by_command(statics, state, controls, controls, every)
            self._kept = _Kept(state, controls.is_held, statics.n_factorisations, rates)
        return self._kept

    def _solved(self, kept: _Kept, controls: Controls) -> tuple[State, int] | None:
        """The equilibrium and the number of iterations; None where these converge too slowly, or may lead to another
        branch.
        """
        statics = self.statics
        ahead = self._ahead(kept, controls)
        if statics.limited(ahead) < 1.0:
            return None
        state = statics.reachable(self.last.state, ahead)
        state = replace(state, effort=np.where(controls.is_held, controls.effort, state.effort))
        correction, moving = np.zeros_like(ahead), slice(statics.system.layout.first_pressure_unknown)
        before = previous = np.inf
        for iteration in range(MOST):
            # The first iteration is seldom the last one.
            tangent = self._is_asked and iteration > 0
            at = statics.system.linearise(state, controls, statics.theta, tangent=tangent)
            residual = statics.norm(at) if at.is_admissible else np.inf
            is_slow = not residual < SLOW * before
            at_end = is_slow or iteration == MOST - 1
            if residual < ACCURATE * TOLERANCE or (at_end and residual < TOLERANCE):
                # As `path.strays`, by the steps themselves.
                way, off = (float(np.linalg.norm(dz[moving])) for dz in (ahead, correction))
                is_reversed = any(term.is_reversed(self.last.state.x, state.x) for term in statics.system.actuated)
                if is_reversed or off > way + SAME * statics.length:
                    return None
                kept.way += statics.reach(ahead)
                self._is_asked, self._tangent = False, (state, at if tangent else None)
                return state, iteration + 1
            if is_slow or (iteration > KEPT and statics.n_factorisations == kept.number):
                if statics.n_factorisations != kept.number or not residual < 1.0:
                    return None
                statics.factorise(statics.system.linearise(state, controls, statics.theta))
                residual, previous = np.inf, np.inf
            dz = -statics.tangent.substitute(at.reduced)
            correction += dz
            state = statics.reachable(state, dz)
            before, previous = previous, residual
        return None

    def _ahead(self, kept: _Kept, controls: Controls) -> Floats:
        """The step dz (n_unknowns,) that is predicted from the last equilibrium to other commands."""
        statics, last = self.statics, self.last
        tangent = kept.by_command @ (prescribed(controls) - prescribed(last.controls))
        way = statics.reach(tangent)
        if way <= SAME * statics.length:  # a polynomial would show rounding errors
            return tangent
        predicted, self._rates = self._trail.beyond(controls, kept.by_command)
        ahead = difference(statics.system.layout, predicted, last.state)
        if statics.reach(ahead - tangent) <= BENT * way:
            return ahead
        self._trail = self._begun(last)
        return tangent

    def _begun(self, reached: Reached) -> Trail:
        return Trail(self.statics.system.layout, reached.controls, reached.state)

    def _switches(self, state: State, controls: Controls, target: Controls) -> bool:
        """Whether an actuator commanded by its coordinate must be held at a limit of its effort, or no longer."""
        if (~controls.is_held & pushing(self.statics.system, state)).any():
            return True
        at_limit = controls.is_held & ~target.is_held
        if not at_limit.any():
            return False
        gap = target.coordinate - self.statics.system.commanded(state, self.statics.theta)
        return bool((at_limit & returning(self.statics, state.effort, gap)).any())
