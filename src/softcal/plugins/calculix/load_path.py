"""Load path from rest to a given equilibrium, in increments that another solver can follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.export.engine import EngineState
from softcal.mechanics.chamber import ChamberTerm
from softcal.sensing.channel import ChannelName
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
    """Equilibria from rest to a given state, and the stiffness of the actuators at that state.

    Attributes
    ----------
    shapes
        Equilibria along the path; the last one is the given state.
    acting
        Names of the actuators that have an effort at the given state.
    stiffness
        d effort / d coordinate of those there (n_acting, n_acting) [SI], or None if unknown.
    """

    shapes: tuple[Snapshot, ...]
    acting: tuple[str, ...]
    stiffness: Floats | None


def load_path(robot: Robot, end: Snapshot) -> LoadPath:
    """Load path to the equilibrium `end`: first the loads alone, if there are any, then the coordinates of the
    actuators that have an effort, such as shortenings of taut cables, also those of drives, in equal increments.

    The number of increments is the largest rotation of an element over 15 degrees. If this path does not reach `end`
    (snap-through along the path, or before it), the path consists of `end` alone.
    """
    robot = by_cables(robot)
    twin = twin_of(robot)
    kinds = {part.name: part.channels for part in robot.actuated if end.efforts.get(part.name, 0.0) != 0.0}
    acting = tuple(kinds)
    if not acting:
        return LoadPath((end,), (), np.zeros((0, 0)))
    begin = simulate(robot, Protocol({}), snapshots=True).snapshots[0]
    n = max(1, int(np.ceil(_largest_turn(twin, begin, end) / TURN)))
    share = np.arange(1, n + 1) / n
    first, last = (coordinates(robot, positions(twin, shape), shape.efforts) for shape in (begin, end))
    commands = {
        name: Command(coordinate.name, first[name] + share * (last[name] - first[name]))
        for name, (coordinate, _) in kinds.items()
    }
    by = list(Protocol(commands).drives)
    response = simulate(robot, Protocol(commands), sensitivities=by, snapshots=True, curve_tolerance=0.0)
    pulls = [{name: float(command.values[i]) for name, command in commands.items()} for i in range(n)]
    scales = {name: float(np.abs(command.values).max()) for name, command in commands.items()}
    found = [
        shape
        for pull in pulls
        for shape in response.snapshots
        if all(abs(shape.controls[name] - value) <= 1e-9 * scales[name] for name, value in pull.items())
    ]
    if not response.succeeded or len(found) != n:
        return LoadPath((end,), acting, None)
    x, y = positions(twin, found[-1]), positions(twin, end)
    if not float(np.abs(x - y).max()) <= SAME * float(np.abs(y - twin.system.layout.X).max()):
        return LoadPath((end,), acting, None)
    rows = [response.sensitivities[str(ChannelName(effort, name))] for name, (_, effort) in kinds.items()]
    stiffness = np.array([[float(row[name][-1]) for name in by] for row in rows])
    theta = parameter_values(robot)
    is_loaded = twin.system.is_loaded(theta)
    return LoadPath((*((begin,) if is_loaded else ()), *found[:-1], end), acting, stiffness)


def by_cables(robot: Robot) -> Robot:
    """The robot without its drives, whose cables have commands of their own."""
    return replace(robot, actuators=tuple(part for part in robot.actuators if not part.actuator.driven))


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


def coordinates(robot: Robot, x: Floats, effort: Mapping[str, float]) -> dict[str, float]:
    """Coordinate of every actuator from rest [SI], cables slack or not.

    Parameters
    ----------
    robot
        Without stretch of cables, and without drives.
    x
        Positions of all points (n_points, 3) [m].
    effort
        Of every chamber [Pa].
    """
    system, found = twin_of(robot).system, dict[str, float]()
    for term in system.actuated:
        found |= zip((one.name for one in term.actuators), term.shape_coordinates(x).tolist(), strict=True)
    for term in system.of(ChamberTerm):
        found[term.name] += term.filling(parameter_values(robot)).swallowed(effort[term.name])
    return found


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
