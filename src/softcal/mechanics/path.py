"""A curve of equilibria along one control: predictor and corrector, with snap-through where the curve is lost.

Sought are the states z(c) with g(z, c) = 0, from a node at c_0 to an end, where g is the gradient of the potential on
the unknowns and the controls are on a straight line, c_0 + c * rate. A node has the exact slope, from the tangent K
factorised there, and says whether the equilibrium is stable:

    K z' = -dg/dc,    stable: K, bordered by the actuators, has no unstable direction

*Predictor* of a step h = c - c_n: a parabola, its curvature by the last two nodes, w apart (`_predicted_step`),

    dz = h z' + h^2/2 z'',    z'' = 2 (z_(n-1) - z_n + w z') / w^2

or, beside a guide, the difference to a path at other parameters, extrapolated from node to node (`_beside`):

    z(c) = y(c) + (z_n - y_n) + h (z' - y'),    y: the guide

*Corrector*: Newton's method at fixed c (`Statics.equilibrium`). Of what it reaches,

- a stable equilibrium near the prediction is the next node. The next step is `GROWTH` times as long after at most
  `EASY` iterations, half as long after `HARD` or more;
- one further from the prediction than that is from z_n (`strays`) may be on another branch: the step is shortened by
  `CUT` and repeated, unless it is among the shortest;
- an unstable one, or none, is a failed attempt. Then, in this order: after each second one the robot is relaxed by
  overdamped motion, if it has modes almost without force (`_settle`); the step is shortened by `CUT` (`_shorten`) until
  it is `CLOSE` of the path so far (where none was found: at most `SMALLEST_STEP` of the range), so that the loss of
  stability or the limit point is located; at last the robot snaps through (`_snap`): the next node is the stable
  equilibrium that overdamped motion reaches (`stability.py`).

A control cannot turn back, so that there is no arc length: beyond a limit point is a snap-through. The path ends at
`end`, at a limit of the work (`path_limits.py`), where there is no other equilibrium, or after `MOST_SNAPS`.

*Between nodes* the curve is the cubic through their states and slopes (`interpolated`), with t = (c - c_n) / h:

    z = z_n + (3 - 2 t) t^2 (z_(n+1) - z_n) + h t (1 - t) ((1 - t) z'_n - t z'_(n+1))

Differences and sums of states compose rotations; see `state.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.cable import cables_of
from softcal.mechanics.layout import Layout
from softcal.mechanics.node import Line, Node, node_at, pushing
from softcal.mechanics.path_limits import PathWork
from softcal.mechanics.path_watch import path_watch
from softcal.mechanics.snap_through import is_nearly_free, is_no_snap, settled, snapped, why_unlike
from softcal.mechanics.state import State, difference, distance, moved
from softcal.mechanics.statics import Statics
from softcal.mechanics.system import System
from softcal.mechanics.term import Failing

SMALLEST_STEP = 1e-4  # of the whole range: smallest step, at a limit point
CLOSE = 1e-3  # of the path so far: accuracy with which a loss of stability is located
SAME = 1e-6  # of the robot's extent: closer states count as equal
MOST_SNAPS = 20  # of a path: more are unphysical, and each costs as much as many steps
LAST = 1.3  # of a step: the last one may be that long, so that it is not much shorter than others
GROWTH, CUT = 2.0, 0.4  # of a step, after fast convergence, and after a failure
CUTS = 1  # of a step, before relaxation by `settled`: Newton's method may converge in a shorter step
SHORTER, SHORTEST = 0.7, 0.05  # of a predicted step: near square-root branches a part of it is a better guess
HALVINGS = 3  # of the distance between nodes, before a node between them is sought by small steps from the first
EASY, HARD = 7, 12  # iterations (with kept factorisations) below which steps grow, above which they shrink


@dataclass(frozen=True)
class Path:
    """Nodes in the order of c, and whether the path reaches its end.

    Attributes
    ----------
    status
        Why it does not, as part of a sentence.
    is_cut
        Whether it ends at a limit of its work or by a stop, and not for want of an equilibrium.
    stopped_by
        The signal that stopped it, where what is ready is kept.
    """

    nodes: tuple[Node, ...]
    reached: bool
    status: str = ""
    names: tuple[str, ...] = field(default=())
    is_cut: bool = False
    stopped_by: KeyboardInterrupt | None = None

    @property
    def snaps(self) -> bool:
        """Whether a snap-through occurs along the path, not before its first node, as under the loads alone."""
        return any(node.is_snapped for node in self.nodes[1:])

    @property
    def is_smooth(self) -> bool:
        """Whether the path reached its end without a snap-through."""
        return self.reached and not self.snaps

    @property
    def ended(self) -> str:
        """The words before the place at which a path ends early."""
        return "the load path was ended at" if self.is_cut else "no equilibrium beyond"

    def stopped(self, by: KeyboardInterrupt) -> Path:
        """The path as far as it is, where a signal stops the work on it."""
        return replace(self, reached=False, status=f"stopped by {str(by) or 'the user'}", is_cut=True, stopped_by=by)


@dataclass(frozen=True)
class _Attempt:
    """A step to c: its length, the predicted state there, and the initial state of the solve."""

    c: float
    step: float
    guess: State
    begin: State


@dataclass
class _Continuation:
    """A path under construction: its nodes, the length of the next step, and the failed attempts since the last node.

    before: earlier nodes, for the curvature of the path; guide: nodes of a path at other parameters, as in `follow`;
    unstable: the nearest equilibrium ahead that was found unstable; work: so far; failing: the element that failed
    first in the last attempt, if that failed; is_cut: whether a limit of the work ended the path; begun: key of the
    step since the last node, and the number of factorisations before it.
    """

    statics: Statics
    line: Line
    names: tuple[str, ...]
    before: tuple[Node, ...]
    nodes: list[Node]
    end: float
    first_step: float
    largest_step: float
    mixed: bool = True
    guide: tuple[Node, ...] = ()
    length: float = field(init=False)
    tried: list[_Attempt] = field(default_factory=list[_Attempt])
    unstable: Node | None = None
    work: PathWork = field(init=False)
    failing: Failing | None = None
    is_cut: bool = False
    begun: tuple[Hashable, int] | None = None

    def __post_init__(self) -> None:
        self.work = PathWork(self.statics.limits)
        self.work.gain(0.0, self.statics.n_factorisations)
        self.length = min(self.first_step, self.largest_step, self.end - self.last.c)

    @property
    def last(self) -> Node:
        return self.nodes[-1]

    @property
    def whole(self) -> float:
        return max(self.end - self.nodes[0].c, 1e-300)

    @property
    def goes_on(self) -> bool:
        return self.last.c < self.end - 1e-12 * self.whole

    def advance(self) -> str:
        """Attempt a step within the limits of the work; returns why the path ends, or ""."""
        statics = self.statics
        over = self.work.why_vain(statics.n_factorisations, fails=self.failing is not None) or statics.why_over()
        why = "" if over else self._step()
        if why:
            over = statics.why_over()  # a solve that ends there has no other reason
        self.is_cut = over != ""
        return over or why

    def _step(self) -> str:
        """Attempt a step, and recover where it fails; returns why it cannot, or ""."""
        c, step = self._ahead()
        if self.begun is None and self._is_plain:
            key = (self.line.key, self.mixed, self.last.c, c, step, self._is_guided)
            if (kept := self.statics.kept_node(key, self.names)) is not None:
                self._add(kept.node, kept.next_step)
                return ""
            self.begun = key, self.statics.n_factorisations
            if self._is_guided:
                return self._step_beside(key, step)
        last = self.last
        go_on_from(self.statics, last)
        ahead = _predicted_step(self.statics.system.layout, [*self.before, *self.nodes], c)
        guess = self.statics.reachable(last.state, ahead)
        attempt = _Attempt(c, step, guess, _nearer(self.statics, self.line, c, last, guess))
        solved = self.statics.equilibrium(attempt.begin, self.line.at(attempt.c))
        node = None
        if solved.converged:
            is_long = CUT * step >= SMALLEST_STEP * self.whole
            if is_long and strays(self.statics, last.state, attempt.guess, solved.state):
                self.length = CUT * step
                return ""
            node = node_at(self.statics, self.line, c, solved.state, self.names, mixed=self.mixed)
            if node.is_stable:
                n = solved.n_iterations
                self._add(node, GROWTH * step if n <= EASY else 0.5 * step if n >= HARD else step)
                return ""
        self.failing = None if node is not None else self.statics.system.failing(solved.state)
        self.tried.append(attempt if node is None else replace(attempt, begin=node.state))
        return "" if self._settle() or self._shorten(attempt, node) else self._snap(attempt, node, solved.status)

    def _step_beside(self, key: Hashable, step: float) -> str:
        """A step to the node beside the guide's next one; where there is none, the path goes on by itself."""
        is_in_vain, n = self.statics.is_in_vain(key), self.statics.n_factorisations
        node = None if is_in_vain else self._beside(self.guide[len(self.nodes)])
        if node is not None:
            self._add(node, step)
            return ""
        if not is_in_vain and not self.statics.why_over():
            self.statics.keep_in_vain(key, since=n)
        self.guide, self.begun = (), None
        return self._step()

    @property
    def _is_plain(self) -> bool:
        """Whether the next node depends on the controls' line and the next step alone."""
        last = self.last
        return not (self.before or self.tried or self.unstable or last.is_snapped or last.has_snapped)

    @property
    def _is_guided(self) -> bool:
        """Whether the next node is beside a node of the guide, as all nodes so far were."""
        return self._is_plain and len(self.nodes) < len(self.guide)

    def _beside(self, there: Node) -> Node | None:
        """The stable node beside a node of the guide; None where Newton's method reaches none. The difference of the
        two paths stays smooth where surfaces meet, since they meet on both.
        """
        statics, last, here = self.statics, self.last, self.guide[len(self.nodes) - 1]
        layout = statics.system.layout
        dz = difference(layout, last.state, here.state) + (there.c - last.c) * (last.slope - here.slope)
        go_on_from(statics, last)
        solved = statics.equilibrium(statics.reachable(there.state, dz), self.line.at(there.c))
        if not solved.converged or strays(statics, last.state, solved.state, solved.state):
            return None
        node = node_at(statics, self.line, there.c, solved.state, self.names, mixed=self.mixed)
        return node if node.is_stable else None

    def _ahead(self) -> tuple[float, float]:
        """The next c, and the step to it. Steps do not depend on the end, except the last one, which is not short."""
        last, remaining = self.last, self.end - self.last.c
        if self._is_guided:
            c = self.guide[len(self.nodes)].c
            return c, c - last.c
        step = min(self.length, self.largest_step)
        if remaining < LAST * step:
            step = min(remaining, self.largest_step)
        if self.unstable is not None:
            step = min(step, 0.5 * (self.unstable.c - last.c))
        return (self.end if abs(last.c + step - self.end) < 1e-12 * self.whole else last.c + step), step

    def _settle(self) -> bool:
        """Relax the robot where modes are nearly free: once per few failed steps, at the first of them."""
        if len(self.tried) % (CUTS + 1) != 0:
            return False
        first = self.tried[-1 - CUTS]
        node = settled(self.statics, self.line, self.last, first.c, first.begin, first.guess, self.names)
        if node is not None:
            self._add(node, max(self.first_step, GROWTH * (node.c - self.last.c)))
        return node is not None

    def _shorten(self, attempt: _Attempt, unstable: Node | None) -> bool:
        """Shorten the step, until the limit point or the loss of stability is located closely enough."""
        close = self._close(attempt.c)
        if unstable is None:  # a branch's first steps are shorter yet
            close = min(SMALLEST_STEP * self.whole, close)
        if CUT * attempt.step < close or (unstable is not None and not self.last.is_stable):
            return False
        self.length, self.unstable = CUT * attempt.step, unstable or self.unstable
        return True

    def _snap(self, attempt: _Attempt, unstable: Node | None, why: str) -> str:
        """Snap through to another equilibrium from a limit point or a loss of stability; returns why it
        cannot, or "".
        """
        if unstable is None and pushing(self.statics.system, self.last.state).any():
            return why
        if sum(node.is_snapped for node in self.nodes) == MOST_SNAPS:
            return f"it buckles or snaps more than {MOST_SNAPS} times"
        if unlike := why_unlike(self.statics, self.last.state):
            return unlike
        # Not from the unstable equilibrium nearest to the bifurcation: the first steps of a branch converge badly.
        begin = self.unstable or unstable
        c, state = (begin.c, begin.state) if begin else (attempt.c, self.last.state)
        try:
            node = snapped(self.statics, self.line, c, state, self.names)
        except SimulationError as error:
            return why or str(error)
        if is_no_snap(self.statics, self.last.state, attempt.guess, node.state):
            node = replace(node, is_snapped=False)
        # Where many branches begin at once they separate further on.
        is_among_many = node.is_snapped and is_nearly_free(node)
        self._add(node, max(attempt.step, self.first_step) if is_among_many else attempt.step)
        return ""

    def _add(self, node: Node, length: float) -> None:
        """Append a node, and set the length of the step from there."""
        has_snapped = self.last.has_snapped or self.last.is_snapped
        self.nodes.append(replace(node, has_snapped=has_snapped) if has_snapped else node)
        self.work.gain(node.c - self.nodes[0].c, self.statics.n_factorisations)
        self.length = length
        self.failing = None
        self.tried.clear()
        if self.unstable is not None and self.unstable.c - node.c < self._close(node.c):
            self.unstable = None
        if self.begun is not None and self._is_plain:
            key, before = self.begun
            self.statics.keep(key, self.names, self.last, length, since=before)
        self.begun = None

    def _close(self, c: float) -> float:
        return CLOSE * max(c - self.nodes[0].c, SMALLEST_STEP * self.whole)


