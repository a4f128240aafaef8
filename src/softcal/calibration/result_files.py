"""A result as files, and back: result.json, trials.csv, response-<experiment>.csv. SI, units in the headers."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from softcal.calibration.result import CalibrationResult, Distance, Estimate, ExperimentFit, HeldOut, Trial
from softcal.calibration.store import storing, write_text
from softcal.checks import Floats
from softcal.errors import Fault, StorageError

_TRIAL_COLUMNS = ("number", "state", "loss", "seconds [s]", "n_factorisations", "reason")


def write_result(result: CalibrationResult, folder: Path) -> None:
    """Write the result's files into a folder; result.json last, so that it stands only beside complete tables.

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    for name, fit in fits_of(result).items():
        write_text(folder / response_file(name), _response_csv(fit))
    write_text(folder / "trials.csv", _trials_csv(result))
    write_text(folder / "result.json", json.dumps(result_json(result), indent=2, allow_nan=False) + "\n")


def load_result(folder: Path) -> CalibrationResult:
    """The result that `write_result` wrote.

    Raises
    ------
    StorageError
        Where a file is missing or is not what it should be.
    """
    path = folder / "result.json"
    if not path.is_file():
        raise StorageError(
            Fault("there is no result", where=str(path), attempt="softcal calibrate with this folder, or --resume")
        )
    try:
        with storing(path):
            held = json.loads(path.read_text(encoding="utf-8"))
        fits = {name: _fit(folder / entry["file"], entry) for name, entry in held["experiments"].items()}
        return CalibrationResult(
            parameters={name: Estimate(**entry) for name, entry in held["parameters"].items()},
            experiments=fits,
            trials=_trials(folder / "trials.csv"),
            **{
                key: held[key]
                for key in ("loss", "loss_name", "method", "seed", "n_solves", "n_factorisations", "wall_s", "status")
            },
            importance=held["importance"],
            n_failed_trials=held["n_failed_trials"],
            hashes=held["hashes"],
            versions=held["versions"],
            notes=tuple(held["notes"]),
            extra=held["extra"],
            held_out={name: _held_out(folder, entry) for name, entry in held.get("held_out", {}).items()},
        )
    except (ValueError, KeyError, TypeError, StopIteration) as error:
        raise StorageError(
            Fault(f"the result cannot be read ({type(error).__name__}: {error})", where=str(folder))
        ) from error


def result_json(result: CalibrationResult) -> dict[str, Any]:
    """What result.json holds.

    Of an experiment of one cable and one plate (paper A's), the errors of tension and pitch stand there in any case,
    null where they were not compared; of any other, those alone that were.
    """
    return {
        "parameters": {
            name: {
                "value": p.value,
                "unit": p.unit,
                "at_bound": p.at_bound,
                "lower": p.lower,
                "upper": p.upper,
                "standard_error": p.standard_error,
                "interval": None if p.interval is None else list(p.interval),
                **({"of": list(p.of)} if p.of else {}),
            }
            for name, p in result.parameters.items()
        },
        "loss": result.loss,
        "loss_name": result.loss_name,
        "method": result.method,
        "seed": result.seed,
        "n_solves": result.n_solves,
        "n_factorisations": result.n_factorisations,
        "n_failed_trials": result.n_failed_trials,
        "wall_s": result.wall_s,
        "status": result.status,
        "experiments": {name: _errors(name, fit) for name, fit in result.experiments.items()},
        **(
            {"held_out": {name: _held_out_json(name, one) for name, one in result.held_out.items()}}
            if result.held_out
            else {}
        ),
        "importance": dict(result.importance),
        "notes": list(result.notes),
        "extra": dict(result.extra),
        "versions": dict(result.versions),
        "hashes": dict(result.hashes),
    }


def response_file(experiment: str) -> str:
    """The name of an experiment's response table."""
    return f"response-{experiment}.csv"


def fits_of(result: CalibrationResult) -> dict[str, ExperimentFit]:
    """Every experiment of a result, fitted or predicted."""
    return {**result.experiments, **{name: one.fit for name, one in result.held_out.items()}}


def _errors(name: str, fit: ExperimentFit) -> dict[str, Any]:
    of_paper_a = any("." not in channel for channel in fit.rmse)
    channels = dict.fromkeys(("tension", "pitch", *fit.rmse) if of_paper_a else fit.rmse)
    errors: dict[str, Any] = {}
    for channel in channels:
        errors[f"{channel}_rmse"] = fit.rmse.get(channel)
        errors[f"{channel}_rmse_detrended"] = fit.rmse_detrended.get(channel)
    if fit.distances:
        errors["distances"] = {point: _distance_json(d, fit.length) for point, d in fit.distances.items()}
    if fit.length is not None:
        errors["length"] = fit.length
    if fit.missing:
        errors["missing"] = dict(fit.missing)
    return {**errors, "file": response_file(name)}


def _distance_json(distance: Distance, length: float | None) -> dict[str, float | int]:
    entry: dict[str, float | int] = asdict(distance)
    if length is not None:
        entry |= {f"{key}_percent": 100 * entry[key] / length for key in ("mean", "max", "rms")}
    return entry


