"""Commands that bring channels of a robot to wanted values, on the exact twin with its exact derivatives.

With channels y(u) of the equilibrium at commands u of m actuators, among them stiffnesses, wanted values w and
tolerances t:

    first     min |r(u)|^2,  r = (y - w) / t,  within limits  lower <= y_j(u) <= upper  of any channels,   (1)
              and distances d_i(u) >= 0  of points of the robot's surface from obstacles
    then      min |p(u)|^2  among the minimisers of (1): least effort, or nearest to the last commands      (2)

*Unknowns.* An actuator is commanded by its effort (a cable's tension) or by its coordinate (its shortening). A slack
cable has no derivative by its shortening. So a cable without tension is released, its unknown is the tension, with
T >= 0, and its command the shortening at which it is just taut; once it is to have tension it is driven again.

*Step* (`_Search.step`). With the derivatives J of all channels at the present equilibrium (one factorisation), limits
are linear inequalities, and three least-squares problems with inequalities follow each other, the next one keeping what
the one before has found: limits that are violated at present; A d = -r of (1), A = J / t; within the null space of A,
p + P d = 0 of (2). All within a box in which, to first order, no channel moves by more than a share `size` of the
robot's extent, or of one radian. Each problem is solved exactly by an active set (`_least`).

*Curvature.* Near a target that cannot be reached r stays, and Gauss-Newton alone would creep. The part of the Hessian
that it leaves out, S = sum r_k d2 r_k, is updated from the change of A^T r (structured symmetric rank one), and used
where A^T A + S is positive definite; with its eigenvalues' sizes where it is not and a step has failed, as in the
curved valley of two targets that all but one actuators move in the same ratio. What S then needs of the null space of A
is no longer free for (2).

*Control of the step* (`_Search.descended`). Merit |r|^2 / 2 + nu V, with the sum V of the violations and nu above the
multipliers. Where a step lowers it by less than a small share of what is predicted, or the twin finds no equilibrium
there, snaps on the way or passes through itself, the box shrinks to a quarter; where the prediction holds, it doubles.
So the search never crosses an instability: it ends before it, and says where it is, by bisection of the commands
(`_Search.located`).

*Preference* (`_Search.preferred`). Steps along the curved set of minimisers: after each one the residual of (1) is
brought back by up to `RESTORED` steps with the same derivatives, and it counts only if (2) has decreased.

*Starts.* The last state; and, if that does not reach the target, rest and a pull of each actuator. The best end counts.

*What is checked at the end* (`_Search.checked`). The commands are given to the twin once more, from the state before.
Reached: every |r_k| <= 1. Nearest: the gradient of (1) is a non-negative combination of those of the active limits, up
to `STATIONARY` of its size. Else: refused, with the reason. On the straight line from the commands before, the
clearance from obstacles is that of `ON_THE_WAY` more states; where the robot is in one, the search goes on with the
deepest state of the line as a limit, d_i(u_s) >= 0 with d u_s = s du.

A robot that remembers (reversing friction, histories of materials) is taken to each trial from the state before, over
the straight line of commands, so that its memory is that of the commands that are returned, one after the other.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import SimulationError
from softcal.geometry.obstacle import Obstacle
from softcal.html_text import summary
from softcal.sensing.channel import channel_name
from softcal.twin.channels import STIFFNESS
from softcal.twin.clearance import Clearances
from softcal.twin.live import LiveState, LiveTwin
from softcal.twin.parameter_name import parameter_name
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.units import format_quantity

Prefer = Literal["effort", "nearest"]
Outcome = Literal["reached", "nearest", "refused"]
PREFERENCES: Mapping[str, str] = {"effort": "of least effort", "nearest": "nearest to the last commands"}

# By unit: where a target counts as reached.
TOLERANCES: Mapping[str, float] = {"m": 1e-5, "rad": float(np.radians(0.01)), "N": 1e-2}

FIRST, LARGEST, SMALLEST = 0.25, 1.0, 1e-5  # sizes of the box: shares of the robot's extent, and of one radian
STEPS, PREFERRED, RESTORED = 60, 40, 3  # at most
CLOSE = 0.02  # of a tolerance, to which targets are solved
KEPT = 1e-3  # of a tolerance, by which a limit may be passed between steps
NO_GAIN = 1e-10  # of the merit: a smaller predicted decrease ends the search
STATIONARY = 1e-3  # of the gradient of the residual: a smaller remainder counts as zero
NO_EFFECT = 1e-7  # of the largest singular value: a smaller one is a direction without effect on the targets
UNSTABLE = "the robot buckles or snaps to another equilibrium."
KINK = "the derivatives jump there, as where friction reverses or a cable becomes slack, and no step comes closer."
UNFINISHED = f"the search still came closer after {STEPS} steps."
ELSEWHERE = "The last commands do not lead there: the robot has another equilibrium, and an instability is between."
TOUCH = TOLERANCES["m"]  # tolerance of the distance from an obstacle
ON_THE_WAY, BISECTIONS = 15, 10  # states on the way to the commands; of the commands between which it ends
DETOURS = 3  # searches at most for commands on whose way no obstacle is
PULL = 0.4  # size of the pulls from which further starts begin


@displayed
@dataclass(frozen=True)
class ReachStep(Checked):
    """The commands for one target.

    Attributes
    ----------
    outcome
        "reached": within all tolerances; "nearest": the target cannot be reached, and no commands near these come
        closer within the limits; "refused": the way to the target ends before, at these commands or, where none near it
        are safe, at the last ones, see `status`.
    wanted
        Channel -> wanted value [SI].
    commands
        Command such as `front.tension` -> value [SI].
    channels
        Every channel there [SI].
    active
        Limits at which the robot is, and obstacles that it touches.
    status
        How it ended, in sentences.
    gradient
        The remainder of the gradient after the active limits: of the residual where the target is not reached, else of
        the preference, over its size [-].
    n_states, n_derivatives
        Equilibria and derivatives that were computed.
    wall_s
        Wall time [s].
    time
        Of the target [s].
    clearances
        Obstacle -> its least distance from the robot's surface [m].
    bands
        Channel of the target -> half the width of the 95 % band that the calibration leaves at these commands [SI].
    command_bands
        Command -> half the width of the 95 % band of the command that brings the channels to where they are [SI].
    why
        Of a refused target: why the way ends, a sentence.
    """

    outcome: Outcome
    wanted: Mapping[str, float]
    commands: Mapping[str, float]
    channels: Mapping[str, float]
    active: tuple[str, ...]
    status: str
    gradient: float
    n_states: int
    n_derivatives: int
    wall_s: float
    time: float | None = None
    clearances: Mapping[str, float] = field(default_factory=dict)
    bands: Mapping[str, float] = field(default_factory=dict)
    command_bands: Mapping[str, float] = field(default_factory=dict)
    why: str = ""

    @property
    def misses(self) -> dict[str, float]:
        """Channel -> value there less the wanted one [SI]."""
        return {name: self.channels[name] - value for name, value in self.wanted.items()}


@displayed
@dataclass(frozen=True)
class ReachResult(Checked):
    """The commands for every target.

    Attributes
    ----------
    steps
        The targets, one after the other.
    units
        Channel -> its SI unit.
    tolerances
        Channel of a target -> error below which it counts as reached [SI].
    preference
        Which of several commands for the same target were taken, a sentence.
    without_bands
        Why a calibrated run has no bands, a sentence; "" where it has, and of a project.
    """

    steps: tuple[ReachStep, ...]
    units: Mapping[str, str]
    tolerances: Mapping[str, float]
    preference: str
    without_bands: str = ""

    @property
    def protocol(self) -> Protocol:
        """The commands of all steps, as `simulate` takes them."""
        names = {command: channel_name(command) for command in self.steps[0].commands}
        values = {command: np.array([step.commands[command] for step in self.steps]) for command in names}
        times = [step.time for step in self.steps]
        return Protocol(
            {one.carrier: Command(one.kind.name, values[command]) for command, one in names.items()},
            None if None in times else np.array(times, dtype=np.float64),
        )

    def _repr_html_(self) -> str:
        rows = [
            [step.outcome, *(format_quantity(value, self.units[name]) for name, value in step.commands.items())]
            for step in self.steps
        ]
        return summary("Reach", ["", *self.steps[0].commands], rows, reach_sentences(self))


def reach_sentences(result: ReachResult) -> list[str]:
    """The statement of a result: the number of targets reached and their largest errors, the others, the preference."""
    n = len(result.steps)
    reached = [step for step in result.steps if step.outcome == "reached"]
    told: list[str] = []
    if reached:
        largest: dict[str, float] = {}
        for step in reached:
            for name, miss in step.misses.items():
                largest[name] = max(abs(miss), largest.get(name, 0.0))
        shown = (f"{name} {format_quantity(off, result.units[name], digits=2)}" for name, off in largest.items())
        told.append(f"{len(reached)} of {n} target(s) reached; largest errors: {', '.join(shown)}.")
    names = dict.fromkeys(name for step in result.steps for name in step.clearances)
    if names:
        least = {name: min(step.clearances[name] for step in result.steps) for name in names}
        apart = (f"{format_quantity(round(least[name], 8) + 0.0, 'm', digits=3)} from {name}" for name in names)
        told.append(f"Least clearance: {', '.join(apart)}.")
    if banded := [step for step in result.steps if step.bands]:

        def widest(each: Sequence[Mapping[str, float]]) -> str:
            most = {name: max(bands.get(name, 0.0) for bands in each) for bands in each for name in bands}
            shown = (f"{name} ± {format_quantity(width, result.units[name], digits=2)}" for name, width in most.items())
            return ", ".join(shown)

        of_commands = widest([step.command_bands for step in banded])
        more = f"; of commands that reach it {of_commands}" if of_commands else ""
        at_commands = widest([step.bands for step in banded])
        told.append(f"What the calibration leaves open, with 95 %, at most: at these commands {at_commands}{more}.")
    told += [result.without_bands] if result.without_bands else []
    for k, step in enumerate(result.steps, start=1):
        if step.outcome != "reached":
            told.append(step.status if n == 1 else f"Target {k}: {step.status}")
    return [*told, result.preference]


@dataclass(frozen=True)
class ReachTask:
    """The task beside its targets; arrays by channel, in their order and SI.

    Attributes
    ----------
    units
        Channel -> its unit: those of the twin, then the stiffnesses that are wanted or limited.
    tolerances
        Below which an error counts as none (n_channels,).
    weights
        Weights of the errors, in units of their tolerances (n_channels,).
    lower, upper
        Limits (n_channels,), infinite where there is none.
    rates
        Largest changes of the channels per second (n_channels,), infinite where there is none.
    prefer
        What is least where actuators are left.
    obstacles
        The obstacles by name.
    """

    units: Mapping[str, str]
    tolerances: Floats
    weights: Floats
    lower: Floats
    upper: Floats
    rates: Floats
    prefer: Prefer = "effort"
    obstacles: Mapping[str, Obstacle] = field(default_factory=dict)

    @property
    def stiffnesses(self) -> tuple[str, ...]:
        """The stiffnesses among the channels."""
        return tuple(name for name in self.units if name.endswith(STIFFNESS))


def reach_targets(
    live: LiveTwin, task: ReachTask, wanted: Sequence[Mapping[str, float]], times: Sequence[float] | None = None
) -> Iterator[ReachStep]:
    """The commands for each target in turn, each from the last ones; the first from rest.

    Parameters
    ----------
    live
        The twin, with the controls of its actuators.
    task
        Tolerances, limits and preference.
    wanted
        Channel -> value [SI], by target.
    times
        Times of the targets [s]; None: each is held for long.

    Raises
    ------
    SimulationError
        Where no commands keep the limits.
    """
    live.reset()
    for k, target in enumerate(wanted):
        elapsed = np.inf if times is None or k == 0 else times[k] - times[k - 1]
        try:
            step = reach_from(live, task, target, elapsed)
        except SimulationError as error:
            raise SimulationError(f"Target {k + 1}: {error}" if len(wanted) > 1 else str(error)) from error
        yield step if times is None else replace(step, time=times[k])


def reach_from(
    live: LiveTwin,
    task: ReachTask,
    wanted: Mapping[str, float],
    elapsed: float = np.inf,
    *,
    only_from_here: bool = False,
) -> ReachStep:
    """The commands for one target from the present state of a twin, which is then at them.

    Parameters
    ----------
    live
        The twin.
    task
        Tolerances, limits and preference.
    wanted
        Channel -> value [SI].
    elapsed
        Time since the last state [s]; infinity: held for long.
    only_from_here
        Whether the search begins at the present state alone, and of several commands takes those at which it ends.

    Raises
    ------
    SimulationError
        Where no commands keep the limits.
    """
    return _Search(live, task, wanted, elapsed, only_from_here=only_from_here).found()


@dataclass(frozen=True)
class _Point:
    """An equilibrium of the search.

    way: states on the straight line of commands to it that must be clear of obstacles too, each behind its share of the
    line. unknowns: per actuator, its effort where it is commanded by it or released, else its coordinate (m,).
    """

    task: ReachTask
    state: LiveState
    unknowns: Floats
    released: np.ndarray
    way: tuple[tuple[float, LiveState], ...] = ()

    @cached_property
    def channels(self) -> dict[str, float]:
        """Channel -> its value, and the same of the stiffnesses."""
        return {**self.state.channels, **self.state.stiffnesses(*self.task.stiffnesses)}

    @cached_property
    def values(self) -> Floats:
        """The channels (n_channels,)."""
        return np.array(list(self.channels.values()))

    @cached_property
    def near(self) -> tuple[tuple[float, LiveState, Clearances], ...]:
        """The distances from obstacles, at the state and on the way to it."""
        each = ((1.0, self.state), *self.way) if self.task.obstacles else ()
        return tuple((share, state, state.clearances(self.task.obstacles)) for share, state in each)


@dataclass(frozen=True)
class _Barrier:
    """Commands that the search could not follow from a state, and why."""

    why: str
    begin: LiveState
    commands: Mapping[str, float]
    released: Sequence[str]


@dataclass(frozen=True)
class _Linear:
    """The problem to first order at a point, in unknowns of which one moves the robot by about its extent.

    scale: of the unknowns (m,). rates: of all channels (n_channels, m). rows, gaps, names: of the limits
    rows @ d >= gaps, in tolerances. moving, error: A and r of (1). fond, off: P and p of (2).
    """

    scale: Floats
    rates: Floats
    rows: Floats
    gaps: Floats
    names: tuple[str, ...]
    moving: Floats
    error: Floats
    fond: Floats
    off: Floats

    @cached_property
    def free(self) -> Floats:
        """The directions without effect on the targets (m, k)."""
        return _without_effect(self.moving)

    @property
    def violation(self) -> float:
        return float(np.maximum(self.gaps - KEPT, 0.0).sum())

    def remainder(self, matrix: Floats, error: Floats, others: Floats) -> tuple[float, list[str]]:
        """The remainder of the gradient matrix^T error after the active limits and any multiple of other rows (k, m),
        over the sizes of both factors; and the names of the limits that it needs.
        """
        from scipy.optimize import nnls

        size = float(np.linalg.norm(matrix) * np.linalg.norm(error))
        active = np.flatnonzero(self.gaps >= -2.0 * CLOSE)
        columns = np.concatenate([self.rows[active], others, -others]).T
        gradient = matrix.T @ error / max(size, 1e-300)
        if not columns.size:
            return float(np.linalg.norm(gradient)), []
        shares, left = nnls(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), gradient, maxiter=1000)
        return float(left), [self.names[k] for k, share in zip(active, shares, strict=False) if share > STATIONARY]


class _Search:
    """The search for the commands of one target, from the state of a live twin."""

    def __init__(
        self, live: LiveTwin, task: ReachTask, wanted: Mapping[str, float], elapsed: float, *, only_from_here: bool
    ) -> None:
        self.only_from_here = only_from_here
        self.began = time.perf_counter()
        self.live, self.task, self.wanted, self.elapsed = live, task, wanted, elapsed
        self.before, self.channels, self.actuators = live.state, list(task.units), live.actuators
        self.number = {name: k for k, name in enumerate(self.channels)}
        self.targets = np.array([self.number[name] for name in wanted])
        self.goal, self.tolerance = np.array(list(wanted.values())), task.tolerances[self.targets]
        self.by_coordinate = np.array([live.controls[one.name] == one.coordinate for one in self.actuators])
        self.effort = np.array([self.number[f"{one.name}.{one.effort}"] for one in self.actuators])
        self.coordinate = np.array([self.number[f"{one.name}.{one.coordinate}"] for one in self.actuators])
        self.command = np.where(self.by_coordinate, self.coordinate, self.effort)
        last = self.last = _Point(task, self.before, np.zeros(0), np.zeros(0)).values
        change = np.full(len(last), np.inf)
        limited = np.isfinite(task.rates) & np.isfinite(elapsed)
        change[limited] = task.rates[limited] * elapsed
        self.lower, self.upper = np.maximum(task.lower, last - change), np.minimum(task.upper, last + change)
        least = np.array([one.least_effort for one in self.actuators])
        self.least = least
        self.lower[self.effort] = np.maximum(self.lower[self.effort], least)
        self.fond = self.effort if task.prefer == "effort" else self.command
        self.reference = np.zeros(len(last)) if task.prefer == "effort" else last
        self.fond_scale = np.zeros(0)  # of the first point
        self.barrier: _Barrier | None = None
        self.is_unfinished = False
        self.n_states, self.n_derivatives = 0, 0
        self.shares: tuple[float, ...] = ()
        size = {"m": live.extent, "rad": 1.0}
        self.motion = np.array([1.0 / size[unit] if unit in size else 0.0 for unit in task.units.values()])

    def found(self) -> ReachStep:
        """The commands, checked.

        Raises
        ------
        SimulationError
            Where no commands keep the limits.
        """
        best: tuple[tuple[bool, float], _Point, _Barrier | None, bool] | None = None
        for start in self.starts():
            barrier, self.barrier = self.barrier, None
            end = self.descended(start)
            cost, told = self.cost(end), self.barrier
            self.barrier = barrier or told
            if best is None or cost < best[0]:
                best = cost, end, told, self.is_unfinished
            if self.only_from_here or self.is_reached(end):
                break
        if best is None or best[0][0]:
            why = "the limits contradict each other along every way that was tried"
            for _, _, near in () if best is None else best[1].near:
                if near.values.min() < -TOUCH:
                    why = f"no way that was tried keeps out of {near.obstacles[int(np.argmin(near.values))]}"
            why = self.barrier.why if self.barrier else why
            raise SimulationError(f"No commands within the limits were found: {why.rstrip('.')}.")
        self.barrier, self.is_unfinished = best[2] or self.barrier, best[3]
        end = best[1] if self.only_from_here else self.preferred(best[1])
        share, passed = self.passed(end)
        for _ in range(DETOURS):
            self.shares = (*self.shares, share)
            if not share or (again := self.evaluated(end.unknowns, end.released, end.state)) is None:
                break
            end = self.preferred(self.descended(again))
            share, passed = self.passed(end)
        return self.checked(end, passed)

    def starts(self) -> Iterator[_Point]:
        """The points where the search begins, in turn."""
        still = np.zeros(len(self.actuators))
        at_rest = np.array(self.by_coordinate & np.isfinite(self.least))
        if self.before.commands:
            released, values = at_rest & (self.last[self.effort] <= self.least), self.last[self.command]
            if (point := self.evaluated(np.where(released, 0.0, values), released, self.before)) is not None:
                yield point
        if not self.live.remembers:
            self.live.reset()
        rest = self.evaluated(still, at_rest, self.live.state)
        if rest is None:
            return
        yield rest
        at = self.linear(rest)
        for k in range(len(self.actuators)):
            step = np.where(np.arange(len(self.actuators)) == k, PULL, 0.0)
            if (point := self.moved(rest, at, step)) is not None:
                yield point

    def evaluated(self, unknowns: Floats, released: np.ndarray, begin: LiveState) -> _Point | None:
        """The equilibrium at values of the unknowns, from a state; None where there is none, or the robot snaps on the
        way.
        """
        live = self.live
        begin = self.before if live.remembers else begin
        if live.state is not begin:
            live.return_to(begin)
        names = np.array([one.name for one in self.actuators])
        commands = dict(zip(names[~released].tolist(), unknowns[~released].tolist(), strict=True))
        slack = names[released].tolist()
        state = live.at(commands, self.elapsed, released=slack)
        self.n_states += 1
        if why := why_ended(state):
            self.barrier = _Barrier(why, begin, commands, slack)
            live.return_to(begin)
            return None
        point = _Point(self.task, state, np.where(released, self.least, unknowns), released)
        more = ~released & self.by_coordinate & (point.values[self.effort] <= self.least)
        if more.any():
            return self.evaluated(unknowns, released | more, state)
        each = ((share, self.on_the_way(point, share, self.before)) for share in self.shares)
        return replace(point, way=tuple((share, state) for share, state in each if state.succeeded))

    def moved(self, here: _Point, at: _Linear, step: Floats) -> _Point | None:
        """The equilibrium after a step of the unknowns, in their scales; None as `evaluated`."""
        change = at.scale * step
        ahead = here.values + at.rates @ change
        released = self.by_coordinate & (ahead[self.effort] - self.least <= 1e-9 * at.scale)
        # To first order a released cable that is driven again has the shortening that gives its tension.
        values = np.where(self.by_coordinate, ahead[self.coordinate], here.unknowns + change)
        low, high = self.lower[self.command], self.upper[self.command]
        values = np.clip(values, low, np.maximum(high, low))
        return self.evaluated(np.where(released, self.least, values), released, here.state)

    def linear(self, here: _Point) -> _Linear:
        """The problem to first order."""
        if self.live.state is not here.state:
            self.live.return_to(here.state)
        found = here.state.by_commands()
        self.n_derivatives += 1
        labels = [
            f"{one.name}.{one.coordinate if driven else one.effort}"
            for one, driven in zip(self.actuators, self.by_coordinate & ~here.released, strict=True)
        ]
        stiff = self.task.stiffnesses
        by_stiffness = [here.state.stiffnesses_by_commands(*stiff).values] if stiff else []
        columns = [found.names.index(label) for label in labels]
        rates = np.concatenate([found.values, *by_stiffness])[:, columns]
        scale = 1.0 / np.maximum(np.abs(rates * self.motion[:, None]).max(axis=0), 1e-12)
        y, m = here.values, len(labels)
        rows: list[Floats] = []
        gaps: list[float] = []
        names: list[str] = []
        # A slack cable may stay behind where it is just taut: no upper limit of its shortening, unless it is driven.
        behind = here.released & (y[self.coordinate] > self.upper[self.coordinate])
        free = set(self.coordinate[behind].tolist())
        for k in np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper)).tolist():
            tolerance, unit = self.task.tolerances[k], self.task.units[self.channels[k]]
            fixed = (self.task.lower[k], self.task.upper[k], *self.least)
            for sign, bound, side in ((1.0, self.lower[k], "lower"), (-1.0, self.upper[k], "upper")):
                if np.isfinite(bound) and not (sign < 0.0 and k in free):
                    rows.append(sign * rates[k] * scale / tolerance)
                    gaps.append(sign * (bound - y[k]) / tolerance)
                    shown = format_quantity(bound + 0.0, unit) + ("" if bound in fixed else " by its rate")
                    names.append(f"{self.channels[k]} at its {side} limit {shown}")
        for k in np.flatnonzero(behind).tolist():
            rows.append(-np.eye(m)[k])
            gaps.append(0.0)
            names.append(f"{self.channels[self.coordinate[k]]} beyond its upper limit: slack")
        for share, state, near in here.near:
            slopes = state.clearances_by_commands(near)
            own = [slopes.names.index(label) if label in slopes.names else -1 for label in labels]
            rows += [*(share * np.where(np.array(own) < 0, 0.0, slopes.values[:, own]) * scale / TOUCH)]
            gaps += (-near.values / TOUCH).tolist()
            there = "" if share == 1.0 else " on the way"
            names += [f"{part} touches {one}{there}" for part, one in zip(near.parts, near.obstacles, strict=True)]
        if not len(self.fond_scale):
            kinds = [channel_name(self.channels[k]).kind.name for k in self.fond]
            own = np.abs(rates[self.fond, np.arange(m)] * scale).tolist()
            largest = {kind: max(size for size, one in zip(own, kinds, strict=True) if one == kind) for kind in kinds}
            self.fond_scale = np.array([max(largest[kind], 1e-12) for kind in kinds])
        weights = self.task.weights[self.targets] / self.tolerance
        return _Linear(
            scale=scale,
            rates=rates,
            rows=np.array(rows).reshape(len(rows), m),
            gaps=np.array(gaps),
            names=tuple(names),
            moving=rates[self.targets] * scale * weights[:, None],
            error=(y[self.targets] - self.goal) * weights,
            fond=rates[self.fond] * scale / self.fond_scale[:, None],
            off=(y[self.fond] - self.reference[self.fond]) / self.fond_scale,
        )

    def errors(self, point: _Point) -> Floats:
        """The errors in tolerances, without their weights."""
        return (point.values[self.targets] - self.goal) / self.tolerance

    def is_reached(self, point: _Point, share: float = 1.0) -> bool:
        return bool(np.abs(self.errors(point)).max(initial=0.0) <= share and self.violation(point) <= KEPT)

    def violation(self, point: _Point) -> float:
        """The sum of the excesses beyond limits, in tolerances."""
        y, t = point.values, self.task.tolerances
        over = y - self.upper
        behind = point.released & self.by_coordinate
        over[self.coordinate[behind]] = -np.inf
        inside = sum(float(np.maximum(-near.values / TOUCH - KEPT, 0.0).sum()) for _, _, near in point.near)
        return float(np.maximum(np.maximum(self.lower - y, over) / t - KEPT, 0.0).sum() + inside)

    def cost(self, point: _Point) -> tuple[bool, float]:
        """Whether limits are violated by more than a tolerance, and half the squared error."""
        r = self.errors(point) * self.task.weights[self.targets]
        return self.violation(point) > 1.0, float(0.5 * r @ r)

    def step(self, at: _Linear, size: float, curvature: Floats) -> tuple[Floats, float]:
        """The step of the unknowns in a box, and the largest multiplier of a limit."""
        m = len(at.scale)
        box = np.concatenate([np.eye(m), -np.eye(m)])
        rows, sides = np.concatenate([at.rows, box]), np.full(2 * m, -size)
        gaps = np.concatenate([at.gaps, sides])
        violated = gaps > 0.0
        back, _ = _least(rows[violated], gaps[violated], rows[~violated], gaps[~violated])
        gaps = np.minimum(gaps - rows @ back, 0.0)
        root, pull, free = at.moving, -at.error - at.moving @ back, at.free
        if curvature.any():
            values, across = np.linalg.eigh(root.T @ root + curvature)
            is_definite = values.min() > 1e-8 * values.max()
            if is_definite or size < FIRST:
                values = np.abs(values)
                kept = values > 1e-8 * values.max()
                values, across = values[kept], across[:, kept]
                root = np.sqrt(values)[:, None] * across.T
                pull = -(across.T @ at.moving.T @ at.error) / np.sqrt(values) - root @ back
                free = _without_effect(np.concatenate([at.moving, root]))
        first, multipliers = _least(root, pull, rows, gaps)
        if free.shape[1]:
            off = at.off + at.fond @ (back + first)
            first = first + free @ _least(at.fond @ free, -off, rows @ free, gaps - rows @ first)[0]
        return back + first, float(multipliers[: len(at.gaps)].max(initial=0.0))

    def descended(self, here: _Point) -> _Point:
        """The end of the search for (1) from a point."""
        size, price, at = FIRST, 0.0, self.linear(here)
        curvature = np.zeros((len(at.scale),) * 2)  # in the unknowns themselves
        self.is_unfinished = False
        for _ in range(STEPS):
            if self.is_reached(here, CLOSE) or size < SMALLEST:
                break
            step, multiplier = self.step(at, size, curvature * np.outer(at.scale, at.scale))
            price = max(price, 2.0 * multiplier)
            merit = 0.5 * at.error @ at.error + price * self.violation(here)
            ahead = at.error + at.moving @ step
            left = np.maximum(at.gaps - at.rows @ step - KEPT, 0.0).sum()
            bent = 0.5 * float(step @ (curvature * np.outer(at.scale, at.scale)) @ step)
            gain = merit - 0.5 * ahead @ ahead - max(bent, -0.5 * merit) - price * left
            if not gain > NO_GAIN * max(merit, 1.0):
                if not curvature.any():
                    break
                curvature = np.zeros_like(curvature)
                continue
            there = self.moved(here, at, step)
            if there is None:
                size *= 0.25
                continue
            error = self.errors(there) * self.task.weights[self.targets]
            actual = merit - 0.5 * error @ error - price * self.violation(there)
            if actual < 1e-4 * gain:
                size = 0.25 * min(size, float(np.abs(step).max()))
                continue
            if actual > 0.5 * gain and np.abs(step).max() > 0.9 * size:
                size = min(2.0 * size, LARGEST)
            after = self.linear(there)
            curvature = self.updated(curvature, at, after, here, there, error)
            here, at = there, after
        else:
            self.is_unfinished = True
        return here

    def updated(
        self, curvature: Floats, at: _Linear, after: _Linear, here: _Point, there: _Point, error: Floats
    ) -> Floats:
        """The curvature after a step, by the change of A^T r: symmetric, of rank one; none for other unknowns."""
        if np.any(here.released != there.released):
            return np.zeros_like(curvature)
        way = there.unknowns - here.unknowns
        bent = error @ (after.moving / after.scale - at.moving / at.scale) - curvature @ way
        denominator = float(bent @ way)
        if abs(denominator) < 1e-8 * np.linalg.norm(bent) * np.linalg.norm(way) or not denominator:
            return curvature
        return curvature + np.outer(bent, bent) / denominator

    def preferred(self, here: _Point) -> _Point:
        """The end of the search for (2) from a point."""
        size, at = FIRST, self.linear(here)
        none = np.zeros((len(at.scale),) * 2)
        for _ in range(PREFERRED):
            if size < SMALLEST or not at.free.shape[1]:
                break
            step, _ = self.step(at, size, none)
            fond, ahead = float(at.off @ at.off), at.off + at.fond @ step
            gain = fond - float(ahead @ ahead)
            if not gain > 1e-8 * max(fond, 1e-6):
                break
            there, worst = self.moved(here, at, step), max(self.cost(here)[1], CLOSE**2)
            for _ in range(RESTORED):
                if there is None or (self.cost(there)[1] <= 1.01 * worst and self.violation(there) == 0.0):
                    break
                there = self.restored(there, at, size)
            if there is not None and self.cost(there)[1] <= 1.01 * worst and self.violation(there) == 0.0:
                off = (there.values[self.fond] - self.reference[self.fond]) / self.fond_scale
                if fond - float(off @ off) > 0.1 * gain:
                    here, at, size = there, self.linear(there), min(2.0 * size, LARGEST)
                    continue
            size *= 0.25
        return here

    def restored(self, there: _Point, at: _Linear, size: float) -> _Point | None:
        """A point nearer to (1), by the derivatives of another one."""
        error = self.errors(there) * self.task.weights[self.targets]
        correction = np.linalg.pinv(at.moving, rcond=1e-9) @ -error
        return self.moved(there, at, np.clip(correction, -size, size))

    def checked(self, end: _Point, passed: str) -> ReachStep:
        """The step of the final commands, solved once more from the previous state; passed: the sentence of `passed` on
        an obstacle between the two.
        """
        live, at = self.live, self.linear(end)
        values = np.clip(end.values[self.command], self.lower[self.command], self.upper[self.command])
        commands = {one.name: float(value) for one, value in zip(self.actuators, values, strict=True)}
        live.return_to(self.before)
        state = live.at(commands, self.elapsed)
        self.n_states += 1
        reached = _Point(self.task, state, end.unknowns, end.released)
        residual, limits = at.remainder(at.moving, at.error, np.zeros((0, len(at.scale))))
        why, barrier = "", self.barrier
        if ended := why_ended(state):
            why = f"The way from the last commands to the best ones ends before them: {ended}"
            barrier = _Barrier(ended, self.before, commands, ())
        elif np.abs(self.errors(reached) - self.errors(end)).max() > 1.0:
            why, barrier = ELSEWHERE, None
        elif passed:
            why, barrier = f"The way from the last commands to the best ones {passed}", None
        if why:  # the last commands stay
            state = live.return_to(self.before)
            reached, values = _Point(self.task, state, end.unknowns, end.released), self.last[self.command]
        elif residual > STATIONARY and not self.is_reached(reached):
            why = f"The way ends there: {barrier.why if barrier else UNFINISHED if self.is_unfinished else KINK}"
        off = self.told(reached)
        if not why and self.is_reached(reached):
            outcome, told = "reached", f"Reached: {off}."
        elif why:
            outcome, told = "refused", f"Refused: {off}. {why}{self.located(barrier)}"
            live.return_to(state)
        else:
            outcome = "nearest"
            told = f"Not reached: {off}. No commands near these come closer within the limits"
            told += f": {', '.join(dict.fromkeys(limits))}." if limits else "."
        if outcome != "reached":
            told += self.wanted_inside()
        left = residual
        if outcome == "reached":
            left, limits = at.remainder(at.fond, at.off, at.moving)
            left *= float(at.free.shape[1] > 0)
        return ReachStep(
            outcome=outcome,
            wanted=dict(self.wanted),
            commands={self.channels[k]: float(value) for k, value in zip(self.command, values, strict=True)},
            channels=reached.channels,
            active=tuple(dict.fromkeys(limits)),
            status=told,
            gradient=left,
            n_states=self.n_states,
            n_derivatives=self.n_derivatives,
            wall_s=time.perf_counter() - self.began,
            why=why,
            clearances={
                name: float(near.values[near.nearest(name)])
                for _, _, near in reached.near
                for name in self.task.obstacles
            },
        )

    def on_the_way(self, end: _Point, share: float, begin: LiveState) -> LiveState:
        """The state at a share of the straight line of commands from the last ones, from a state on it."""
        self.live.return_to(self.before if self.live.remembers else begin)
        self.n_states += 1
        values = end.values[self.command]
        commands = dict(zip((one.name for one in self.actuators), values.tolist(), strict=True))
        return self.live.at(self.between(self.before, commands, share), self.elapsed * share)

    def passed(self, end: _Point) -> tuple[float, str]:
        """The deepest penetration into an obstacle on the straight line from the last commands: its fraction of the
        line, 0 without penetration, and part of a sentence.
        """
        deepest, share, told, state = -TOUCH, 0.0, "", self.before
        for k in range(1, ON_THE_WAY + 1) if self.task.obstacles else ():
            state = self.on_the_way(end, k / (ON_THE_WAY + 1), state)
            near = state.clearances(self.task.obstacles)
            worst = int(np.argmin(near.values))
            if state.succeeded and near.values[worst] < deepest:
                deepest, share = float(near.values[worst]), k / (ON_THE_WAY + 1)
                told = f"passes through {near.obstacles[worst]}: {near.parts[worst]} by"
                told += f" {format_quantity(-deepest, 'm', digits=2)}, {self.commanded(state)}."
        return share, told

    def between(self, begin: LiveState, commands: Mapping[str, float], share: float) -> dict[str, float]:
        """Commands on the straight line from those of a state."""
        names = {name: f"{name}.{self.live.controls[name]}" for name in commands}
        return {name: (1.0 - share) * begin.channels[names[name]] + share * end for name, end in commands.items()}

    def located(self, barrier: _Barrier | None) -> str:
        """The sentence, with a blank before it, on the last safe commands on the way to a barrier, and the loads."""
        if barrier is None or self.only_from_here:
            return ""
        low, high, safe = 0.0, 1.0, barrier.begin
        for _ in range(BISECTIONS):
            share = 0.5 * (low + high)
            self.live.return_to(barrier.begin)
            commands = self.between(barrier.begin, barrier.commands, share)
            state = self.live.at(commands, self.elapsed, released=barrier.released)
            self.n_states += 1
            low, high, safe = (low, share, safe) if why_ended(state) else (share, high, state)
        robot = self.live.robot
        masses, parts = {f"{plate.name}.mass" for plate in robot.plates}, {load.name for load in robot.loads}
        loads = [
            f"{name} {format_quantity(one.value, one.quantity.unit)}"
            for name, one in robot_parameters(robot).items()
            if one.value and (name in masses or parameter_name(name).part in parts)
        ]
        under = f", under {', '.join(loads)}" if loads else ""
        return f" The last safe commands on that way are {self.commanded(safe)}{under}."

    def commanded(self, state: LiveState) -> str:
        """The commands and the efforts of a state."""
        names = (self.channels[k] for k in dict.fromkeys([*self.command, *self.effort]))
        return ", ".join(
            f"{name} {format_quantity(state.channels[name] + 0.0, self.task.units[name])}" for name in names
        )

    def wanted_inside(self) -> str:
        """The sentences, with a blank before each, on wanted places that are inside obstacles."""
        found = ""
        for carrier in dict.fromkeys(channel_name(name).point for name in self.wanted):
            place = [self.wanted.get(f"{carrier}.{axis}", np.nan) for axis in "xyz"]
            for name, obstacle in self.task.obstacles.items():
                if (distance := obstacle.distances(np.array([place]))[0][0]) < 0.0:
                    found += f" The place wanted of {carrier} is inside {name}, by {format_quantity(-distance, 'm')}."
        return found

    def told(self, point: _Point) -> str:
        """By how much each target is missed."""
        off = np.abs(point.values[self.targets] - self.goal)
        units = [self.task.units[name] for name in self.wanted]
        each = zip(self.wanted, off.tolist(), units, strict=True)
        return ", ".join(f"{name} {format_quantity(value, unit, digits=3)} off" for name, value, unit in each)


def why_ended(state: LiveState) -> str:
    """Why a way ends at a state: no equilibrium, an instability, bodies that intersect; or ""."""
    try:
        is_stable = state.succeeded and not state.snaps and state.is_stable
    except SimulationError as error:
        return str(error)
    return state.crossed if is_stable else UNSTABLE if state.succeeded else state.status


def _without_effect(A: Floats) -> Floats:
    """The null space of A (n, m), in errors per unknown: (m, k)."""
    _, size, across = np.linalg.svd(A)
    return across[int(np.sum(size > max(NO_EFFECT * size.max(initial=0.0), 1e-3))) :].T


def _least(A: Floats, b: Floats, rows: Floats, gaps: Floats) -> tuple[Floats, Floats]:
    """min |A x - b| subject to rows @ x >= gaps, and the multipliers, by an active set from x = 0: gaps <= 0.

    Among steps without effect on A x it takes the shortest.
    """
    m = A.shape[1]
    x, active, multipliers = np.zeros(m), list[int](), np.zeros(len(gaps))
    lengths = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)
    G, h = rows / lengths[:, None], np.minimum(gaps / lengths, 0.0)
    size = max(float(np.linalg.norm(A)), 1e-300)
    for _ in range(20 * (m + 2)):
        across = np.linalg.svd(G[active])[2][len(active) :].T if active else np.eye(m)
        way = across @ np.linalg.lstsq(A @ across, b - A @ x, rcond=1e-10)[0]
        if np.abs(way).max(initial=0.0) < 1e-12:
            multipliers[:] = 0.0
            shares = np.linalg.lstsq(G[active].T, A.T @ (A @ x - b), rcond=None)[0] if active else np.zeros(0)
            multipliers[active] = shares / lengths[active]
            if not active or shares.min() > -1e-12 * size * (1.0 + float(np.linalg.norm(A @ x - b))):
                break
            del active[int(np.argmin(shares))]
            continue
        rate = G @ way
        towards = rate < -1e-12 * np.abs(way).max()
        towards[active] = False
        room = np.where(towards, np.maximum(G @ x - h, 0.0) / np.where(towards, -rate, 1.0), np.inf)
        first = int(np.argmin(room)) if len(room) else 0
        share = min(1.0, float(room.min(initial=np.inf)))
        x = x + share * way
        if share < 1.0:
            active.append(first)
    return x, np.maximum(multipliers, 0.0)
