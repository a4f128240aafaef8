"""A curve of equilibria along one control: adaptive steps, tangent predictor, exact slope at every node."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.free_modes import exclude_free_modes
from softcal.mechanics.layout import Layout
from softcal.mechanics.mixed import mixed_derivatives
from softcal.mechanics.stability import fall
from softcal.mechanics.state import State, difference, distance, moved
from softcal.mechanics.statics import FREE, NO_MODES, SLACK_TENSION, Statics
from softcal.mechanics.system import Controls

SMALLEST_STEP = 1e-4  # of the whole range: where equilibria end
CLOSE = 1e-3  # of the way so far: where they cease to be stable
SAME = 1e-6  # of the robot's extent: states as near as this are one
NO_FALL = 1e-4  # of the robot's extent: what moves it no farther, a tenth of the nudge, is no fall
MOST_FALLS = 20  # of a path: beyond it is not a robot's, and every one takes as long as many steps
GROWTH = 2.0
CUTS = 1  # of a step, before the robot is let settle: Newton's method may find its way in a shorter one
SHORTER, SHORTEST = 0.7, 0.05  # of a predicted step: where branches turn as roots do less of it serves better
EASY, HARD = 7, 12  # iterations (with kept factorisations) below which steps grow, above which they shrink


@dataclass(frozen=True)
class Line:
    """Controls that move along a straight line: at(c) = start + c * rate, cables held or not throughout."""

    is_held: np.ndarray
    tension: Floats
    shortening: Floats
    tension_rate: Floats
    shortening_rate: Floats
    load: float = 1.0
    load_rate: float = 0.0

    def at(self, c: float) -> Controls:
        """Controls at the line's parameter c."""
        return Controls(
            self.is_held,
            self.tension + c * self.tension_rate,
            self.shortening + c * self.shortening_rate,
            self.load + c * self.load_rate,
        )


@dataclass(frozen=True, eq=False)
class Node:
    """An equilibrium on the path; no two are equal. slope: dz/dc (n_unknowns,); by_parameter: dz/dtheta at fixed c
    (n_unknowns, k); mixed: d2z/dc dtheta (n_unknowns, k);
    is_stable: whether it is one of least energy, or one that a cable would have to push for, which is none anyway;
    is_fallen: whether the robot fell to it from an unstable one (it buckled, or snapped); has_fallen: whether it did so
    before; free: the modes (n_unknowns - n_cables, k) along which the robot moves without force, and slope
    and by_parameter do not.
    """

    c: float
    state: State
    slope: Floats
    by_parameter: Floats
    mixed: Floats
    is_stable: bool = True
    is_fallen: bool = False
    has_fallen: bool = False
    free: Floats = field(default_factory=lambda: NO_MODES)


@dataclass(frozen=True)
class Path:
    """Nodes in the order of c, and whether its end was reached. status: a sentence."""

    nodes: tuple[Node, ...]
    reached: bool
    status: str = ""
    names: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class _Attempt:
    """A step to c: the state that is predicted there, and the one to solve from."""

    c: float
    guess: State
    begin: State


def node_at(
    statics: Statics, line: Line, c: float, state: State, names: tuple[str, ...], *, mixed: bool = True
) -> Node:
    """The node of an equilibrium: one factorisation, then a substitution for the slope and two per parameter.

    mixed: whether the mixed derivatives are wanted, to read between this node and the next; zero otherwise.

    Raises
    ------
    SimulationError
        Where the tangent is singular.
    """
    controls = line.at(c)
    at = statics.tangent_at(state, controls)
    by_control = _rate_of_gradient(statics, line, state)
    sought = statics.seeks_free_modes or statics.n_unstable() != 0
    free = exclude_free_modes(statics, at) if sought else NO_MODES
    stable = bool(pushing(state).any()) or statics.n_unstable() == 0
    by_theta = statics.system.gradient_by_parameters(state, at, statics.theta, names)
    dz = -statics.solve(np.column_stack([by_control, by_theta]))
    # A held cable's tension is given: its rate is the line's.
    tensions = dz[statics.system.layout.first_tension_unknown :]
    tensions[line.is_held, 0] = line.tension_rate[line.is_held]
    slope, by_parameter = dz[:, 0], dz[:, 1:]
    of_both = mixed_derivatives(statics, controls, state, slope, by_parameter, names if mixed else ())
    return Node(c, state, slope, by_parameter, of_both, stable, free=free)