def _held_out_json(name: str, held: HeldOut) -> dict[str, Any]:
    return {"loss": held.loss, "own": dict(held.own), **_errors(name, held.fit)}


def _held_out(folder: Path, entry: Mapping[str, Any]) -> HeldOut:
    return HeldOut(entry["loss"], _fit(folder / entry["file"], entry), entry["own"])


def _response_csv(fit: ExperimentFit) -> str:
    columns: dict[str, Floats] = {f"{name} [{fit.units[name]}]": values for name, values in fit.response.items()}
    for family, channels in (("measured", fit.measured), ("simulated", fit.simulated)):
        columns |= {f"{family}.{name} [{fit.units[name]}]": values for name, values in channels.items()}
    # A value that was not measured is an empty cell.
    cells = ([float(value) if np.isfinite(value) else "" for value in values] for values in columns.values())
    return _csv(list(columns), zip(*cells, strict=True))


def _trials_csv(result: CalibrationResult) -> str:
    parameters = [f"{name} [{p.unit}]" for name, p in result.parameters.items()]
    experiments = [f"loss of {name}" for name in result.experiments]
    told = {(name, of): unit for name, fit in result.experiments.items() for of, unit in _told(fit).items()}
    errors = [f"error of {name}: {of} [{unit}]" for (name, of), unit in told.items()]
    rows = [
        [
            t.number,
            t.state,
            "" if t.loss is None else t.loss,
            t.seconds,
            t.n_factorisations,
            t.reason,
            *(t.theta[name] for name in result.parameters),
            *(t.experiment_losses.get(name, "") for name in result.experiments),
            *(t.errors.get(name, {}).get(of, "") for name, of in told),
        ]
        for t in result.trials
    ]
    return _csv([*_TRIAL_COLUMNS, *parameters, *experiments, *errors], rows)


def _told(fit: ExperimentFit) -> dict[str, str]:
    """The unit of every error of an experiment: of markers and plates, and of the channels that are none of them."""
    others = {c: fit.units[c] for c in fit.rmse if c.rpartition(".")[0] not in fit.distances}
    return {**dict.fromkeys(fit.distances, "m"), **others}


def _csv(header: Sequence[str], rows: Any) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue()


def _table(path: Path) -> tuple[list[str], list[list[str]]]:
    with storing(path):
        lines = path.read_text(encoding="utf-8")
    rows = csv.reader(io.StringIO(lines))
    return next(rows), list(rows)


def _fit(path: Path, entry: Mapping[str, Any]) -> ExperimentFit:
    header, rows = _table(path)
    cells = [float(cell) if cell else math.nan for row in rows for cell in row]
    values = np.array(cells, dtype=np.float64).reshape(len(rows), len(header))
    parts: dict[str, dict[str, Floats]] = {"measured": {}, "simulated": {}, "": {}}
    units: dict[str, str] = {}
    for column, title in enumerate(header):
        name, unit = title.removesuffix("]").rsplit(" [", 1)
        family, _, channel = name.partition(".")
        known = family in ("measured", "simulated")
        key = channel if known else name
        parts[family if known else ""][key] = values[:, column]
        units[key] = unit
    return ExperimentFit(
        rmse={c: entry[f"{c}_rmse"] for c in parts["simulated"]},
        rmse_detrended={c: entry[f"{c}_rmse_detrended"] for c in parts["simulated"]},
        measured=parts["measured"],
        simulated=parts["simulated"],
        units=units,
        response=parts[""],
        distances={
            point: Distance(**{key: held[key] for key in ("mean", "max", "rms", "n")})
            for point, held in entry.get("distances", {}).items()
        },
        length=entry.get("length"),
        missing=entry.get("missing", {}),
    )


def _trials(path: Path) -> tuple[Trial, ...]:
    header, rows = _table(path)
    fixed = len(_TRIAL_COLUMNS)
    trials: list[Trial] = []
    for row in rows:
        number, state, loss, seconds, n_factorisations, reason = row[:fixed]
        theta: dict[str, float] = {}
        losses: dict[str, float] = {}
        errors: dict[str, dict[str, float]] = {}
        for title, text in zip(header[fixed:], row[fixed:], strict=True):
            if title.startswith("loss of "):
                if text:
                    losses[title.removeprefix("loss of ")] = float(text)
            elif title.startswith("error of "):
                if text:
                    experiment, of = title.removeprefix("error of ").rsplit(" [", 1)[0].split(": ", 1)
                    errors.setdefault(experiment, {})[of] = float(text)
            else:
                theta[title.rsplit(" [", 1)[0]] = float(text)
        value = float(loss) if loss else None
        if state not in ("COMPLETE", "FAILED") or (value is not None and not math.isfinite(value)):
            raise ValueError(f"trial {number} is neither complete nor failed")
        own = losses, errors
        trials.append(Trial(int(number), theta, state, value, reason, float(seconds), int(n_factorisations), *own))
    return tuple(trials)
