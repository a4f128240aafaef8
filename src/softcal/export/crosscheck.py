"""Cross-check of softcal's statics with other engines on the same state of the same robot.

Engines have different laws and elements, so each is compared with softcal's twin in that engine's law and elements, on
the same mesh, at the same parameters and loads: differences are then numerical and not of the model.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.calibration.problem import SOFTCAL
from softcal.checks import Floats
from softcal.errors import Fault, InputError, SimulationError
from softcal.export.calculix import calculix_deck, deck_faults, in_its_law
from softcal.export.calculix_run import HOW_TO_GET, TIMEOUT, find_calculix, run_calculix
from softcal.export.load_path import LoadPath, load_path, positions, shortenings
from softcal.export.sofa_engine import sofa_engine
from softcal.export.sofa_install import find_sofa
from softcal.export.sofa_robot import linear_robot, scene_faults
from softcal.export.sofa_settings import SofaSettings
from softcal.twin.build import twin_of
from softcal.twin.protocol import Protocol, furthest_state
from softcal.twin.response import Response, Snapshot
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

AGREES = 1e-4  # relative difference; for angles in rad
STILL = 1e-12  # [m]
NEEDED = "tension (by slope)"  # tension that an engine needs for softcal's shortening; see `EngineState`


@dataclass(frozen=True)
class EngineState:
    """An equilibrium computed by an engine.

    Attributes
    ----------
    tensions, shortenings
        Cable -> tension [N] and shortening [m], unless prescribed.
    plates
        Plate -> position (3,) [m] and rotation (3, 3).
    points
        Body or rod -> positions of the nodes (n, 3) [m].
    needed
        For an engine with prescribed tensions: cable -> tension [N] that it needs for softcal's shortening, to first
        order by softcal's exact stiffness.
    """

    tensions: Mapping[str, float]
    shortenings: Mapping[str, float]
    plates: Mapping[str, tuple[Floats, Floats]]
    points: Mapping[str, Floats]
    needed: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Running:
    """Settings of the engines: timeout of each process [s], None for the engine's default; SOFA's settings."""

    timeout: float | None = None
    sofa: SofaSettings = field(default_factory=SofaSettings)


@dataclass(frozen=True)
class Engine:
    """Another program that solves a robot's statics.

    Attributes
    ----------
    own
        Converts the robot to the engine's law and elements.
    missing
        Why the engine cannot run here and how to install it, or "".
    solve
        Solves a robot for a protocol of one sample, given softcal's shape and the settings.
    lacks
        Faults of a robot's features that the engine does not support.
    leaves_out
        Relative difference at a shape explained by the engine's model, and the neglected effect; 0 and "" if none.
    """

    own: Callable[[Robot], Robot]
    missing: Callable[[], str]
    solve: Callable[[Robot, Protocol, Snapshot, Running], EngineState]
    lacks: Callable[[Robot], list[Fault]] = lambda robot: []
    leaves_out: Callable[[Snapshot], tuple[float, str]] = lambda shape: (0.0, "")


@dataclass(frozen=True)
class Difference:
    """One quantity in softcal and in the engine; relative: over the largest of its kind, for an angle over 1 rad."""

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
        Changes of the robot's law and elements from the project's, in both programs.
    falls
        Sentence on instabilities along softcal's load path, or "".
    left_out
        `Engine.leaves_out` at this state.
    """

    engine: str
    differences: tuple[Difference, ...]
    changed: tuple[str, ...]
    falls: str = ""
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
        if self.falls:
            text += f". {self.falls} Two engines may reach different ones of several equilibria"
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
    running: Running | None = None,
    progress: Callable[[str], None] = lambda name: None,
) -> Crosscheck:
    """Compare the furthest state of a protocol with other engines.

    engines: names in `ENGINES`; `softcal`, the reference, is ignored. progress: called with the name of each engine.
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
        try:
            own = engine.own(robot)
            response = simulate(own, end, snapshots=True, curve_tolerance=0.0)
            ours = _of_response(response)
            if _is_still(own, ours):
                still.append(name)
                continue
            theirs = engine.solve(own, end, response.snapshots[-1], running or Running())
        except (InputError, SimulationError) as error:
            failed[name] = str(error)
            continue
        differences = tuple(_differences(own, ours, theirs))
        left_out = engine.leaves_out(response.snapshots[-1])
        comparisons.append(EngineComparison(name, differences, tuple(_changes(robot, own)), response.falls, left_out))
    return Crosscheck(tuple(comparisons), absent, refused, failed, tuple(still))


def _of_response(response: Response) -> EngineState:
    if not response.succeeded:
        raise SimulationError(response.status)
    shape = response.snapshots[-1]
    names = list(shape.tensions)
    return EngineState(
        tensions={name: float(response.channels[f"{name}.tension"][-1]) for name in names},
        shortenings={name: float(response.channels[f"{name}.shortening"][-1]) for name in names},
        plates=shape.plates,
        points={**shape.points, **shape.rods},
    )


def _moved(robot: Robot, outcome: EngineState) -> dict[str, Floats]:
    """Displacements of the nodes of bodies and rods [m]."""
    rest = {name: mesh.points for name, mesh in twin_of(robot).meshes.items()}
    rest |= {rod.name: rod.centreline.nodes for rod in robot.rods}
    return {name: x - rest[name] for name, x in outcome.points.items()}


def _is_still(robot: Robot, ours: EngineState) -> bool:
    return all(np.abs(u).max() < STILL for u in _moved(robot, ours).values())


def _differences(robot: Robot, ours: EngineState, theirs: EngineState) -> list[Difference]:
    moved, there = _moved(robot, ours), _moved(robot, theirs)
    tip = max(float(np.linalg.norm(u, axis=1).max()) for u in moved.values())
    strongest = max((abs(value) for value in ours.tensions.values()), default=0.0)
    found: list[Difference] = []
    for kind, unit, a, b, size in (
        ("tension", "N", ours.tensions, theirs.tensions, strongest),
        (NEEDED, "N", ours.tensions, theirs.needed, strongest),
        ("shortening", "m", ours.shortenings, theirs.shortenings, tip),
    ):
        found += [
            Difference(f"{name}.{kind}", unit, a[name], b[name], abs(a[name] - b[name]), _over(a[name] - b[name], size))
            for name in a
            if name in b
        ]
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


def _changes(given: Robot, own: Robot) -> list[str]:
    return [
        f"{a.name}: {what} {getattr(a, what)} becomes {getattr(b, what)}"
        for a, b in zip(given.bodies, own.bodies, strict=True)
        for what in ("law", "element")
        if getattr(a, what) != getattr(b, what)
    ]


def _missing_calculix() -> str:
    return "" if find_calculix() else HOW_TO_GET


def _solve_calculix(robot: Robot, protocol: Protocol, shape: Snapshot, running: Running) -> EngineState:
    """Solve with CalculiX under gravity, loads and softcal's tensions."""
    twin, path = twin_of(robot), load_path(robot, shape)
    deck = calculix_deck(robot, path.shapes)
    layout = twin.system.layout
    with tempfile.TemporaryDirectory() as folder:
        x = layout.X + run_calculix(deck, Path(folder), timeout=running.timeout or TIMEOUT)[-1, : layout.n_points]
    shortening = shortenings(twin, x)
    plates: dict[str, tuple[Floats, Floats]] = {}
    for name, k in twin.frame.items():
        riders = np.flatnonzero(layout.rider == k)
        if k < layout.n_moving_frames and len(riders) >= 3:
            plates[name] = _fitted_pose(layout.X[riders], x[riders], layout.references[k])
    return EngineState(
        tensions={},
        shortenings=shortening,
        plates=plates,
        points={name: x[deck.first[name] :][: mesh.n_points] for name, mesh in twin.meshes.items()},
        needed=_needed(path, shape, shortenings(twin, positions(twin, shape)), shortening),
    )