def _advice(system: System) -> str:
    """The advice where elements fail first: changes of cables that the robot has, contact where it has none."""
    pulled = "a plate where a force acts, or a via point with a radius, " if cables_of(system).names else ""
    meeting = "" if system.contacts else "contact where surfaces meet, "
    return f"Try {pulled}larger elements there, {meeting}or a law that stiffens in compression"


def follow(  # noqa: PLR0913 (one keyword for each option)
    statics: Statics,
    line: Line,
    start: Node | tuple[Node, ...],
    end: float,
    *,
    first_step: float,
    names: tuple[str, ...] = (),
    share: Callable[[Node], float] | None = None,
    largest_step: float = np.inf,
    mixed: bool = True,
    guide: tuple[Node, ...] = (),
    keeps: bool = False,
) -> Path:
    """Stable equilibria from a node to c = end, see the top of this file. The path ends early at a limit of its work,
    with a status.

    Parameters
    ----------
    statics
        The system at its parameters.
    line
        The controls by c.
    start
        The node to begin from, or several of which it is the last: the others give the curvature of the path.
    end
        The c to reach, in the unit of c.
    first_step, largest_step
        Lengths of the first step, and of the longest, in the unit of c.
    names
        Parameters (k,) of the nodes' derivatives.
    share
        Share of another aim than the end that a node reaches [-]; the path ends at 1.
    mixed
        Whether nodes have mixed derivatives, see `node_at`.
    guide
        The nodes of a path at other parameters from the same start to the same end, beside which this one is solved as
        long as it can be.
    keeps
        Whether Ctrl-C ends the path, instead of being raised.
    """
    before, start = (start[:-1], start[-1]) if isinstance(start, tuple) else ((), start)
    way = _Continuation(
        statics=statics,
        line=line,
        names=names,
        before=before,
        nodes=[start],
        end=end,
        first_step=first_step,
        largest_step=largest_step,
        mixed=mixed,
        guide=guide,
    )
    outer, statics.path_begin = statics.path_begin, statics.n_factorisations
    watch, reached = path_watch(), share or (lambda node: (node.c - start.c) / way.whole)
    try:
        while way.goes_on and (way.last is start or share is None or share(way.last) < 1.0):
            if status := way.advance():
                # With the physical cause and the place, if there are such.
                limit = statics.system.at_limit(way.last.state.x)
                place = "" if way.failing is None else f"{statics.system.place(way.failing)}. {_advice(statics.system)}"
                why = "; ".join(filter(None, (status, limit, place)))
                return Path(tuple(way.nodes), False, why, names, way.is_cut)
            watch.tell(reached(way.last), statics.n_factorisations)
    except KeyboardInterrupt as stop:
        if not keeps:
            raise
        return Path(tuple(way.nodes), False, names=names).stopped(stop)
    finally:
        statics.path_begin = outer
    return Path(tuple(way.nodes), True, names=names)


