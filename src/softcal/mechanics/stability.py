"""Where the robot goes from an equilibrium that is not stable: down, as through honey, until it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.free_modes import exclude_free_modes
from softcal.mechanics.state import State
from softcal.mechanics.statics import FREE, NO_MODES, TOLERANCE, TORN, Equilibrium, Statics
from softcal.mechanics.system import Controls, Linearisation

NUDGE = 1e-3  # of the robot's extent: how far it is pushed off at first
LEAST_DRAG, MOST_DRAG = 1e-11, 1e6  # of the tangent's usual diagonal entry; what rounding makes is below
MORE, LESS, MUCH_LESS = 4.0, 0.5, 0.1  # drag after steps that went wrong, well, and as far as they may
INVERSE_ITERATIONS = 12
MAX_STEPS = 120
ASK_AGAIN = 10  # steps after which it may stand, though the residual is no smaller
CHORDS = 12  # steps with one factorisation, at most
ASIDE = 3  # of them that may lead up the side of a valley before one leads down it
BACK = 0.5  # of the step before, and cosine of the angle to it: more of it taken back is too far
WORSE = 10.0  # times the residual before: the factors do not serve any more

Switched = Callable[[State, Controls], Controls]


def fall(
    statics: Statics, state: State, controls: Controls, switched: Switched = lambda state, controls: controls
) -> Equilibrium:
    """The stable equilibrium that an overdamped robot comes to from a state under these controls.

    From an unstable equilibrium it is pushed off in the direction in which it falls fastest, always to the same side:
    of a symmetric robot's two ways one is taken. Implicit Euler steps with drag, (K + drag) dz = -g, go down in energy;
    the drag is as small as the steps allow, but never so small that a step would go up. Never raises: the status says
    why where none is found. switched: the controls to go on with from a state, cables taut or slack as they are there.
    """
    statics.free_modes = NO_MODES
    residual, drag, less, tried, work = np.inf, LEAST_DRAG, LESS, np.inf, 0.0
    state = replace(state, tension=np.where(controls.is_held, controls.tension, state.tension))
    try:
        at = statics.system.linearise(state, controls, statics.theta)
        for step in range(MAX_STEPS):
            if (now := switched(state, controls)) is not controls:
                controls, tried = now, np.inf
                state = replace(state, tension=np.where(controls.is_held, controls.tension, state.tension))
                at = statics.system.linearise(state, controls, statics.theta)
            residual = statics.norm(at)
            if residual < FREE and (residual < 0.1 * tried or step % ASK_AGAIN == 0):
                ended, tried = _at_rest(statics, state, controls), residual
                stays = ended.converged and switched(ended.state, controls) is controls
                if stays and statics.n_unstable() == 0:
                    return replace(ended, n_iterations=step + ended.n_iterations, work=work)
                if stays:
                    drag, tried = _holding(statics, statics.tangent_at(ended.state, controls), LEAST_DRAG), np.inf
                    state = statics.reachable(ended.state, _push(statics))
                    at = statics.system.linearise(state, controls, statics.theta)
            way, drag = _down(statics, state, controls, at, max(less * drag, LEAST_DRAG))
            state, work = way.state, work + way.work
            at = statics.system.linearise(state, controls, statics.theta)
            less = MUCH_LESS if way.is_easy else LESS
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


def _at_rest(statics: Statics, state: State, controls: Controls) -> Equilibrium:
    """The equilibrium close to a state but for motions that need no force, its tangent factorised without them.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    statics.free_modes = exclude_free_modes(statics, statics.tangent_at(state, controls))
    ended = statics.equilibrium(state, controls)
    statics.free_modes = NO_MODES
    if ended.converged:
        exclude_free_modes(statics, statics.tangent_at(ended.state, controls))
    return ended


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


@dataclass(frozen=True)
class _Way:
    """A way down: where it leads, the energy that it gives off [J], and whether less drag would have held it."""

    state: State
    work: float
    is_easy: bool


def _down(statics: Statics, state: State, controls: Controls, at: Linearisation, drag: float) -> tuple[_Way, float]:
    """Down with one factorisation, of as much drag as it takes, also given."""
    while drag < MOST_DRAG:
        drag = _holding(statics, at, drag)
        way = _with_factors(statics, state, controls, at)
        if way.state is not state:
            return way, drag
        drag *= MORE
    raise SimulationError("No drag holds it.")


def _with_factors(statics: Statics, state: State, controls: Controls, at: Linearisation) -> _Way:
    """Step after step with the factors at hand, as long as they serve; the state itself where they lead up. A step
    along a curved valley leads up its side first, and the next ones down again.
    """
    moving = slice(statics.system.layout.first_pressure_unknown)
    tensions = slice(statics.system.layout.first_tension_unknown, None)
    here, best, given_off, climbed, aside, residual = state, state, 0.0, 0.0, 0, np.inf
    dz = np.zeros(0)
    for _ in range(CHORDS):
        before, dz = dz, -statics.solve(at.reduced)
        if before.size and (statics.limited(dz) < 1.0 or _turns_back(statics, before, dz)):
            break
        dz = statics.limited(dz) * dz  # lengths that are given lead far whatever the drag
        here = statics.reachable(here, dz)
        if statics.is_torn(here):
            raise SimulationError(TORN)
        there = statics.system.linearise(here, controls, statics.theta, tangent=False)
        if not there.is_admissible:
            break
        # Energies compare among states with the lengths that are given: to these, first.
        if float(np.abs(at.reduced[tensions]).max(initial=0.0)) < FREE * statics.length:
            climbed += 0.5 * float(dz[moving] @ (at.reduced + there.reduced)[moving])
        at = there
        aside = aside + 1 if climbed > 0.0 else 0
        if aside == ASIDE:
            break
        if aside:
            continue
        best, given_off, climbed = here, given_off - climbed, 0.0
        worse, residual = WORSE * max(residual, FREE), statics.norm(at)
        if residual < TOLERANCE or residual > worse:
            break
    else:
        return _Way(best, given_off, aside == 0)
    return _Way(best, given_off, False)


def _turns_back(statics: Statics, before: Floats, dz: Floats) -> bool:
    """Whether a step takes much of the one before back, which led too far: across a hill, at worst."""
    moving = slice(statics.system.layout.first_pressure_unknown)
    one, other = before[moving] / statics.unit[moving], dz[moving] / statics.unit[moving]
    lengths = float(np.linalg.norm(one)), float(np.linalg.norm(other))
    return lengths[1] > BACK * lengths[0] and float(one @ other) < -BACK * lengths[0] * lengths[1]
