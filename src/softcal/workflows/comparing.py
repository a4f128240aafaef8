"""Reference values of a report: errors at the nominal values, and shapes of selected configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.analysis.nominal import Nominal, nominal
from softcal.calibration.experiment import AXES, FRAME, Experiment
from softcal.calibration.frame import rotation
from softcal.calibration.observation import commands
from softcal.calibration.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem import Problem
from softcal.calibration.result import CalibrationResult
from softcal.checks import Floats
from softcal.project.axes import shown_configurations
from softcal.project.calibration_schema import CalibrationSection
from softcal.project.project import Project
from softcal.report.compared import Compared, Configuration
from softcal.report.twin_view import TwinView
from softcal.twin.parameters import robot_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.units import format_quantity
from softcal.workflows.calibration import calibrated, make_loss
from softcal.workflows.simulation import robot_in


def compared(project: Project, settings: CalibrationSection, result: CalibrationResult) -> Compared | None:
    """Errors at the nominal values and the configurations to draw; None for a calibration without positions.

    The nominal robot has the project's values. The rig has the project's values in a sweep and the calibrated ones in
    a calibration, so that an unknown camera pose does not count as an error of the nominal robot.
    """
    if not result.is_sweep and not any(fit.distances for fit in result.experiments.values()):
        return None
    units = {name: e.unit for name, e in result.parameters.items()}
    length = next((fit.length for fit in result.experiments.values() if fit.length is not None), None)
    at_nominal = _nominal_project(project, result)
    known = _nominal(at_nominal, settings, result)
    state = None if known is None else _furthest_state(project, result)
    if state is None:
        return Compared(known, (), units, length)
    configurations = _configurations(project, at_nominal, result, state)
    return Compared(known, tuple(configurations), units, length, _state_text(project, state))


def _nominal(project: Project, settings: CalibrationSection, result: CalibrationResult) -> Nominal | None:
    """Errors of the project's own values in a result's experiments; None if no robot parameter was calibrated."""
    of_robot = robot_parameters(project.robot)
    free = [
        FreeParameter(name, e.unit, e.lower, e.upper, of=e.of)
        for name, e in result.parameters.items()
        if result.is_sweep or all(target in of_robot for target in e.of or (name,))
    ]
    if not free:
        return None
    experiments = tuple(project.experiments[name] for name in (*result.experiments, *result.held_out))
    length = next((e.rig.length for e in experiments if e.rig.length is not None), None)
    loss = make_loss(settings.model_copy(update={"loss": result.loss_name}), length)
    return nominal(Problem(project.robot, experiments, SearchSpace(tuple(free)), loss))


def _configurations(
    project: Project, at_nominal: Project, result: CalibrationResult, state: tuple[str, int]
) -> list[Configuration]:
    """The twin in one state at the nominal, best and (for a sweep) worst values, or those listed under `sweep.show`."""
    present = {name: _present(at_nominal, e.of or (name,)) for name, e in result.parameters.items()}
    if result.is_sweep and project.sweep is not None and project.sweep.show:
        shown = shown_configurations(project.sweep.show, project.parameters, project.tied)
        there = [_shown(name, project, result, state, values, present) for name, values in shown.items()]
        return [one for one in there if one is not None]
    found = [_configuration("Nominal", at_nominal, state, {n: v for n, v in present.items() if v is not None})]
    best = {name: e.value for name, e in result.parameters.items()}
    chosen = {"Best cell" if result.is_sweep else "Calibrated": best}
    done = [trial for trial in result.trials if trial.loss is not None]
    if result.is_sweep and done:
        chosen["Worst cell"] = dict(max(done, key=lambda trial: trial.loss or 0.0).theta)
    for name, theta in chosen.items():
        there = {n: replace(e, value=theta[n]) for n, e in result.parameters.items()}
        found.append(_configuration(name, calibrated(project, replace(result, parameters=there)), state, theta))
    return [one for one in found if one is not None]


def _shown(
    name: str,
    project: Project,
    result: CalibrationResult,
    state: tuple[str, int],
    values: Mapping[str, float],
    present: Mapping[str, float | None],
) -> Configuration | None:
    """A configuration listed by the sweep; its other parameters are nominal."""
    there = {n: replace(e, value=values[n]) for n, e in result.parameters.items() if n in values}
    theta = {n: v for n in result.parameters if (v := values.get(n, present[n])) is not None}
    return _configuration(name, calibrated(project, replace(result, parameters=there)), state, theta)


def _nominal_project(project: Project, result: CalibrationResult) -> Project:
    if result.is_sweep:
        return project
    of_robot = robot_parameters(project.robot)
    experiments = {
        name: replace(
            one,
            settings={
                n: v for n, v in one.settings.items() if n not in of_robot or n in project.experiments[name].settings
            },
        )
        for name, one in calibrated(project, result).experiments.items()
    }
    return replace(project, experiments=experiments)


def _present(project: Project, targets: Sequence[str]) -> float | None:
    """The common value of all targets; None if they differ, or if the value is per experiment."""
    known = project.parameters
    values = {known[target].value for target in targets if target in known}
    return values.pop() if len(values) == 1 else None


def _furthest_state(project: Project, result: CalibrationResult) -> tuple[str, int] | None:
    """Experiment and row with the strongest pull; among equal ones, that with the largest marker error."""
    states: dict[tuple[str, int], tuple[float, float]] = {}
    for name, fit in result.experiments.items():
        experiment = project.experiments[name]
        placed = [c for c in experiment.compared if experiment.point_of(c)]
        if not placed:
            continue
        squares = np.sum([(fit.simulated[c] - fit.measured[c]) ** 2 for c in placed], axis=0)
        drives = [experiment.dataset.values(c) for c in experiment.drives]
        pull = np.max(drives, axis=0) if drives else np.zeros(experiment.dataset.n_samples)
        states |= {(name, int(k)): (float(pull[k]), float(squares[k])) for k in np.flatnonzero(np.isfinite(squares))}
    return max(states, key=lambda state: states[state]) if states else None


def _state_text(project: Project, state: tuple[str, int]) -> str:
    """Description of a state: "cable6 (cable6.tension 19.62 N)"."""
    experiment = project.experiments[state[0]]
    data = experiment.dataset
    drives = [
        f"{experiment.twin_channel(c)} {format_quantity(float(data.values(c)[state[1]]), data.channels[c].unit)}"
        for c in experiment.drives
    ]
    return f"{experiment.name} ({', '.join(drives)})" if drives else experiment.name


def _configuration(
    name: str, project: Project, state: tuple[str, int], theta: Mapping[str, float]
) -> Configuration | None:
    """The twin in one state of one experiment; None if it cannot be simulated or does not move."""
    experiment, row = project.experiments[state[0]], state[1]
    rig = experiment.rig_values()
    controls = {
        cable: Command(command.control, command.values[row : row + 1])
        for cable, command in commands(experiment, rig).items()
    }
    robot = robot_in(project, experiment.name)
    response = simulate(robot, Protocol(controls), snapshots=True)
    if not response.succeeded or len(response.snapshots) < 2:
        return None
    twin = TwinView(robot, response.snapshots[0], response.snapshots[-1], response.tets)
    return Configuration(name, theta, twin, _measured(experiment, rig, row))


def _measured(experiment: Experiment, rig: Mapping[str, float], row: int) -> dict[str, Floats]:
    """Measured position of every marker and plate [m], in the robot's frame."""
    frame = np.array([rig.get(name, 0.0) for name in FRAME])
    found: dict[str, Floats] = {}
    for point in experiment.points:
        parts = {c.rsplit(".", 1)[-1]: c for c in experiment.compared if experiment.point_of(c) == point}
        if set(parts) == set(AXES):
            seen = np.array([experiment.dataset.values(parts[axis])[row] for axis in AXES])
            found[point] = (seen - frame[:3]) @ rotation(frame[3:])
    return found
