"""From one set of commands to the next, with an active-set method for efforts within their limits.

Of an actuator that is commanded by its coordinate q, with the effort e within its limits, one of two holds:

    driven:       q = q_commanded,    least < e < most        (a cable: taut)
    at a limit:   e = least, q >= q_commanded, or e = most, q <= q_commanded      (a cable: slack, e = 0)

Which, is the active set. The march from a sample to the next commands begins with that of the sample, and repeats
(`reach`):

1. *Line* (`_line`). Each driven actuator moves from its present coordinate to the commanded one, each that is commanded
   by its effort from that of the sample; those at a limit stay there. If the commands lie on the line that
   led to the sample, that line goes on, with its nodes and their curvature.
2. *Way.* One step with a tangent predictor (`_at_once`); where it does not converge or may lead to another branch,
   the path along the line (`path.py`). Where the line moves nothing, as when time alone has passed, the equilibrium.
3. *Check* at the end. Driven actuators whose effort passes a limit (`node.pushing`) are put at it, first by one solve,
   else along a path on which what is beyond decreases to zero (`_released`). Those at a limit whose coordinate
   commands that they leave it (`node.returning`) are driven. Without either the sample is reached.

A path that ends early at efforts beyond their limits goes on from the first node that has some, with these at their
limit. After a snap-through that was followed with a fixed set, switching would end elsewhere; then, and where the sets
do not settle, the robot moves overdamped from the last sample, and the set follows its state (`_fallen`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.actuator import SWITCHING
from softcal.mechanics.bordered import EXACT
from softcal.mechanics.node import Line, Node, by_parameters, node_at, pushing, returning
from softcal.mechanics.path import follow, strays
from softcal.mechanics.redundancy import DEPENDENT
from softcal.mechanics.snap_through import stable_node_at
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import Controls

SAME = 1e-9  # of the largest command: closer commands count as equal


@dataclass(frozen=True)
class CommandPath:
    """A straight line through the space of commands, and the last equilibria on it, from which it can be continued."""

    line: Line
    nodes: tuple[Node, ...]

    def to(self, target: Controls) -> float | None:
        """The parameter c of the target commands on the line, beyond its last node; None where they are not on this
        line.
        """
        line = self.line
        held = line.is_held
        start = np.where(held, line.effort, line.coordinate)
        rate = np.where(held, line.effort_rate, line.coordinate_rate)
        end = np.where(held, target.effort, target.coordinate)
        if not np.any(rate):
            return None
        c = float((end - start) @ rate / (rate @ rate))
        here = self.nodes[-1].c
        off = np.abs(start + c * rate - end).max() if c > here else np.inf
        return c if off <= SAME * np.abs(end).max() else None


@dataclass(frozen=True)
class Reached:
    """An equilibrium at some commands.

    Attributes
    ----------
    state
        The equilibrium, with its memory for the next one.
    controls
        The controls there.
    by_parameter
        dz/dtheta (n_unknowns, k).
    snaps, has_snapped
        Whether the robot snapped through on the line to this equilibrium, and whether on this line or any before it.
    commanded
        The line to this equilibrium; None where the next line cannot continue it.
    tangent
        Number of its tangent among the tangents of the statics.
    """

    state: State
    controls: Controls
    by_parameter: Floats
    snaps: bool = False
    has_snapped: bool = False
    commanded: CommandPath | None = None
    tangent: int = -1


@dataclass(frozen=True)
class Target:
    """Commands, and what else is wanted there.

    Attributes
    ----------
    controls
        The commands; `is_held` marks the actuators that are commanded by their effort, all others are by their
        coordinate.
    names
        Names of the parameters by which derivatives are wanted (k,).
    rates
        Derivatives of the commands by these (n_actuators, k); None: they are fixed.
    """

    controls: Controls
    names: tuple[str, ...] = ()
    rates: Floats | None = None


def reach(statics: Statics, last: Reached, aim: Target) -> Reached:
    """Solve at the target with an active-set loop: follow a straight line with each actuator driven, or held at a limit
    of its effort, as before (cables: taut or slack); hold those whose effort passes a limit, drive those at a limit
    again that must be, and repeat until unchanged.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    last
        The sample before.
    aim
        The commands, and the derivatives that are wanted.

    Raises
    ------
    SimulationError
        Where there is no equilibrium, or none was found.
    """
    target = aim.controls
    system, by_coordinate = statics.system, ~target.is_held
    state, snaps = last.state, False
    # A driven actuator moves from its present coordinate to the target's; the check below drives those at a limit.
    held = system.engaged(last.controls.is_held, target)
    start = replace(
        target,
        is_held=held,
        effort=np.where(held, last.controls.effort, 0.0),
        coordinate=system.commanded(state, statics.theta),
    )
    commanded, end = last.commanded, None if last.commanded is None else last.commanded.to(target)
    for _ in range(4 * len(system.actuators) + 4):
        if commanded is None or end is None:
            commanded, end = CommandPath(_line(start, target), ()), 1.0
        line, has_snapped = commanded.line, last.has_snapped or snaps
        statics.seeks_free_modes = has_snapped
        driven = by_coordinate & ~start.is_held
        if not np.any(line.effort_rate[start.is_held]) and not np.any(line.coordinate_rate[~start.is_held]):
            state, why_not = _settled(statics, line, state)
            if why_not:
                raise SimulationError(f"no equilibrium after further time under the same commands: {why_not}.")
            node, commanded = stable_node_at(statics, line, end, state, ()), None
            snaps |= node.is_snapped
        elif not commanded.nodes and (node := _at_once(statics, line, state, last)) is not None:
            commanded = CommandPath(line, (replace(node, has_snapped=has_snapped),))
        else:
            state = state if commanded.nodes else _settled(statics, line, state)[0]
            begin = commanded.nodes or (replace(node_at(statics, line, 0.0, state, ()), has_snapped=has_snapped),)
            path = follow(statics, line, begin, end, first_step=end - begin[-1].c, mixed=False)
            first = next((i for i, node in enumerate(path.nodes) if (driven & pushing(system, node.state)).any()), None)
            node = path.nodes[-1]
            if not path.reached and first is not None and DEPENDENT not in path.status:
                # A state with a cable in compression is not admissible: continue from the first one, with it slack.
                path = replace(path, nodes=path.nodes[: first + 1])
                node = node_at(statics, line, path.nodes[-1].c, path.nodes[-1].state, (), mixed=False)
            elif not path.reached:
                raise SimulationError(f"{path.ended} {100 * node.c / end:.3g} % of the step: {path.status}.")
            snaps |= path.snaps
            commanded = CommandPath(line, path.nodes[-2:])
        state, here = node.state, line.at(node.c)
        coordinates = system.commanded(state, statics.theta)
        pushes = driven & pushing(system, state)
        returns = by_coordinate & start.is_held & returning(statics, state.effort, target.coordinate - coordinates)
        returns &= node.c == end
        is_held = system.engaged((start.is_held | pushes) & ~returns, target)
        pushes &= is_held
        if np.all(is_held == start.is_held):
            controls = held_at(target, start.is_held, start.effort)
            snapped = snaps, last.has_snapped or snaps
            return remembered(statics, node.state, controls, aim, snapped, commanded)
        if snaps:
            break  # the snap-through was found with fixed taut and slack states; with switching ones it ends elsewhere
        effort = np.where(by_coordinate, np.clip(state.effort, *system.effort_limits), here.effort)
        start = replace(target, is_held=is_held, effort=np.where(is_held, effort, 0.0), coordinate=coordinates)
        if pushes.any():
            state = _released(statics, state, start, pushes)
            start = replace(start, coordinate=system.commanded(state, statics.theta))
        commanded = None
    return _fallen(statics, last, aim)


def _at_once(statics: Statics, line: Line, state: State, last: Reached) -> Node | None:
    """The node at the end of a line in one step with a tangent predictor; None where that does not converge, or may
    lead to another branch.

    last: the sample before; where this is its state, and nothing was factorised since, its tangent is used.
    """
    controls = line.at(1.0)
    here = replace(state, effort=np.where(controls.is_held, controls.effort, state.effort))
    is_kept = state is last.state and last.tangent == statics.tangent.n_tangents and not last.has_snapped
    is_kept = is_kept and bool(np.all(last.controls.is_held == controls.is_held))
    at = statics.system.linearise(here, controls, statics.theta, tangent=not is_kept)
    if not at.is_admissible:
        return None
    try:
        if not is_kept:
            statics.factorise(at)
        ahead = -statics.solve(at.reduced)
    except SimulationError:
        return None
    guess = statics.reachable(here, statics.limited(ahead) * ahead)
    solved = statics.equilibrium(guess, controls)
    if not solved.converged or strays(statics, state, guess, solved.state):
        return None
    node = node_at(statics, line, 1.0, solved.state, (), mixed=False)
    return node if node.is_stable else None


def _settled(statics: Statics, line: Line, state: State) -> tuple[State, str]:
    """The equilibrium at the begin of a line, since a material may have relaxed or flowed meanwhile; on failure the
    state as it is, and the reason.
    """
    if not statics.system.remembers:
        return state, ""
    solved = statics.equilibrium(state, line.at(0.0))
    return (solved.state, "") if solved.converged else (state, solved.status)


def _fallen(statics: Statics, last: Reached, aim: Target) -> Reached:
    """The equilibrium reached by snap-through from the last one, with cables becoming taut or slack meanwhile.

    Raises
    ------
    SimulationError
        Where none is reached.
    """
    target = aim.controls
    system, by_coordinate = statics.system, ~target.is_held
    least, most = system.effort_limits

    def within_limits(is_held: np.ndarray, state: State) -> Controls:
        return held_at(target, is_held, np.clip(state.effort, least, most))

    def switched(state: State, controls: Controls) -> Controls:
        returns = by_coordinate & returning(
            statics, state.effort, target.coordinate - system.commanded(state, statics.theta)
        )
        is_held = system.engaged(np.where(controls.is_held, ~returns, pushing(system, state)), target)
        return controls if np.all(is_held == controls.is_held) else within_limits(is_held, state)

    snapped = overdamped_equilibrium(statics, last.state, within_limits(last.controls.is_held, last.state), switched)
    if not snapped.converged:
        raise SimulationError(f"{SWITCHING}: {snapped.status}.")
    state = snapped.state
    at_limit = (state.effort == least) | (state.effort == most)
    controls = switched(state, within_limits(~by_coordinate | at_limit, state))
    statics.seeks_free_modes = True
    node = stable_node_at(statics, _line(controls, controls), 1.0, state, ())
    return remembered(statics, node.state, controls, aim, (True, True))


def held_at(target: Controls, is_held: np.ndarray, effort: Floats) -> Controls:
    """The target with some of the actuators that are commanded by their coordinate at prescribed efforts instead.

    Parameters
    ----------
    target
        The commands.
    is_held
        Which actuators have a prescribed effort (n_actuators,).
    effort
        Efforts of those that are not commanded by it (n_actuators,), each in its own unit.
    """
    return replace(target, is_held=is_held, effort=np.where(target.is_held, target.effort, effort))


def remembered(
    statics: Statics,
    state: State,
    controls: Controls,
    aim: Target,
    snaps: tuple[bool, bool],
    commanded: CommandPath | None = None,
) -> Reached:
    """The sample that ends at an equilibrium. Its derivatives are by the tangent factorised last.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    state
        The equilibrium.
    controls
        The controls there.
    aim
        The commands, and the derivatives that are wanted.
    snaps
        `Reached.snaps` and `has_snapped`.
    commanded
        The line to the equilibrium, from which the next sample may continue.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    by_parameter, rates = by_parameters(statics, state, controls, aim.names), aim.rates
    if rates is not None and rates.any():
        acting = np.flatnonzero(rates.any(axis=1))
        by_parameter = by_parameter + by_command(statics, state, controls, aim.controls, acting) @ rates[acting]
    state = statics.system.advanced(state, controls, statics.theta, by_parameter, aim.names)
    # The nodes on the line there have the memory of its start, and are no part of what follows.
    commanded = None if statics.system.remembers else commanded
    return Reached(
        state=state,
        controls=controls,
        by_parameter=by_parameter,
        snaps=snaps[0],
        has_snapped=snaps[1],
        commanded=commanded,
        tangent=statics.tangent.n_tangents,
    )


