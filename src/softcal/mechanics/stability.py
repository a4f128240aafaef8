"""Where the robot goes from an equilibrium that is not stable: down, as through honey, until it stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.state import State, distance
from softcal.mechanics.statics import NO_MODES, TOLERANCE, TORN, Equilibrium, Statics
from softcal.mechanics.system import Controls, Linearisation

NUDGE = 1e-3  # of the robot's extent: how far it is pushed off at first
LEAST_DRAG, MOST_DRAG = 1e-11, 1e6  # of the tangent's usual diagonal entry; what rounding makes is below
MORE, LESS = 4.0, 0.5  # drag after a step that went wrong, and after one that went well
INVERSE_ITERATIONS = 12
MAX_STEPS = 300
NEARLY = 1e-3  # residual from which Newton's method may end it


def fall(statics: Statics, state: State, controls: Controls) -> Equilibrium:
    """The stable equilibrium that an overdamped robot comes to from a state under these controls.

    From an unstable equilibrium it is pushed off in the direction in which it falls fastest, always to the same side:
    of a symmetric robot's two ways one is taken. Implicit Euler steps with drag, (K + drag) dz = -g, go down in energy;
    the drag is as small as the steps allow, but never so small that a step would go up. Never raises: the status says
    why where none is found.
    """
    layout = statics.system.layout
    statics.seeks_free_modes, statics.free_modes = True, NO_MODES
    residual, drag, last = np.inf, LEAST_DRAG, 0.0
    state = replace(state, tension=np.where(controls.is_held, controls.tension, state.tension))
    try:
        at = statics.system.linearise(state, controls, statics.theta)
        for step in range(MAX_STEPS):
            residual = statics.norm(at)
            ended = statics.equilibrium(state, controls) if residual < NEARLY else None
            # Further off than by a last step it may be another equilibrium than the one that the robot falls to.
            if ended is not None and ended.converged and distance(layout, ended.state, state) <= last:
                there = statics.tangent_at(ended.state, controls)
                if is_stable(statics, there):
                    return replace(ended, n_iterations=step + ended.n_iterations)
                if residual < TOLERANCE:
                    drag = _holding(statics, there, LEAST_DRAG)
                    state = statics.reachable(ended.state, _push(statics))
                    at = statics.system.linearise(state, controls, statics.theta)
            before = state
            state, at, drag = _down(statics, state, controls, at, max(LESS * drag, LEAST_DRAG))
            last = distance(layout, state, before)
    except SimulationError as error:
        return Equilibrium(state, False, 0, residual, str(error).rstrip("."))
    return Equilibrium(state, False, MAX_STEPS, residual, f"it does not come to rest within {MAX_STEPS} steps")


def is_stable(statics: Statics, at: Linearisation) -> bool:
    """Whether an equilibrium, linearised and factorised last, is one of least energy. One that can move without force
    counts as stable: rounding alone decides on the sign of its eigenvalue.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    if statics.n_unstable() == 0:
        return True
    statics.factorise(at, LEAST_DRAG)
    held = statics.n_unstable() == 0
    statics.factorise(at)
    return held


def _holding(statics: Statics, at: Linearisation, drag: float) -> float:
    """Factorise with the least drag, of those from `drag` on, with which no direction is left to fall in."""
    while drag < MOST_DRAG:
        statics.factorise(at, drag)
        if statics.n_unstable() == 0:
            return drag
        drag *= MORE
    raise SimulationError("No drag holds it.")


def _push(statics: Statics) -> Floats:
    """A small step in the direction that the drag factorised last barely holds (inverse iteration)."""
    layout = statics.system.layout
    moving = layout.first_pressure_unknown
    seed = np.zeros(layout.n_unknowns)
    seed[:moving] = np.random.default_rng(1).standard_normal(moving)
    mode = seed
    for _ in range(INVERSE_ITERATIONS):
        pushed = np.zeros_like(mode)
        pushed[:moving] = mode[:moving] / np.linalg.norm(mode[:moving])
        mode = statics.solve(pushed)
    mode = mode * np.sign(mode[:moving] @ seed[:moving])
    mode[layout.first_tension_unknown :] = 0.0
    return (NUDGE * statics.length / statics.reach(mode)) * mode


def _down(
    statics: Statics, state: State, controls: Controls, at: Linearisation, drag: float
) -> tuple[State, Linearisation, float]:
    """One step with as much drag as it takes: the state, its linearisation, and that drag."""
    moving = statics.system.layout.first_pressure_unknown
    while drag < MOST_DRAG:
        drag = _holding(statics, at, drag)
        dz = -statics.solve(at.reduced)
        if statics.limited(dz) == 1.0:
            candidate = statics.reachable(state, dz)
            if statics.is_torn(candidate):
                raise SimulationError(TORN)
            there = statics.system.linearise(candidate, controls, statics.theta)
            if there.is_admissible and dz[:moving] @ (at.reduced + there.reduced)[:moving] <= 0.0:
                return candidate, there, drag
        drag *= MORE
    raise SimulationError("No drag holds it.")
