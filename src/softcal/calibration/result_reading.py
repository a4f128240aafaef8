"""A result read back from its files, each part checked by its schema and against the others."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from softcal.calibration.left_out import LeftOut
from softcal.calibration.loss import rms
from softcal.calibration.random_effects import Spread
from softcal.calibration.residuals import ResidualRecord
from softcal.calibration.result import (
    CalibrationResult,
    CycleFit,
    Distance,
    Estimate,
    ExperimentFit,
    HeldOut,
    Note,
    SearchResult,
    SweepResult,
    Trial,
)
from softcal.calibration.result_files import FORMAT, TRIAL_COLUMNS, TRIALS, response_file
from softcal.calibration.store import RESULT
from softcal.calibration.stored import Amount, Count, Record, contradiction, damaged, read_record, read_rows
from softcal.checks import Floats
from softcal.errors import Fault, StorageError
from softcal.sensing.channel import channel_name

_WHAT = "the result"
_SAME = 1e-6  # relative; of an error that is computed again from its table


class _Fit(Record):
    """The errors of one experiment; those by channel (`tension_rmse`) are extra keys."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float | None]  # pyright: ignore[reportIncompatibleVariableOverride]

    file: str
    distances: dict[str, Distance] = Field(default_factory=dict[str, Distance])
    length: Amount | None = None
    missing: dict[str, Count] = Field(default_factory=dict[str, int])
    cycles: tuple[CycleFit, ...] = ()


class _HeldOut(_Fit):
    loss: float
    own: dict[str, float]


