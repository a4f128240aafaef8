"""The path of equilibria of a robot with one driven actuator, and the curve of its channels along it."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.kept_nodes import KeptNodes
from softcal.mechanics.node import Line, Node, node_at
from softcal.mechanics.path import Path, between, follow
from softcal.mechanics.path_watch import part_of_series, path_watch
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.round_number import roundest
from softcal.sensing.kind import ChannelKind
from softcal.twin.build import Twin
from softcal.twin.crossings import path_unit
from softcal.twin.curve import Curve
from softcal.twin.parameters import parameter_values
from softcal.twin.sensors import SensorReading, angle_columns, channel_units, read
from softcal.twin.start import loaded, slack_line
from softcal.units import format_quantity, unit_factor

CURVE_TOLERANCE = 1e-4  # interpolation error over a channel's largest value
FIRST_STEP = 0.12  # of the span of the driven coordinate
FAR = 10.0  # of the driven coordinate's span: where a path to an effort ends at the latest
WOUND_UP = 1e-3  # of its length: a cable shorter than this is wound up
SAME = 1e-9  # of its length: two nodes closer than this are one
DERIVATIVES = 10.0  # times the curve's tolerance: that of the channels' derivatives by parameters
FEW_NODES, NODES_FOR_DERIVATIVES = 16, 4  # limit for derivatives, and per node for the values: kinks never converge
LEAST_MOTION = 1e-4  # [rad], or of the robot's extent: lower limit of a channel's scale
LEAST_SENSITIVITY = 1e-3  # of the most sensitive channel's: the same for derivatives
ASIDE = 0.1  # of an interval of the curve: how far from its middle a node may be, for a round number
BEYOND = 0.03  # of the shortening of the last sample: how far beyond it a shared path may end
FEW = 2  # samples in an interval of the curve, of which one becomes a node
MAX_REFINEMENTS = 24  # a region of high curvature may be a thousandth of the curve's length


@dataclass(frozen=True)
class EquilibriumPath:
    """Equilibria by the driven actuator's shortening c, from where it just becomes taut, all others slack.

    Attributes
    ----------
    twin, statics
        The twin, and its statics.
    names
        Parameters (k,) of the nodes' derivatives.
    actuator
        The driven actuator; None where nothing is driven.
    tolerance
        Tolerance of the curve, over a channel's largest value [-]; 0 solves every sample.
    is_shared
        Whether simulations of other samples are to follow, as in a search: their paths then end at the same places.
    guide
        The path at other parameters, whose nodes predict those of this one; see `guide_of`.
    readings
        The nodes' readings so far.
    """

    twin: Twin
    statics: Statics
    names: tuple[str, ...]
    actuator: str | None
    tolerance: float
    is_shared: bool = False
    guide: EquilibriumPath | None = None
    readings: dict[Node, SensorReading] = field(default_factory=dict[Node, SensorReading])

    @cached_property
    def units(self) -> dict[str, str]:
        """The channels' units by name."""
        return channel_units(self.twin)

    @property
    def number(self) -> int:
        """The driven actuator's number."""
        return self.twin.system.number(self.actuator or "")

    def column(self, kind: ChannelKind) -> int:
        """The column of a channel of the driven actuator."""
        return self.twin.column(self.actuator or "", kind)

    @property
    def length(self) -> float:
        """A long span of the driven coordinate: a cable's length at rest [m], a chamber's volume [m^3]."""
        return self.span(0.0)

    def span(self, effort: float) -> float:
        """The same on a path to an effort, with what the transmission takes up at that."""
        efforts = np.where(np.arange(self.twin.system.layout.n_actuators) == self.number, effort, 0.0)
        return float(self.twin.system.coordinate_spans(self.statics.length, self.statics.theta, efforts)[self.number])

    @property
    def channels(self) -> tuple[ChannelKind, ChannelKind]:
        """The channels of the driven actuator's coordinate and effort."""
        return self.twin.robot.actuated[self.number].channels

    @property
    def only_pulls(self) -> bool:
        """Whether the driven actuator only pulls, as a cable does."""
        return bool(self.twin.system.effort_limits[0][self.number] == 0.0)

    @property
    def wound_up(self) -> float:
        """Shortening at which the cable counts as wound up [m]; of what has no such end, a coordinate far away."""
        return self.furthest(0.0)

    def furthest(self, effort: float) -> float:
        """The coordinate at which a path to an effort ends at the latest."""
        return self.length * (1.0 - WOUND_UP) if self.only_pulls else FAR * self.span(effort)

    @property
    def line(self) -> Line:
        """The controls along the path."""
        line = slack_line(self.twin)
        if self.actuator is None:
            return line
        driven = np.arange(len(line.is_held)) == self.number
        return replace(line, is_held=~driven, coordinate_rate=driven.astype(float))

    def start(self) -> Node:
        """The robot under its loads, with the driven actuator just taut: c there is L0 - L."""

        def solved() -> Node:
            start = loaded(self.twin, self.statics)
            c = 0.0 if self.actuator is None else self.shortening(start.state)
            return replace(node_at(self.statics, self.line, c, start.state, self.names), is_snapped=start.snaps)

        return self._kept_start(self.line, solved)

    def shortening(self, state: State) -> float:
        """Shortening of the driven actuator at a state [m]."""
        return float(self.twin.system.coordinates(state, self.statics.theta)[self.number])

    def work(self, nodes: Sequence[Node]) -> Floats:
        """The driven actuator's work [J] at some nodes (n,), from the one where its effort is least."""
        c, effort = np.array([(node.c, float(node.state.effort[self.number])) for node in nodes]).T
        work = cumulative_trapezoid(effort, c, initial=0.0)
        return np.abs(work - work[np.abs(effort).argmin()])

    def slack_node(self, start: Node) -> Node:
        """The same state with the driven actuator slack: taking up its slack moves nothing."""
        line = slack_line(self.twin)
        return self._kept_start(line, lambda: node_at(self.statics, line, start.c, start.state, self.names))

    def _kept_start(self, line: Line, solved: Callable[[], Node]) -> Node:
        """The first node on a line, solved where it is not kept."""
        key, n = ("start", line.key), self.statics.n_factorisations
        if (kept := self.statics.kept_node(key, self.names)) is not None:
            return kept.node
        node = solved()
        self.statics.keep(key, self.names, node, 0.0, since=n)
        return node

    def passages(self, curve: Curve, efforts: Floats) -> Floats:
        """The first c at which the driven effort has each of the values (n,), upwards or downwards from the start; NaN
        for values that it never has.
        """
        i = self.column(self.channels[1])
        up, down = curve.sides(i)
        above = up.first_passage(i, np.where(efforts > 0.0, efforts, up.values[0, i]))
        below = down.first_passage(i, np.where(efforts < 0.0, -efforts, down.values[0, i]))
        return np.where(efforts < 0.0, -below, above)

    def curve(self, nodes: tuple[Node, ...]) -> Curve:
        """The channels along some nodes."""
        for node in nodes:
            if node not in self.readings:
                self.readings[node] = read(self.twin, self.statics, node, self.names)
        readings = [self.readings[node] for node in nodes]
        values = np.array([reading.values for reading in readings])
        # A neck may fold past half a turn: atan2's jump there is not the curve's.
        turns = angle_columns(self.twin)
        values[:, turns] = np.unwrap(values[:, turns], axis=0)
        slopes = np.array([reading.slopes for reading in readings])
        by_parameter = np.array([reading.by_parameter for reading in readings])
        mixed = np.array([reading.mixed for reading in readings])
        c = np.array([node.c for node in nodes])
        snapped_to = np.array([node.is_snapped for node in nodes[1:]], dtype=bool)
        return Curve(c, values, slopes, by_parameter, mixed, snapped_to)

    def refined(self, path: Path, samples: Floats, *, of_tension: bool = False) -> tuple[Path, Curve]:
        """The path, refined until the curve is within tolerance at the samples. It stays as it is where it was stopped.

        A kink, as where surfaces meet, is within no tolerance: there every shortening becomes a node.

        Parameters
        ----------
        path
            The path.
        samples
            Shortenings (n,) [m], by nodes between many or at some of them, or tensions (n,) [N], wherever the curve may
            reach them.
        of_tension
            Whether they are tensions.
        """
        if path.stopped_by is None:
            try:
                return self._refined(path, samples, of_tension=of_tension)
            except KeyboardInterrupt as stop:
                if not path_watch().keeps:
                    raise
                path = path.stopped(stop)
            except SimulationError:
                over = self.statics.why_over()
                if not over:
                    raise
                path = path if path.is_cut else replace(path, reached=False, status=over, is_cut=True)
        return path, self.curve(path.nodes)

    def _refined(self, path: Path, samples: Floats, *, of_tension: bool) -> tuple[Path, Curve]:
        curve = self.curve(path.nodes)
        most = np.inf  # nodes; known once the values are exact enough
        for _ in range(MAX_REFINEMENTS):
            if len(path.nodes) < 2 or self.tolerance <= 0.0:
                break
            scale = self.scale(curve.values)[:, None]
            new = 0.5 * (curve.c[1:] + curve.c[:-1])
            if of_tension:
                i = self.column(self.channels[1])
                up, down = curve.sides(i)
                is_read = np.concatenate([down.may_pass(i, -samples)[::-1], up.may_pass(i, samples)])
            elif len(left := self.missing(path, samples)):
                # Among many samples a node is independent of their places, as of the slack, and is kept for others.
                inside = np.diff(np.searchsorted(left, curve.c))
                round_ones = [
                    roundest(m - ASIDE * h, m + ASIDE * h) for m, h in zip(new, np.diff(curve.c), strict=True)
                ]
                new = np.where(inside > FEW, round_ones, left[np.abs(left[:, None] - new).argmin(axis=0)])
                is_read = inside > 0
            else:
                break
            is_coarse = is_read & (curve.error() > self.tolerance * scale[:, 0]).any(axis=1)
            if not is_coarse.any():
                # With contact derivatives jump wherever a point meets a surface: the curve's nodes must do.
                more = 0 if self.twin.system.contacts else FEW_NODES + (NODES_FOR_DERIVATIVES - 1) * len(path.nodes)
                most = min(most, len(path.nodes) + more)
            if self.names and not is_coarse.any() and len(path.nodes) < most:
                by_parameter = np.abs(curve.by_parameter).max(axis=0)
                least = LEAST_SENSITIVITY * scale * (by_parameter / scale).max(axis=0)
                of_derivatives = self._scale(by_parameter, least)
                tolerance = DERIVATIVES * self.tolerance
                is_coarse |= is_read & (curve.error_by_parameter() > tolerance * of_derivatives).any(axis=(1, 2))
            coarse = np.flatnonzero(is_coarse)
            if len(coarse) == 0:
                break
            path = self.with_nodes(path, new[coarse])
            curve = self.curve(path.nodes)
        return path, curve

    def largest(self, values: Floats) -> Floats:
        """For each channel (n_channels,), the largest of the values (n, n_channels) in all channels of its unit."""
        return self._scale(np.abs(values).max(axis=0)[:, None], np.zeros(1))[:, 0]

    def scale(self, values: Floats) -> Floats:
        """See `largest`; at least a value above rounding error."""
        return self._scale(np.abs(values).max(axis=0)[:, None], self._least)[:, 0]

    def at(self, path: Path, c: float) -> Node:
        """The equilibrium at c, on the path or between its nodes."""
        nodes = self.with_nodes(path, self.missing(path, np.array([c]))).nodes
        return min(nodes, key=lambda node: abs(node.c - c))

    def _scale(self, largest: Floats, least: Floats) -> Floats:
        """The largest of all channels of one unit, for each (n_channels, k): a roll of 1e-6 needs no 1e-10."""
        units = np.array(list(self.units.values()))
        return np.maximum(np.array([largest[units == unit].max(axis=0) for unit in units]), least) + 1e-300

    @property
    def _least(self) -> Floats:
        """Smallest values of the channels above rounding error, (n_channels, 1)."""
        least = {"rad": LEAST_MOTION, "m": LEAST_MOTION * self.statics.length}
        return np.array([[least.get(unit, 0.0)] for unit in self.units.values()])

    def with_nodes(self, path: Path, c: Floats) -> Path:
        """The path with more nodes, at values of c."""
        extra = [between(self.statics, self.line, path, float(value)) for value in c]
        return replace(path, nodes=tuple(sorted([*path.nodes, *extra], key=lambda node: node.c)))

    def missing(self, path: Path, c: Floats) -> Floats:
        """The values of c that have no node."""
        have = np.array([node.c for node in path.nodes])
        unique = np.unique(c)
        return unique[np.abs(unique[:, None] - have[None, :]).min(axis=1) > SAME * self.length]

    def follow(
        self,
        start: Node,
        end: float,
        *,
        until: float = np.inf,
        past: float = np.inf,
        guide: tuple[Node, ...] = (),
    ) -> Path:
        """The path from a node.

        Parameters
        ----------
        start
            The node.
        end
            Shortening at which it ends [m].
        until
            Tension at which it ends [N].
        past
            Shortening [m] from which on it ends at the next node.
        guide
            See `softcal.mechanics.path.follow`.
        """
        i = self.number
        length = self.span(until) if np.isfinite(until) else self.length
        step = FIRST_STEP * length

        def of_tension(node: Node) -> float:
            return float(node.state.effort[i]) / until

        def of_shortening(node: Node) -> float:
            return (node.c - start.c) / (past - start.c)

        if np.isfinite(until):
            stiffness = start.slope[self.twin.system.layout.first_effort_unknown + i]
            if stiffness > 0.0:
                step = min(step, 0.35 * until / stiffness)
        return follow(
            self.statics,
            self.line,
            start,
            end,
            first_step=step,
            names=self.names,
            share=of_tension if np.isfinite(until) else of_shortening if np.isfinite(past) else None,
            largest_step=3.0 * FIRST_STEP * length if not np.isfinite(until) else max(step, 0.25 * length),
            guide=guide,
            keeps=path_watch().keeps,
        )

    def lowered(self, start: Node, *, to: float = -np.inf, until: float = -np.inf) -> tuple[Node, ...]:
        """The nodes of the way down from the start to a lower coordinate, or effort, in ascending order; the start
        alone where nothing lower is wanted.

        Parameters
        ----------
        start
            The start.
        to, until
            Coordinate, or effort, to go down to [SI].

        Raises
        ------
        SimulationError
            Where there is no such equilibrium.
        """
        i, by_effort = self.number, np.isfinite(until)
        if self.only_pulls or not (until < 0.0 if by_effort else np.isfinite(to) and to < start.c):
            return (start,)
        back = replace(self.line, coordinate_rate=-self.line.coordinate_rate)
        share, span = (lambda node: float(node.state.effort[i]) / until), self.span(until if by_effort else 0.0)
        path = follow(
            self.statics,
            back,
            node_at(self.statics, back, -start.c, start.state, ()),
            self.furthest(until) if by_effort else -to,
            first_step=FIRST_STEP * span,
            share=share if by_effort else None,
            largest_step=3.0 * FIRST_STEP * span,
            mixed=False,
        )
        last = path.nodes[-1]
        if path.reached and by_effort and share(last) < 1.0:
            effort, least = self.channels[1], min(float(node.state.effort[i]) for node in path.nodes)
            raise SimulationError(
                f"No equilibrium below {format_quantity(least, effort.unit)} of {effort.name} of {self.actuator}, down "
                f"to {self.place(-last.c)}. Command the {self.channels[0].name} to go beyond."
            )
        if not path.reached:
            raise SimulationError(f"{path.ended[0].upper()}{path.ended[1:]} {self.place(-last.c)}: {path.status}.")
        snaps = (*(node.is_snapped for node in path.nodes[1:]), False)  # which are on the way up, too
        ways = [*zip(path.nodes, snaps, strict=True)][:0:-1]
        nodes = (
            replace(node_at(self.statics, self.line, -node.c, node.state, self.names), is_snapped=is_snapped)
            for node, is_snapped in ways
        )
        return (*nodes, replace(start, is_snapped=snaps[0]) if snaps[0] else start)

    def towards(self, start: Node, end: float) -> Path:
        """The path from a node to a shortening [m]; a shared one to a place beyond that serves others too, where the
        robot gets there without a snap-through.
        """
        last = roundest(end, min((1.0 + BEYOND) * end, self.wound_up))
        if self.is_shared and self.twin.system.contacts and end <= self.statics.shared_end:
            guide = self._guide_to(end) if start.c >= self.start().c else ()
            parts = 1 if self.guide is None else 2
            with part_of_series(parts - 1, parts):
                path = self.follow(start, max(self.wound_up, end), past=end, guide=guide)
            if not path.is_smooth and path.stopped_by is None:
                self.statics.shared_end = path.nodes[-1].c
        elif self.is_shared and not self.twin.system.contacts and last > end:
            path = self.follow(start, last)
        else:
            return self.follow(start, end)
        return path if path.is_smooth or path.stopped_by is not None else self.follow(start, end)

    def _guide_to(self, end: float) -> tuple[Node, ...]:
        """The nodes of the guide to a shortening [m]; empty where the guide snaps through or ends before."""
        if self.guide is None:
            return ()
        try:
            with part_of_series(0, 2):
                path = self.guide.towards(self.guide.start(), end)
        except SimulationError:
            return ()
        if path.stopped_by is not None:
            raise path.stopped_by
        return path.nodes if path.is_smooth else ()

    def place(self, *c: float) -> str:
        """Values of the driven coordinate, as part of a sentence."""
        kind = self.channels[0]
        unit = path_unit(kind, max(c, key=abs))
        numbers = ", ".join(f"{value / unit_factor(unit, kind.unit):.4g}" for value in c)
        return f"{numbers} {unit} of {kind.name} of {self.actuator}"

    def sentence(self, path: Path, n: int, n_samples: int) -> str:
        """The sentence on the path's end.

        Parameters
        ----------
        path
            The path.
        n
            Number of samples reached.
        n_samples
            Number of all samples.
        """
        if path.reached:
            sentence = f"Solved: {len(path.nodes)} equilibria, {self.statics.n_factorisations} factorisations."
            for node in path.nodes:  # from where on via points coincide, unless the cable is wound up there
                if node.c < self.wound_up * (1.0 - SAME) and (limit := self.twin.system.at_limit(node.state.x)):
                    return f"{sentence} From {self.place(node.c)} on {limit}."
            return sentence
        end = self.place(path.nodes[-1].c)
        ended = path.ended[0].upper() + path.ended[1:]
        return f"{ended} {end} ({n} of {n_samples} samples reached): {path.status}."


