"""A calibrated run, or a project at its parameters, studied for what the mesh contributes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from softcal.analysis.mesh_study import UNKNOWNS, MeshStudy, Observer
from softcal.analysis.mesh_study import mesh_study as study_problem
from softcal.calibration.problem import SOFTCAL, Problem
from softcal.errors import Fault, InputError, ParameterError
from softcal.project.project import Project, load
from softcal.twin.finer import ELEMENT_RANK
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import ElementKind
from softcal.workflows.calibration import JOINT, make_problem
from softcal.workflows.mesh_study_files import FOLDER, write_study
from softcal.workflows.output import require_free_folder
from softcal.workflows.run_folder import Run, load_run, refuse_project_folder

MOST_HALVINGS = 3


@dataclass(frozen=True)
class StudySource:
    """What is studied: a problem at values [SI by label], and the calibration of a run that found them, or "".

    notes: what the reader of the study must know.
    """

    problem: Problem
    theta: Mapping[str, float]
    calibration: str
    project: Project
    notes: tuple[str, ...] = ()


def study_source(path: Path, values: Mapping[str, str] | None = None, calibration: str = "") -> StudySource:
    """What a run folder found, by its joint calibration or the one that is named; or a project file as it stands.

    Raises
    ------
    InputError
        For what is neither, a calibration that the run does not have or a sweep, values for a run, or a project with
        nothing measured or free.
    StorageError
        For a folder that holds no run.
    """
    if path.is_dir():
        refuse_project_folder(path)
        if values:
            raise InputError(
                Fault("a run is studied at what it found", "--set", ", ".join(values), "a project file with --set")
            )
        return _of_run(load_run(path), calibration)
    if calibration:
        raise InputError(Fault("a project file holds no calibrations", "--calibration", f"'{calibration}'"))
    project = load(path, values=values or {})
    problem = make_problem(project)
    return StudySource(problem, _present(problem), "", project)


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


def default_folder(path: Path) -> Path | None:
    """Where the study of a run goes if nobody says: into the run. That of a project is printed only."""
    return path / FOLDER if path.is_dir() else None


def _of_run(run: Run, calibration: str) -> StudySource:
    label = calibration or (JOINT if JOINT in run.results else next(iter(run.results)))
    if label not in run.results:
        raise InputError(
            Fault("the run has no such calibration", "--calibration", f"'{label}'", ", ".join(run.results))
        )
    result = run.results[label]
    if result.is_sweep:
        attempt = "softcal calibrate, or softcal mesh-study PROJECT for its present values"
        raise InputError(Fault("a sweep has no optimum to study", str(run.folder), attempt=attempt))
    problem = make_problem(run.project, run.settings).only(list(result.experiments))
    engine = result.hashes.get("engine", SOFTCAL)
    notes = (
        () if engine == SOFTCAL else (f"The calibration was computed by {engine}, the study is by {SOFTCAL} itself.",)
    )
    return StudySource(problem, {name: e.value for name, e in result.parameters.items()}, label, run.project, notes)


def _present(problem: Problem) -> dict[str, float]:
    """The present values of what is free, an experiment's own from its rig; of tied parameters the mean."""
    of_robot = {name: info.value for name, info in robot_parameters(problem.robot).items()}
    theta: dict[str, float] = {}
    faults: list[Fault] = []
    for p in problem.space.parameters:
        serving = next(e for e in problem.experiments if p.serves(e.name))
        values = {**of_robot, **_rig(problem), **serving.rig_values()}
        theta[p.label] = sum(values[target] for target in p.targets) / len(p.targets)
        if not p.lower <= theta[p.label] <= p.upper:
            got, allowed = f"{theta[p.label]:.6g} {p.unit}", f"{p.lower:.6g} to {p.upper:.6g} {p.unit}"
            faults.append(Fault("the present value lies outside its bounds", p.label, got, allowed, "--set, or a run"))
    if faults:
        raise ParameterError(faults)
    return theta


def _rig(problem: Problem) -> dict[str, float]:
    """The rig's present values, those of the first experiment that has them."""
    return {name: value for e in reversed(problem.experiments) for name, value in e.rig_values().items()}


def _has_lower(problem: Problem, element: ElementKind) -> bool:
    return any(ELEMENT_RANK[body.element] < ELEMENT_RANK[element] for body in problem.robot.bodies)
