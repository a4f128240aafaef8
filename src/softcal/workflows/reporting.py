"""Report of a run: simulates the calibrated twin, computes loss landscapes, collects the content."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from softcal.analysis.landscape import ProportionalTwin, loss_over, scales_with_modulus
from softcal.calibration.results.result import CalibrationResult, SearchResult
from softcal.declare import checked_arguments
from softcal.project.calibration_schema import CalibrationSection
from softcal.project.project import Project
from softcal.report.content import ExperimentContent, Landscape, ReportContent
from softcal.report.figure import named_figures
from softcal.report.write import Observer, ReportPaths
from softcal.report.write import write_report as write_content
from softcal.twin.parameter_name import parameter_name
from softcal.twin.response import Response
from softcal.workflows.calibrated_shapes import calibrated_shapes, from_undeformed, furthest_response
from softcal.workflows.calibration import JOINT, calibrated, make_problem
from softcal.workflows.comparing import compared_calibration, compared_sweep
from softcal.workflows.importance import IMPORTANCE
from softcal.workflows.mesh_study import MESH_STUDY
from softcal.workflows.run import SWEEP, CalibrationRun, Run, SweepRun, headline_of
from softcal.workflows.run_folder import load_run
from softcal.workflows.simulation import twin_view
from softcal.workflows.study_files import StudyKind
from softcal.workflows.twin_frame import twin_frame
from softcal.workflows.whole_record import compare_records
from softcal.workflows.workspace import WORKSPACE

# Columns and rows of a computed landscape; with this many trials, the trials are drawn instead.
LANDSCAPE_SHAPE = (41, 9)
ENOUGH_TRIALS = 100

S = TypeVar("S")


@checked_arguments
def write_report(
    run: str | Path,
    out: str | Path | None = None,
    *,
    figures: Collection[str] = (),
    solved: Mapping[str, Response] | None = None,
    progress: Observer | None = None,
) -> ReportPaths:
    """Write the report of a run folder: one self-contained page, figures as PNG and SVG, tables as CSV.

    Parameters
    ----------
    run
        A folder that `calibrate` wrote; it may have been moved.
    out
        Where the report goes; by default into the run folder.
    figures
        Names of the figures that are drawn; by default all that the run has data for.
    solved
        Calibration -> furthest response (see `furthest_responses`), if already solved.
    progress
        Called with what is done next, its number from 0, and how many there are: reading the run, simulating, each
        figure, writing the page.

    Raises
    ------
    ParameterError
        For a name without a figure.
    StorageError
        Where there is no run with a result, or the folder cannot be written.
    """
    begin = progress or (lambda stage, done, of: None)
    of = len(named_figures(figures)) + 3
    begin("reading the run", 0, of)
    read = load_run(run)
    begin("simulating the twin", 1, of)
    content = report_content(read, solved or {})
    folder = Path(out) if out is not None else read.folder
    return write_content(content, folder, figures=figures, progress=lambda what, done, _: begin(what, done + 2, of))


def report_content(run: CalibrationRun | SweepRun, solved: Mapping[str, Response] | None = None) -> ReportContent:
    """Content of a run's report; solved: furthest responses that need not be solved again."""
    match run:
        case CalibrationRun(project=project):
            headline = JOINT if JOINT in run.results else next(iter(run.results))
            stale = f"The mesh study in {MESH_STUDY.folder} is not of the calibrated values"
            mesh, mesh_note = _current(run, MESH_STUDY, stale)
            stale = f"The study in {IMPORTANCE.folder} is not over the bounds of the search"
            importance, importance_note = _current(run, IMPORTANCE, stale)
            stale = f"The workspace in {WORKSPACE.folder} is not at the calibrated values"
            workspace, workspace_note = _current(run, WORKSPACE, stale)
            return ReportContent(
                results=run.results,
                headline=headline,
                experiments={name: experiment_content(project, name) for name in project.experiments},
                landscapes=_landscapes(project, run.results, run.settings),
                records={label: compare_records(project, result) for label, result in run.results.items()},
                compared=compared_calibration(project, run.settings, run.results[headline]),
                mesh_study=mesh,
                mesh_note=mesh_note,
                importance=importance,
                importance_note=importance_note,
                workspace=workspace,
                workspace_note=workspace_note,
                **_shared(run, run.results[headline], (solved or {}).get(headline)),
            )
        case SweepRun(project=project, result=result):
            return ReportContent(
                results={SWEEP: result},
                experiments={name: experiment_content(project, name) for name in result.experiments},
                compared=compared_sweep(project, run.settings, result),
                **_shared(run, result),
            )