def go_on_from(statics: Statics, node: Node) -> None:
    """Continue from a node, with its free modes until new ones are computed: they appear with the first buckling."""
    statics.free_modes, statics.seeks_free_modes = node.free, node.has_snapped or node.is_snapped


def strays(statics: Statics, before: State, guess: State, solved: State) -> bool:
    """Whether an equilibrium may be on another branch: it is further from the prediction than the
    prediction from the previous equilibrium, or an actuator was reversed. With contact only a reversal counts, since
    predictions are less accurate.

    Parameters
    ----------
    statics
        The system at its parameters.
    before, guess, solved
        The equilibrium before the step, the prediction, and the equilibrium at the step's end.
    """
    if any(term.is_reversed(before.x, solved.x) for term in statics.system.actuated):
        return True
    if statics.system.contacts:
        return False
    layout = statics.system.layout
    return distance(layout, solved, guess) > distance(layout, guess, before) + SAME * statics.length


def between(statics: Statics, line: Line, path: Path, c: float) -> Node:
    """One more node inside a path, from the cubic through its neighbours, or by small steps from the node before it.

    Parameters
    ----------
    statics
        The system at its parameters.
    line
        The controls by c, those of the path.
    path
        The path.
    c
        Where the node is, between the first and the last of the path.

    Raises
    ------
    SimulationError
        Where no equilibrium was found from there.
    """
    before, after = neighbours(path, c)
    key, n = (line.key, before.c, after.c, c), statics.n_factorisations
    is_plain = not (before.has_snapped or before.is_snapped)
    if is_plain and (kept := statics.kept_node(key, path.names)) is not None:
        return kept.node
    node = _between(statics, line, before, after, c, path.names)
    if is_plain and not node.is_snapped:
        statics.keep(key, path.names, node, 0.0, since=n)
    return node


