"""A result as files: result.json, trials.csv, response-<experiment>.csv. SI, units in the headers."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from softcal.calibration.result import CalibrationResult, Distance, ExperimentFit, HeldOut, SearchResult, SweepResult
from softcal.calibration.store import RESULT, write_text
from softcal.checks import Floats
from softcal.csv_text import csv_text

FORMAT = 1
TRIALS = "trials.csv"
TRIAL_COLUMNS = ("number", "state", "loss", "seconds [s]", "n_factorisations", "reason")


def write_result(result: SearchResult, folder: Path) -> None:
    """Write the result's files into a folder; result.json last, so that it exists only beside complete tables.

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    for name, fit in fits_of(result).items():
        write_text(folder / response_file(name), _response_csv(fit))
    write_text(folder / TRIALS, _trials_csv(result))
    write_text(folder / RESULT, json.dumps(result_json(result), indent=2, allow_nan=False) + "\n")


def result_json(result: SearchResult) -> dict[str, Any]:
    """The contents of result.json.

    An experiment of one cable and one plate (paper A's) always has the errors of tension and pitch, null where they
    were not compared; any other has those alone that were.
    """
    warnings = [note.text for note in result.notes if note.level == "warning"]
    document: dict[str, Any] = {
        "format": FORMAT,
        "parameters": {
            name: {
                "value": p.value,
                "unit": p.unit,
                "at_bound": p.at_bound,
                "lower": p.lower,
                "upper": p.upper,
                "standard_error": p.standard_error,
                "interval": None if p.interval is None else list(p.interval),
                "scale": p.scale,
                **({"of": list(p.of)} if p.of else {}),
                **({"shares": dict(p.shares)} if p.shares else {}),
                **({} if p.dof is None else {"dof": p.dof}),
                **({} if p.beyond is None else {"beyond": p.beyond}),
                **({"profile": [list(pair) for pair in p.profile]} if p.profile else {}),
                **({"moved_by": dict(p.moved_by)} if p.moved_by else {}),
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
        "converged": None,  # of a search that looks for no minimum
        "experiments": {name: _errors(name, fit) for name, fit in result.experiments.items()},
        **(
            {"held_out": {name: _held_out_json(name, one) for name, one in result.held_out.items()}}
            if result.held_out
            else {}
        ),
        **({"spreads": {name: asdict(one) for name, one in result.spreads.items()}} if result.spreads else {}),
        **({"left_out": {name: asdict(one) for name, one in result.left_out.items()}} if result.left_out else {}),
        "residuals": {
            name: {channel: asdict(one) for channel, one in held.items()} for name, held in result.residuals.items()
        },
        "importance": dict(result.importance),
        "notes": [note.text for note in result.notes],
        **({"warnings": warnings} if warnings else {}),
        "extra": dict(result.extra),
        "versions": dict(result.versions),
        "hashes": dict(result.hashes),
    }
    match result:
        case CalibrationResult():
            document["converged"] = result.converged
        case SweepResult():
            document["extra"]["axes"] = {name: list(values) for name, values in result.axes.items()}
        case _:
            raise TypeError(f"there is no file of a {type(result).__name__}")
    return document


def response_file(experiment: str) -> str:
    """The name of an experiment's response table."""
    return f"response-{experiment}.csv"


def fits_of(result: SearchResult) -> dict[str, ExperimentFit]:
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
    if fit.cycles:
        errors["cycles"] = [asdict(cycle) for cycle in fit.cycles]
    return {**errors, "file": response_file(name)}


def _distance_json(distance: Distance, length: float | None) -> dict[str, float | int]:
    entry: dict[str, float | int] = asdict(distance)
    if length is not None:
        entry |= {f"{key}_percent": 100 * entry[key] / length for key in ("mean", "max", "rms")}
    return entry


def _held_out_json(name: str, held: HeldOut) -> dict[str, Any]:
    return {"loss": held.loss, "own": dict(held.own), **_errors(name, held.fit)}


def _response_csv(fit: ExperimentFit) -> str:
    columns: dict[str, Floats] = {f"{name} [{fit.units[name]}]": values for name, values in fit.response.items()}
    families = {"measured": fit.measured, "simulated": fit.simulated, "band": fit.bands, "repeat": fit.repeats}
    for family, channels in families.items():
        columns |= {f"{family}.{name} [{fit.units[name]}]": values for name, values in channels.items()}
    # A value that was not measured is an empty cell.
    cells = ([float(value) if np.isfinite(value) else "" for value in values] for values in columns.values())
    return csv_text(list(columns), zip(*cells, strict=True))


def _trials_csv(result: SearchResult) -> str:
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
    return csv_text([*TRIAL_COLUMNS, *parameters, *experiments, *errors], rows)


def _told(fit: ExperimentFit) -> dict[str, str]:
    """The unit of every reported error of an experiment: of markers and plates, and of all other channels."""
    others = {c: fit.units[c] for c in fit.alone}
    return {**dict.fromkeys(fit.distances, "m"), **others}
