"""Cross-check of softcal's statics with other engines on the same state of the same robot.

Engines have different laws and elements, so each is compared with softcal's twin in that engine's law and elements, on
the same mesh, at the same parameters and loads, without contact where the engine leaves it out: differences are then
numerical and not of the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.calibration.problem.problem import SOFTCAL
from softcal.checks import Floats
from softcal.declare import Declared
from softcal.errors import InputError, SimulationError
from softcal.export.engine import ENGINES, EngineState, Running, engine_settings, state_of
from softcal.plugins.calculix.load_path import positions
from softcal.twin.build import twin_of
from softcal.twin.channels import channels_of
from softcal.twin.protocol import Protocol, furthest_state
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

AGREES = 1e-4  # relative difference; for angles in rad
STILL = 1e-12  # [m]
NEEDED = " (by slope)"  # after the effort that an engine needs for softcal's coordinate; see `EngineState`


@dataclass(frozen=True)
class Difference:
    """One quantity in softcal and in the engine; relative: over the largest of its kind, for an angle over 1 rad,
    for a volume over that of the largest chamber.
    """

    quantity: str
    unit: str
    softcal: float
    engine: float
    absolute: float
    relative: float


@dataclass(frozen=True)
class EngineComparison:
    """Comparison of one engine at one state.

    Attributes
    ----------
    engine
        Name of the engine.
    differences
        Compared quantities.
    changed
        Changes of the robot's law, elements and contact from the project's, in both programs.
    instabilities
        Sentence on instabilities along softcal's load path, or "".
    left_out
        `Engine.leaves_out` at this state.
    """

    engine: str
    differences: tuple[Difference, ...]
    changed: tuple[str, ...]
    instabilities: str = ""
    left_out: tuple[float, str] = (0.0, "")

    @property
    def limit(self) -> float:
        """The relative difference that counts as agreement."""
        return max(AGREES, self.left_out[0])

    @property
    def verdict(self) -> str:
        """A sentence on the agreement."""
        if not self.differences:
            return f"{self.engine} and softcal have nothing in common to compare"
        worst = max(self.differences, key=lambda one: one.relative)
        if worst.relative <= AGREES:
            return f"{self.engine} and softcal agree to {AGREES:g} (worst: {worst.relative:.1e}, {worst.quantity})"
        if worst.relative <= self.limit:
            return (
                f"{self.engine} and softcal agree to {self.limit:.1g} (worst: {worst.relative:.1e}, {worst.quantity}): "
                f"more than {AGREES:g}, but {self.engine} neglects {self.left_out[1]}"
            )
        text = (
            f"{self.engine} and softcal differ by {worst.absolute:.3g} {worst.unit} in {worst.quantity}, "
            f"{worst.relative:.1e} relative; the limit is {self.limit:.1g}"
        )
        if self.instabilities:
            text += f". {self.instabilities} Two engines may reach different ones of several equilibria"
        return text

    @property
    def agrees(self) -> bool:
        """Whether every difference is at most `limit`."""
        return bool(self.differences) and all(one.relative <= self.limit for one in self.differences)


@dataclass(frozen=True)
class Crosscheck:
    """Result of a cross-check.

    Attributes
    ----------
    comparisons
        One comparison per engine that ran.
    absent
        Engine -> why it is not installed.
    refused
        Engine -> why it does not support the robot.
    failed
        Engine -> why it failed.
    still
        Engines not run, because nothing moves the robot.
    """

    comparisons: tuple[EngineComparison, ...]
    absent: Mapping[str, str] = field(default_factory=dict)
    refused: Mapping[str, str] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    still: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether no engine failed and all comparisons agree."""
        return not self.failed and all(one.agrees for one in self.comparisons)


