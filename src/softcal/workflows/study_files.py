"""The kinds of studies, and how each is stored: a record of it and what was studied, beside tables, in a new folder."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.store import write_text
from softcal.calibration.results.stored import Record, read_record, sealed
from softcal.calibration.search.outcome import installed_versions
from softcal.project.project import Project
from softcal.workflows.output import new_folder

FORMAT = 1
S = TypeVar("S")


class _StudyRecord(Record, Generic[S]):
    study: S
    calibration: str


@dataclass(frozen=True)
class StudyKind(Generic[S]):
    """A kind of study, by the dataclass of its results.

    Attributes
    ----------
    what
        Its name in messages, such as "the mesh study".
    study
        The dataclass, which is the schema of its record.
    file
        Name of the record, which is written last.
    sentences
        What it says in words.
    tables
        File -> text of a table.
    folder
        Its folder in a run, by default; "" where it has none.
    is_of
        Whether a study is still one of a calibration's result.
    slim, complete
        The study without what its tables have, and the same of a folder with it again.
    """

    what: str
    study: type[S]
    file: str
    sentences: Callable[[S], Sequence[str]]
    tables: Mapping[str, Callable[[S], str]]
    folder: str = ""
    is_of: Callable[[S, CalibrationResult], bool] = lambda study, result: True
    slim: Callable[[S], S] = lambda study: study
    complete: Callable[[S, Path], S] = lambda study, folder: study

    def write(self, study: S, project: Project, calibration: str, folder: Path) -> None:
        """Write a study, its record and its tables, into a new folder.

        Parameters
        ----------
        study
            The study.
        project
            Project of the study, with its hashes.
        calibration
            Label of the studied calibration of a run, or "".
        folder
            New or empty.

        Raises
        ------
        StorageError
            If the folder holds files, or cannot be written; nothing is then written.
        """
        entries: Any = self.slim(study)
        record = {
            "format": FORMAT,
            "project": project.name,
            "calibration": calibration,
            "sentences": list(self.sentences(study)),
            "study": asdict(entries),
            "hashes": dict(project.hashes),
            "versions": installed_versions(),
        }
        with new_folder(folder) as part:
            for table, text in self.tables.items():
                write_text(part / table, text(study))
            write_text(part / self.file, sealed(record))

    def read(self, folder: Path) -> StoredStudy[S] | None:
        """The study in a folder, or None.

        Raises
        ------
        StorageError
            Where it cannot be read, or is damaged.
        """
        path = folder / self.file
        if not path.is_file():
            return None
        record = read_record(_StudyRecord[self.study], path, self.what, FORMAT)
        return StoredStudy(self, self.complete(record.study, folder), record.calibration)


@dataclass(frozen=True)
class StoredStudy(Generic[S]):
    """A stored study and the label of its calibration, "" for a project's study."""

    kind: StudyKind[S]
    study: S
    calibration: str

    def is_of(self, results: Mapping[str, CalibrationResult]) -> bool:
        """Whether the study still belongs to a run's results."""
        result = results.get(self.calibration)
        return result is not None and self.kind.is_of(self.study, result)


def has_values(result: CalibrationResult, values: Mapping[str, float]) -> bool:
    """Whether the study has the values of a result [SI by label]."""
    return dict(values) == {label: e.value for label, e in result.parameters.items()}
