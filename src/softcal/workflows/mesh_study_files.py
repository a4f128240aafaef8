"""Files of a mesh study, written and read: `mesh-study.json`, with tables of parameters and channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from softcal.analysis.mesh_study import MeshStudy
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.stored import Record
from softcal.csv_text import csv_text
from softcal.project.project import Project
from softcal.workflows.study_files import are_values_of, read_study_record, write_study_files

STUDY, PARAMETERS, CHANGES = "mesh-study.json", "parameters.csv", "changes.csv"


def write_study(found: MeshStudy, project: Project, calibration: str, folder: Path) -> None:
    """Write the study (`mesh-study.json`) and its tables (`parameters.csv`, `changes.csv`) into a new folder.

    Parameters
    ----------
    found
        The study.
    project
        Of the study, with its hashes.
    calibration
        Label of the studied calibration of a run, or "".
    folder
        New or empty.

    Raises
    ------
    StorageError
        If the folder holds files, or cannot be written; nothing is then written.
    """
    record = {"verdicts": [one.text for one in mesh_verdicts(found)], "study": asdict(found)}
    tables = {PARAMETERS: parameters_csv(found), CHANGES: changes_csv(found)}
    write_study_files(folder, STUDY, record, tables, project, calibration)


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
        values = {label: e.value for label, e in self.study.parameters.items()}
        return are_values_of(values, results.get(self.calibration))


def read_study(folder: Path) -> StoredStudy | None:
    """The study in a folder, or None.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    record = read_study_record(_StudyRecord, folder / STUDY, "the mesh study")
    return None if record is None else StoredStudy(record.study, record.calibration)


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
