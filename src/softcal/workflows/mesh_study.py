"""Mesh study of a calibrated run, or of a project at its present parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from softcal.analysis.mesh_study import UNKNOWNS, MeshStudy, Observer
from softcal.analysis.mesh_study import mesh_study as study_problem
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, unknown
from softcal.executors.each import Workers
from softcal.mechanics.elements import DEFAULT, higher_elements
from softcal.project.project import ProjectSource
from softcal.twin.finer import has_lower
from softcal.workflows.output import require_free_folder
from softcal.workflows.study_files import StudyKind, has_values
from softcal.workflows.study_source import StudySource, study_source

MOST_HALVINGS = 3


def study(
    source: StudySource,
    *,
    element: str = DEFAULT.name,
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    workers: Workers = 1,
    progress: Observer | None = None,
) -> MeshStudy:
    """Mesh study of a source; see `softcal.analysis.mesh_study`.

    Parameters
    ----------
    source
        The problem at the studied values.
    element
        Element to which bodies of lower order are raised.
    halvings
        Number of refinements by halving.
    max_unknowns
        Limit of unknowns; larger discretisations are skipped with a note.
    workers
        An executor, or a number of processes: a discretisation for each.
    progress
        Called for every discretisation and trajectory.

    Raises
    ------
    InputError
        For an unknown element, or a number out of range.
    SimulationError
        If the twin cannot be simulated on its own mesh.
    """
    faults: list[Fault] = []
    if element not in higher_elements():
        faults.append(unknown("this is not a higher-order element", "--element", element, higher_elements()))
    if not 0 <= halvings <= MOST_HALVINGS:
        allowed = f"0 to {MOST_HALVINGS}"
        faults.append(Fault("this number of halvings is not allowed", "--halvings", str(halvings), allowed))
    if max_unknowns < 1:
        faults.append(Fault("the limit of unknowns must be positive", "--unknowns", str(max_unknowns), "1 or more"))
    if not faults and halvings == 0 and not has_lower(source.problem.robot, element):
        got = f"no halving, and no body with an element below {element}"
        faults.append(Fault("no refinement is requested", "--halvings", got, attempt="--halvings 1"))
    if faults:
        raise InputError(faults)
    result = study_problem(
        source.problem,
        source.theta,
        element=element,
        halvings=halvings,
        max_unknowns=max_unknowns,
        workers=workers,
        progress=progress,
    )
    return replace(result, notes=(*source.notes, *result.notes))


@checked_arguments
def mesh_study(  # noqa: PLR0913 (one argument for each option)
    path: ProjectSource,
    *,
    calibration: str = "",
    values: Mapping[str, str] | None = None,
    element: str = DEFAULT.name,
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    workers: Workers = 1,
    out: str | Path | None = None,
    progress: Observer | None = None,
) -> MeshStudy:
    """Influence of the mesh on a run's calibrated values, or on a project's twin at its present parameters.

    Parameters
    ----------
    path
        A run folder, a project file, or a project.
    calibration
        Label of a run's calibration; by default the joint one, else the first.
    values
        Parameters of a project to fix, such as `{"neck.poissons_ratio": "0.45"}`.
    element
        Element to which bodies of lower order are raised.
    halvings
        Number of refinements by halving.
    max_unknowns
        Limit of unknowns; larger discretisations are skipped with a note.
    workers
        An executor, or a number of processes: a discretisation for each.
    out
        A new folder for the study as JSON and CSV; a run's report shows the one in its `mesh-study`.
    progress
        Called for every discretisation and trajectory.

    Raises
    ------
    InputError
        For an invalid source or option, or a folder that holds files.
    SimulationError
        If the twin cannot be simulated on its own mesh.
    """
    if out is not None:
        require_free_folder(Path(out))
    source = study_source(path, values, calibration)
    result = study(
        source,
        element=element,
        halvings=halvings,
        max_unknowns=max_unknowns,
        workers=workers,
        progress=progress,
    )
    if out is not None:
        MESH_STUDY.write(result, source.project, source.calibration, Path(out))
    return result


def parameters_csv(found: MeshStudy) -> str:
    """A row per discretisation and parameter: calibrated value, standard error, value expected there [SI]."""
    header = ["discretisation", "unknowns", "parameter", "unit", "found", "standard_error", "expected", "shift"]
    rows: list[list[object]] = []
    for one in found.finer:
        first = [one.name, None if one.size is None else one.size.unknowns]
        if one.failure:
            rows.append([*first, *[None] * 8, one.failure])
        for label, value in one.values.items():
            estimate = found.parameters[label]
            shift, error = value - estimate.value, estimate.standard_error
            cells = [label, estimate.unit, estimate.value, error, value, shift]
            rows.append([*first, *cells, shift / error if error else None, label in one.at_bound, "simulated"])
    return csv_text([*header, "shift over standard error [1]", "at_bound", "status"], rows)


def changes_csv(found: MeshStudy) -> str:
    """A row per discretisation, experiment and channel: its change, noise and residual [SI]."""
    header = ["discretisation", "experiment", "of", "unit", "RMS change", "relative [1]", "noise sd", "RMSE of the fit"]
    rows: list[list[object]] = []
    for one in found.finer:
        for c in one.changes:
            numbers = [c.rms, c.share, c.noise, c.residual, c.n, c.order]
            rows.append([one.name, c.experiment, c.name, c.unit, *numbers])
    return csv_text([*header, "n [1]", "order [1]"], rows)


MESH_STUDY = StudyKind(
    what="the mesh study",
    study=MeshStudy,
    file="mesh-study.json",
    folder="mesh-study",
    sentences=lambda study: [verdict.text for verdict in mesh_verdicts(study)],
    tables={"parameters.csv": parameters_csv, "changes.csv": changes_csv},
    is_of=lambda study, result: has_values(result, {label: e.value for label, e in study.parameters.items()}),
)
