"""A result read back from its files, each part checked by its schema and against the others."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_json

from softcal.calibration.problem.loss import rms, rms_detrended
from softcal.calibration.results.result import CalibrationResult, ExperimentFit, SweepResult, Trial
from softcal.calibration.results.result_files import FORMAT, TRIAL_COLUMNS, TRIALS, response_file
from softcal.calibration.results.store import RESULT
from softcal.calibration.results.stored import (
    Amount,
    Count,
    Record,
    as_document,
    as_record,
    contradiction,
    damaged,
    read_bytes,
    read_rows,
    require_unchanged,
)
from softcal.checks import Floats
from softcal.errors import Fault, StorageError
from softcal.sensing.channel import channel_name

_WHAT = "the result"
# Keys of every file, whose fields a result in Python may leave out.
_ALWAYS = ("converged", "notes", "extra", "versions", "hashes")
_SAME = 1e-6  # relative; of an error that is computed again from its table


def load_result(folder: Path) -> CalibrationResult | SweepResult:
    """The result that `write_result` wrote.

    Raises
    ------
    StorageError
        Where a file is missing or damaged, or the files contradict each other.
    """
    path = folder / RESULT
    if not path.is_file():
        raise StorageError(
            Fault("there is no result", where=str(path), attempt="softcal calibrate with this folder, or --resume")
        )
    text = read_bytes(path, _WHAT)
    document = as_document(text, path, _WHAT)
    if missing := [f"{key}: field required" for key in _ALWAYS if key not in document]:
        raise contradiction(path, _WHAT, ", ".join(missing))
    kind = _record(document)
    record = as_record(kind, to_json(document), path, _WHAT, FORMAT)
    for name, entry in {**document["experiments"], **document.get("held_out", {})}.items():
        if entry.get("file") != response_file(name):
            raise contradiction(path, _WHAT, f"the table of {name} is named '{entry.get('file')}'")
    result = replace(
        record,
        experiments={name: _fit(folder, name, fit) for name, fit in record.experiments.items()},
        held_out={name: replace(one, fit=_fit(folder, name, one.fit)) for name, one in record.held_out.items()},
        trials=_trials(folder / TRIALS),
    )
    if isinstance(result, SweepResult):
        cells = list(itertools.product(*result.axes.values()))
        for trial in result.trials:
            cell = dict(zip(result.axes, cells[trial.number], strict=True)) if trial.number < len(cells) else None
            if cell != dict(trial.theta):
                raise contradiction(path, _WHAT, f"trial {trial.number} in {TRIALS} is no cell of its grid")
    if not result.parameters or not result.experiments:
        raise contradiction(path, _WHAT, "it has no parameters or no experiments")
    if any(result.extra.get(key, value) != value for key, value in (("method", result.method), ("seed", result.seed))):
        raise contradiction(path, _WHAT, "its method or its seed is not that of its settings")
    values = {name: one.value for name, one in result.parameters.items()}
    if not any(trial.loss == result.loss and dict(trial.theta) == values for trial in result.trials):
        raise contradiction(path, _WHAT, f"no trial in {TRIALS} has its values and its loss")
    if len({trial.number for trial in result.trials}) < len(result.trials):
        raise contradiction(path, _WHAT, f"{TRIALS} has a trial twice")
    if sum(trial.state == "FAILED" for trial in result.trials) != result.n_failed_trials:
        raise contradiction(path, _WHAT, f"{TRIALS} has another number of failed trials")
    header, _ = read_rows(folder / TRIALS, _WHAT)
    if others := {f"{name} [{one.unit}]" for name, one in result.parameters.items()} - {*header}:
        raise contradiction(path, _WHAT, f"{TRIALS} has no {min(others)}")
    require_unchanged(text, path, _WHAT)
    return result


def _record(document: dict[str, Any]) -> type[CalibrationResult | SweepResult]:
    """The kind of result of a document, in which the changes of `result_json` to its record are undone."""
    document.setdefault("format", FORMAT)  # earlier files have none
    for part in ("experiments", "held_out"):
        entries = document.get(part)
        for entry in entries.values() if isinstance(entries, dict) else ():
            if not isinstance(entry, dict):
                continue  # which its schema refuses
            for kind in ("rmse", "rmse_detrended"):
                errors = {key: value for key, value in entry.items() if key.endswith(f"_{kind}") and value is not None}
                entry[kind] = {key.removesuffix(f"_{kind}"): value for key, value in errors.items()}
            if part == "held_out":
                entry["fit"] = {**entry}
    notes, warnings = document.get("notes"), document.get("warnings", [])
    if isinstance(notes, list) and isinstance(warnings, list):
        document["notes"] = [{"text": text, "tone": "warning" if text in warnings else "note"} for text in notes]
    extra = document.get("extra")
    if not isinstance(extra, dict):
        return CalibrationResult
    document["extra"] = {key: value for key, value in extra.items() if value is not None}
    document["axes"] = document["extra"].pop("axes", None)
    return CalibrationResult if document["axes"] is None else SweepResult


def _fit(folder: Path, name: str, errors: ExperimentFit) -> ExperimentFit:
    """The fit of an experiment, from its errors and its table."""
    path = folder / response_file(name)
    header, rows = read_rows(path, _WHAT)
    if not rows:
        raise contradiction(path, _WHAT, "there are no samples")
    # Channels of the table by family ("" for the twin's own), and their units.
    parts: dict[str, dict[str, Floats]] = {"measured": {}, "simulated": {}, "band": {}, "repeat": {}, "": {}}
    units: dict[str, str] = {}
    for column, title in enumerate(header):
        key, _, unit = title.removesuffix("]").rpartition(" [")
        family, _, channel = key.partition(".")
        family, key = (family, channel) if family in parts else ("", key)
        missing = family in ("measured", "band", "repeat")
        numbers = [_number(path, row[column], i, missing=missing) for i, row in enumerate(rows, start=1)]
        parts[family][key], units[key] = np.array(numbers), unit
        if unit != (own := channel_name(key).kind.unit) and own:
            raise contradiction(path, _WHAT, f"its column '{title}' is not in {own}")
    compared = errors.rmse.keys()
    if not compared or not compared == errors.rmse_detrended.keys() == parts["simulated"].keys():
        raise contradiction(path, _WHAT, f"its simulated channels are not those of {RESULT}")
    fit = replace(
        errors,
        measured=parts["measured"],
        simulated=parts["simulated"],
        units=units,
        response=parts[""],
        bands=parts["band"],
        repeats=parts["repeat"],
    )
    for channel, simulated in fit.simulated.items():
        measured = fit.measured.get(channel)
        if measured is None or np.isnan(measured).any():
            continue
        for of, stated in ((rms, fit.rmse), (rms_detrended, fit.rmse_detrended)):
            again = of(simulated - measured)
            if not math.isclose(again, stated[channel], rel_tol=_SAME, abs_tol=1e-12 + 1e-9 * fit.rmse[channel]):
                why = f"its {channel} is off by {again:.6g}, and in {RESULT} by another number"
                raise contradiction(path, _WHAT, why)
    return fit


def _number(path: Path, cell: str, row: int, *, missing: bool = False) -> float:
    if missing and not cell:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise contradiction(path, _WHAT, f"row {row} has '{cell[:40]}' in the place of a number")
    return value


class _TrialRow(Record):
    """A row of the table of trials, its empty cells left out."""

    number: Count
    state: Literal["COMPLETE", "FAILED"]
    loss: float | None = None
    reason: str
    seconds: Amount
    n_factorisations: Count


_ROW = TypeAdapter(_TrialRow)


def _trials(path: Path) -> tuple[Trial, ...]:
    header, rows = read_rows(path, _WHAT)
    fixed = len(TRIAL_COLUMNS)
    if tuple(header[:fixed]) != TRIAL_COLUMNS:
        raise contradiction(path, _WHAT, f"its columns do not begin with {', '.join(TRIAL_COLUMNS)}")
    trials: list[Trial] = []
    for i, row in enumerate(rows, start=1):
        theta: dict[str, float] = {}
        losses: dict[str, float] = {}
        errors: dict[str, dict[str, float]] = {}
        for title, text in zip(header[fixed:], row[fixed:], strict=True):
            if title.startswith("loss of "):
                if text:
                    losses[title.removeprefix("loss of ")] = _number(path, text, i)
            elif title.startswith("error of "):
                if text:
                    experiment, _, of = title.removeprefix("error of ").rpartition(" [")[0].partition(": ")
                    errors.setdefault(experiment, {})[of] = _number(path, text, i)
            else:
                theta[title.rpartition(" [")[0]] = _number(path, text, i)
        names = ("number", "state", "loss", "seconds", "n_factorisations", "reason")
        cells = {name: text for name, text in zip(names, row[:fixed], strict=True) if text or name == "reason"}
        try:
            t = _ROW.validate_strings(cells)
        except ValidationError as error:
            raise damaged(path, _WHAT, error) from error
        if (t.state == "COMPLETE") != (t.loss is not None):
            why = f"trial {t.number} is {t.state}, and its loss is '{cells.get('loss', '')}'"
            raise contradiction(path, _WHAT, why)
        trials.append(Trial(t.number, theta, t.state, t.loss, t.reason, t.seconds, t.n_factorisations, losses, errors))
    return tuple(trials)
