"""A run folder: the project as used with copies of all its inputs, every calibration, and the headline's files.

project.yaml, inputs/…, run.json      the input; sufficient to load the project from any location of the folder
calibrations/<label>/…                each calibration with every trial (see `softcal.calibration.results.store`)
result.json, trials.csv, response-<experiment>.csv      the headline result, and the trials of all calibrations
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Annotated, Any

from pydantic import AfterValidator, Field, ValidatorFunctionWrapHandler, WrapValidator

from softcal.calibration.results.result import CalibrationResult, SearchResult, SweepResult
from softcal.calibration.results.result_files import fits_of, response_file, result_json
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.store import RESULT, write_bytes, write_text
from softcal.calibration.results.stored import (
    Record,
    contradiction,
    read_bytes,
    read_record,
    require_unchanged,
    sealed,
)
from softcal.calibration.search.outcome import installed_versions
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, StorageError
from softcal.geometry.write import write_mesh
from softcal.project.calibration_schema import CalibrationSection
from softcal.project.files import sha256, stored_mesh
from softcal.project.project import Project, load
from softcal.regular_file import not_a_file, require_inside
from softcal.twin.parameters import robot_parameters
from softcal.workflows.output import new_folder, require_writable, unwritable
from softcal.workflows.run import SWEEP, CalibrationRun, SweepRun, headline_of

FORMAT = 1
PROJECT, RECORD, INPUTS, CALIBRATIONS = "project.yaml", "run.json", "inputs", "calibrations"


def _inside(place: str) -> str:
    """Validate that a path is inside the run's folder."""
    if not place or PurePath(place).is_absolute() or ".." in PurePath(place).parts or "\0" in place:
        raise ValueError("a path within the run's folder is needed")
    return place


def _as_written(value: dict[str, Any], handler: ValidatorFunctionWrapHandler) -> CalibrationSection:
    """Settings in the form that a run writes; project files allow several spellings."""
    section: CalibrationSection = handler(value)
    written = section.model_dump()
    if json.dumps(value, sort_keys=True) != json.dumps({key: written[key] for key in value}, sort_keys=True):
        raise ValueError("a run writes its settings in another form")
    return section


_Place = Annotated[str, AfterValidator(_inside)]


class _RunRecord(Record):
    values: dict[str, float]
    changes: dict[str, Any] = Field(default_factory=dict[str, Any])  # earlier records have none
    copies: dict[str, _Place]
    calibrations: Annotated[list[_Place], Field(min_length=1)]
    settings: Annotated[CalibrationSection, WrapValidator(_as_written)]
    hashes: dict[str, str]
    versions: dict[str, str]
    created: str


def calibration_folder(folder: Path, label: str) -> Path:
    """Folder of one of a run's calibrations."""
    return folder / CALIBRATIONS / label


def begin_run(project: Project, settings: CalibrationSection, labels: list[str], folder: Path) -> None:
    """Write a new run folder with all inputs of the run, completely or not at all.

    Parameters
    ----------
    project
        With its files.
    settings
        Settings of the calibration.
    labels
        Labels of the calibrations, in order.
    folder
        New or empty.

    Raises
    ------
    StorageError
        Where the folder holds files, or cannot be written, or the project's files have changed since it was loaded.
    """
    sources = {project.path.name: project.path, **project.inputs}
    if changed := [path.absolute() for name, path in sources.items() if _digest(path) != project.hashes[name]]:
        what, attempt = "the file has changed or gone since the project was loaded", "load the project again"
        raise StorageError([Fault(what, str(path), attempt=attempt) for path in changed])
    with new_folder(folder, "another --out, or --resume to go on with the run in it") as part:
        try:
            shutil.copyfile(project.path, part / PROJECT)
            copies = _copy_inputs(project, part)
            made = {name: sha256(part / place) for name, place in copies.items() if name not in project.hashes}
        except OSError as error:
            raise unwritable(folder, error) from error
        record = {
            "format": FORMAT,
            "project": project.name,
            "values": dict(project.held),
            "changes": dict(project.changes),
            "copies": copies,
            "calibrations": labels,
            "settings": settings.model_dump(),
            "hashes": {**project.hashes, **made},
            "versions": installed_versions(),
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
        }
        write_text(part / RECORD, sealed(record))


def reopen_run(project: Project, folder: Path) -> None:
    """Check that a run can be resumed.

    Raises
    ------
    StorageError
        If the folder holds no run of this project, the project's files have changed since the run began, or the folder
        cannot be written.
    """
    record = _record(folder)
    require_inside(folder, [f"{CALIBRATIONS}/{label}" for label in record.calibrations])
    _require_unchanged(folder, record)
    what, attempt = "the file was changed after the run began", "restore it, or use another --out without --resume"
    if changed := _changed_inputs(project, record):
        raise StorageError([Fault(what, str(project.inputs[written]), attempt=attempt) for written in changed])
    if record.values != dict(project.held):
        raise StorageError(
            Fault("the run has other fixed parameters", str(folder), str(dict(project.held)), str(record.values))
        )
    if record.changes != dict(project.changes):
        raise StorageError(
            Fault("the run has other entries", str(folder), str(dict(project.changes)), str(record.changes))
        )
    require_writable(folder)