def pushing(state: State) -> np.ndarray:
    """Which cables push (n_cables,), as none can: such a state is on the way to another at most."""
    return state.tension < -SLACK_TENSION * np.abs(state.tension).max(initial=0.0)


def stable_node_at(statics: Statics, line: Line, c: float, state: State, names: tuple[str, ...]) -> Node:
    """The node of an equilibrium, or of the stable one that the robot falls to from there.

    Raises
    ------
    SimulationError
        Where the tangent is singular, or the robot falls to no other equilibrium.
    """
    node = node_at(statics, line, c, state, names, mixed=False)
    return node if node.is_stable else _fallen(statics, line, c, state, names)


def follow(
    statics: Statics,
    line: Line,
    start: Node | tuple[Node, ...],
    end: float,
    *,
    first_step: float,
    names: tuple[str, ...] = (),
    stop: Callable[[Node], bool] = lambda node: False,
    largest_step: float = np.inf,
) -> Path:
    """Stable equilibria from a node to c = end, or to where `stop` says so. A failed step is cut and tried again.

    start: the node, or several of which it is the last: the others tell how the path turns.
    Where they cease to be stable the robot falls: the next node is the stable equilibrium that it comes to.
    """
    layout = statics.system.layout
    before, start = (start[:-1], start[-1]) if isinstance(start, tuple) else ((), start)
    nodes = [start]
    h = min(first_step, largest_step, end - start.c)
    scale = max(end - start.c, 1e-300)
    tried: list[_Attempt] = []  # from the last node on, without success
    beyond: Node | None = None  # the nearest equilibrium ahead that was found unstable
    while nodes[-1].c < end - 1e-12 * scale:
        last = nodes[-1]
        # Steps that fill what is left evenly.
        remaining = end - last.c
        step = min(remaining / max(1, int(np.ceil(remaining / h - 1e-9))), largest_step)
        if beyond is not None:
            step = min(step, 0.5 * (beyond.c - last.c))
        c = end if abs(last.c + step - end) < 1e-12 * scale else last.c + step
        go_on_from(statics, last)
        guess = statics.reachable(last.state, _predicted_step(layout, [*before, *nodes], c))
        attempt = _Attempt(c, guess, _nearer(statics, line, c, last, guess))
        solved = statics.equilibrium(attempt.begin, line.at(c))
        if (
            solved.converged
            and 0.4 * step >= SMALLEST_STEP * scale
            and _strays(statics, last.state, guess, solved.state)
        ):
            h = 0.4 * step
            continue
        node = node_at(statics, line, c, solved.state, names) if solved.converged else None
        if node is None or not node.is_stable:
            tried.append(attempt if node is None else replace(attempt, begin=node.state))
        # Once for a few steps that failed, and over the first of them.
        settles = len(tried) > 0 and len(tried) % (CUTS + 1) == 0
        if settles and (settled := _settled(statics, line, last, tried[-1 - CUTS], names)):
            node, h = settled, max(first_step, GROWTH * (settled.c - last.c))
        elif node is None or not node.is_stable:
            close = CLOSE * max(c - start.c, SMALLEST_STEP * scale)
            if node is None:  # a branch's first steps are shorter yet
                close = min(SMALLEST_STEP * scale, close)
            if 0.4 * step >= close and (node is None or last.is_stable):
                h, beyond = 0.4 * step, node or beyond
                continue
            if node is None and pushing(last.state).any():
                return _ended(statics, nodes, solved.status, names)
            if sum(one.is_fallen for one in nodes) == MOST_FALLS:
                return _ended(statics, nodes, f"it buckles or snaps more than {MOST_FALLS} times", names)
            # Not from the nearest unstable one: a branch's first steps are hard.
            unstable = beyond or node
            c, state = (unstable.c, unstable.state) if unstable else (c, last.state)
            try:
                node = _fallen(statics, line, c, state, names)
            except SimulationError as error:
                return _ended(statics, nodes, solved.status or str(error), names)
            if _is_no_fall(statics, last.state, guess, node.state):
                node = replace(node, is_fallen=False)
            # Where many branches begin at once they are told apart further on.
            h = max(step, first_step) if node.is_fallen and _is_nearly_free(node) else step
        elif solved.n_iterations <= EASY:
            h = GROWTH * step
        elif solved.n_iterations >= HARD:
            h = 0.5 * step
        tried.clear()
        nodes.append(replace(node, has_fallen=last.has_fallen or last.is_fallen))
        if beyond is not None and beyond.c - node.c < CLOSE * max(c - start.c, SMALLEST_STEP * scale):
            beyond = None
        if stop(node):
            break
    return Path(tuple(nodes), True, names=names)


