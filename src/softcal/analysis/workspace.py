"""The workspace of a robot: the values that some channels can take within the limits, its border, how far and how
stiffly the robot moves in it, and the poses where a direction is lost.

With k channels y(u) of the equilibrium at commands u of m actuators, k at most 3 and at most m, each in units of what
it spans:

*States.* Commands of a Sobol sequence within the limits of the actuators, every second one moved to a face of k - 1
dimensions of these ranges, of whose images the border mostly consists, and their corners; each is followed to its
neighbour. A state beyond another limit or in an obstacle is left out; so is one on whose way the robot buckles, snaps,
passes through itself or has no equilibrium, and these are counted by their reason.

*Shape* (`alpha_shape`). The simplices of the states' Delaunay triangulation with a circumscribed sphere below the least
radius for which they are one piece that has every state (an alpha shape): it may have bays and holes.

*Border* (`_Border.pushed`). From every state on the outside of that shape the search of `reach` goes for a place a
step further outward along the normal, and on by twice the step while it reaches it. It ends where no commands near
these come closer: the gradient of the distance is a combination of those of the active limits, which are named; or
before an instability. So every point of the border is an equilibrium and a local end. The shape with these points is
the workspace, flat between them.

*Mobility.* The derivatives of the channels by the commands, lengths over the robot's extent, commands over their
range, have the singular values s_1 >= .. >= s_k: the part of its extent, or of one radian, by which the robot moves
when commands change by their whole range, to first order, in the best and the worst direction. Their product is the
manipulability (Yoshikawa 1985). A pose is singular where s_k is below `SINGULAR` of the widest span of a channel (s_1
has no bound: it grows without end where the robot comes near buckling): to first order no change of the commands moves
the robot in one direction.

*Singular poses* (`_Border.singular`). From states whose s_k is below `LOW` of that and smaller than their neighbours'
in the space of commands, s_k is minimised by a simplex (Nelder and Mead) within the limits.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from softcal.analysis.reach import KINK, UNFINISHED, ReachTask, reach_from, why_ended
from softcal.checks import Floats, Ints
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, SimulationError
from softcal.html_text import summary
from softcal.twin.channels import STIFFNESS
from softcal.twin.live import LiveState, LiveTwin
from softcal.units import format_quantity, plain

STATES: Mapping[int, int] = {1: 64, 2: 256, 3: 512}  # by the number of channels
SINGULAR = 1e-3  # of the widest span of a channel: a smaller mobility is none
LOW = 0.25  # of that span: from states with less singular poses are sought
STARTS, EVALUATIONS = 4, 60  # of these minimisations
STEP, PUSHES = 0.1, 10  # outward from a state: of what the states span, doubled each time, and how often
CLOSE = 1e-4  # of that: where a place outward counts as reached
ROOM = {2: 1.2, 3: 2.0}  # over the least radius of the shape: in space gaps between states look like bays sooner
ROUNDS = 4  # of pushes outward, until all that is outside is an end
FOLD = "a singular pose, no limit"
WIDTH = {2: "area", 3: "volume"}
NAMED = 6  # ends in the statement


@displayed
@dataclass(frozen=True)
class WorkspaceState(Checked):
    """An equilibrium within the limits.

    Attributes
    ----------
    commands
        Command such as `front.tension` -> value [SI].
    channels
        Each channel of the workspace [SI].
    mobility
        Singular values of the derivatives of the channels by the commands, from the largest to the smallest: shares of
        the robot's extent, or of one radian, for a change of the commands by their whole range, to first order.
    compliances
        Channel of the workspace -> its change by a unit force or moment along it, the commands staying [SI]; without
        what has none.
    limits
        Of a state on the border: what ends it there.
    """

    commands: Mapping[str, float]
    channels: Mapping[str, float]
    mobility: tuple[float, ...]
    compliances: Mapping[str, float]
    limits: tuple[str, ...] = ()

    @property
    def manipulability(self) -> float:
        """The product of the singular values (Yoshikawa 1985)."""
        return float(np.prod(self.mobility))


@displayed
@dataclass(frozen=True)
class Workspace(Checked):
    """The values that some channels of a robot can have within its limits.

    Attributes
    ----------
    channels
        The channels, one to three.
    units
        Channel or command -> its SI unit.
    ranges
        Command -> its lowest and highest value [SI].
    states
        Equilibria inside and on the border.
    border
        Numbers of the states that are an end, where no commands near these lead further outward.
    simplices
        Numbers of the states at the corners of the segments, triangles or tetrahedra of which the workspace consists.
    singular
        Poses at which the robot loses a direction.
    least
        The state of the least mobility in its worst direction.
    refused
        Why commands have no state -> their number.
    n_outside
        Commands beyond another limit or in an obstacle.
    without_compliance
        Why there are no compliances, a sentence; "" where there are.
    values
        Calibrated parameter -> its value [SI], of a run.
    widest
        The widest span of a channel: a share of the robot's extent, or of one radian.
    wall_s
        Wall time [s].
    """

    channels: tuple[str, ...]
    units: Mapping[str, str]
    ranges: Mapping[str, tuple[float, float]]
    states: tuple[WorkspaceState, ...]
    border: tuple[int, ...]
    simplices: tuple[tuple[int, ...], ...]
    singular: tuple[WorkspaceState, ...]
    least: WorkspaceState
    refused: Mapping[str, int]
    n_outside: int
    without_compliance: str
    values: Mapping[str, float]
    widest: float
    wall_s: float

    @property
    def places(self) -> Floats:
        """The channels of all states (n_states, n_channels) [SI]."""
        return np.array([[state.channels[name] for name in self.channels] for state in self.states])

    @property
    def lost(self) -> float:
        """The mobility [-] below which a direction counts as lost."""
        return SINGULAR * self.widest

    @property
    def spans(self) -> dict[str, tuple[float, float]]:
        """Channel -> its lowest and its highest value [SI]; zero where that is rounding."""
        ends = np.array([self.places.min(axis=0), self.places.max(axis=0)])
        ends[np.abs(ends) < 1e-9 * np.abs(ends).max(axis=0)] = 0.0
        return {name: (low, high) for name, (low, high) in zip(self.channels, ends.T.tolist(), strict=True)}

    @property
    def size(self) -> float:
        """Length, area or volume: the product of the channels' units."""
        return float(simplex_sizes(self.places[np.array(self.simplices)]).sum())

    @property
    def size_unit(self) -> str:
        """The unit of `size`."""
        units = Counter(self.units[name] for name in self.channels)
        return " ".join(unit if n == 1 else f"{unit}^{n}" for unit, n in units.items())

    @property
    def outline(self) -> tuple[tuple[int, ...], ...]:
        """Numbers of the states at the corners of its outer faces: points, edges or triangles."""
        faces = Counter(
            tuple(sorted(corners[:k] + corners[k + 1 :])) for corners in self.simplices for k in range(len(corners))
        )
        return tuple(face for face, n in faces.items() if n == 1)

    def _repr_html_(self) -> str:
        rows = [[name, *(format_quantity(end, self.units[name]) for end in ends)] for name, ends in self.spans.items()]
        return summary("Workspace", ["channel", "from", "to"], rows, workspace_sentences(self))