@contextmanager
def statics_of(twin: Twin, theta: Mapping[str, float], kept: KeptNodes | None = None) -> Generator[Statics]:
    """Statics whose factors are released at the end.

    Parameters
    ----------
    twin
        The twin.
    theta
        Parameter values by dotted name [SI].
    kept
        Nodes of other paths at theta, where these are kept.
    """
    statics = Statics(twin.system, theta, twin.robot.limits, kept)
    try:
        yield statics
    finally:
        statics.release()


@contextmanager
def guide_of(twin: Twin, theta: Mapping[str, float], actuator: str | None) -> Generator[EquilibriumPath | None]:
    """The path of a robot at its own parameters, where surfaces touch: the guide of its paths at others, theta.

    Where points meet surfaces a path turns, and its last nodes say little of the next one; a path at other parameters
    turns there too. Not one of another shape at rest: in that, the guide's surfaces may have passed through each other.

    Parameters
    ----------
    twin
        The twin.
    theta
        Parameter values by dotted name [SI].
    actuator
        The driven actuator; None: none is.
    """
    own = parameter_values(twin.robot)
    if actuator is None or not twin.system.contacts or dict(theta) == own:
        yield None
        return
    with statics_of(twin, own, twin.kept.at(own)) as statics:
        yield EquilibriumPath(twin, statics, (), actuator, CURVE_TOLERANCE, is_shared=True)
