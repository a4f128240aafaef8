"""Files of a mesh study, written and read: `mesh-study.json`, with tables of parameters and channels."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from softcal.analysis.mesh_study import MeshStudy
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.outcome import installed_versions
from softcal.calibration.result import CalibrationResult
from softcal.calibration.store import write_text
from softcal.calibration.stored import Record, read_record
from softcal.csv_text import csv_text
from softcal.project.project import Project
from softcal.workflows.output import new_folder

FOLDER, STUDY, PARAMETERS, CHANGES = "mesh-study", "mesh-study.json", "parameters.csv", "changes.csv"
FORMAT = 1


def write_study(found: MeshStudy, project: Project, calibration: str, folder: Path) -> None:
    """Write the study (`mesh-study.json`) and its tables (`parameters.csv`, `changes.csv`) into a new folder.

    calibration: label of the studied calibration of a run, or "".

    Raises
    ------
    StorageError
        If the folder holds files, or cannot be written; nothing is then written.
    """
    record = {
        "format": FORMAT,
        "project": project.name,
        "calibration": calibration,
        "verdicts": [one.text for one in mesh_verdicts(found)],
        "study": asdict(found),
        "hashes": dict(project.hashes),
        "versions": installed_versions(),
    }
    with new_folder(folder) as part:
        write_text(part / PARAMETERS, parameters_csv(found))
        write_text(part / CHANGES, changes_csv(found))
        write_text(part / STUDY, json.dumps(record, indent=2, allow_nan=False) + "\n")


class _StudyRecord(Record):
    study: MeshStudy
    calibration: str


@dataclass(frozen=True)
class StoredStudy:
    """A stored study and the label of its calibration, "" for a project's study."""

    study: MeshStudy
    calibration: str

    def is_of(self, results: Mapping[str, CalibrationResult]) -> bool:
        """Whether the run's values are still the studied ones."""
        result = results.get(self.calibration)
        found = {label: e.value for label, e in self.study.parameters.items()}
        return result is not None and found == {label: e.value for label, e in result.parameters.items()}


def read_study(folder: Path) -> StoredStudy | None:
    """The study in a folder, or None.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    path = folder / STUDY
    if not path.is_file():
        return None
    record = read_record(_StudyRecord, path, "the mesh study", FORMAT)
    return StoredStudy(record.study, record.calibration)


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
