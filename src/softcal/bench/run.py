"""Run a case with softcal, or score any method's predictions of it; both leave the same files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from softcal.bench.case import CASES, BenchmarkCase, Progress
from softcal.bench.predictions import Predictions, read_predictions
from softcal.bench.record import CaseRecord
from softcal.bench.score import Score, score
from softcal.executors.executor import Executor
from softcal.workflows.output import new_folder, require_free_folder

PREDICTIONS, SCORE = "predictions.csv", "score.json"


@dataclass(frozen=True)
class Ran:
    """The score of softcal's own predictions, and the folder with its files."""

    score: Score
    folder: Path


def run_case(
    name: str,
    out: Path,
    *,
    data: Path | None = None,
    workers: int | Executor = 1,
    progress: Progress = lambda stage: None,
) -> Ran:
    """softcal's predictions of a case, fitted to the samples of the fit alone, with their score.

    Writes `predictions.csv` and `score.json` into a folder that is new or empty.

    Raises
    ------
    SoftcalError
        For an unknown case, further data in another layout, a folder that cannot be used, or a fit without a result.
    """
    case = CASES.named(name)
    record = case.record(data)
    require_free_folder(out)
    found = case.run(data, workers=workers, progress=progress)
    return Ran(_written(case, record, found, out, data), out)


def score_file(
    name: str, predictions: Path, *, data: Path | None = None, method: str = "", out: Path | None = None
) -> Score:
    """The score of a table of predictions, by any program; `out`: a folder for its files, new or empty.

    Raises
    ------
    InputError
        For an unknown case, or with everything that is wrong with the table.
    """
    case = CASES.named(name)
    record = case.record(data)
    found = read_predictions(predictions, record, method, aligned=case.aligned)
    if out is None:
        return _scored(case, record, found, data)
    return _written(case, record, found, out, data)


def _scored(case: BenchmarkCase, record: CaseRecord, found: Predictions, data: Path | None) -> Score:
    return score(case.name, record, found, aligned=case.aligned, data="" if data is None else data.name)


def _written(case: BenchmarkCase, record: CaseRecord, found: Predictions, out: Path, data: Path | None) -> Score:
    result = _scored(case, record, found, data)
    with new_folder(out) as folder:
        (folder / PREDICTIONS).write_text(found.text(record.units), encoding="utf-8")
        (folder / SCORE).write_text(json.dumps(result.as_json(), indent=2) + "\n", encoding="utf-8")
    return result
