"""From one set of commands to the next, with an active-set method for taut and slack cables."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.cable import SLACK_LENGTH, cables_of
from softcal.mechanics.node import Line, Node, node_at, pushing
from softcal.mechanics.path import follow
from softcal.mechanics.redundancy import DEPENDENT
from softcal.mechanics.snap_through import stable_node_at
from softcal.mechanics.stability import overdamped_equilibrium
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import Controls

SAME = 1e-9  # of the largest command: closer commands count as equal


@dataclass(frozen=True)
class Way:
    """A straight line through the space of commands, and the last nodes on it."""

    line: Line
    nodes: tuple[Node, ...]

    def to(self, target: Controls) -> float | None:
        """The line's parameter at which the commands are reached beyond the last node; None where they are not on the
        line.
        """
        line = self.line
        held = line.is_held
        start = np.where(held, line.tension, line.shortening)
        rate = np.where(held, line.tension_rate, line.shortening_rate)
        wanted = np.where(held, target.effort, target.coordinate)
        if not np.any(rate):
            return None
        c = float((wanted - start) @ rate / (rate @ rate))
        here = self.nodes[-1].c
        off = np.abs(start + c * rate - wanted).max() if c > here else np.inf
        return c if off <= SAME * np.abs(wanted).max() else None


@dataclass(frozen=True)
class Reached:
    """An equilibrium at some commands.

    state: with the memory that it leaves to the next one; snaps: whether the robot snapped through on the line to it,
    has_snapped: or before; way: the line to it.
    """

    state: State
    controls: Controls
    by_parameter: Floats
    snaps: bool = False
    has_snapped: bool = False
    way: Way | None = None


def reach(statics: Statics, last: Reached, target: Controls, by_length: np.ndarray, names: tuple[str, ...]) -> Reached:
    """Solve at the target with an active-set loop: follow a straight line with each cable's taut or slack state kept,
    release cables in compression, engage over-long ones, and repeat until unchanged.

    Parameters
    ----------
    by_length
        Which cables are commanded in length.
    names
        Of the parameters by which derivatives are wanted.

    Raises
    ------
    SimulationError
        Where there is no equilibrium, or none was found.
    """
    cables = cables_of(statics.system)
    state, snaps = last.state, False
    # A taut cable moves from its present length to the target's; the check below engages slack ones.
    held = last.controls.is_held
    start = Controls(held, np.where(held, last.controls.effort, 0.0), cables.rest_length - cables.lengths(state.x))
    way, end = last.way, None if last.way is None else last.way.to(target)
    for _ in range(4 * cables.n_cables + 4):
        if way is None or end is None:
            way, end = Way(_line(start, target), ()), 1.0
        line, has_snapped = way.line, last.has_snapped or snaps
        statics.seeks_free_modes = has_snapped
        taut = by_length & ~start.is_held
        if not np.any(line.tension_rate[start.is_held]) and not np.any(line.shortening_rate[~start.is_held]):
            node, way = stable_node_at(statics, line, end, state, names), None
            snaps |= node.is_snapped
        else:
            begin = way.nodes or (replace(node_at(statics, line, 0.0, state, ()), has_snapped=has_snapped),)
            path = follow(statics, line, begin, end, first_step=end - begin[-1].c, names=names)
            first = next(
                (i for i, node in enumerate(path.nodes) if (taut & pushing(statics.system, node.state)).any()), None
            )
            node = path.nodes[-1]
            if not path.reached and first is not None and DEPENDENT not in path.status:
                # A state with a cable in compression is not admissible: continue from the first one, with it slack.
                path = replace(path, nodes=path.nodes[: first + 1])
                node = node_at(statics, line, path.nodes[-1].c, path.nodes[-1].state, names, mixed=False)
            elif not path.reached:
                raise SimulationError(f"no equilibrium beyond {100 * node.c / end:.3g} % of the step: {path.status}.")
            snaps |= any(node.is_snapped for node in path.nodes[1:])
            way = Way(line, path.nodes[-2:])
        state, here = node.state, line.at(node.c)
        lengths = cables.lengths(state.x)
        pushes = taut & pushing(statics.system, state)
        gap = lengths - cables.rest_length + target.coordinate
        too_long = by_length & start.is_held & (gap > SLACK_LENGTH * cables.rest_length) & (node.c == end)
        if not pushes.any() and not too_long.any():
            controls = replace(target, is_held=start.is_held)
            return _reached(statics, node, controls, names, snaps, last.has_snapped or snaps, way)
        if snaps:
            break  # the snap-through was found with fixed taut and slack states; with switching ones it ends elsewhere
        is_held = (start.is_held | pushes) & ~too_long
        tension = np.where(is_held, np.where(by_length, np.maximum(state.effort, 0.0), here.effort), 0.0)
        start = Controls(is_held, np.where(pushes, 0.0, tension), cables.rest_length - lengths)
        if pushes.any():
            state = _released(statics, state, start, pushes)
            start = replace(start, coordinate=cables.rest_length - cables.lengths(state.x))
        way = None
    return _fallen(statics, last, target, by_length, names)


def _fallen(
    statics: Statics, last: Reached, target: Controls, by_length: np.ndarray, names: tuple[str, ...]
) -> Reached:
    """The equilibrium reached by snap-through from the last one, with cables becoming taut or slack meanwhile.

    Raises
    ------
    SimulationError
        Where none is reached.
    """
    cables = cables_of(statics.system)

    def switched(state: State, controls: Controls) -> Controls:
        gap = cables.lengths(state.x) - cables.rest_length + target.coordinate
        held = controls.is_held
        is_held = np.where(
            held, ~by_length | (gap <= SLACK_LENGTH * cables.rest_length), ~held & pushing(statics.system, state)
        )
        return controls if np.all(is_held == held) else replace(controls, is_held=is_held)

    snapped = overdamped_equilibrium(statics, last.state, replace(target, is_held=last.controls.is_held), switched)
    if not snapped.converged:
        raise SimulationError(f"cables keep switching between taut and slack: {snapped.status}.")
    controls = switched(snapped.state, replace(target, is_held=~by_length | (snapped.state.effort == 0.0)))
    statics.seeks_free_modes = True
    node = stable_node_at(statics, _line(controls, controls), 1.0, snapped.state, names)
    return _reached(statics, node, controls, names, snaps=True, has_snapped=True)


def _reached(
    statics: Statics,
    node: Node,
    controls: Controls,
    names: tuple[str, ...],
    snaps: bool,
    has_snapped: bool,
    way: Way | None = None,
) -> Reached:
    """The sample that ends at a node: converged, and remembered."""
    state = statics.system.advanced(node.state, controls, statics.theta, node.by_parameter, names)
    # The nodes on the way there have the memory of its start, and are no part of what follows.
    way = None if statics.system.remembers else way
    return Reached(state, controls, node.by_parameter, snaps, has_snapped, way)


def _line(start: Controls, target: Controls) -> Line:
    """The line from the start (c = 0) to the target (c = 1)."""
    return Line(
        start.is_held,
        start.effort,
        start.coordinate,
        np.where(start.is_held, target.effort - start.effort, 0.0),
        target.coordinate - start.coordinate,
    )


def _released(statics: Statics, state: State, held: Controls, pushes: np.ndarray) -> State:
    """The equilibrium with the cables in compression slack: directly where that converges, else by reducing their
    compression in steps.

    Raises
    ------
    SimulationError
        Where an equilibrium in between does not exist.
    """
    slack = replace(state, effort=np.where(pushes, 0.0, state.effort))
    released = statics.equilibrium(slack, held)
    if released.converged:
        return released.state
    push = np.where(pushes, state.effort, 0.0)
    none = np.zeros_like(push)
    line = Line(held.is_held, held.effort + push, held.coordinate, -push, none)
    path = follow(statics, line, node_at(statics, line, 0.0, state, ()), 1.0, first_step=0.2)
    if not path.reached:
        raise SimulationError(f"no equilibrium as a cable goes slack: {path.status}.")
    return path.nodes[-1].state
