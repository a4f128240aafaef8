"""Equilibria at the start values: under the loads alone, and at the end of each experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.checks import Ints
from softcal.mechanics.actuator import NO_EFFORT
from softcal.mechanics.state import rest_state
from softcal.project.project import Project
from softcal.sensing.channel import ChannelName, of_actuator
from softcal.sensing.sensors.actuators import SHORTENING
from softcal.twin.build import twin_of
from softcal.twin.parameters import parameter_values, robot_parameters, with_parameters
from softcal.twin.protocol import Protocol, furthest_state
from softcal.twin.response import Response, Snapshot
from softcal.twin.simulate import simulate
from softcal.twin.start import snapshot
from softcal.units import format_quantity
from softcal.workflows.simulation import efforts_shown, protocol_of, response_to, robot_in, turning_angle

# Larger rotations, or displacements over the robot's size, under the loads alone suggest another orientation.
TURNED, MOVED = np.deg2rad(30.0), 0.25
ROUGH = 0.01  # of the largest value, between the solved states: for a judgement by eye; the end is solved
SLACK = 0.2  # of an experiment's travel: a longer slack phase is suspicious

StageObserver = Callable[[str], None]
# Called with rows (part, description) and warnings as soon as they are known.
BlockObserver = Callable[[Sequence[tuple[str, str]], Sequence[str]], None]


@dataclass(frozen=True)
class StartStates:
    """Equilibria at the start values.

    Attributes
    ----------
    rows
        (state, description) to print.
    warnings
        Sentences.
    responses
        Experiment -> response.
    undeformed
        The shape without loads.
    shapes
        Title -> equilibrium shape.
    tets
        Body -> connectivity of the shapes.
    """

    rows: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...]
    responses: Mapping[str, Response]
    undeformed: Snapshot
    shapes: Mapping[str, Snapshot] = field(default_factory=dict[str, Snapshot])
    tets: Mapping[str, Ints] = field(default_factory=dict[str, Ints])


def start_states(
    project: Project,
    progress: StageObserver = lambda stage: None,
    ready: BlockObserver = lambda rows, warnings: None,
) -> StartStates:
    """Solve the equilibria under the loads alone and at the end of every experiment, at the start values.

    Parameters
    ----------
    project
        The project.
    progress
        Called with the name of each stage.
    ready
        Called after each stage with its rows and warnings.

    Raises
    ------
    KeyboardInterrupt
        Where it is stopped; what is known of the state that was being solved is passed on before.
    """
    project = at_start_values(project)
    twin = twin_of(project.robot)
    theta = parameter_values(project.robot)
    undeformed = snapshot(twin, rest_state(twin.system.layout), theta, {}, 0.0, "")
    rows: list[tuple[str, str]] = []
    warnings: list[str] = []
    shapes: dict[str, Snapshot] = {}
    tense = {cable.name for cable in project.robot.cables if cable.pretension}
    for part in project.robot.actuators:
        tense |= {*part.actuator.driven} if part.values.get("pretension") else set[str]()
    pretensioned = [cable.name for cable in project.robot.cables if cable.name in tense]
    if twin.system.is_loaded(theta) or pretensioned:
        progress("Solving the robot under its loads")
        response = response_to(project.robot, Protocol({}), snapshots=True)
        if not response.succeeded:
            warnings.append(f"the robot has no equilibrium under its loads at the start values: {response.status}")
            rows.append(("under its loads", "no equilibrium"))
            ready(rows, warnings)
            return StartStates(tuple(rows), tuple(warnings), {}, undeformed)
        shapes["Under its loads"] = response.snapshots[0]
        text, far = _moved(undeformed, response.snapshots[0])
        tensions = {name: response.snapshots[0].efforts[name] for name in pretensioned}
        left = [f"{name} {format_quantity(tension, 'N')}" for name, tension in tensions.items()]
        rows.append(("under its loads", "; ".join([text, *([", ".join(left)] if left else [])])))
        warnings += [
            f"under its loads {name} is slack, in spite of its pretension: that is its tension while the robot has its "
            "shape at rest, and the robot gives way to its loads; a larger one may leave it taut"
            for name, tension in tensions.items()
            if tension <= 0.0
        ]
        if far:
            warnings.append(
                f"under its loads alone, {text}: if the bench differs, check the direction of gravity, the placement, "
                "the masses and the start of the modulus"
            )
        warnings += [f"under its loads: {sentence}" for sentence in response.warnings]
        ready(rows, warnings)
    responses: dict[str, Response] = {}
    for i, (name, experiment) in enumerate(project.experiments.items(), start=1):
        progress(f"Solving the end of {name} ({i} of {len(project.experiments)})")
        protocol = protocol_of(project, name)
        if len(protocol.commands) > 1 or project.robot.remembers:  # independent states, or a way there and back
            protocol = furthest_state(protocol)
        response = simulate(robot_in(project, name), protocol, snapshots=True, curve_tolerance=ROUGH)
        responses[name] = response
        row, about = _end_summary(experiment, response, undeformed)
        rows.append((f"end of {name}", row))
        about = [f"{name}: {sentence}" for sentence in about]
        warnings += about
        ready(rows[-1:], about)
        if response.stopped_by is not None:
            raise response.stopped_by
        if response.succeeded and response.snapshots:
            shape = response.snapshots[-1]
            driven = [f"{part} {effort}" for part, effort in efforts_shown(project.robot, shape).items()]
            shapes[f"{name}\n{', '.join(driven[:2])}{' …' if len(driven) > 2 else ''}".strip()] = shape
    tets = {name: mesh.tets for name, mesh in twin.meshes.items()}
    return StartStates(tuple(rows), tuple(warnings), responses, undeformed, shapes, tets)


def at_start_values(project: Project) -> Project:
    """The project with every free parameter at its start value, if it has one."""
    of_robot = robot_parameters(project.robot)
    free = [p for p in (project.space.parameters if project.space else ()) if p.start is not None]
    shared = {t: float(p.start or 0.0) for p in free for t in p.targets if t in of_robot and not p.experiment}

    def own(experiment: Experiment) -> dict[str, float]:
        values = experiment.rig_values()
        mine = [p for p in free if p.serves(experiment.name)]
        return {t: float(p.start or 0.0) for p in mine for t in p.targets if t in values and t not in of_robot}

    tests = {n: replace(e, settings={**own(e), **e.settings}) for n, e in project.experiments.items()}
    return replace(project, robot=with_parameters(project.robot, shared), experiments=tests)


def _end_summary(experiment: Experiment, response: Response, undeformed: Snapshot) -> tuple[str, list[str]]:
    """Description of the end of an experiment, and warnings."""
    if response.stopped_by is not None:
        return response.status, []
    if not response.succeeded:
        return "not reached", [f"the twin at the start values cannot follow this test. {response.status}"]
    warnings = list(response.warnings)
    parts: list[str] = []
    for channel in experiment.drives:
        name, kind = experiment.twin_channel(channel).carrier, experiment.twin_channel(channel).kind
        kinds = of_actuator(kind)
        coordinate, effort = (response.channels[str(ChannelName(one, name))] for one in kinds)
        last = int(np.argmax(np.abs(coordinate)))
        ends = zip((coordinate, effort), kinds, strict=True)
        parts.append(f"{name} {', '.join(format_quantity(float(of[last]), one.unit) for of, one in ends)}")
        slack = effort <= NO_EFFORT * effort.max()
        if kind == SHORTENING and np.count_nonzero(slack) > 1:
            begin = float(coordinate.min())
            travel = f"{1e3 * (coordinate[slack].max() - begin):.3g} of {1e3 * np.ptp(coordinate):.3g} mm"
            parts.append(f"slack for the first {travel}")
            if coordinate[slack].max() > SLACK * coordinate.max():
                warnings.append(
                    f"{name} is slack for the first {travel} of the test: the loads bend the robot towards it, so "
                    "that the test has little information on the rest; check gravity and the slack of the rig"
                )
    if response.snapshots:
        parts.append(_moved(undeformed, response.snapshots[-1])[0])
    return "; ".join(parts), warnings


def _moved(before: Snapshot, after: Snapshot) -> tuple[str, bool]:
    """The largest displacement, in words, and whether it is suspicious."""
    size = float(np.ptp(np.concatenate([*before.points.values(), *before.rods.values()]), axis=0).max())
    plates = {
        name: (float(np.linalg.norm(at - before.plates[name][0])), turning_angle(turn))
        for name, (at, turn) in after.plates.items()
    }
    if plates:
        name = max(plates, key=lambda plate: plates[plate])
        by, angle = plates[name]
        text = f"{name} moves by {format_quantity(by, 'm', digits=3)} and rotates by {np.rad2deg(angle):.3g} deg"
        return text, by > MOVED * size or angle > TURNED
    parts = {name: (x, before.points[name]) for name, x in after.points.items()}
    parts |= {name: (x, before.rods[name]) for name, x in after.rods.items()}
    moved = {name: float(np.linalg.norm(now - then, axis=1).max()) for name, (now, then) in parts.items()}
    name = max(moved, key=lambda part: moved[part])
    return f"{name} moves by up to {format_quantity(moved[name], 'm', digits=3)}", moved[name] > MOVED * size