def inputs_changed(project: Project, folder: Path) -> bool:
    """Whether files of a project have changed since its run in a folder began.

    Raises
    ------
    StorageError
        If the folder holds no run.
    """
    return bool(_changed_inputs(project, _record(folder)))


def _changed_inputs(project: Project, record: _RunRecord) -> list[str]:
    """The project's files that are others than the run's, as they are written."""
    return [
        written
        for written, digest in project.hashes.items()
        if written in project.inputs and record.hashes.get(written, digest) != digest
    ]


def finish_run(project: Project, results: Mapping[str, CalibrationResult], folder: Path) -> None:
    """Write the headline's files beside the calibrations; result.json last.

    Parameters
    ----------
    project
        Project of the run.
    results
        Label -> calibration.
    folder
        The run folder.

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    label, headline = headline_of(results)
    _finish(project, label, headline, results, folder, {})


def finish_sweep(project: Project, result: SweepResult, folder: Path, told: Mapping[str, Any]) -> None:
    """See `finish_run`; for a sweep.

    Parameters
    ----------
    project
        Project of the run.
    result
        The sweep.
    folder
        The run folder.
    told
        What result.json has of it under "sweep".

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    _finish(project, SWEEP, result, {SWEEP: result}, folder, {SWEEP: told})


def _finish(
    project: Project,
    label: str,
    headline: SearchResult,
    results: Mapping[str, SearchResult],
    folder: Path,
    more: Mapping[str, Any],
) -> None:
    try:
        for name in fits_of(headline):
            source = calibration_folder(folder, label or name) / response_file(name)
            write_bytes(folder / source.name, read_bytes(source, "the response"))
    except OSError as error:
        raise unwritable(folder, error) from error
    units = {name: e.unit for result in results.values() for name, e in result.parameters.items()}
    fixed = ["calibration", "number", "state", "loss", "seconds [s]", "n_factorisations", "reason"]
    rows = [
        [label, t.number, t.state, t.loss, t.seconds, t.n_factorisations, t.reason, *(t.theta.get(n) for n in units)]
        for label, result in results.items()
        for t in result.trials
    ]
    heads = [*fixed, *(f"{name} [{unit}]" for name, unit in units.items())]
    write_text(folder / "trials.csv", csv_text(heads, rows))
    summaries = {name: result_json(result) for name, result in results.items()}
    document = {
        **result_json(replace(headline, hashes={**project.hashes, **headline.hashes})),
        "project": project.name,
        "values": dict(project.held),
        "headline": label or "each experiment by itself",
        "calibrations": {
            name: {key: value for key, value in full.items() if key not in ("versions", "hashes")}
            for name, full in summaries.items()
        },
        **more,
    }
    write_text(folder / RESULT, sealed(document))


@checked_arguments
def load_run(folder: str | Path) -> CalibrationRun | SweepRun:
    """Read a run, independent of its folder's location and of the original project.

    Raises
    ------
    StorageError
        If there is no run or no result yet, a file is missing or damaged, or an input has changed.
    ProjectFileError
        Where the project in it cannot be loaded.
    InputError
        For anything but a path.
    """
    folder = Path(folder)
    record = _record(folder)
    project, settings = project_of_run(folder)
    results = {
        label: load_result(calibration_folder(folder, label))
        for label in record.calibrations
        if (calibration_folder(folder, label) / RESULT).is_file()
    }
    if not results:
        raise StorageError(
            Fault("the run has no result yet", str(folder), attempt="softcal calibrate … --resume, to go on with it")
        )
    for label, result in results.items():
        strangers = sorted({*result.experiments, *result.held_out} - set(project.experiments))
        if strangers:
            where = str(calibration_folder(folder, label))
            raise StorageError(
                Fault("the result is of an experiment that the run does not have", where, ", ".join(strangers))
            )
    _require_project(folder, project, settings, results)
    if (headline := folder / RESULT).is_file():
        require_unchanged(read_bytes(headline, "the result"), headline, "the result")
    about = (folder, project, settings, record.versions, record.hashes, record.created)
    calibrations = {label: result for label, result in results.items() if isinstance(result, CalibrationResult)}
    match list(results.values()):
        case [SweepResult() as swept]:
            return SweepRun(*about, swept)
        case _ if len(calibrations) == len(results):
            return CalibrationRun(*about, calibrations)
        case _:
            raise contradiction(folder / CALIBRATIONS, "the run", "there is a sweep among its calibrations")


