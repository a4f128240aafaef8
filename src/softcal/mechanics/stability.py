"""The stable equilibrium that a robot reaches from an unstable one: overdamped motion, a gradient flow.

With the potential Pi(z), its gradient g and its tangent K, an overdamped robot moves by

    D z' = -g(z),    D = 1 / unit^2 on points and frames, zero on pressures and efforts

so that Pi decreases until g = 0 again. The way there is of no interest, so steps are long. One implicit Euler step from
z_n, of a length 1 / drag, solves

    r(z) = g(z) + drag D (z - z_n) = 0

1. *Drag.* The least one, from the one before upwards by factors of `MORE`, at which K + drag D has no unstable
   direction: then the step's potential is convex at its begin, and the step goes downhill (`_holding`).
2. *Step.* Newton's method on r, with the factors of K + drag D (`_step`). A correction above `SERVES` of the one
   before asks for new factors, once a correction has been taken with the old ones, and only in the first step with
   them; else the step fails. The energy that it releases is -1/2 (z - z_n) . (g(z_n) + g(z)); a step that would take
   energy fails, once the prescribed lengths are satisfied.
3. *Several steps* share one factorisation (`_down`). Then the drag decreases: much where they were easy, little
   where one failed, and not at all where it had to be raised.
4. *Rest.* Where the residual is small, Newton's method without drag looks for the equilibrium nearby, modes of
   motion without force excluded (`_at_rest`). If it is stable, that is the result. If not, as at the start, the robot
   is pushed along its most unstable direction u, which inverse iteration finds since the least drag that stabilises it
   makes it nearly singular,

       (K + drag D) u_(i+1) = D u_i / |D^(1/2) u_i|,

   by `NUDGE` of its extent, always with the same sign: of a symmetric robot's two branches one is taken.

Between steps `switched` may drive other actuators: cables become taut or slack as the robot moves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.free_modes import exclude_free_modes
from softcal.mechanics.state import State, difference
from softcal.mechanics.statics import FREE, NO_MODES, TOLERANCE, TORN, Equilibrium, Statics
from softcal.mechanics.system import Controls, Linearisation

NUDGE = 1e-3  # of the robot's extent: size of the initial perturbation
LEAST_DRAG, MOST_DRAG = 1e-11, 1e6  # of the tangent's typical diagonal entry; rounding errors are below
MORE, LESS, MUCH_LESS = 4.0, 0.3, 0.1  # factors on the drag after failure, convergence, and easy convergence
INVERSE_ITERATIONS = 12
MAX_STEPS = 120
ASK_AGAIN = 10  # steps after which equilibrium is tested, even though the residual is no smaller
SOLVES = 12  # with one factorisation, about
ITERATIONS = 6  # of Newton's method in a step
SERVES = 0.5  # of the correction before: larger ones require a new factorisation, or more drag
CLOSE = 0.3  # of a step: it ends with corrections as small; the next one corrects the remaining error

Switched = Callable[[State, Controls], Controls]


def overdamped_equilibrium(
    statics: Statics, state: State, controls: Controls, switched: Switched = lambda state, controls: controls
) -> Equilibrium:
    """The stable equilibrium that an overdamped robot reaches from a state, see the top of this file. Never raises:
    where there is none, the status says why.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    state
        The state at the begin.
    controls
        The controls.
    switched
        The controls to continue with from a state, with cables taut or slack as they are there.
    """
    statics.free_modes = NO_MODES
    residual, tried, work = np.inf, np.inf, 0.0
    state = replace(state, effort=np.where(controls.is_held, controls.effort, state.effort))
    try:
        at = statics.system.linearise(state, controls, statics.theta)
        least = drag = LEAST_DRAG * statics.stiffness(at)
        for step in range(MAX_STEPS):
            if (now := switched(state, controls)) is not controls:
                controls, tried = now, np.inf
                state = replace(state, effort=np.where(controls.is_held, controls.effort, state.effort))
                at = statics.system.linearise(state, controls, statics.theta)
            residual = statics.norm(at)
            if residual < FREE and (residual < 0.1 * tried or step % ASK_AGAIN == 0):
                # The equilibrium close by up to free modes, its tangent factorised without them.
                statics.free_modes = exclude_free_modes(statics, statics.tangent_at(state, controls))
                ended, tried = statics.equilibrium(state, controls), residual
                statics.free_modes = NO_MODES
                if ended.converged:
                    exclude_free_modes(statics, statics.tangent_at(ended.state, controls))
                stays = ended.converged and switched(ended.state, controls) is controls
                if stays and statics.n_unstable() == 0:
                    return replace(ended, n_iterations=step + ended.n_iterations, work=work)
                if stays:
                    drag = _holding(statics, statics.tangent_at(ended.state, controls), least)
                    state = statics.reachable(ended.state, _push(statics))
                    at = statics.system.linearise(state, controls, statics.theta)
                    tried = statics.norm(at)  # no new test for equilibrium before it has moved on
                elif not ended.converged and residual < TOLERANCE:
                    return replace(ended, n_iterations=step)
            way = _down(statics, state, controls, at, drag)
            drag = max(way.drag * (1.0 if way.drag > drag else MUCH_LESS if way.is_easy else LESS), least)
            state, work = way.state, work + way.work
            at = statics.system.linearise(state, controls, statics.theta)
    except SimulationError as error:
        return Equilibrium(state, False, 0, residual, str(error).rstrip("."))
    return Equilibrium(state, False, MAX_STEPS, residual, f"it does not come to rest within {MAX_STEPS} steps")


def is_stable(statics: Statics, at: Linearisation) -> bool:
    """Whether the energy of an equilibrium, linearised and factorised last, is a minimum. One with free modes counts as
    stable: the sign of their eigenvalues is rounding error.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    if statics.n_unstable() == 0:
        return True
    statics.factorise(at, LEAST_DRAG * statics.stiffness(at))
    held = statics.n_unstable() == 0
    statics.factorise(at)
    return held