def _between(statics: Statics, line: Line, before: Node, after: Node, c: float, names: tuple[str, ...]) -> Node:
    """See `between`; where the cubic is too far from the equilibrium, first between nodes that are closer."""
    low, high = before, after
    for _ in range(HALVINGS):
        node = _corrected(statics, line, low, high, c, names)
        if node is not None:
            return node
        closer = [_corrected(statics, line, low, high, 0.5 * (c + end.c), names) for end in (low, high)]
        low, high = closer[0] or low, closer[1] or high
        if closer == [None, None]:
            break
    go_on_from(statics, before)
    way = follow(statics, line, before, c, first_step=0.3 * (c - before.c), names=names)
    if not way.reached:
        raise SimulationError(f"No equilibrium between two neighbouring ones: {way.status}.")
    return replace(way.nodes[-1], is_snapped=any(node.is_snapped for node in way.nodes[1:]))


def _corrected(
    statics: Statics, line: Line, before: Node, after: Node, c: float, names: tuple[str, ...]
) -> Node | None:
    """The stable node that Newton's method reaches from the cubic between two nodes; None where it reaches none."""
    go_on_from(statics, before)
    guess = interpolated(statics.system.layout, before, after, c)
    if statics.system.free_way(before.state, guess) < 1.0:
        return None
    solved = statics.equilibrium(guess, line.at(c))
    node = node_at(statics, line, c, solved.state, names) if solved.converged else None
    if node is None or not node.is_stable:
        return None
    return replace(node, has_snapped=before.has_snapped or before.is_snapped)


