"""A project's twin on a grid of parameters, judged in every cell; kept in a run folder like a calibration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from softcal.analysis.nominal import Nominal, nominal
from softcal.analysis.sweep import BestCell, best_cells, section_errors, sections
from softcal.calibration.problem.loss import LOSSES
from softcal.calibration.problem.parameters import search_space
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import SweepResult, Trial
from softcal.calibration.results.store import write_text
from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.search.interrupts import stoppable
from softcal.calibration.search.search import Progress
from softcal.calibration.sweep import sweep as sweep_problem
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.display import displayed
from softcal.errors import CalibrationError, Fault, InputError, ParameterError, unknown
from softcal.executors.each import Workers
from softcal.html_text import summary
from softcal.project.axes import Axis, cells_fault, doubled, parse_axis
from softcal.project.bench_names import experiments_named
from softcal.project.project import Project, ProjectSource, project_of
from softcal.units import format_quantity
from softcal.workflows.calibration import make_loss
from softcal.workflows.run import SWEEP, Outcome
from softcal.workflows.run_folder import begin_run, calibration_folder, finish_sweep, reopen_run

FORMULA = "nominal error / error of the best cell - 1; 100 % where the error was halved"


@displayed
@dataclass(frozen=True)
class Swept(Outcome):
    """The result of a sweep of a project.

    Attributes
    ----------
    result
        Every cell, as trials.
    nominal
        The errors at the nominal values.
    best
        The best cell of all sections together and of each.
    """

    result: SweepResult
    nominal: Nominal
    best: tuple[BestCell, ...]

    def _repr_html_(self) -> str:
        units = {name: one.unit for name, one in self.result.parameters.items()}
        rows = [
            [
                one.section.name,
                *(format_quantity(one.trial.theta[name], unit) for name, unit in units.items()),
                *(one.section.text(error) for error in (one.error, one.nominal)),
            ]
            for one in self.best
        ]
        notes = [str(note) for note in self.result.notes]
        title = f"{len(self.result.trials)} cells, {self.result.n_failed_trials} of them failed"
        return summary(
            title, ["best for", *units, "error", "at the nominal values"], rows, [self.result.status, *notes]
        )


@checked_arguments
def sweep(
    project: ProjectSource,
    *,
    over: Mapping[str, str | Sequence[str | float]] | None = None,
    experiments: Sequence[str] | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    workers: Workers = 1,
    progress: Callable[[str, Progress], None] | None = None,
) -> Swept:
    """Simulate a project's experiments in every cell of a grid over any of its parameters.

    The error is paper B's distance where positions alone are compared, otherwise the project's loss. The best cells and
    the nominal values' error come with it. A cell that cannot be simulated is kept as FAILED with its reason.

    Parameters
    ----------
    project
        A project, or the path of a project file.
    over
        In the place of what the project says: values and ranges by parameter, such as
        `{"springs.youngs_modulus": "10GPa:1GPa:1GPa", "springs.poissons_ratio": ["0.4999", "0.45:0.05:0.05"]}`.
        The last parameter changes fastest.
    experiments
        Names or patterns of those to judge by; as the project says, or all, when None.
    out
        Run folder, new or empty; None keeps nothing on disk.
    resume
        Go on with the sweep in `out`.
    workers
        An executor, or a number of processes; the result is the same for any number.
    progress
        Called after every cell.

    Raises
    ------
    InputError
        For a parameter, value, range or experiment that makes no sense, a folder that cannot be used, or a project that
        cannot be loaded.
    CalibrationError
        Where no cell could be simulated; `sweep.csv` is written nevertheless.
    KeyboardInterrupt
        Where the user stopped it before any was.
    """
    project = project_of(project)
    axes = _axes(project, over)
    problem = make_sweep(project, axes, experiments)
    folder = None if out is None else Path(out)
    settings = project.calibration.model_copy(
        update={
            "method": "grid",
            "loss": problem.loss.name,
            "fit": "joint",
            "trials": None,
            "hold_out": [],
            "split": [],
        }
    )
    if folder is None and resume:
        raise InputError(Fault("a sweep is resumed from its folder, which is missing", attempt="out"))
    if folder is not None and resume:
        reopen_run(project, folder)
    elif folder is not None:
        begin_run(project, settings, [SWEEP], folder)
    nominal_cell = nominal(problem)
    store = None if folder is None else calibration_folder(folder, SWEEP)
    with stoppable() as stop:
        try:
            result = sweep_problem(
                problem,
                {axis.name: axis.values for axis in axes},
                seed=settings.seed,
                workers=workers,
                store=store,
                resume=resume and store is not None and (store / "run.json").is_file(),
                progress=None if progress is None else lambda state: progress(SWEEP, state),
            )
        except CalibrationError as error:
            cells = [] if store is None else [stored.trial for stored in stored_trials(store).values()]
            failed = [] if any(cell.loss is not None for cell in cells) else cells
            if failed and folder is not None:
                write_text(folder / "sweep.csv", failed_csv(problem, failed))
            if stop.by is not None:
                raise stop.by from None
            if not failed or folder is None:
                raise
            raise CalibrationError(f"{error} Every cell and its reason: {folder / 'sweep.csv'}.") from None
    swept = Swept(result, nominal_cell, best_cells(result, nominal_cell), folder=folder, stopped_by=stop.by)
    if folder is not None:
        write_text(folder / "sweep.csv", sweep_csv(result))
        finish_sweep(project, result, folder, sweep_json(swept))
    return swept


def make_sweep(project: Project, axes: Sequence[Axis], experiments: Sequence[str] | None = None) -> Problem:
    """The problem whose free parameters are those of the axes, with the project's present values for all others.

    Parameters
    ----------
    project
        The project.
    axes
        A parameter and its values each.
    experiments
        Names of the experiments; None: those of the project's sweep, else all.

    Raises
    ------
    ParameterError
        For an experiment that does not exist, or a parameter that none of the chosen ones has.
    """
    wanted = list(project.experiments) if experiments is None else list(experiments)
    if experiments is None and project.sweep is not None and project.sweep.experiments:
        wanted = project.sweep.experiments
    names = experiments_named(wanted, project.experiments)
    faults = [
        unknown("there is no such experiment", "experiments", name, project.experiments)
        for name in names
        if name not in project.experiments
    ]
    if not names:
        faults.append(Fault("there is no experiment to judge by", str(project.path), attempt="experiments: …"))
    if faults:
        raise ParameterError(faults)
    chosen = tuple(project.experiments[name] for name in names)
    space = search_space([axis.parameter for axis in axes], names, project.parameters)
    # Paper B's distance where positions alone are compared, else the project's loss.
    placed = all(e.point_of(channel) for e in chosen for channel in e.compared)
    loss = project.calibration.model_copy(update={"loss": "distance"}) if placed else project.calibration
    length = next((e.rig.length for e in chosen if e.rig.length is not None), None)
    return Problem(project.robot, chosen, space, make_loss(loss, length))


def sweep_csv(result: SweepResult) -> str:
    """A row for every cell: its number, state, reason, parameters [SI], loss, and error of every section.

    Errors are in % of the length where it is known, else in SI; of several experiments each has its own columns too.
    """
    parts = sections(result)
    several = list(result.experiments) if len(result.experiments) > 1 else []
    header = _header({name: p.unit for name, p in result.parameters.items()}, result.loss_name)
    header += [f"error of {s.name} [{s.shown_unit}]" for s in parts]
    header += [f"error of {s.name} in {e} [{s.shown_unit}]" for e in several for s in parts]
    rows: list[list[object]] = []
    for trial in result.trials:
        joint = section_errors(result, trial.errors)
        row = _row(trial, list(result.parameters))
        for errors in (joint, *(trial.errors.get(e, {}) for e in several)):
            row += [s.shown(errors[s.name]) if s.name in errors else "" for s in parts]
        rows.append(row)
    return csv_text(header, rows)


def failed_csv(problem: Problem, trials: Sequence[Trial]) -> str:
    """As `sweep_csv` where no cell could be simulated, and it is not known which errors there would have been."""
    units = {p.label: p.unit for p in problem.space.parameters}
    return csv_text(_header(units, problem.loss.name), [_row(trial, list(units)) for trial in trials])


def sweep_json(found: Swept) -> dict[str, Any]:
    """Content of result.json of a sweep beside the best cell's fit."""
    result, known = found.result, found.nominal
    errors = section_errors(result, known.errors)
    return {
        "axes": {n: {"unit": result.parameters[n].unit, "values": list(values)} for n, values in result.axes.items()},
        "cells": len(result.trials),
        "failed": result.n_failed_trials,
        "nominal": {
            "parameters": dict(known.parameters),
            "loss": known.loss,
            "reason": known.failure,
            "errors": {s.name: s.shown(errors[s.name]) for s in sections(result) if s.name in errors},
        },
        "best": {
            best.section.name: {
                "cell": best.trial.number,
                "parameters": dict(best.trial.theta),
                "error": best.section.shown(best.error),
                "unit": best.section.shown_unit,
                "nominal_error": None if best.nominal is None else best.section.shown(best.nominal),
                "error_reduction_percent": best.reduction,
                "improvement_percent": best.improvement,
                "notes": list(best.notes),
            }
            for best in found.best
        },
        "improvement_percent": FORMULA,
    }