def go_on_from(statics: Statics, node: Node) -> None:
    """Free modes come with the first buckling, and are those of the node before until they are found anew."""
    statics.free_modes, statics.seeks_free_modes = node.free, node.has_fallen or node.is_fallen


def _ended(statics: Statics, nodes: list[Node], status: str, names: tuple[str, ...]) -> Path:
    """A path that goes no further, with the physical cause where it is known."""
    met = statics.system.cables.meeting(nodes[-1].state.x)
    return Path(tuple(nodes), False, f"{status}; {met}" if met else status, names)


def _strays(statics: Statics, before: State, guess: State, found: State) -> bool:
    """Whether an equilibrium is further from what was predicted than that is from the one before, or a cable's segment
    was reversed on the way: it may be on another branch. Where surfaces touch predictions are worth less.
    """
    cables = statics.system.cables
    if len(cables.cable) and np.any((cables.vectors(before.x) * cables.vectors(found.x)).sum(axis=1) < 0.0):
        return True
    if statics.system.contacts:
        return False
    layout = statics.system.layout
    return distance(layout, found, guess) > distance(layout, guess, before) + SAME * statics.length


def _is_nearly_free(node: Node) -> bool:
    """Whether the robot has buckled in many ways at once: it then moves in several ways that take hardly any force."""
    return (node.has_fallen or node.is_fallen) and node.free.shape[1] > 1


def _settled(statics: Statics, line: Line, last: Node, attempt: _Attempt, names: tuple[str, ...]) -> Node | None:
    """The stable node that the robot settles to where Newton's method finds no way along modes that are nearly free.

    None where it has none, or where it settles to none that is close, or that so little force leads to.
    """
    if not _is_nearly_free(last) or pushing(last.state).any():
        return None
    fallen = fall(statics, attempt.begin, line.at(attempt.c))
    if not fallen.converged:
        return None
    way = statics.reach(difference(statics.system.layout, fallen.state, last.state))
    at = statics.system.linearise(fallen.state, line.at(attempt.c), statics.theta, tangent=False)
    is_driven = fallen.work >= FREE * statics.force_scale(at) * way
    if is_driven and not _is_no_fall(statics, last.state, attempt.guess, fallen.state):
        return None
    return node_at(statics, line, attempt.c, fallen.state, names)


def _is_no_fall(statics: Statics, before: State, guess: State, found: State) -> bool:
    """Whether a fall ends where it began, or where a step would have led: it was none."""
    layout = statics.system.layout
    ahead, way = (statics.reach(difference(layout, state, before)) for state in (guess, found))
    return way <= NO_FALL * statics.length + 2.0 * ahead


def _fallen(statics: Statics, line: Line, c: float, state: State, names: tuple[str, ...]) -> Node:
    """The stable node at c that the robot falls to from a state.

    Raises
    ------
    SimulationError
        Where it comes to none.
    """
    fallen = fall(statics, state, line.at(c))
    if not fallen.converged:
        raise SimulationError(f"the robot is not stable there, and falls to no other equilibrium: {fallen.status}")
    statics.seeks_free_modes = True
    return replace(node_at(statics, line, c, fallen.state, names), is_fallen=True)


