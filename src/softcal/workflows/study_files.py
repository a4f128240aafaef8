"""What the files of every study share: a record that says what was studied, beside its tables, in a new folder."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.store import write_text
from softcal.calibration.results.stored import Record, read_record
from softcal.calibration.search.outcome import installed_versions
from softcal.project.project import Project
from softcal.workflows.output import new_folder

FORMAT = 1
R = TypeVar("R", bound=Record)


def write_study_files(
    folder: Path, name: str, found: Mapping[str, Any], tables: Mapping[str, str], project: Project, calibration: str
) -> None:
    """Write a study's record and its tables into a new folder.

    Parameters
    ----------
    name
        File of the record, which is written last.
    found
        Entries of the record.
    tables
        File -> text of a table.
    project, calibration
        What was studied: the project, and the label of its calibration, "" without one.

    Raises
    ------
    StorageError
        If the folder holds files, or cannot be written; nothing is then written.
    """
    record = {
        "format": FORMAT,
        "project": project.name,
        "calibration": calibration,
        **found,
        "hashes": dict(project.hashes),
        "versions": installed_versions(),
    }
    with new_folder(folder) as part:
        for table, text in tables.items():
            write_text(part / table, text)
        write_text(part / name, json.dumps(record, indent=2, allow_nan=False) + "\n")


def are_values_of(values: Mapping[str, float], result: CalibrationResult | None) -> bool:
    """Whether the values [SI by label] that were studied are still those of a result."""
    return result is not None and dict(values) == {label: e.value for label, e in result.parameters.items()}


def read_study_record(kind: type[R], path: Path, what: str) -> R | None:
    """The record of a study, or None where there is none.

    Parameters
    ----------
    kind
        Dataclass of the record.
    path
        Its file.
    what
        Name of the study in messages.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    return read_record(kind, path, what, FORMAT) if path.is_file() else None