def _current(run: CalibrationRun, kind: StudyKind[S], stale: str) -> tuple[S | None, str]:
    """A study in the run's folder if it belongs to the run's results, and a note on it."""
    stored = kind.read(run.folder / kind.folder)
    if stored is None:
        return None, ""
    if not stored.is_of(dict([headline_of(run.results), *run.results.items()])):
        return None, f"{stale}: delete it and repeat it."
    return stored.study, f"Of the calibration '{stored.calibration}'." if len(run.results) > 1 else ""


def _shared(run: Run, result: SearchResult, furthest: Response | None = None) -> dict[str, Any]:
    """Content that every report has of its run, and of the twin at the values of the headline's result."""
    project = run.project
    equilibria = calibrated_shapes(project, result)
    response = furthest or furthest_response(project, result)
    twin = twin_view(calibrated(project, result).robot, response) if response.succeeded else None
    return {
        "project_name": project.name,
        "twin": twin or from_undeformed(equilibria),
        "frame": None if twin is None else twin_frame(twin, response),
        "equilibria": equilibria,
        "print_infill": project.print_infill,
        "versions": run.versions,
        "hashes": run.hashes,
        "created": run.created,
    }


def experiment_content(project: Project, name: str) -> ExperimentContent:
    """Content of a report on an experiment's data."""
    experiment = project.experiments[name]
    return ExperimentContent(
        name=name,
        raw=project.records[name],
        prepared=experiment.dataset,
        corrected=project.corrected[name],
        drive=experiment.drives[0] if experiment.drives else "",
    )


def _landscapes(
    project: Project, results: Mapping[str, CalibrationResult], settings: CalibrationSection
) -> dict[str, Landscape]:
    """Loss over modulus and ratio of each calibration, if it is cheap and the trials do not already show it. A search
    by derivatives needs no map: its intervals say more.
    """
    if settings.method == "least-squares":
        return {}
    problem = make_problem(project, settings)
    if not scales_with_modulus(problem):
        return {}
    # The largest shortening [m] of the twin for any slack within its bounds.
    slacks = [p.lower for p in problem.space.parameters if parameter_name(p.name).kind == "slack"]
    slacks += [
        v for e in problem.experiments for name, v in e.rig_values().items() if parameter_name(name).kind == "slack"
    ]
    furthest = max(float(np.max(e.dataset.values(drive))) for e in problem.experiments for drive in e.drives)
    twin = ProportionalTwin(furthest - min([0.0, *slacks]))
    landscapes: dict[str, Landscape] = {}
    for label, result in results.items():
        pair = [
            next((n for n in result.parameters if n.endswith(kind)), "")
            for kind in ("youngs_modulus", "poissons_ratio")
        ]
        if not all(pair) or len(result.trials) >= ENOUGH_TRIALS:
            continue
        one = replace(problem if label == JOINT else problem.alone(label), simulate=twin)
        theta = {name: estimate.value for name, estimate in result.parameters.items()}
        grid = loss_over(one, theta, pair[0], pair[1], LANDSCAPE_SHAPE)
        failed = np.isnan(grid.loss)
        filled = np.where(failed, 0.0, grid.loss)
        landscapes[label] = Landscape(pair[0], pair[1], grid.x, grid.y, filled, failed.astype(np.int64))
    return landscapes