def between(statics: Statics, line: Line, path: Path, c: float) -> Node:
    """One more node inside a path, from the cubic through its neighbours, or by small steps from the one before.

    Raises
    ------
    SimulationError
        Where no equilibrium was found from there.
    """
    before, after = neighbours(path, c)
    go_on_from(statics, before)
    guess = interpolated(statics.system.layout, before, after, c)
    if statics.system.free_way(before.state, guess) == 1.0:
        solved = statics.equilibrium(guess, line.at(c))
        if solved.converged:
            node = node_at(statics, line, c, solved.state, path.names)
            if node.is_stable:
                return replace(node, has_fallen=before.has_fallen or before.is_fallen)
    way = follow(statics, line, before, c, first_step=0.3 * (c - before.c), names=path.names)
    if not way.reached:
        raise SimulationError(f"No equilibrium between two neighbouring ones: {way.status}.")
    return replace(way.nodes[-1], is_fallen=any(node.is_fallen for node in way.nodes[1:]))


def neighbours(path: Path, c: float) -> tuple[Node, Node]:
    """The last node up to c and the first one from there on."""
    before = max((node for node in path.nodes if node.c <= c), key=lambda node: node.c)
    return before, min((node for node in path.nodes if node.c >= c), key=lambda node: node.c)


def interpolated(layout: Layout, before: Node, after: Node, c: float) -> State:
    """The cubic Hermite state between two nodes."""
    h = after.c - before.c
    if h <= 0.0:
        return before.state
    t = (c - before.c) / h
    whole = difference(layout, after.state, before.state)
    dz = (3.0 - 2.0 * t) * t**2 * whole + h * t * (1.0 - t) * ((1.0 - t) * before.slope - t * after.slope)
    return moved(layout, before.state, dz)


def _nearer(statics: Statics, line: Line, c: float, last: Node, guess: State) -> State:
    """The state on the way to a predicted one with the least residual."""
    if not _is_nearly_free(last):
        return guess
    layout = statics.system.layout
    way = difference(layout, guess, last.state)

    def off(state: State) -> float:
        at = statics.system.linearise(state, line.at(c), statics.theta, tangent=False)
        return statics.norm(at) if at.is_admissible else np.inf

    least, part = off(guess), SHORTER
    while part > SHORTEST and (here := off(nearer := moved(layout, last.state, part * way))) <= least:
        guess, least, part = nearer, here, SHORTER * part
    return guess


def _predicted_step(layout: Layout, nodes: list[Node], c: float) -> Floats:
    """h z' + h^2/2 z'' with z'' from the last two nodes."""
    last = nodes[-1]
    h = c - last.c
    dz = h * last.slope
    # Beside a fall a branch turns as no parabola does: one may lead to the branch that was left.
    if len(nodes) > 1 and not any(node.is_fallen for node in nodes[-2:]):
        before = nodes[-2]
        width = last.c - before.c
        back = difference(layout, before.state, last.state)  # z(c - width) - z(c)
        curvature = 2.0 * (back + width * last.slope) / width**2
        dz = dz + 0.5 * h**2 * curvature
    return dz


def _rate_of_gradient(statics: Statics, line: Line, state: State) -> Floats:
    """d reduced gradient / dc at fixed z."""
    system = statics.system
    layout = system.layout
    rate = np.zeros(layout.n_unknowns)
    rate[layout.first_tension_unknown :] = np.where(line.is_held, 0.0, line.shortening_rate)
    inner = rate[: layout.first_tension_unknown]
    if line.load_rate != 0.0:
        full = np.zeros(3 * layout.n_points + layout.n_pressures)
        full[: 3 * layout.n_points] = -line.load_rate * system.loads.total(statics.theta).ravel()
        inner += system.motion.reduce_gradient(state, full)
    for i in np.flatnonzero(line.is_held & (line.tension_rate != 0.0)):
        inner += line.tension_rate[i] * system.pull(state, int(i), statics.theta)
    return rate