def neighbours(path: Path, c: float) -> tuple[Node, Node]:
    """The last node up to c and the first one from there on."""
    before = max((node for node in path.nodes if node.c <= c), key=lambda node: node.c)
    return before, min((node for node in path.nodes if node.c >= c), key=lambda node: node.c)


def interpolated(layout: Layout, before: Node, after: Node, c: float) -> State:
    """The cubic Hermite state between two nodes.

    Parameters
    ----------
    layout
        Numbering of the unknowns.
    before, after
        The nodes, with their slopes.
    c
        Where the state is, between those of the nodes.
    """
    h = after.c - before.c
    if h <= 0.0:
        return before.state
    t = (c - before.c) / h
    whole = difference(layout, after.state, before.state)
    dz = (3.0 - 2.0 * t) * t**2 * whole + h * t * (1.0 - t) * ((1.0 - t) * before.slope - t * after.slope)
    return moved(layout, before.state, dz)


def _nearer(statics: Statics, line: Line, c: float, last: Node, guess: State) -> State:
    """The state between the last one and the predicted one with the least residual."""
    if not is_nearly_free(last):
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
    # Near a snap-through a branch is not parabolic: a parabola may lead back to the former branch.
    if len(nodes) > 1 and not any(node.is_snapped for node in nodes[-2:]):
        before = nodes[-2]
        width = last.c - before.c
        back = difference(layout, before.state, last.state)  # z(c - width) - z(c)
        curvature = 2.0 * (back + width * last.slope) / width**2
        dz = dz + 0.5 * h**2 * curvature
    return dz