class _Extra(Record):
    """Settings of the search and options of its optimiser; a sweep alone has the values of every axis."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float]  # pyright: ignore[reportIncompatibleVariableOverride]

    importance_kind: str = ""
    method: str | None = None
    trials: Count | None = None
    seed: Count | None = None
    batch: Count | None = None
    axes: dict[str, list[float]] | None = None
    hold_out: list[str] | None = None


class _Result(Record):
    format: Annotated[int, Field(ge=FORMAT, le=FORMAT)] = FORMAT
    parameters: dict[str, Estimate]
    loss: float
    loss_name: str
    method: str
    seed: Count
    n_solves: Count
    n_factorisations: Count
    n_failed_trials: Count
    wall_s: Amount
    status: str
    converged: bool | None
    experiments: dict[str, _Fit]
    held_out: dict[str, _HeldOut] = Field(default_factory=dict[str, _HeldOut])
    spreads: dict[str, Spread] = Field(default_factory=dict[str, Spread])
    left_out: dict[str, LeftOut] = Field(default_factory=dict[str, LeftOut])
    residuals: dict[str, dict[str, ResidualRecord]] = Field(default_factory=dict[str, dict[str, ResidualRecord]])
    importance: dict[str, float]
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()  # those of the notes that are; earlier files have none
    extra: _Extra
    versions: dict[str, str]
    hashes: dict[str, str]


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
    held = read_record(_Result, path, _WHAT)
    shared: dict[str, Any] = {
        "parameters": held.parameters,
        "loss": held.loss,
        "loss_name": held.loss_name,
        "method": held.method,
        "seed": held.seed,
        "n_solves": held.n_solves,
        "n_factorisations": held.n_factorisations,
        "wall_s": held.wall_s,
        "status": held.status,
        "experiments": {name: _fit(folder, name, entry) for name, entry in held.experiments.items()},
        "spreads": held.spreads,
        "left_out": held.left_out,
        "residuals": held.residuals,
        "importance": held.importance,
        "trials": _trials(folder / TRIALS),
        "n_failed_trials": held.n_failed_trials,
        "hashes": held.hashes,
        "versions": held.versions,
        "notes": tuple(Note(text, "warning" if text in held.warnings else "note") for text in held.notes),
        "extra": held.extra.model_dump(exclude_none=True, exclude={"axes"}),
        "held_out": {
            name: HeldOut(entry.loss, _fit(folder, name, entry), entry.own) for name, entry in held.held_out.items()
        },
    }
    if held.extra.axes is None:
        result = CalibrationResult(**shared, converged=held.converged)
    else:
        result = SweepResult(**shared, axes={name: tuple(values) for name, values in held.extra.axes.items()})
        _check_cells(path, result)
    _check(path, result)
    header, _ = read_rows(folder / TRIALS, _WHAT)
    if others := {f"{name} [{one.unit}]" for name, one in result.parameters.items()} - {*header}:
        raise contradiction(path, _WHAT, f"{TRIALS} has no {min(others)}")
    return result


def _check_cells(path: Path, result: SweepResult) -> None:
    """Whether every trial of a sweep is the cell of its number."""
    cells = list(itertools.product(*result.axes.values()))
    for trial in result.trials:
        if trial.number >= len(cells) or dict(zip(result.axes, cells[trial.number], strict=True)) != dict(trial.theta):
            raise contradiction(path, _WHAT, f"trial {trial.number} in {TRIALS} is no cell of its grid")


def _check(path: Path, result: SearchResult) -> None:
    """Whether the parts of a result agree: its estimates are those of its best trial."""
    if not result.parameters or not result.experiments:
        raise contradiction(path, _WHAT, "it has no parameters or no experiments")
    values = {name: one.value for name, one in result.parameters.items()}
    if not any(trial.loss == result.loss and dict(trial.theta) == values for trial in result.trials):
        raise contradiction(path, _WHAT, f"no trial in {TRIALS} has its values and its loss")
    if len({trial.number for trial in result.trials}) < len(result.trials):
        raise contradiction(path, _WHAT, f"{TRIALS} has a trial twice")
    if sum(trial.state == "FAILED" for trial in result.trials) != result.n_failed_trials:
        raise contradiction(path, _WHAT, f"{TRIALS} has another number of failed trials")


def _fit(folder: Path, name: str, entry: _Fit) -> ExperimentFit:
    if entry.file != response_file(name):
        raise contradiction(folder / RESULT, _WHAT, f"the table of {name} is named '{entry.file}'")
    path = folder / entry.file
    parts, units = _response(path)
    errors: Mapping[str, Any] = entry.model_extra or {}
    fit = ExperimentFit(
        rmse={c: _error(path, errors, f"{c}_rmse") for c in parts["simulated"]},
        rmse_detrended={c: _error(path, errors, f"{c}_rmse_detrended") for c in parts["simulated"]},
        measured=parts["measured"],
        simulated=parts["simulated"],
        units=units,
        response=parts[""],
        distances=entry.distances,
        length=entry.length,
        missing=entry.missing,
        bands=parts["band"],
        repeats=parts["repeat"],
        cycles=entry.cycles,
    )
    compared = {key for key, error in errors.items() if error is not None and key.endswith("_rmse")}
    if not compared or compared != {f"{channel}_rmse" for channel in fit.simulated}:
        raise contradiction(path, _WHAT, f"its simulated channels are not those of {RESULT}")
    for channel, simulated in fit.simulated.items():
        measured = fit.measured.get(channel)
        if measured is None or np.isnan(measured).any():
            continue
        again = rms(simulated - measured)
        if not math.isclose(again, fit.rmse[channel], rel_tol=_SAME, abs_tol=1e-12):
            raise contradiction(path, _WHAT, f"its {channel} is off by {again:.6g}, and in {RESULT} by another number")
    return fit


def _error(path: Path, errors: Mapping[str, float | None], key: str) -> float:
    found = errors.get(key)
    if found is None:
        raise contradiction(path.with_name(RESULT), _WHAT, f"there is no {key} for {path.name}")
    return found


def _response(path: Path) -> tuple[dict[str, dict[str, Floats]], dict[str, str]]:
    """Channels of a response table by family ("" for the twin's own), and their units."""
    header, rows = read_rows(path, _WHAT)
    if not rows:
        raise contradiction(path, _WHAT, "there are no samples")
    parts: dict[str, dict[str, Floats]] = {"measured": {}, "simulated": {}, "band": {}, "repeat": {}, "": {}}
    units: dict[str, str] = {}
    for column, title in enumerate(header):
        name, _, unit = title.removesuffix("]").rpartition(" [")
        family, _, channel = name.partition(".")
        known = family in parts
        key = channel if known else name
        parts[family if known else ""][key] = np.array(
            [
                _number(path, row[column], i, missing=family in ("measured", "band", "repeat"))
                for i, row in enumerate(rows, start=1)
            ]
        )
        units[key] = unit
        if unit != (own := channel_name(key).kind.unit) and own:
            raise contradiction(path, _WHAT, f"its column '{title}' is not in {own}")
    return parts, units


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
        trials.append(_trial(path, row[:fixed], theta, losses, errors))
    return tuple(trials)


def _trial(
    path: Path,
    cells: list[str],
    theta: dict[str, float],
    losses: dict[str, float],
    errors: dict[str, dict[str, float]],
) -> Trial:
    told = dict(zip(("number", "state", "loss", "seconds", "n_factorisations", "reason"), cells, strict=True))
    try:
        row = _ROW.validate_strings({key: text for key, text in told.items() if text or key == "reason"})
    except ValidationError as error:
        raise damaged(path, _WHAT, error) from error
    if (row.state == "COMPLETE") != (row.loss is not None):
        raise contradiction(path, _WHAT, f"trial {row.number} is {row.state}, and its loss is '{told['loss']}'")
    return Trial(row.number, theta, row.state, row.loss, row.reason, row.seconds, row.n_factorisations, losses, errors)
