"""Reference values of a report: errors at the nominal values, and shapes of selected configurations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from softcal.analysis.nominal import Nominal, nominal
from softcal.calibration.problem.frame import FRAME, rotation
from softcal.calibration.problem.observation import commands
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import CalibrationResult, SearchResult, SweepResult
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

State = tuple[str, int]
"""An experiment, and a row of its table."""


def compared_calibration(project: Project, settings: CalibrationSection, result: CalibrationResult) -> Compared | None:
    """Errors at the nominal values and the configurations to draw; None for a calibration without positions.

    With the nominal values of the rig, an unknown camera pose would count as an error of the nominal robot.

    Parameters
    ----------
    project
        With the nominal values of the robot.
    settings
        Settings of the calibration.
    result
        The calibrated values, of which the rig's hold for the nominal robot too.
    """
    if not any(fit.distances for fit in result.experiments.values()):
        return None
    of_robot = robot_parameters(project.robot)
    free = [name for name, e in result.parameters.items() if all(target in of_robot for target in e.of or (name,))]
    # The project's robot in the calibrated rig.
    experiments = {
        name: replace(
            one,
            settings={
                n: v for n, v in one.settings.items() if n not in of_robot or n in project.experiments[name].settings
            },
        )
        for name, one in calibrated(project, result).experiments.items()
    }
    at_nominal = replace(project, experiments=experiments)
    known = _nominal(at_nominal, settings, result, free) if free else None

    def configurations(state: State) -> list[Configuration | None]:
        nominal = _configuration("Nominal", at_nominal, state, _nominal_values(at_nominal, result))
        return [nominal, _at(project, "Calibrated", result, _values(result), state)]

    return _compared(project, result, known, configurations)


def compared_sweep(project: Project, settings: CalibrationSection, result: SweepResult) -> Compared:
    """Errors at the nominal values, robot's and rig's, and the configurations to draw: those listed under `sweep.show`,
    else nominal, best and worst cell.

    Parameters
    ----------
    project
        With the nominal values, and the configurations of `sweep.show`.
    settings
        Settings of the sweep.
    result
        Its cells.
    """

    def configurations(state: State) -> list[Configuration | None]:
        present = _nominal_values(project, result)
        if project.sweep is not None and project.sweep.show:
            shown = shown_configurations(project.sweep.show, project.parameters, project.tied)
            chosen = {name: {**present, **values} for name, values in shown.items()}
        else:
            worst = max((cell for cell in result.trials if cell.loss is not None), key=lambda cell: cell.loss or 0.0)
            chosen = {"Nominal": present, "Best cell": _values(result), "Worst cell": worst.theta}
        return [_at(project, name, result, theta, state) for name, theta in chosen.items()]

    return _compared(project, result, _nominal(project, settings, result, list(result.parameters)), configurations)


def _compared(
    project: Project,
    result: SearchResult,
    nominal_errors: Nominal | None,
    configurations: Callable[[State], list[Configuration | None]],
) -> Compared:
    units = {name: e.unit for name, e in result.parameters.items()}
    length = next((fit.length for fit in result.experiments.values() if fit.length is not None), None)
    # The state with the strongest pull; among equal ones, that with the largest marker error.
    states: dict[State, tuple[float, float]] = {}
    for name, fit in result.experiments.items() if nominal_errors is not None else ():
        experiment = project.experiments[name]
        if placed := [c for c in experiment.compared if experiment.point_of(c)]:
            squares = np.sum([(fit.simulated[c] - fit.measured[c]) ** 2 for c in placed], axis=0)
            drives = [np.abs(experiment.dataset.values(c)) for c in experiment.drives]
            pull = np.max(drives, axis=0) if drives else np.zeros(experiment.dataset.n_samples)
            seen = np.flatnonzero(np.isfinite(squares))
            states |= {(name, int(k)): (float(pull[k]), float(squares[k])) for k in seen}
    if not states:
        return Compared(nominal_errors, (), units, length)
    state = max(states, key=lambda one: states[one])
    there = tuple(one for one in configurations(state) if one is not None)
    experiment, row = project.experiments[state[0]], state[1]
    data = experiment.dataset
    drives = [
        f"{experiment.twin_channel(c)} {format_quantity(float(data.values(c)[row]), data.channels[c].unit)}"
        for c in experiment.drives
    ]
    text = f"{experiment.name} ({', '.join(drives)})" if drives else experiment.name
    return Compared(nominal_errors, there, units, length, text)


def _nominal(project: Project, settings: CalibrationSection, result: SearchResult, free: Sequence[str]) -> Nominal:
    """Errors of the project's own values of the `free` parameters in a result's experiments."""
    estimates = {name: result.parameters[name] for name in free}
    space = SearchSpace(tuple(FreeParameter(name, e.unit, e.lower, e.upper, of=e.of) for name, e in estimates.items()))
    experiments = tuple(project.experiments[name] for name in (*result.experiments, *result.held_out))
    length = next((e.rig.length for e in experiments if e.rig.length is not None), None)
    loss = make_loss(settings.model_copy(update={"loss": result.loss_name}), length)
    return nominal(Problem(project.robot, experiments, space, loss))


def _values(result: SearchResult) -> dict[str, float]:
    return {name: e.value for name, e in result.parameters.items()}


def _nominal_values(project: Project, result: SearchResult) -> dict[str, float]:
    """The project's values of a result's parameters, without parameters with several values."""
    parameters = project.parameters
    present = {
        name: {parameters[target].value for target in e.of or (name,) if target in parameters}
        for name, e in result.parameters.items()
    }
    return {name: values.pop() for name, values in present.items() if len(values) == 1}


def _at(
    project: Project, name: str, result: SearchResult, theta: Mapping[str, float], state: State
) -> Configuration | None:
    """The twin at values [SI] of a result's parameters; those that theta leaves out stay the project's."""
    there = {n: replace(e, value=theta[n]) for n, e in result.parameters.items() if n in theta}
    shown = {n: e.value for n, e in there.items()}
    return _configuration(name, calibrated(project, replace(result, parameters=there)), state, shown)


def _configuration(name: str, project: Project, state: State, theta: Mapping[str, float]) -> Configuration | None:
    """The twin in one state of one experiment; None if it cannot be simulated or does not move."""
    experiment, row = project.experiments[state[0]], state[1]
    rig = experiment.rig_values()
    controls = {
        actuator: Command(command.control, command.values[row : row + 1])
        for actuator, command in commands(experiment, rig).items()
    }
    robot = robot_in(project, experiment.name)
    response = simulate(robot, Protocol(controls), snapshots=True)
    if not response.succeeded or len(response.snapshots) < 2:
        return None
    twin = TwinView(robot, response.snapshots[0], response.snapshots[-1], response.tets)
    # The measured position of every marker and plate [m], in the robot's frame.
    frame = np.array([rig.get(name, 0.0) for name in FRAME])
    measured: dict[str, Floats] = {}
    for point in experiment.points:
        parts = experiment.parts_of(point)
        if len(parts) == 3:
            seen = np.array([experiment.dataset.values(part)[row] for part in parts])
            measured[point] = (seen - frame[:3]) @ rotation(frame[3:])
    return Configuration(name, theta, twin, measured)
