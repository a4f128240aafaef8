"""Load path from rest to a given equilibrium, in increments that another solver can follow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.export.engine import EngineState
from softcal.mechanics.cable import cables_of
from softcal.sensing.channel import ChannelName
from softcal.sensing.sensors.cable import TENSION
from softcal.twin.build import Twin, twin_of
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Snapshot
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

TURN = np.deg2rad(15.0)  # of the element that turns most, from one shape to the next, about
SAME = 1e-6  # of the largest displacement


@dataclass(frozen=True)
class LoadPath:
    """Equilibria from rest to a given state, and the cable stiffness at that state.

    Attributes
    ----------
    shapes
        Equilibria along the path; the last one is the given state.
    taut
        Names of the cables that are taut at the given state.
    stiffness
        d tension / d shortening of the taut cables there (n_taut, n_taut) [N/m], or None if unknown.
    """

    shapes: tuple[Snapshot, ...]
    taut: tuple[str, ...]
    stiffness: Floats | None


def load_path(robot: Robot, end: Snapshot) -> LoadPath:
    """Load path to the equilibrium `end`: first the loads alone, if there are any, then the taut cables shortened in
    equal increments.

    The number of increments is the largest rotation of an element over 15 degrees. If this path does not reach `end`
    (snap-through along the path, or before it), the path consists of `end` alone.
    """
    twin = twin_of(robot)
    cables = cables_of(twin.system)
    taut = tuple(name for name in cables.names if end.tensions.get(name, 0.0) > 0.0)
    if not taut:
        return LoadPath((end,), (), np.zeros((0, 0)))
    begin = simulate(robot, Protocol({}), snapshots=True).snapshots[0]
    n = max(1, int(np.ceil(_largest_turn(twin, begin, end) / TURN)))
    share = np.arange(1, n + 1) / n
    first, last = (shortenings(twin, positions(twin, shape)) for shape in (begin, end))
    commands = {name: Command("shortening", first[name] + share * (last[name] - first[name])) for name in taut}
    by = list(Protocol(commands).drives)
    response = simulate(robot, Protocol(commands), sensitivities=by, snapshots=True, curve_tolerance=0.0)
    pulls = [{name: float(command.values[i]) for name, command in commands.items()} for i in range(n)]
    scales = [max(abs(value) for value in pull.values()) for pull in pulls]
    found = [
        shape
        for pull, scale in zip(pulls, scales, strict=True)
        for shape in response.snapshots
        if all(abs(shape.controls[name] - value) <= 1e-9 * scale for name, value in pull.items())
    ]
    if not response.succeeded or len(found) != n:
        return LoadPath((end,), taut, None)
    x, y = positions(twin, found[-1]), positions(twin, end)
    if not float(np.abs(x - y).max()) <= SAME * float(np.abs(y - twin.system.layout.X).max()):
        return LoadPath((end,), taut, None)
    rows = [response.sensitivities[str(ChannelName(TENSION, name))] for name in taut]
    stiffness = np.array([[float(row[name][-1]) for name in by] for row in rows])
    theta = parameter_values(robot)
    is_loaded = twin.system.is_loaded(theta)
    return LoadPath((*((begin,) if is_loaded else ()), *found[:-1], end), taut, stiffness)


def positions(twin: Twin, shape: Snapshot | EngineState) -> Floats:
    """Positions of all points of the twin (n_points, 3) [m] in a shape of its robot."""
    layout = twin.system.layout
    x, position, rotation = layout.X.copy(), layout.references.copy(), np.tile(np.eye(3), (layout.n_frames, 1, 1))
    for name, points in shape.points.items():
        x[twin.first_point[name] :][: len(points)] = points
    for name, (at, turn) in shape.plates.items():
        position[twin.frame[name]], rotation[twin.frame[name]] = at, turn
    layout.links.place(x, position, rotation)
    return x


def shortenings(twin: Twin, x: Floats) -> dict[str, float]:
    """Shortening of each cable from rest [m], slack or not, with all points at x (n_points, 3) [m]."""
    cables = cables_of(twin.system)
    return dict(zip(cables.names, cables.shape_coordinates(x).tolist(), strict=True))


def _largest_turn(twin: Twin, before: Snapshot, after: Snapshot) -> float:
    """The largest rotation angle of an element [rad], at most pi."""
    largest = 0.0
    for name, mesh in twin.meshes.items():
        first, others = mesh.tets[:, :1], mesh.tets[:, 1:4]
        edges = (shape.points[name][others] - shape.points[name][first] for shape in (before, after))
        was, now = (np.swapaxes(vectors, 1, 2) for vectors in edges)  # as columns (n_tets, 3, 3)
        U, _, Vt = np.linalg.svd(now @ np.linalg.inv(was))
        trace = np.trace(U @ Vt, axis1=1, axis2=2)
        largest = max(largest, float(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)).max()))
    return largest