def crosscheck(
    robot: Robot,
    protocol: Protocol,
    engines: Sequence[str],
    *,
    timeout: float | None = None,
    stated: Mapping[str, Declared] | None = None,
    progress: Callable[[str], None] = lambda name: None,
) -> Crosscheck:
    """Compare the furthest state of a protocol with other engines.

    Parameters
    ----------
    robot
        The robot, of any law and feature.
    protocol
        Its commands.
    engines
        Names in `ENGINES`; `softcal`, the reference, is ignored.
    timeout
        Limit [s] of each process; None for the engine's own.
    stated
        Engine -> settings that a project states.
    progress
        Called with the name of each engine.
    """
    end = furthest_state(protocol)
    comparisons: list[EngineComparison] = []
    absent: dict[str, str] = {}
    refused: dict[str, str] = {}
    failed: dict[str, str] = {}
    still: list[str] = []
    for name in engines:
        if name == SOFTCAL:
            continue
        engine = ENGINES[name]
        # Before `missing`: an engine that does not support the robot need not be installed.
        if faults := engine.lacks(robot):
            refused[name] = "\n".join(map(str, faults))
            continue
        if why := engine.missing():
            absent[name] = why
            continue
        progress(name)
        running = Running(timeout, engine_settings(name, stated or {}))
        try:
            own = engine.own(robot)
            response = simulate(own, end, snapshots=True, curve_tolerance=0.0)
            ours = state_of(response)
            if all(np.abs(u).max() < STILL for u in _moved(own, ours).values()):
                still.append(name)
                continue
            theirs = engine.solve(own, end, response.snapshots[-1], running)
            differences = tuple(_compared(own, ours, theirs))
        except (InputError, SimulationError) as error:
            failed[name] = str(error)
            continue
        left_out = engine.leaves_out(response.snapshots[-1])
        changed = [
            f"{a.name}: {what} {getattr(a, what)} becomes {getattr(b, what)}"
            for a, b in zip(robot.bodies, own.bodies, strict=True)
            for what in ("law", "element")
            if getattr(a, what) != getattr(b, what)
        ]
        if robot.contact is not None and own.contact is None:
            changed.append("no contact, so that parts may pass through each other")
        comparisons.append(EngineComparison(name, differences, tuple(changed), response.instabilities, left_out))
    return Crosscheck(tuple(comparisons), absent, refused, failed, tuple(still))


def _compared(own: Robot, ours: EngineState, theirs: EngineState) -> list[Difference]:
    """The differences of an engine that gives every body and rod as softcal does, in finite numbers: none agrees with
    NaN.

    Raises
    ------
    SimulationError
        Where it does not.
    """
    for name, points in ours.points.items():
        if name not in theirs.points or np.shape(theirs.points[name]) != points.shape:
            raise SimulationError(f"The engine gives no position of each of the {len(points)} nodes of {name}.")
    kinds = {part.name: part.channels for part in own.actuated}
    numbers: list[tuple[str, float | Floats]] = []
    for i, values in ((1, theirs.efforts), (1, theirs.needed), (0, theirs.coordinates)):
        numbers += [(f"the {kinds[name][i].name} of {name}", value) for name, value in values.items()]
    numbers += [(f"the pose of {name}", np.hstack([np.ravel(v) for v in pose])) for name, pose in theirs.plates.items()]
    numbers += [(f"the shape of {name}", value) for name, value in theirs.points.items()]
    if lost := [what for what, value in numbers if not np.isfinite(value).all()]:
        raise SimulationError(f"The engine gives no finite number of {', '.join(lost)}.")
    differences = _differences(own, ours, theirs)
    if lost := [one.quantity for one in differences if not np.isfinite(one.absolute)]:
        raise SimulationError(f"There is no finite number of {', '.join(lost)}.")
    return differences


def _moved(robot: Robot, outcome: EngineState) -> dict[str, Floats]:
    """Displacements of the nodes of bodies and rods [m]."""
    rest = {name: mesh.points for name, mesh in twin_of(robot).meshes.items()}
    rest |= {rod.name: rod.centreline.nodes for rod in robot.rods}
    return {name: x - rest[name] for name, x in outcome.points.items()}


