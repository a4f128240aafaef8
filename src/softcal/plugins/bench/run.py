"""Run a case with softcal, or score any method's predictions of it; both leave the same files."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from softcal.calibration.results.store import write_text
from softcal.calibration.results.stored import as_json
from softcal.errors import Fault, StorageError
from softcal.executors.executor import Executor
from softcal.plugins.bench.case import CASES, BenchmarkCase, Progress
from softcal.plugins.bench.predictions import Predictions, read_predictions
from softcal.plugins.bench.record import CaseRecord
from softcal.plugins.bench.score import Score, score
from softcal.workflows.output import new_folder, require_free_folder

PREDICTIONS, SCORE, FIT = "predictions.csv", "score.json", "fit"


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
    resume: bool = False,
    progress: Progress = lambda stage: None,
) -> Ran:
    """softcal's predictions of a case, fitted to the samples of the fit alone, with their score.

    Writes `predictions.csv` and `score.json`, beside `fit`, the run folder of the fit, where the case has one.

    Parameters
    ----------
    name
        Case of `softcal bench list`.
    out
        Folder that is new or empty, or that of the run to be resumed.
    data, workers, progress
        See `BenchmarkCase.run`.
    resume
        Go on with the fit of a run of the same case that was stopped.

    Raises
    ------
    StorageError
        Where the folder holds files, or no fit to resume.
    SoftcalError
        For an unknown case, further data in another layout, a folder that cannot be used, or a fit without a result.
    """
    case = CASES.named(name)
    record = case.record(data)
    if resume:
        if (out / SCORE).exists():
            raise StorageError(
                Fault("the folder has a finished run of the case", str(out), f"{SCORE} in it", attempt="another --out")
            )
        if not (out / FIT).is_dir():
            raise StorageError(Fault("there is no fit to resume", str(out), attempt="without --resume"))
    else:
        require_free_folder(out)
    found = case.run(data, workers=workers, store=out / FIT, resume=resume, progress=progress)
    out.mkdir(parents=True, exist_ok=True)
    result = _scored(case, record, found, data)
    for file, text in _texts(record, found, result).items():
        write_text(out / file, text)
    return Ran(result, out)


def score_file(
    name: str, predictions: Path, *, data: Path | None = None, method: str = "", out: Path | None = None
) -> Score:
    """The score of a table of predictions, by any program.

    Parameters
    ----------
    name
        Case of `softcal bench list`.
    predictions, method
        See `read_predictions`.
    data
        See `BenchmarkCase.run`.
    out
        Folder for the files of the score, new or empty; None to write nothing.

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
    result = _scored(case, record, found, data)
    with new_folder(out) as folder:
        for file, text in _texts(record, found, result).items():
            (folder / file).write_text(text, encoding="utf-8")
    return result


def _scored(case: BenchmarkCase, record: CaseRecord, found: Predictions, data: Path | None) -> Score:
    # A name may be of bytes that are no text, which JSON cannot have.
    name = "" if data is None else data.name.encode("utf-8", "replace").decode()
    return score(case.name, record, found, aligned=case.aligned, data=name)


def _texts(record: CaseRecord, found: Predictions, result: Score) -> dict[str, str]:
    """The files of scored predictions, by name; the score, which says that they are whole, last."""
    return {PREDICTIONS: found.text(record.units), SCORE: json.dumps(as_json(result), indent=2) + "\n"}
