"""One driven actuator: the response to a protocol is one curve in its coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.errors import SimulationError
from softcal.mechanics.node import Node
from softcal.mechanics.path import Path
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.crossings import crossed_on_path
from softcal.twin.drives import Samples, by_coordinate, by_effort
from softcal.twin.equilibrium_path import SAME, EquilibriumPath
from softcal.twin.protocol import Protocol
from softcal.twin.response import Derivatives, Response, Shown, Snapshot, by_column
from softcal.twin.start import UNDER_LOADS, instability, snapshot


@dataclass(frozen=True)
class Sweep:
    """The response along one path, with the shapes to keep, and whether crossings are searched for."""

    along: EquilibriumPath
    snapshots: Shown
    crossings: bool = True

    def response(self, protocol: Protocol) -> Response:
        """See `simulate`."""
        along = self.along
        try:
            start = along.start()
            if along.actuator is None:
                path, none = Path((start,), True), np.zeros(protocol.n_samples)
                values, slopes, by_parameter = along.curve(path.nodes).at(none)
                numbers = range(1, protocol.n_samples + 1) if self.snapshots == "samples" else (0,)
                shapes = [
                    snapshot(along.twin, start.state, along.statics.theta, {}, k, "") for k in numbers if self.snapshots
                ]
                samples = Samples(
                    path=path,
                    c=none,
                    commands=none,
                    values=values,
                    slopes=slopes,
                    by_parameter=by_parameter,
                    status=f"Solved: no {along.twin.robot.actuator_word} is driven.",
                    succeeded=True,
                )
                return self._response(samples, shapes)
            command = protocol.commands[along.actuator]
            coordinate, effort = along.channels
            is_coordinate = command.control == coordinate.name
            read, unit = (by_coordinate, coordinate.unit) if is_coordinate else (by_effort, effort.unit)
            samples = read(along, start, command.values, ends_there=bool(self.snapshots))
            return self._response(samples, self._shapes(start, samples, unit))
        except SimulationError as error:
            # Not even the loads, or a state on the way, could be solved.
            none = np.zeros((0, len(along.units), len(along.names)))
            return Response(
                channels=dict.fromkeys(along.units, np.zeros(0)),
                units=along.units,
                status=str(error),
                succeeded=False,
                n_factorisations=along.statics.n_factorisations,
                sensitivities=Derivatives(tuple(along.units), along.names, none),
            )

    def _shapes(self, start: Node, samples: Samples, unit: str) -> list[Snapshot]:
        """The shapes to draw, of commands in this unit: at every sample, or at every node of the path, from the start
        on: the shorter way of those below and above it, and then the longer one.
        """
        if not self.snapshots:
            return []
        nodes = samples.path.nodes
        if self.snapshots == "samples":
            have = np.array([node.c for node in nodes])
            at = [nodes[int(np.abs(have - c).argmin())] for c in samples.c]
            return [self._shape(node, float(told), unit) for node, told in zip(at, samples.commands, strict=True)]
        i, nearly = self.along.number, SAME * self.along.length
        if below := [node for node in nodes[::-1] if node.c < start.c - nearly]:
            above = [node for node in nodes if node.c > start.c + nearly]
            ways = sorted((below, above), key=lambda way: abs(way[-1].c - start.c) if way else 0.0)
            nodes = (start, *ways[0], *ways[1])
        is_coordinate = unit == self.along.channels[0].unit
        return [self._shape(node, node.c if is_coordinate else float(node.state.effort[i]), unit) for node in nodes]

    def _shape(self, node: Node, command: float, unit: str) -> Snapshot:
        along = self.along
        return snapshot(along.twin, node.state, along.statics.theta, {along.actuator or "": command}, command, unit)

    def _response(self, samples: Samples, shapes: list[Snapshot]) -> Response:
        along, units, path = self.along, self.along.units, samples.path
        snaps, crossed, slightly = instability(UNDER_LOADS) if path.nodes[0].is_snapped else "", "", ""
        if at := [node.c for node in path.nodes[1:] if node.is_snapped]:
            snaps += instability(f"at {along.place(*at)}")
        remarks = along.twin.system.remarks(path.nodes[-1].state, along.statics.theta)
        if self.crossings:
            kind = SHORTENING if along.actuator is None else along.channels[0]
            crossed, slightly = crossed_on_path(
                along.twin.skins,
                along.twin.system.layout,
                path.nodes,
                samples.end,
                driven=(along.actuator or "", kind),
                work=np.zeros(len(path.nodes)) if along.actuator is None else along.work(path.nodes),
                theta=along.statics.theta,
            )
        return Response(
            channels=by_column(units, samples.values),
            units=units,
            status=samples.status + snaps + crossed + slightly + remarks,
            succeeded=samples.succeeded,
            instabilities=snaps.strip(),
            crossings=crossed.strip(),
            remarks=remarks.strip(),
            n_factorisations=along.statics.n_factorisations,
            sensitivities=Derivatives(tuple(units), along.names, samples.by_parameter),
            slopes=by_column(units, samples.slopes),
            snapshots=tuple(shapes),
            tets=along.twin.tets if shapes else {},
            walls=along.twin.walls if shapes else {},
            stopped_by=path.stopped_by,
        )