def by_command(
    statics: Statics,
    state: State,
    now: Controls,
    target: Controls,
    which: Ints,
    accuracy: float = EXACT,
    guess: Floats | None = None,
) -> Floats:
    """dz / d command (n_unknowns, k) of some actuators, by the tangent taken last.

    Parameters
    ----------
    statics
        The system at its parameters, with the factors of its tangent.
    state
        The state.
    now
        The controls of the equilibrium.
    target
        The commands; an actuator that is commanded by its coordinate may be at a limit of its effort now.
    which
        Numbers of the actuators (k,).
    accuracy
        Relative error where the tangent's own factors are not there.
    guess
        What the result is about; None: nothing is known of it.
    """
    system = statics.system
    first = system.layout.first_effort_unknown
    right = np.zeros((system.layout.n_unknowns, len(which)))
    for column, i in enumerate(which.tolist()):
        if not now.is_held[i]:
            right[first + i, column] = 1.0
        elif target.is_held[i]:
            right[:, column] = system.gradient_by_effort(state, i, now, statics.theta)
    if len(which) == 0:
        return right
    if guess is not None:
        guess = np.concatenate([guess[:first], np.where(now.is_held[:, None], 0.0, guess[first:])]) * right.any(axis=0)
    dz = statics.solve(-right, accuracy, guess)
    efforts = dz[first:]
    efforts[now.is_held] = 0.0
    for column, i in enumerate(which.tolist()):
        if now.is_held[i] and target.is_held[i]:
            efforts[i, column] = 1.0
    return dz