def _require_project(
    folder: Path, project: Project, settings: CalibrationSection, results: Mapping[str, SearchResult]
) -> None:
    """Check that results have the units, bounds and loss of the project, by which everything is shown."""
    units = {name: one.unit for name, one in robot_parameters(project.robot).items()}
    units |= {one.name: one.unit for one in (project.space.parameters if project.space else ())}
    faults = [
        Fault(
            f"{name} has another unit than in the project",
            str(calibration_folder(folder, label)),
            f"'{one.unit}'",
            unit,
        )
        for label, result in results.items()
        for name, one in result.parameters.items()
        if (unit := units.get(name.partition("[")[0], one.unit)) != one.unit
    ]
    space = {one.name: one for one in (project.space.parameters if project.space else ())}
    for label, result in results.items():
        where = str(calibration_folder(folder, label))
        for name, one in result.parameters.items() if isinstance(result, CalibrationResult) else ():
            of = space.get(name.partition("[")[0])
            if of is not None and (one.lower, one.upper, one.scale) != (of.lower, of.upper, of.scale):
                got, allowed = (f"{p.lower:g} to {p.upper:g} {of.unit}, {p.scale}" for p in (one, of))
                faults.append(Fault(f"{name} has other bounds than in the project", where, got, allowed))
        if isinstance(result, CalibrationResult) and result.loss_name != settings.loss:
            faults.append(Fault("the loss differs from that of the run", where, result.loss_name, settings.loss))
    if faults:
        raise StorageError(faults)


def project_of_run(folder: str | Path) -> tuple[Project, CalibrationSection]:
    """The project and the settings of a run that may still be searching, by the copies in its folder.

    Raises
    ------
    StorageError
        If there is no run, or an input of it is missing, has changed or lies outside the folder.
    ProjectFileError
        Where the project in it cannot be loaded.
    """
    folder = Path(folder)
    record = _record(folder)
    _require_unchanged(folder, record)
    project = load(folder / PROJECT, values=record.values, copies=record.copies, changes=record.changes)
    return project, record.settings


def refuse_project_folder(folder: Path) -> None:
    """Check that a folder is a run and not a project's, of which the project file is the valid argument.

    Raises
    ------
    StorageError
        Where it is.
    """
    if (folder / PROJECT).is_file() and not (folder / RECORD).is_file():
        allowed = "a folder that softcal calibrate wrote, or a project file"
        raise StorageError(Fault("there is no run here", str(folder), f"no {RECORD}", allowed, str(folder / PROJECT)))


def _record(folder: Path) -> _RunRecord:
    path = folder / RECORD
    if not_a_file(path):
        raise StorageError(
            Fault("there is no run here", str(folder), f"no {RECORD}", "a folder that softcal calibrate wrote")
        )
    require_inside(folder, [RECORD, PROJECT])
    return read_record(_RunRecord, path, "the record of the run", FORMAT)


def _require_unchanged(folder: Path, record: _RunRecord) -> None:
    """Check that the run's inputs are unchanged and its own, so that a report shows the data of its results, and no
    file from elsewhere.
    """
    require_inside(folder, record.copies.values())
    faults: list[Fault] = []
    for number, (written, before) in enumerate(record.hashes.items()):
        # First comes the project's file, which is called otherwise here than it may have been.
        path = folder / (record.copies.get(written, written) if number else PROJECT)
        missing = not_a_file(path)
        what = "a file of the run is missing" if missing else "the file was changed after the calibration"
        try:
            is_changed = bool(missing) or sha256(path) != before
        except OSError as error:
            raise StorageError(Fault("the file cannot be read", str(path), error.strerror or str(error))) from error
        if is_changed:
            attempt = "restore it, or softcal calibrate the changed project with another --out"
            faults.append(Fault(what, str(path), attempt=attempt))
    # As of meshes that were generated before runs kept their hashes.
    faults += [
        Fault(
            "the run has no hash of the file at the time of the calibration",
            str(folder / place),
            f"no hash of it in {RECORD}",
            attempt="softcal calibrate the project again, with another --out",
        )
        for written, place in record.copies.items()
        if written not in record.hashes
    ]
    if faults:
        raise StorageError(faults)


def _digest(path: Path) -> str:
    """SHA-256 of a file; "" where it cannot be read."""
    try:
        return sha256(path)
    except OSError:
        return ""


def _copy_inputs(project: Project, folder: Path) -> dict[str, str]:
    """Copy the project's input files; files outside its folder get a numbered folder each."""
    copies: dict[str, str] = {}
    for number, (written, path) in enumerate(project.inputs.items()):
        inside = not PurePath(written).is_absolute() and not {"..", "~"} & set(PurePath(written).parts)
        place = Path(INPUTS, written) if inside else Path(INPUTS, "elsewhere", f"{number}-{path.name}")
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, folder / place)
        copies[written] = place.as_posix()
    for name, mesh in project.generated.items():
        place = Path(INPUTS, "meshes", f"{name}.vtu")
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        write_mesh(mesh, folder / place)
        copies[stored_mesh(name)] = place.as_posix()
    return copies
