"""A calibrated run, or a project at its parameters, studied for what the mesh contributes; the study as files."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from softcal.analysis.mesh_changes import Change
from softcal.analysis.mesh_study import UNKNOWNS, Finer, MeshStudy, Observer, mesh_study
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.outcome import installed_versions
from softcal.calibration.problem import Problem
from softcal.calibration.result import CalibrationResult, Estimate
from softcal.calibration.store import write_text
from softcal.errors import Fault, InputError, ParameterError, StorageError
from softcal.project.calibration import JOINT, make_problem
from softcal.project.output import new_folder
from softcal.project.project import Project, load
from softcal.project.run_folder import PROJECT, RECORD, Run, load_run
from softcal.twin.finer import ELEMENT_RANK, Size
from softcal.twin.parameters import robot_parameters
from softcal.twin.robot import ElementKind

FOLDER, STUDY, PARAMETERS, CHANGES = "mesh-study", "mesh-study.json", "parameters.csv", "changes.csv"
FORMAT = 1
MOST_HALVINGS = 3


@dataclass(frozen=True)
class StudySource:
    """What is studied: a problem at values [SI by label], and the calibration of a run that found them, or ""."""

    problem: Problem
    theta: Mapping[str, float]
    calibration: str
    project: Project


def study_source(path: Path, values: Mapping[str, str] | None = None, calibration: str = "") -> StudySource:
    """What a run folder found, by its joint calibration or the one that is named; or a project file as it stands.

    Raises
    ------
    InputError
        For what is neither, a calibration that the run does not have or a sweep, values for a run, or a project with
        nothing measured or free.
    """
    if path.is_dir():
        if (path / PROJECT).is_file() and not (path / RECORD).is_file():
            allowed = "a folder that softcal calibrate wrote, or a project file"
            raise StorageError(Fault("there is no run here", str(path), f"no {RECORD}", allowed, str(path / PROJECT)))
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
    return mesh_study(
        source.problem, source.theta, element=kind, halvings=halvings, max_unknowns=max_unknowns, progress=progress
    )


def default_folder(path: Path) -> Path | None:
    """Where the study of a run goes if nobody says: into the run. That of a project is printed only."""
    return path / FOLDER if path.is_dir() else None


def write_study(found: MeshStudy, source: StudySource, folder: Path) -> None:
    """Write the study (`mesh-study.json`) and its tables (`parameters.csv`, `changes.csv`) into a new folder.

    Raises
    ------
    StorageError
        Where the folder holds files, or cannot be written; nothing is then left behind.
    """
    record = {
        "format": FORMAT,
        "project": source.project.name,
        "calibration": source.calibration,
        "verdicts": [one.text for one in mesh_verdicts(found)],
        "study": asdict(found),
        "hashes": dict(source.project.hashes),
        "versions": installed_versions(),
    }
    with new_folder(folder) as part:
        write_text(part / PARAMETERS, parameters_csv(found))
        write_text(part / CHANGES, changes_csv(found))
        write_text(part / STUDY, json.dumps(record, indent=2, allow_nan=False) + "\n")


@dataclass(frozen=True)
class StoredStudy:
    """A study read back, and the calibration that it is of, "" for a project's."""

    study: MeshStudy
    calibration: str

    def is_of(self, results: Mapping[str, CalibrationResult]) -> bool:
        """Whether the run still has the values that were studied."""
        result = results.get(self.calibration)
        found = {label: e.value for label, e in self.study.parameters.items()}
        return result is not None and found == {label: e.value for label, e in result.parameters.items()}


def read_study(folder: Path) -> StoredStudy | None:
    """The study in a folder, or None where there is none.

    Raises
    ------
    StorageError
        Where it cannot be read.
    """
    path = folder / STUDY
    if not path.is_file():
        return None
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if record["format"] != FORMAT:
            raise StorageError(Fault("the study is of another format", str(path), str(record["format"]), str(FORMAT)))
        return StoredStudy(_study(record["study"]), record["calibration"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise StorageError(Fault("the mesh study cannot be read", str(path), str(error))) from error


def parameters_csv(found: MeshStudy) -> str:
    """A row for every discretisation and parameter: what was found, its standard error, what is expected there [SI]."""
    header = ["discretisation", "unknowns", "parameter", "unit", "found", "standard_error", "expected", "shift"]
    rows: list[list[object]] = [[*header, "shift over standard error [1]", "at_bound", "status"]]
    for one in found.finer:
        first = [one.name, "" if one.size is None else one.size.unknowns]
        if one.failure:
            rows.append([*first, *[""] * 8, one.failure])
        for label, value in one.values.items():
            estimate = found.parameters[label]
            shift, error = value - estimate.value, estimate.standard_error
            told = [label, estimate.unit, estimate.value, "" if error is None else error, value, shift]
            rows.append([*first, *told, shift / error if error else "", label in one.at_bound, "simulated"])
    return _csv(rows)


def changes_csv(found: MeshStudy) -> str:
    """A row for every discretisation, experiment and channel: how much it changes, beside noise and residual [SI]."""
    header = ["discretisation", "experiment", "of", "unit", "RMS change", "relative [1]", "noise sd", "RMSE of the fit"]
    rows: list[list[object]] = [[*header, "n [1]", "order [1]"]]
    for one in found.finer:
        for c in one.changes:
            numbers = [c.rms, c.share, c.noise, c.residual, c.n, c.order]
            rows.append([one.name, c.experiment, c.name, c.unit, *("" if x is None else x for x in numbers)])
    return _csv(rows)


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
    return StudySource(problem, {name: e.value for name, e in result.parameters.items()}, label, run.project)


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


def _study(data: dict[str, Any]) -> MeshStudy:
    return MeshStudy(
        parameters={label: Estimate(**one) for label, one in data["parameters"].items()},
        of_robot=tuple(data["of_robot"]),
        loss=data["loss"],
        loss_name=data["loss_name"],
        elements=tuple(data["elements"]),
        element=data["element"],
        size=Size(**data["size"]),
        finer=tuple(_finer(one) for one in data["finer"]),
        reference=data["reference"],
        notes=tuple(data["notes"]),
    )


def _finer(data: dict[str, Any]) -> Finer:
    held: dict[str, Any] = dict(data)
    held["size"] = None if data["size"] is None else Size(**data["size"])
    held["changes"] = tuple(Change(**change) for change in data["changes"])
    held["at_bound"] = tuple(data["at_bound"])
    return Finer(**held)


def _csv(rows: list[list[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
