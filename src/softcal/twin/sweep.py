"""One driven cable: the response to a protocol is one curve in its shortening."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.cable import cables_of
from softcal.mechanics.node import Line, Node, node_at
from softcal.mechanics.path import Path, between, follow, go_on_from, interpolated, neighbours
from softcal.mechanics.state import State
from softcal.mechanics.statics import Statics
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.cable import SHORTENING, TENSION
from softcal.twin.build import Twin
from softcal.twin.crossings import crossed_on_path
from softcal.twin.curve import Curve
from softcal.twin.protocol import Protocol
from softcal.twin.reading import SensorReading, read
from softcal.twin.response import Response, Shown, Snapshot, by_column, derivatives_by_column
from softcal.twin.sensors import angle_columns, channel_units
from softcal.twin.start import UNDER_LOADS, instability, loaded, slack_line, snapshot

FIRST_STEP = 0.12  # of the driven cable's length
WOUND_UP = 1e-3  # of its length: a cable shorter than this is wound up
SAME = 1e-9  # of its length: two nodes closer than this are one
DERIVATIVES = 10.0  # times the curve's tolerance: that of the channels' derivatives by parameters
FEW_NODES, NODES_FOR_DERIVATIVES = 16, 4  # limit for derivatives, and per node for the values: kinks never converge
LEAST_MOTION = 1e-4  # [rad], or of the robot's extent: lower limit of a channel's scale
LEAST_SENSITIVITY = 1e-3  # of the most sensitive channel's: the same for derivatives
MAX_REFINEMENTS = 24  # a region of high curvature may be a thousandth of the curve's length


@dataclass(frozen=True)
class Sweep:
    """A twin, its statics, and the cable that is driven (None: nothing is)."""

    twin: Twin
    statics: Statics
    names: tuple[str, ...]
    cable: str | None
    tolerance: float
    snapshots: Shown
    crossings: bool = True
    readings: dict[Node, SensorReading] = field(default_factory=dict[Node, SensorReading])

    def response(self, protocol: Protocol) -> Response:
        """See `simulate`."""
        try:
            start = self._start()
            if self.cable is None:
                return self._at_rest(start, protocol.n_samples)
            command = protocol.commands[self.cable]
            if command.control == "shortening":
                return self._by_shortening(start, command.values)
            return self._by_tension(start, command.values)
        except SimulationError as error:
            return self._response(np.zeros((0, len(self._units))), None, None, str(error), False)

    # The path of equilibria: by the driven cable's shortening c, from where it just becomes taut, all others slack.

    @property
    def _units(self) -> dict[str, str]:
        return channel_units(self.twin)

    @property
    def _i_cable(self) -> int:
        return [cable.name for cable in self.twin.robot.cables].index(self.cable or "")

    def _column(self, kind: ChannelKind) -> int:
        return self.twin.column(self.cable or "", kind)

    @property
    def _length(self) -> float:
        return float(cables_of(self.twin.system).rest_length[self._i_cable])

    @property
    def _line(self) -> Line:
        line = slack_line(self.twin)
        if self.cable is None:
            return line
        driven = np.arange(len(line.is_held)) == self._i_cable
        return replace(line, is_held=~driven, coordinate_rate=driven.astype(float))

    def _start(self) -> Node:
        """The robot under its loads, with the driven cable just taut: c there is L0 - L."""
        start = loaded(self.twin, self.statics)
        c = 0.0 if self.cable is None else self._shortening(start.state)
        return replace(node_at(self.statics, self._line, c, start.state, self.names), is_snapped=start.snaps)

    def _shortening(self, state: State) -> float:
        return float(self.twin.system.coordinates(state.x)[self._i_cable])

    def _slack_node(self, start: Node) -> Node:
        """The same state with the driven cable slack: taking up its slack moves nothing."""
        line = slack_line(self.twin)
        return node_at(self.statics, line, start.c, start.state, self.names)

    def _curve(self, nodes: tuple[Node, ...]) -> Curve:
        readings = [self._reading(node) for node in nodes]
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

    def _reading(self, node: Node) -> SensorReading:
        """The reading of a node, cached."""
        if node not in self.readings:
            self.readings[node] = read(self.twin, self.statics, node, self.names)
        return self.readings[node]

    def _refined(self, path: Path, tensions: Floats | None = None) -> tuple[Path, Curve]:
        """The path, refined until the curve is within tolerance, or only where it may reach one of these tensions."""
        curve = self._curve(path.nodes)
        most = np.inf  # nodes; known once the values are exact enough
        for _ in range(MAX_REFINEMENTS):
            if len(path.nodes) < 2 or self.tolerance <= 0.0:
                break
            scale = self._scale(np.abs(curve.values).max(axis=0)[:, None], self._least)
            is_read = True if tensions is None else curve.may_pass(self._column(TENSION), tensions)
            is_coarse = is_read & (curve.error() > self.tolerance * scale[:, 0]).any(axis=1)
            if not is_coarse.any():
                most = min(most, FEW_NODES + NODES_FOR_DERIVATIVES * len(path.nodes))
            if self.names and not is_coarse.any() and len(path.nodes) < most:
                by_parameter = np.abs(curve.by_parameter).max(axis=0)
                least = LEAST_SENSITIVITY * scale * (by_parameter / scale).max(axis=0)
                of_derivatives = self._scale(by_parameter, least)
                tolerance = DERIVATIVES * self.tolerance
                is_coarse |= is_read & (curve.error_by_parameter() > tolerance * of_derivatives).any(axis=(1, 2))
            coarse = np.flatnonzero(is_coarse)
            if len(coarse) == 0:
                break
            path = self._with_nodes(path, 0.5 * (curve.c[coarse] + curve.c[coarse + 1]))
            curve = self._curve(path.nodes)
        return path, curve

    def _scale(self, largest: Floats, least: Floats) -> Floats:
        """The largest of all channels of one unit, for each (n_channels, k): a roll of 1e-6 needs no 1e-10."""
        units = np.array(list(self._units.values()))
        return np.maximum(np.array([largest[units == unit].max(axis=0) for unit in units]), least) + 1e-300

    @property
    def _least(self) -> Floats:
        """Smallest values of the channels above rounding error, (n_channels, 1)."""
        least = {"rad": LEAST_MOTION, "m": LEAST_MOTION * self.statics.length}
        return np.array([[least.get(unit, 0.0)] for unit in self._units.values()])

    def _with_nodes(self, path: Path, c: Floats) -> Path:
        extra = [between(self.statics, self._line, path, float(value)) for value in c]
        return replace(path, nodes=tuple(sorted([*path.nodes, *extra], key=lambda node: node.c)))

    def _missing(self, path: Path, c: Floats) -> Floats:
        """Those values of c without a node."""
        have = np.array([node.c for node in path.nodes])
        unique = np.unique(c)
        return unique[np.abs(unique[:, None] - have[None, :]).min(axis=1) > SAME * self._length]

    # Control by shortening or by tension.

    def _by_shortening(self, start: Node, d: Floats) -> Response:
        end = float(d.max())
        path = Path((start,), True, names=self.names)
        if end > start.c + SAME * self._length:
            path = self._follow(start, end)
        taut = d > start.c
        if not _snaps_on(path):
            path, _ = self._refined(path)
        if snaps := _snaps_on(path):  # beyond a snap-through the curve is neither smooth nor reached from both sides
            path = self._by_samples(start, np.unique(d[taut]))
        curve = self._curve(path.nodes)
        reached = path.nodes[-1].c
        n = len(d) if path.reached else int(np.argmax(np.append(d, np.inf) > reached))
        if self.tolerance <= 0.0 and not snaps:
            path = self._with_nodes(path, self._missing(path, d[:n][taut[:n]]))
            curve = self._curve(path.nodes)
        values, slopes, by_parameter = curve.at(np.maximum(d[:n], start.c))
        slack = ~taut[:n]
        if slack.any():
            still = self._curve((self._slack_node(start),))
            values[slack], slopes[slack], by_parameter[slack] = still.values, still.slopes, still.by_parameter
        # A slack cable's shortening is the command, not the shortening that would make it taut.
        values[:, self._column(SHORTENING)] = d[:n]
        slopes[:, self._column(SHORTENING)] = 1.0
        by_parameter[:, self._column(SHORTENING)] = 0.0
        status = self._sentence(path, n, len(d))
        if path.reached and np.any(values[:, self._column(TENSION)] < 0.0):
            low = float(d[:n][np.argmin(values[:, self._column(TENSION)])])
            status = f"Cable {self.cable} would have to push at {1e3 * low:.4g} mm: the robot snaps through there."
            shapes = self._solved(path, "m")
            return self._response(
                np.zeros((0, values.shape[1])), None, None, status, False, shapes, self._remarks(path)
            )
        shapes = self._shapes(path, np.maximum(d[:n], start.c), d[:n], "m")
        return self._response(values, slopes, by_parameter, status, path.reached, shapes, self._remarks(path))

    def _by_tension(self, start: Node, T: Floats) -> Response:
        i_tension = self._column(TENSION)
        largest = float(T.max())
        wound = self._length * (1.0 - WOUND_UP)
        path = Path((start,), True, names=self.names)
        if largest > 0.0:
            path = self._follow(start, wound, until=largest)
        path, curve = self._refined(path, T)
        if len(path.nodes) == 1:
            at = np.full(len(T), start.c)
            shapes = self._shapes(path, at, np.zeros(len(T)), "N")
            return self._response(*curve.at(at), "Solved: no tension.", True, shapes, self._remarks(path, start.c))
        is_wound = path.reached and path.nodes[-1].c >= wound * (1.0 - 1e-9)
        c = curve.first_passage(i_tension, T)
        if self.tolerance <= 0.0:
            path = self._at_tensions(path, c, T)
            curve = self._curve(path.nodes)
            c = curve.first_passage(i_tension, T)
        # The rest: tensions that the solved curve reaches at another shortening than the interpolated one.
        while self.tolerance <= 0.0:
            missing = self._missing(path, c[np.isfinite(c)])
            if len(missing) == 0:
                break
            path = self._with_nodes(path, missing)
            curve = self._curve(path.nodes)
            c = curve.first_passage(i_tension, T)
        beyond = ~np.isfinite(c)
        n = len(T) if is_wound or not beyond.any() else int(np.argmax(beyond))
        at = np.where(beyond, curve.c[-1], c)[:n]
        values, by_c, by_parameter = curve.at(at)
        stiffness = by_c[:, i_tension]
        slopes = by_c / stiffness[:, None]
        by_parameter = by_parameter - slopes[:, :, None] * by_parameter[:, i_tension, None, :]
        values[:, i_tension] = T[:n]
        slopes[beyond[:n]] = 0.0
        by_parameter[beyond[:n]] = 0.0
        slopes[:, i_tension], by_parameter[:, i_tension] = 1.0, 0.0
        status = self._sentence(path, n, len(T))
        if is_wound and beyond.any():
            limit = float(curve.values[:, i_tension].max())
            status += f" Cable {self.cable} is wound up to zero length from {limit:.4g} N on."
        if self.snapshots:
            path = self._up_to(path, float(at.max(initial=start.c)))
        shapes = self._shapes(path, at, T[:n], "N")
        # Where the path ends early, crossings up to its end may be the cause.
        remarks = self._remarks(path, float(at.max(initial=start.c)) if n == len(T) else np.inf)
        return self._response(values, slopes, by_parameter, status, n == len(T), shapes, remarks)

    def _by_samples(self, start: Node, c: Floats) -> Path:
        """The path through every value of c, in their order."""
        path = Path((start,), True, names=self.names)
        for value in c:
            leg = self._follow(path.nodes[-1], float(value))
            path = replace(leg, nodes=(*path.nodes, *leg.nodes[1:]))
            if not leg.reached:
                break
        return path

    def _at_tensions(self, path: Path, c: Floats, T: Floats) -> Path:
        """The path with a node at each tension whose shortening is known about; to solve at that and read the tension
        again would take two solves.
        """
        about = dict(zip(c.tolist(), T.tolist(), strict=True))
        missing = self._missing(path, c[np.isfinite(c)]).tolist()
        extra = [self._at_tension(path, value, about[value]) for value in missing]
        nodes = [*path.nodes, *(node for node in extra if node is not None)]
        return replace(path, nodes=tuple(sorted(nodes, key=lambda node: node.c)))

    def _at_tension(self, path: Path, c: float, T: float) -> Node | None:
        """The node at a tension between the two nodes around c; None where no stable equilibrium was found there."""
        before, after = neighbours(path, c)
        guess = interpolated(self.twin.system.layout, before, after, c)
        if after.is_snapped or self.twin.system.free_way(before.state, guess) < 1.0:
            return None
        held = slack_line(self.twin).at(0.0)
        held = replace(held, effort=np.where(np.arange(len(held.effort)) == self._i_cable, T, 0.0))
        go_on_from(self.statics, before)
        solved = self.statics.equilibrium(guess, held)
        if not solved.converged:
            return None
        c = self._shortening(solved.state)
        node = node_at(self.statics, self._line, c, solved.state, self.names) if before.c < c < after.c else None
        return node if node is not None and node.is_stable else None

    def _up_to(self, path: Path, c: float) -> Path:
        """The path up to c, with a node there: a path to a tension ends beyond it."""
        path = self._with_nodes(path, self._missing(path, np.array([c])))
        return replace(path, nodes=tuple(node for node in path.nodes if node.c <= c + SAME * self._length))

    def _follow(self, start: Node, end: float, *, until: float = np.inf) -> Path:
        i = self._i_cable
        step = FIRST_STEP * self._length
        if np.isfinite(until):
            stiffness = start.slope[self.twin.system.layout.first_effort_unknown + i]
            if stiffness > 0.0:
                step = min(step, 0.35 * until / stiffness)
        return follow(
            self.statics,
            self._line,
            start,
            end,
            first_step=step,
            names=self.names,
            stop=lambda node: bool(node.state.effort[i] >= until),
            largest_step=3.0 * FIRST_STEP * self._length if not np.isfinite(until) else max(step, 0.25 * self._length),
        )

    # The response.

    def _at_rest(self, start: Node, n: int) -> Response:
        numbers = range(1, n + 1) if self.snapshots == "samples" else (0,)
        shapes = tuple(snapshot(self.twin, start.state, {}, k, "") for k in numbers) if self.snapshots else ()
        status, remarks = "Solved: no cable is driven.", self._remarks(Path((start,), True))
        return self._response(*self._curve((start,)).at(np.zeros(n)), status, True, shapes, remarks)

    def _shapes(self, path: Path, c: Floats, commands: Floats, unit: str) -> tuple[Snapshot, ...]:
        """The shapes to draw: at samples with commands [unit] and shortenings c, or at every node of the path."""
        if self.snapshots != "samples":
            return self._solved(path, unit)
        have = np.array([node.c for node in path.nodes])
        nearest = [path.nodes[int(np.abs(have - value).argmin())] for value in c]
        return tuple(self._shape(node, float(told), unit) for node, told in zip(nearest, commands, strict=True))

    def _solved(self, path: Path, unit: str) -> tuple[Snapshot, ...]:
        if not self.snapshots:
            return ()
        i = self._i_cable
        commands = [node.c if unit == "m" else float(node.state.effort[i]) for node in path.nodes]
        return tuple(self._shape(node, told, unit) for node, told in zip(path.nodes, commands, strict=True))

    def _shape(self, node: Node, command: float, unit: str) -> Snapshot:
        return snapshot(self.twin, node.state, {self.cable or "": command}, command, unit)

    def _sentence(self, path: Path, n: int, n_samples: int) -> str:
        if path.reached:
            solved = f"Solved: {len(path.nodes)} equilibria, {self.statics.n_factorisations} factorisations."
            return solved + self._met(path)
        end = 1e3 * path.nodes[-1].c
        return (
            f"No equilibrium beyond {end:.4g} mm of shortening of {self.cable} "
            f"({n} of {n_samples} samples reached): {path.status}."
            f"{self.twin.system.remarks(path.nodes[-1].state, self.statics.theta)}"
        )

    def _remarks(self, path: Path, end: float = np.inf) -> tuple[str, str]:
        """Snap-throughs, and crossings up to `end`: sentences with a blank before each, or nothing."""
        if not self.crossings:
            return self._falls(path), ""
        layout = self.twin.system.layout
        return self._falls(path), crossed_on_path(self.twin.skins, layout, path.nodes, end, self.cable or "")

    def _met(self, path: Path) -> str:
        """Sentence, after a blank, on the shortening from which on via points coincide; not for a wound-up cable."""
        for node in path.nodes:
            if node.c < self._length * (1.0 - WOUND_UP) * (1.0 - SAME) and (
                limit := self.twin.system.at_limit(node.state.x)
            ):
                return f" From {1e3 * node.c:.4g} mm of shortening of {self.cable} on {limit}."
        return ""

    def _falls(self, path: Path) -> str:
        loads = [instability(UNDER_LOADS)] if path.nodes[0].is_snapped else []
        at = ", ".join(f"{1e3 * node.c:.4g}" for node in path.nodes[1:] if node.is_snapped)
        return "".join([*loads, *([instability(f"at {at} mm of shortening of {self.cable}")] if at else [])])

    def _response(
        self,
        values: Floats,
        slopes: Floats | None,
        by_parameter: Floats | None,
        status: str,
        succeeded: bool,
        shapes: tuple[Snapshot, ...] = (),
        remarks: tuple[str, str] = ("", ""),
    ) -> Response:
        units = self._units
        return Response(
            channels=by_column(units, values),
            units=units,
            status=status + "".join(remarks),
            succeeded=succeeded,
            instabilities=remarks[0].strip(),
            crossings=remarks[1].strip(),
            n_factorisations=self.statics.n_factorisations,
            sensitivities={} if by_parameter is None else derivatives_by_column(units, self.names, by_parameter),
            slopes={} if slopes is None else by_column(units, slopes),
            snapshots=shapes,
            tets={name: mesh.tets for name, mesh in self.twin.meshes.items()} if shapes else {},
        )


def _snaps_on(path: Path) -> bool:
    """Whether a snap-through occurs along the path, other than under the loads alone."""
    return any(node.is_snapped for node in path.nodes[1:])
