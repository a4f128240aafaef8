"""Files of an importance study, written and read: `importance.json` and `indices.csv`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from softcal.analysis.importance import ImportanceStudy, Range
from softcal.analysis.importance_verdict import importance_sentences
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.stored import Record
from softcal.csv_text import csv_text
from softcal.project.project import Project
from softcal.workflows.study_files import read_study_record, write_study_files

STUDY, INDICES = "importance.json", "indices.csv"


def write_importance(found: ImportanceStudy, project: Project, calibration: str, folder: Path) -> None:
    """Write the study (`importance.json`) and its indices (`indices.csv`) into a new folder.

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
    record = {"sentences": list(importance_sentences(found)), "study": asdict(found)}
    write_study_files(folder, STUDY, record, {INDICES: indices_csv(found)}, project, calibration)


def indices_csv(found: ImportanceStudy) -> str:
    """A row per output and parameter, or pair of them: its index with its error [-]."""
    rows: list[list[object]] = []
    for name, output in found.outputs.items():
        for order, indices in (("first", output.first), ("total", output.total)):
            for label, one in indices.items():
                rows.append([name, order, label, "", one.value, one.error])
        for pair in output.pairs:
            rows.append([name, "pair", *pair.labels, pair.index.value, pair.index.error])
    return csv_text(["output", "order", "parameter", "with", "index [1]", "error [1]"], rows)


class _ImportanceRecord(Record):
    study: ImportanceStudy
    calibration: str


@dataclass(frozen=True)
class StoredImportance:
    """A stored study and the label of its calibration, "" for a project's study."""

    study: ImportanceStudy
    calibration: str

    def is_of(self, results: Mapping[str, CalibrationResult]) -> bool:
        """Whether the run searched within the studied bounds."""
        result = results.get(self.calibration)
        return result is not None and self.study.ranges == {
            label: Range(e.lower, e.upper, e.unit, e.scale) for label, e in result.parameters.items()
        }


def read_importance(folder: Path) -> StoredImportance | None:
    """The study in a folder, or None.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    record = read_study_record(_ImportanceRecord, folder / STUDY, "the importance study")
    return None if record is None else StoredImportance(record.study, record.calibration)