def _header(units: Mapping[str, str], loss: str) -> list[str]:
    parameters = [f"{name} [{unit}]" for name, unit in units.items()]
    return ["cell", "status", "reason", *parameters, f"loss {loss} [{LOSSES.named(loss).unit}]"]


def _row(trial: Trial, parameters: Sequence[str]) -> list[object]:
    loss = "" if trial.loss is None else trial.loss
    return [trial.number, trial.state, trial.reason, *(trial.theta[name] for name in parameters), loss]


def _axes(project: Project, over: Mapping[str, str | Sequence[str | float]] | None) -> list[Axis]:
    given: dict[str, Sequence[str | float]] = {}
    if over:
        given = {name: [entry] if isinstance(entry, str) else list(entry) for name, entry in over.items()}
    elif project.sweep is not None:
        given = {name: list(entries) for name, entries in project.sweep.over.items()}
    faults: list[Fault] = []
    axes: list[Axis] = []
    if not given:
        attempt = "--over neck.youngs_modulus=1MPa:4MPa:0.5MPa, or sweep: {over: …} in the project"
        faults.append(Fault("the axes of the sweep are not specified", str(project.path), attempt=attempt))
    for name, written in given.items():
        try:
            axes.append(parse_axis(name, written, project.parameters, project.tied))
        except InputError as error:
            faults += error.faults
    faults += doubled(axes, project.held)
    if axes and (fault := cells_fault(axes)):
        faults.append(replace(fault, where="--over" if over else "sweep.over"))
    if faults:
        raise ParameterError(faults)
    return axes
