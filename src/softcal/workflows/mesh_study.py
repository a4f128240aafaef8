"""A calibrated run, or a project at its parameters, studied for what the mesh contributes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from softcal.analysis.mesh_study import UNKNOWNS, MeshStudy, Observer
from softcal.analysis.mesh_study import mesh_study as study_problem
from softcal.calibration.problem import Problem
from softcal.errors import Fault, InputError
from softcal.twin.finer import ELEMENT_RANK
from softcal.twin.robot import ElementKind
from softcal.workflows.mesh_study_files import write_study
from softcal.workflows.output import require_free_folder
from softcal.workflows.study_source import StudySource, study_source

MOST_HALVINGS = 3


def study(
    source: StudySource,
    *,
    element: str = "P2P1",
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    progress: Observer | None = None,
) -> MeshStudy:
    """What the mesh contributes; see `softcal.analysis.mesh_study`.

    Raises
    ------
    InputError
        For an element that there is not, or a number that makes no sense.
    SimulationError
        Where the twin cannot be simulated as it is.
    """
    faults: list[Fault] = []
    kind: ElementKind | None = next((known for known in ELEMENT_RANK if known == element), None)
    if kind is None or ELEMENT_RANK[kind] == 0:
        faults.append(Fault("this is no higher element", "--element", f"'{element}'", "P2, P2P1"))
    if not 0 <= halvings <= MOST_HALVINGS:
        faults.append(Fault("elements cannot be halved so often", "--halvings", str(halvings), f"0 to {MOST_HALVINGS}"))
    if max_unknowns < 1:
        faults.append(Fault("there must be room for unknowns", "--unknowns", str(max_unknowns), "1 or more"))
    if kind is not None and not faults and halvings == 0 and not _has_lower(source.problem, kind):
        got = f"no halving, and no body with an element below {element}"
        faults.append(Fault("nothing finer is asked for", "--halvings", got, attempt="--halvings 1"))
    if faults or kind is None:
        raise InputError(faults)
    found = study_problem(
        source.problem, source.theta, element=kind, halvings=halvings, max_unknowns=max_unknowns, progress=progress
    )
    return replace(found, notes=(*source.notes, *found.notes))


def mesh_study(
    path: str | Path,
    *,
    calibration: str = "",
    values: Mapping[str, str] | None = None,
    element: str = "P2P1",
    halvings: int = 2,
    max_unknowns: int = UNKNOWNS,
    out: str | Path | None = None,
    progress: Observer | None = None,
) -> MeshStudy:
    """What the mesh contributes to what a run found, or to a project's twin at its present parameters.

    Parameters
    ----------
    path
        A run folder, or a project file.
    calibration
        Of a run: which; the joint one by default, else the first.
    values
        Of a project: parameters to hold, such as `{"neck.poissons_ratio": "0.45"}`.
    element
        What bodies of lower elements are raised to.
    halvings
        How often elements are halved.
    max_unknowns
        Discretisations with more are left out, and say so.
    out
        A new folder for the study as JSON and CSV; a run's report tells the one in its `mesh-study`.
    progress
        Told of every discretisation and trajectory.

    Raises
    ------
    InputError
        For what cannot be studied, an option that makes no sense, or a folder that holds files.
    SimulationError
        Where the twin cannot be simulated as it is.
    """
    if out is not None:
        require_free_folder(Path(out))
    source = study_source(Path(path), values, calibration)
    found = study(source, element=element, halvings=halvings, max_unknowns=max_unknowns, progress=progress)
    if out is not None:
        write_study(found, source.project, source.calibration, Path(out))
    return found


def _has_lower(problem: Problem, element: ElementKind) -> bool:
    return any(ELEMENT_RANK[body.element] < ELEMENT_RANK[element] for body in problem.robot.bodies)