def _holding(statics: Statics, at: Linearisation, drag: float) -> float:
    """Factorise with the least drag, from `drag` upwards, at which no direction is unstable.

    Raises
    ------
    SimulationError
        Where none is enough, or the work is at a limit.
    """
    most = MOST_DRAG * statics.stiffness(at)
    while drag < most:
        if over := statics.why_over():
            raise SimulationError(over)
        statics.factorise(at, drag)
        if statics.n_unstable() == 0:
            return drag
        drag *= MORE
    raise SimulationError("No drag stabilises it.")


def _push(statics: Statics) -> Floats:
    """A small step in the direction that the drag factorised last barely stabilises: (K + drag) dz = least * drag dz
    (inverse iteration, in the units in which the drag is the same for all).
    """
    layout = statics.system.layout
    moving = layout.first_pressure_unknown
    unit = statics.unit[:moving]
    seed = np.random.default_rng(1).standard_normal(moving)
    mode, dz = seed, np.zeros(layout.n_unknowns)
    for _ in range(INVERSE_ITERATIONS):
        load = np.zeros_like(dz)
        load[:moving] = mode / np.linalg.norm(mode) / unit
        dz = statics.solve(load)
        mode = dz[:moving] / unit
    dz *= np.sign(mode @ seed)
    dz[layout.first_effort_unknown :] = 0.0
    return (NUDGE * statics.length / statics.reach(dz)) * dz


@dataclass(frozen=True)
class _Way:
    """Several steps of overdamped motion: their end, the energy released [J], the drag used, and whether less
    would do.
    """

    state: State
    work: float
    drag: float
    is_easy: bool


def _down(statics: Statics, state: State, controls: Controls, at: Linearisation, drag: float) -> _Way:
    """As many steps as one factorisation serves, two where the first step needs it, with as much drag as necessary.

    Raises
    ------
    SimulationError
        Where no drag is enough, the robot is torn, or the work is at a limit.
    """
    while True:
        drag = _holding(statics, at, drag)
        step = _step(statics, state, controls, at, drag, may_factorise=True)
        if step is not None:
            break
        drag *= MORE
    work, solves = step.work, step.solves
    while solves < SOLVES and statics.norm(step.at) >= TOLERANCE:
        after = _step(statics, step.state, controls, step.at, drag, may_factorise=False)
        if after is None:
            return _Way(step.state, work, drag, False)
        step, work, solves = after, work + after.work, solves + after.solves
    return _Way(step.state, work, drag, True)


@dataclass(frozen=True)
class _Step:
    """A step's end, linearised, the energy released [J], and the number of solves."""

    state: State
    at: Linearisation
    work: float
    solves: int


def _step(
    statics: Statics, begin: State, controls: Controls, start: Linearisation, drag: float, *, may_factorise: bool
) -> _Step | None:
    """One implicit Euler step with the present factors; None where it does not converge.

    may_factorise: the factors are those at the step's start, and may be replaced where they do not serve.
    """
    layout = statics.system.layout
    moving, tensions = slice(layout.first_pressure_unknown), slice(layout.first_effort_unknown, None)
    unit = statics.unit[moving]
    at, here, r, before, is_fresh = start, begin, start.reduced, np.inf, may_factorise
    for n in range(1, ITERATIONS + 1):
        dz = -statics.solve(r)
        size = float(np.linalg.norm(dz[moving] / unit))
        if not is_fresh and (statics.limited(dz) < 1.0 or size > SERVES * before):
            if not may_factorise:
                return None
            statics.factorise(statics.system.linearise(here, controls, statics.theta), drag)
            if statics.n_unstable() != 0:
                return None
            dz = -statics.solve(r)
            size = float(np.linalg.norm(dz[moving] / unit))
        part = statics.limited(dz)  # prescribed lengths cause large steps at any drag
        if part == 1.0 and size > SERVES * before:
            return None
        here, is_fresh = statics.reachable(here, part * dz), False
        if statics.is_torn(here):
            raise SimulationError(TORN)
        at = statics.system.linearise(here, controls, statics.theta, tangent=False)
        if not at.is_admissible:
            return None
        way = difference(layout, here, begin)[moving]
        r = at.reduced.copy()
        r[moving] += drag * way / unit**2
        is_close = n > 1 and size < CLOSE * float(np.linalg.norm(way / unit))
        if part == 1.0 and (is_close or statics.measured(r, statics.force_scale(at)) < TOLERANCE):
            work = -0.5 * float(way @ (start.reduced + at.reduced)[moving])
            # Energies can be compared only among states that satisfy the prescribed lengths: reach these first.
            has_lengths = float(np.abs(start.reduced[tensions]).max(initial=0.0)) < FREE * statics.length
            return None if work < 0.0 and has_lengths else _Step(here, at, work, n)
        before = size if part == 1.0 else np.inf
    return None