def workspace_sentences(found: Workspace) -> list[str]:
    """The statement of a workspace: its size and border, what ends it, its mobility and its singular poses."""
    spans = [
        f"{name} {format_quantity(low, found.units[name])} to {format_quantity(high, found.units[name])}"
        for name, (low, high) in found.spans.items()
    ]
    shown = {"m": (1e3, "mm"), "rad": (180.0 / np.pi, "deg")}
    powers = Counter(shown.get(found.units[name], (1.0, found.units[name])) for name in found.channels)
    size = found.size * math.prod(scale**n for (scale, _), n in powers.items())
    unit = " ".join(name if n == 1 else f"{name}^{n}" for (_, name), n in powers.items())
    width = f"; {WIDTH[len(spans)]} {plain(size, 4)} {unit}" if len(spans) > 1 else ""
    told = [f"Within the limits: {', '.join(spans)}{width}. {n_of(len(found.border), 'state')} on the border."]
    ends = Counter(limit for k in found.border for limit in found.states[k].limits)
    if ends:
        most = ", ".join(f"{name} ({n})" for name, n in ends.most_common(NAMED))
        more = f", and {len(ends) - NAMED} more" if len(ends) > NAMED else ""
        told.append(f"What ends it there, with the number of states: {most}{more}.")
    told += [f"{n_of(n, 'command')} without a state: {why}" for why, n in found.refused.items()]
    if found.n_outside:
        told.append(f"{found.n_outside} of the commands that were tried lead beyond another limit or into an obstacle.")
    pose, n = (found.singular or (found.least,))[0], len(found.singular)
    at = ", ".join(f"{name} {format_quantity(value + 0.0, found.units[name])}" for name, value in pose.commands.items())
    if n:
        lost = sum(state.mobility[-1] <= found.lost for state in found.states)
        also = f", and so it does at {lost} of the {len(found.states)} states" if lost else ""
        told.append(f"At {n_of(n, 'pose')} the robot loses a direction{also}; the first: {at}.")
    else:
        least = plain(pose.mobility[-1], 3)
        told.append(f"No singular pose: the mobility in the worst direction is {least} at least, at {at}.")
    return [*told, found.without_compliance] if found.without_compliance else told


