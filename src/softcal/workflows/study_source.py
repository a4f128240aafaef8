"""Source of a study or of a twin: a calibrated run at its calibrated values, or a project at its present parameters.

Modules that only a study needs are imported after the project is read, so that its faults are reported at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, ParameterError, SimulationError, unknown
from softcal.limits import JOINT
from softcal.project.project import Project, ProjectSource, load

if TYPE_CHECKING:
    from softcal.calibration.problem.problem import Problem
    from softcal.calibration.results.result import CalibrationResult
    from softcal.calibration.statistics.estimator import Estimator
    from softcal.checks import Floats


@dataclass(frozen=True)
class StudySource:
    """A problem with the values to study [SI by label], and the label of the run's calibration, or "".

    notes: remarks for the reader of the study. result: the run's, with these values.
    """

    problem: Problem
    theta: Mapping[str, float]
    calibration: str
    project: Project
    notes: tuple[str, ...] = ()
    result: CalibrationResult | None = None

    @property
    def includes_mesh(self) -> bool:
        """Whether the calibration's intervals include the error of the mesh."""
        from softcal.calibration.problem.uncertain import MESH_ERROR

        estimates = {} if self.result is None else self.result.parameters
        return any(MESH_ERROR.source in estimate.shares for estimate in estimates.values())

    def estimator(self) -> tuple[Estimator, Floats]:
        """The minimum as an estimator, with the error of the mesh where the intervals include it, and d theta / d z
        (size,) there; evaluates the twin.

        Raises
        ------
        SimulationError
            Where the twin cannot be simulated at these values.
        """
        import numpy as np

        from softcal.calibration.statistics.mesh_error import with_mesh_error
        from softcal.calibration.statistics.sensitivity import local_estimator

        problem, space = self.problem, self.problem.space
        best, uncertain = problem.evaluate(self.theta, jacobian=True), problem.uncertain
        if best.loss is None:
            raise SimulationError(f"The twin cannot be simulated at the calibrated values. {best.failure}")
        if self.includes_mesh:
            seen = with_mesh_error(problem, best)
            best, uncertain = seen.best, seen.uncertain
        z = np.clip(space.to_search(self.theta), 0.0, 1.0)
        return local_estimator(space, problem.loss, z, best.blocks, uncertain), space.jacobian(z)


def study_source(path: ProjectSource, values: Mapping[str, str] | None = None, calibration: str = "") -> StudySource:
    """The values of a run's joint or named calibration, or those of a project or its file.

    Parameters
    ----------
    path
        A run folder, a project file, or a project.
    values
        Parameters of a project file to fix, as text.
    calibration
        Label of a run's calibration; by default the joint one, else the first.

    Raises
    ------
    InputError
        For any other path, an unknown calibration or a sweep, values for a run or for a project that is loaded already,
        or a project without measurements or free parameters.
    ParameterError
        For a project's value of a free parameter outside its bounds.
    StorageError
        For a folder that holds no run.
    """
    path = path if isinstance(path, Project) else Path(path)
    if not isinstance(path, Project) and path.is_dir():
        if values:
            raise InputError(
                Fault("a run has its calibrated values", "--set", ", ".join(values), "a project file with --set")
            )
        return run_source(path, calibration)
    if calibration:
        raise InputError(Fault("a project file holds no calibrations", "--calibration", f"'{calibration}'"))
    if isinstance(path, Project) and values:
        attempt = "softcal.load(path, values=…)"
        raise InputError(Fault("a project has its values already", "values", ", ".join(values), attempt=attempt))
    project = path if isinstance(path, Project) else load(path, values=values or {})
    from softcal.twin.parameters import parameter_values
    from softcal.workflows.calibration import make_problem

    problem = make_problem(project)
    of_robot = parameter_values(problem.robot)
    # Of the rig's values those of the first experiment that has them.
    of_rig = {name: value for e in reversed(problem.experiments) for name, value in e.rig_values().items()}
    theta: dict[str, float] = {}
    faults: list[Fault] = []
    for p in problem.space.parameters:
        serving = next(e for e in problem.experiments if p.serves(e.name))
        present = {**of_robot, **of_rig, **serving.rig_values()}
        theta[p.label] = sum(present[target] for target in p.targets) / len(p.targets)  # the mean of tied parameters
        if not p.lower <= theta[p.label] <= p.upper:
            got, allowed = f"{theta[p.label]:.6g} {p.unit}", f"{p.lower:.6g} to {p.upper:.6g} {p.unit}"
            faults.append(Fault("the present value is outside its bounds", p.label, got, allowed, "--set, or a run"))
    if faults:
        raise ParameterError(faults)
    return StudySource(problem, theta, "", project)


def run_source(path: Path, calibration: str = "") -> StudySource:
    """The values of a run's joint or named calibration.

    Raises
    ------
    InputError
        For no folder, an unknown calibration, or a sweep.
    StorageError
        For a folder that holds no run.
    """
    from softcal.workflows.run import SweepRun
    from softcal.workflows.run_folder import load_run, refuse_project_folder

    if path.is_file():
        raise InputError(
            Fault("a file holds no calibration", str(path), allowed="a run folder", attempt="softcal calibrate")
        )
    refuse_project_folder(path)
    run = load_run(path)
    if isinstance(run, SweepRun):
        raise InputError(Fault("a sweep has no optimum to study", str(run.folder), attempt="softcal calibrate"))
    label = calibration or (JOINT if JOINT in run.results else next(iter(run.results)))
    if label not in run.results:
        raise InputError(unknown("the run has no such calibration", "--calibration", label, run.results))
    from softcal.calibration.problem.problem import SOFTCAL
    from softcal.calibration.search.robot_errors import with_uncertain_errors
    from softcal.workflows.calibration import make_problem

    result = run.results[label]
    problem = make_problem(run.project, run.settings).only(list(result.experiments))
    problem = with_uncertain_errors(problem, result.robot_errors)
    engine = result.hashes.get("engine", SOFTCAL)
    notes = () if engine == SOFTCAL else (f"The calibration was computed by {engine}, the study by {SOFTCAL}.",)
    theta = {name: estimate.value for name, estimate in result.parameters.items()}
    return StudySource(problem, theta, label, run.project, notes, result)


def default_folder(path: Path, name: str) -> Path | None:
    """Default folder of a study of this name: in the run; None for a project, whose study is only printed."""
    return path / name if path.is_dir() else None


@checked_arguments
def load_calibrated(path: str | Path, values: Mapping[str, str] | None = None) -> Project:
    """The project of a run folder at the calibrated values, or that of a project file.

    Parameters
    ----------
    path
        The run folder, or the project file.
    values
        Parameter -> value with its unit, such as "2 MPa", in the place of the calibrated ones.

    Raises
    ------
    InputError
        For a project that cannot be loaded, or an invalid value.
    StorageError
        For a folder that holds no run.
    """
    path = Path(path)
    if not path.is_dir():
        return load(path, values=values or {})
    from softcal.project.search import held_values
    from softcal.twin.parameters import robot_parameters, with_parameters
    from softcal.workflows.calibration import calibrated
    from softcal.workflows.run_folder import load_run, refuse_project_folder

    refuse_project_folder(path)
    run = load_run(path)
    project = calibrated(run.project, run.headline)
    fixed = held_values(values or {}, robot_parameters(project.robot))
    return replace(project, robot=with_parameters(project.robot, fixed))