def _differences(robot: Robot, ours: EngineState, theirs: EngineState) -> list[Difference]:
    moved, there = _moved(robot, ours), _moved(robot, theirs)
    tip = max(float(np.linalg.norm(u, axis=1).max()) for u in moved.values())
    sizes = {"m": tip, "rad": 1.0}
    scales: dict[str, float] = {}
    for term in twin_of(robot).system.actuated:
        scales |= zip((one.name for one in term.actuators), term.coordinate_scales(tip).tolist(), strict=True)
    for part in robot.actuated:
        coordinate, effort = (kind.unit for kind in part.channels)
        sizes[coordinate] = max(sizes.get(coordinate, 0.0), scales[part.name])
        sizes[effort] = max(sizes.get(effort, 0.0), abs(ours.efforts[part.name]))
    found: list[Difference] = []
    for after, i, a, b in (
        ("", 1, ours.efforts, theirs.efforts),
        (NEEDED, 1, ours.efforts, theirs.needed),
        ("", 0, ours.coordinates, theirs.coordinates),
    ):
        for part in robot.actuated:
            if (name := part.name) in b:
                kind, gap = part.channels[i], a[name] - b[name]
                relative = _over(gap, sizes[kind.unit])
                found.append(Difference(f"{name}.{kind.name}{after}", kind.unit, a[name], b[name], abs(gap), relative))
    for one in robot.sensors:
        a_all, b_all = (one.sensor.sense(EnginePosture(robot, state, ours)) for state in (ours, theirs))
        for channel, a, b in zip(channels_of([one]), a_all, b_all, strict=True):
            unit = channel.kind.unit
            relative = _over(float(a - b), sizes.get(unit, abs(float(a))))
            found.append(Difference(str(channel), unit, float(a), float(b), abs(float(a - b)), relative))
    for plate in robot.plates:
        if plate.fixed or plate.name not in theirs.plates:
            continue
        (at, turn), (place, turned) = ours.plates[plate.name], theirs.plates[plate.name]
        gap = float(np.linalg.norm(at - place))
        went, goes = (float(np.linalg.norm(x - plate.reference)) for x in (at, place))
        found.append(Difference(f"{plate.name}.displacement", "m", went, goes, gap, _over(gap, tip)))
        angle = _angle(turn.T @ turned)
        found.append(Difference(f"{plate.name}.rotation", "rad", _angle(turn), _angle(turned), angle, angle))
    for name, u in moved.items():
        gap = float(np.linalg.norm(u - there[name], axis=1).max())
        went, goes = (float(np.linalg.norm(v, axis=1).max()) for v in (u, there[name]))
        found.append(Difference(f"{name}: largest displacement", "m", went, goes, gap, _over(gap, tip)))
    return found


def _over(difference: float, size: float) -> float:
    return abs(difference) / size if size > 0.0 else (0.0 if difference == 0.0 else float("inf"))


def _angle(R: Floats) -> float:
    """The angle [rad] of a rotation."""
    return float(Rotation.from_matrix(R).magnitude())


@dataclass(frozen=True)
class EnginePosture:
    """An engine's state, for sensors to read.

    robot: the engine's robot; own: softcal's state, with the actuators' commands.
    """

    robot: Robot
    state: EngineState
    own: EngineState

    def point(self, name: str) -> Floats:
        """Position (3,) [m] of a marker, or of a plate's reference."""
        twin = twin_of(self.robot)
        if name in twin.frame:
            return self._pose(name)[0]
        place = twin.markers[name]
        return place.position(positions(twin, self.state), self.rotation(place.marker.on) if place.turns else np.eye(3))

    def rotation(self, plate: str) -> Floats:
        """Rotation (3, 3) of a plate."""
        return self._pose(plate)[1]

    def coordinate(self, actuator: str) -> float:
        """Coordinate [SI] of an actuator."""
        return self.state.coordinates.get(actuator, self.own.coordinates[actuator])

    def effort(self, actuator: str) -> float:
        """Effort [SI] of an actuator."""
        return self.state.efforts.get(actuator, self.own.efforts[actuator])

    def _pose(self, plate: str) -> tuple[Floats, Floats]:
        (found,) = (one for one in self.robot.plates if one.name == plate)
        if plate not in self.state.plates and not found.fixed:
            raise SimulationError(f"The engine gives no pose of {plate}, which a sensor reads.")
        return self.state.plates.get(plate, (found.reference, np.eye(3)))