def compliance_unit(unit: str) -> str:
    """The unit of the compliance of a channel by its unit."""
    return {"m": "m/N", "rad": "rad/(N*m)"}[unit]


def n_of(n: int, what: str) -> str:
    """A number of things."""
    return f"{n} {what}{'s' * (n != 1)}"


def find_workspace(
    live: LiveTwin,
    task: ReachTask,
    channels: Sequence[str],
    *,
    n_states: int | None = None,
    seed: int = 1,
    values: Mapping[str, float] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Workspace:
    """The workspace of a twin.

    Parameters
    ----------
    live
        The twin, with the controls of its actuators.
    task
        Limits and obstacles.
    channels
        One to three channels.
    n_states
        Commands of the sequence; None: `STATES` by the number of channels.
    seed
        Seed of the sequence.
    values
        Calibrated values, for the record.
    progress
        Called with what is computed, its number from 0, and how many there are.

    Raises
    ------
    ParameterError
        For a command without limits, or more channels than commands.
    SimulationError
        Where the robot has too few states within the limits.
    """
    return _Border(live, task, tuple(channels), values or {}, progress).found(n_states, seed)


class _Border:
    """The search for a workspace."""

    def __init__(
        self,
        live: LiveTwin,
        task: ReachTask,
        channels: tuple[str, ...],
        values: Mapping[str, float],
        progress: Callable[[str, int, int], None] | None,
    ) -> None:
        self.began = time.perf_counter()
        self.live, self.task, self.channels, self.values = live, task, channels, values
        self.progress = progress or (lambda what, done, of: None)
        self.names = tuple(one.name for one in live.actuators)
        self.commands = tuple(f"{name}.{live.controls[name]}" for name in self.names)
        number = {name: k for k, name in enumerate(task.units)}
        self.columns = [number[name] for name in channels]
        least = {f"{one.name}.{one.effort}": one.least_effort for one in live.actuators}
        own = [number[name] for name in self.commands]
        # A coordinate without a lower limit begins where it is at rest.
        rest = [least.get(name, 0.0) for name in self.commands]
        lower = np.where(np.isfinite(task.lower[own]), task.lower[own], rest)
        self.lower, self.upper = (
            np.maximum(lower, [least.get(name, -np.inf) for name in self.commands]),
            task.upper[own],
        )
        faults = [
            Fault("the range of the command has no end", f"limits.{name}", allowed="a lower and an upper limit")
            for name, ends in zip(self.commands, zip(self.lower, self.upper, strict=True), strict=True)
            if not np.isfinite(ends).all()
        ]
        if len(channels) > len(self.commands):
            got = f"{len(channels)} channels and {n_of(len(self.commands), 'command')}"
            faults.append(Fault("there are more channels than commands", "channels", got, "at most as many"))
        if faults:
            raise ParameterError(faults)
        size = {"m": live.extent, "rad": 1.0}
        self.width = np.where(self.upper > self.lower, self.upper - self.lower, 1.0)  # a fixed command has a share too
        self.extent = np.array([size.get(task.units[name], 1.0) for name in channels])
        self.stiff = [f"{name}{STIFFNESS}" for name in channels if f"{name}{STIFFNESS}" in live.stiffness_units]
        self.without = "" if self.stiff else "No force along these channels is defined, so they have no compliance."
        self.refused, self.n_outside = Counter[str](), 0

    def found(self, n_states: int | None, seed: int) -> Workspace:
        """The workspace.

        Raises
        ------
        SimulationError
            Where there are too few states.
        """
        from scipy.stats import qmc

        k, m = len(self.channels), len(self.commands)
        n = STATES[k] if n_states is None else n_states
        shares = qmc.Sobol(m, rng=np.random.default_rng(seed)).random_base2(int(np.ceil(np.log2(n))))[:n]
        # Every second one on a face of k - 1 dimensions: of the images of these the border mostly consists.
        faces = shares[::2]
        nearest = np.argsort(np.abs(faces - np.round(faces)), axis=1)[:, : m - k + 1]
        np.put_along_axis(faces, nearest, np.round(np.take_along_axis(faces, nearest, axis=1)), axis=1)
        corners = [*product((0.0, 1.0), repeat=m)] if 2**m <= n else []
        shares = np.unique(np.concatenate([shares, np.reshape(corners, (-1, m))]), axis=0)
        at = [state for state in self.sampled(shares) if state is not None]
        if len(at) < k + 2:
            tried = n_of(len(shares), "command")
            told = f"Only {len(at)} of {tried} have a state within the limits; {k + 2} are needed. Try more states."
            why = "; ".join(f"{count} times: {text}" for text, count in self.refused.items())
            raise SimulationError(f"{told} {why}".rstrip())
        states = [self.described(state) for state in at]
        spans = np.ptp(self.places(states), axis=0)
        if not np.all(spans > 1e-9 * self.extent):
            still = ", ".join(np.array(self.channels)[spans <= 1e-9 * self.extent].tolist())
            raise SimulationError(f"The same at all commands: {still}. The workspace has no extent there.")
        self.widest = float(np.max(spans / self.extent))
        if k > 1 and all(state.mobility[-1] <= SINGULAR * self.widest for state in states):
            together = f"{', '.join(self.channels)} depend on each other, and the robot loses a direction"
            raise SimulationError(f"At all commands {together}: they have no {WIDTH[k]}. Try fewer, or other limits.")
        every, pushed, refused, n_outside = states.copy(), set[int](), dict(self.refused), self.n_outside
        for _ in range(ROUNDS):
            normals = outward_normals(self.places(every) / spans)
            outside = {k: normal for k, normal in normals.items() if k < len(states) and k not in pushed}
            for done, (number, normal) in enumerate(outside.items()):
                self.progress("border", done, len(outside))
                every.append(self.pushed(at[number], normal, spans))
            pushed |= outside.keys()
        least, singular = self.singular(every)
        return Workspace(
            channels=self.channels,
            units={name: self.task.units[name] for name in (*self.channels, *self.commands)},
            ranges=dict(zip(self.commands, zip(self.lower.tolist(), self.upper.tolist(), strict=True), strict=True)),
            states=tuple(every),
            border=tuple(range(len(states), len(every))),
            simplices=tuple(tuple(corners) for corners in alpha_shape(self.places(every) / spans).tolist()),
            singular=singular,
            least=least,
            refused=refused,
            n_outside=n_outside,
            without_compliance=self.without,
            values=dict(self.values),
            widest=self.widest,
            wall_s=time.perf_counter() - self.began,
        )

    def places(self, states: Sequence[WorkspaceState]) -> Floats:
        """The values (n, k) of the workspace's channels in states."""
        return np.array([[state.channels[name] for name in self.channels] for state in states])

    def at(self, share: Floats) -> LiveState | None:
        """The state at shares of the commands' ranges; None where there is none within the limits."""
        if self.live.remembers:
            self.live.reset()
        before = self.live.state
        values = self.lower + share * (self.upper - self.lower)
        state = self.live.at(dict(zip(self.names, values.tolist(), strict=True)))
        if why := why_ended(state):
            self.refused[why] += 1
            self.live.return_to(before)
            return None
        y, tolerance = np.array([*state.channels.values()]), self.task.tolerances[: len(state.channels)]
        lower, upper = (each[: len(y)] for each in (self.task.lower, self.task.upper))
        stiff = np.array([*state.stiffnesses(*self.task.stiffnesses).values()])
        is_inside = bool(np.all(y >= lower - tolerance) and np.all(y <= upper + tolerance))
        if len(stiff):
            ends = self.task.lower[len(y) :], self.task.upper[len(y) :]
            is_inside &= bool(np.all(stiff >= ends[0]) and np.all(stiff <= ends[1]))
        if is_inside and self.task.obstacles:
            is_inside = bool(state.clearances(self.task.obstacles).values.min() >= 0.0)
        self.n_outside += not is_inside
        return state if is_inside else None

    def sampled(self, shares: Floats) -> list[LiveState | None]:
        """The states at shares (n, m) of the ranges, each from its nearest neighbour before."""
        self.live.reset()
        left, here, states = list(range(len(shares))), np.zeros(shares.shape[1]), list[LiveState | None]()
        while left:
            self.progress("states", len(states), len(shares))
            nearest = min(left, key=lambda k: float(np.sum((shares[k] - here) ** 2)))
            left.remove(nearest)
            here = shares[nearest]
            states.append(self.at(here))
        return states

    def described(self, state: LiveState, limits: tuple[str, ...] = ()) -> WorkspaceState:
        """A state with its mobility and compliances."""
        if self.live.state is not state:
            self.live.return_to(state)
        compliances: dict[str, float] = {}
        if self.stiff and not self.without:
            try:
                stiffness = state.stiffnesses(*self.stiff)
                compliances = {name.removesuffix(STIFFNESS): 1.0 / value for name, value in stiffness.items() if value}
            except SimulationError as error:
                self.without = f"No compliances: {str(error).rstrip('.')}."
        return WorkspaceState(
            commands={name: float(state.channels[name]) for name in self.commands},
            channels={name: float(state.channels[name]) for name in self.channels},
            mobility=tuple(self.mobility(state).tolist()),
            compliances=compliances,
            limits=limits,
        )

    def mobility(self, state: LiveState) -> Floats:
        """The singular values (k,), from the largest."""
        rates = state.by_commands()
        by = rates.of(self.channels)[:, [rates.names.index(command) for command in self.commands]]
        return np.array(np.linalg.svd(by / self.extent[:, None] * (self.upper - self.lower), compute_uv=False).tolist())

    def pushed(self, state: LiveState, normal: Floats, spans: Floats) -> WorkspaceState:
        """The last state that is reached outwards from a state, along a normal (k,) of the scaled channels."""
        tolerances, limits = self.task.tolerances.copy(), tuple[str, ...]()
        tolerances[self.columns] = CLOSE * spans
        task = replace(self.task, tolerances=tolerances)
        for push in range(PUSHES):
            y = np.array([state.channels[name] for name in self.channels])
            if self.live.remembers:
                self.live.reset()
            elif self.live.state is not state:
                self.live.return_to(state)
            goal = dict(zip(self.channels, (y + STEP * 2**push * spans * normal).tolist(), strict=True))
            try:
                end = reach_from(self.live, task, goal, only_from_here=True)
            except SimulationError as error:
                limits = (str(error).rstrip("."),)
                break
            state, limits = self.live.state, end.active
            if end.outcome == "refused":
                limits = (end.why.removeprefix("The way ends there: ").rstrip("."),)
            if end.outcome != "reached":
                break
        is_fold = not limits or any(one.rstrip(".") in limits for one in (KINK, UNFINISHED))
        if is_fold and self.mobility(state)[-1] <= SINGULAR * self.widest:
            limits = (FOLD,)
        return self.described(state, limits)

    def singular(self, states: Sequence[WorkspaceState]) -> tuple[WorkspaceState, tuple[WorkspaceState, ...]]:
        """The state of the least mobility in its worst direction, and the singular poses."""
        from scipy.optimize import minimize
        from scipy.spatial import KDTree

        commands = np.array([[*state.commands.values()] for state in states])
        shares = (commands - self.lower) / self.width
        worst, largest = (np.array([state.mobility[k] for state in states]) for k in (-1, 0))
        n = min(2 * shares.shape[1] + 1, len(states))
        near = KDTree(shares).query(shares, n)[1]
        low = np.flatnonzero((worst <= worst[near].min(axis=1)) & (worst < LOW * self.widest))
        lowest = low[np.argsort(worst[low])][:STARTS].tolist()
        least, found = states[int(np.argmin(worst))], list[WorkspaceState]()
        for done, k in enumerate(lowest):
            self.progress("singular poses", done, len(lowest))
            ends: list[tuple[float, LiveState]] = []

            def mobility(share: Floats, ends: list[tuple[float, LiveState]] = ends) -> float:
                state = self.at(np.clip(share, 0.0, 1.0))
                if state is None:
                    return float(largest.max())
                ends.append((float(self.mobility(state)[-1]), state))
                return ends[-1][0]

            corners = np.vstack([shares[k], shares[k] + np.diag(np.where(shares[k] < 0.5, 0.05, -0.05))])
            options = {"maxfev": EVALUATIONS, "initial_simplex": corners, "xatol": 1e-5, "fatol": 1e-6 * largest.max()}
            minimize(mobility, shares[k], method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(corners[0]), options=options)
            if not ends:
                continue
            end = self.described(min(ends, key=lambda one: one[0])[1])
            least = min(least, end, key=lambda one: one.mobility[-1])
            apart = [
                max(abs(a - b) for a, b in zip(end.channels.values(), one.channels.values(), strict=True))
                for one in found
            ]
            if end.mobility[-1] <= SINGULAR * self.widest and min(apart, default=np.inf) > 1e-3 * self.extent.min():
                found.append(end)
        return least, tuple(found)


def simplex_sizes(corners: Floats) -> Floats:
    """Lengths, areas or volumes of simplices (n, k + 1, k)."""
    edges = corners[:, 1:] - corners[:, :1]
    return np.abs(np.linalg.det(edges)) / math.factorial(edges.shape[1])


def alpha_shape(places: Floats) -> Ints:
    """The simplices (n, k + 1) of an alpha shape of places (n_places, k)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import Delaunay

    if places.shape[1] == 1:
        order = np.argsort(places[:, 0])
        return np.column_stack([order[:-1], order[1:]])
    whole = Delaunay(places)
    simplices, neighbours = whole.simplices.astype(np.int64), whole.neighbors
    corners = places[simplices]
    edges = corners[:, 1:] - corners[:, :1]
    flat = simplex_sizes(corners) < 1e-12
    edges[flat] = np.eye(edges.shape[1])
    centres = np.linalg.solve(edges, 0.5 * np.sum(edges**2, axis=2)[..., None])[..., 0]
    radii = np.where(flat, np.inf, np.linalg.norm(centres, axis=1))
    needed = np.unique(simplices)
    rows, sides = np.nonzero(neighbours >= 0)
    beside = neighbours[rows, sides]

    def is_one_piece(radius: float) -> bool:
        kept = radii <= radius
        both = kept[rows] & kept[beside]
        n = len(kept)
        graph = coo_matrix((np.ones(both.sum()), (rows[both], beside[both])), shape=(n, n))
        labels = connected_components(graph, directed=False)[1][kept]
        return len(np.unique(simplices[kept])) == len(needed) and len(np.unique(labels)) == 1

    tried = np.unique(radii[np.isfinite(radii)])
    low, high = 0, len(tried) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if is_one_piece(tried[middle]) else (middle + 1, high)
    return simplices[radii <= ROOM[places.shape[1]] * tried[high]]


def outward_normals(places: Floats) -> dict[int, Floats]:
    """Number of a place (n, k) on the outside of their shape -> the unit normal (k,) outward."""
    if places.shape[1] == 1:
        return {int(np.argmin(places)): np.array([-1.0]), int(np.argmax(places)): np.array([1.0])}
    simplices = alpha_shape(places)
    faces: dict[tuple[int, ...], list[int]] = {}
    for corners in simplices.tolist():
        for k, opposite in enumerate(corners):
            faces.setdefault(tuple(sorted(corners[:k] + corners[k + 1 :])), []).append(opposite)
    normals: dict[int, Floats] = {}
    for face, opposite in faces.items():
        if len(opposite) > 1:
            continue
        first, *others = places[list(face)]
        edges = np.array(others) - first
        # Across the face, as long as it is large.
        across = np.array([(-1.0) ** k * np.linalg.det(np.delete(edges, k, axis=1)) for k in range(places.shape[1])])
        across *= -np.sign(across @ (places[opposite[0]] - first))
        for number in face:
            normals[number] = normals.get(number, np.zeros(places.shape[1])) + across
    return {k: across / size for k, across in normals.items() if (size := float(np.linalg.norm(across))) > 0.0}