def _needed(
    path: LoadPath, shape: Snapshot, ours: Mapping[str, float], theirs: Mapping[str, float]
) -> dict[str, float]:
    """Tensions [N] that another engine needs for softcal's shortenings, from those under softcal's tensions."""
    if path.stiffness is None:
        return {}
    lacks = np.array([ours[name] - theirs[name] for name in path.taut])
    more = path.stiffness @ lacks
    return {name: shape.tensions[name] + float(dT) for name, dT in zip(path.taut, more, strict=True)}


def _fitted_pose(X: Floats, x: Floats, reference: Floats) -> tuple[Floats, Floats]:
    """Reference point and rotation moved by the least-squares rigid motion from X to x."""
    centre, now = X.mean(axis=0), x.mean(axis=0)
    U, _, Vt = np.linalg.svd((x - now).T @ (X - centre))
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return now + R @ (reference - centre), R


def _missing_sofa() -> str:
    try:
        find_sofa()
    except InputError as error:
        return str(error)
    return ""


def _solve_sofa(robot: Robot, protocol: Protocol, shape: Snapshot, running: Running) -> EngineState:
    """Solve with SOFA, run to rest under the protocol's commands."""
    engine = sofa_engine(replace(running.sofa, timeout=running.timeout or running.sofa.timeout))
    found = _of_response(engine(robot, protocol, snapshots=True))
    given = {f"{name}.{command.control}" for name, command in protocol.commands.items()}
    return replace(
        found,
        tensions={name: value for name, value in found.tensions.items() if f"{name}.tension" not in given},
        shortenings={name: value for name, value in found.shortenings.items() if f"{name}.shortening" not in given},
    )


def _strain_of_rods(shape: Snapshot) -> tuple[float, str]:
    """SOFA's beams neglect axial and shear strain in the balance of moments; see docs/sofa.md, Rods."""
    if not shape.rod_strains:
        return 0.0, ""
    rod = max(shape.rod_strains, key=lambda name: shape.rod_strains[name])
    strain = shape.rod_strains[rod]
    return strain, f"the strain of beam axes in the balance of moments, here {strain:.1e} in {rod}"


ENGINES: dict[str, Engine] = {
    "calculix": Engine(in_its_law, _missing_calculix, _solve_calculix, deck_faults),
    "sofa": Engine(lambda robot: linear_robot(robot).robot, _missing_sofa, _solve_sofa, scene_faults, _strain_of_rods),
}
