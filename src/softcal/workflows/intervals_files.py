"""Files of an interval study, written and read: `intervals.json` and `points.csv`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from softcal.calibration.interval_studies.checked_interval import IntervalStudy
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.stored import Record, contradiction, read_rows
from softcal.csv_text import csv_text
from softcal.project.project import Project
from softcal.workflows.study_files import are_values_of, read_study_record, write_study_files

STUDY, POINTS, EXCESS = "intervals.json", "points.csv", "excess"
_WHAT = "the interval study"


def folder_name(by: str, over: str = "") -> str:
    """The folder of a study in a run."""
    return "-".join(["intervals", by, *([over] if over else [])])


def write_intervals(found: IntervalStudy, project: Project, calibration: str, folder: Path) -> None:
    """Write the study (`intervals.json`) and its points (`points.csv`) into a new folder.

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
    record = {"sentences": list(found.sentences), "study": asdict(replace(found, points={}, excess=()))}
    write_study_files(folder, STUDY, record, {POINTS: points_csv(found)}, project, calibration)


def points_csv(found: IntervalStudy) -> str:
    """A row per point: the parameters [SI], and where there is a likelihood its excess over the least."""
    header = [f"{label} [{found.intervals[label].unit}]" for label in found.points]
    columns = list(found.points.values())
    if found.excess:
        header, columns = [*header, EXCESS], [*columns, found.excess]
    return csv_text(header, zip(*columns, strict=True))


class _IntervalsRecord(Record):
    study: IntervalStudy
    calibration: str


@dataclass(frozen=True)
class StoredIntervals:
    """A stored study and the label of its calibration."""

    study: IntervalStudy
    calibration: str

    def is_of(self, results: Mapping[str, CalibrationResult]) -> bool:
        """Whether the run's values are still the studied ones."""
        values = {label: one.value for label, one in self.study.intervals.items()}
        return are_values_of(values, results.get(self.calibration))


def read_intervals(folder: Path) -> StoredIntervals | None:
    """The study in a folder, or None.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    record = read_study_record(_IntervalsRecord, folder / STUDY, _WHAT)
    if record is None:
        return None
    header, rows = read_rows(folder / POINTS, _WHAT)
    columns: dict[str, tuple[float, ...]] = {}
    for title, cells in zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True):
        columns[title.rpartition(" [")[0] or title] = tuple(_number(folder / POINTS, cell) for cell in cells)
    excess = columns.pop(EXCESS, ())
    if columns and set(columns) != set(record.study.intervals):
        raise contradiction(folder / POINTS, _WHAT, f"its columns are not the parameters of {STUDY}")
    return StoredIntervals(replace(record.study, points=columns, excess=excess), record.calibration)


def _number(path: Path, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise contradiction(path, _WHAT, f"'{cell[:40]}' stands in the place of a number")
    return value