def _line(start: Controls, target: Controls) -> Line:
    """The line from the start (c = 0) to the target (c = 1); actuators at a limit stay there."""
    return Line(
        start.is_held,
        start.effort,
        start.coordinate,
        np.where(start.is_held & target.is_held, target.effort - start.effort, 0.0),
        target.coordinate - start.coordinate,
        elapsed=target.elapsed,
    )


def _released(statics: Statics, state: State, held: Controls, pushes: np.ndarray) -> State:
    """The equilibrium with the actuators whose effort passed a limit held there (cables in compression: slack):
    directly where that converges, else by reducing what is beyond the limit in steps.

    Raises
    ------
    SimulationError
        Where an equilibrium in between does not exist.
    """
    released = statics.equilibrium(replace(state, effort=np.where(pushes, held.effort, state.effort)), held)
    if released.converged:
        return released.state
    beyond = np.where(pushes, state.effort - held.effort, 0.0)
    line = Line(
        held.is_held, held.effort + beyond, held.coordinate, -beyond, np.zeros_like(beyond), elapsed=held.elapsed
    )
    path = follow(statics, line, node_at(statics, line, 0.0, state, ()), 1.0, first_step=0.2)
    if not path.reached:
        raise SimulationError(f"no equilibrium as a cable goes slack: {path.status}.")
    return path.nodes[-1].state
