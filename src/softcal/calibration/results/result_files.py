"""A result as files: result.json, trials.csv, response-<experiment>.csv. SI, units in the headers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softcal.calibration.results.result import ExperimentFit, SearchResult
from softcal.calibration.results.store import RESULT, write_text
from softcal.calibration.results.stored import as_json, sealed
from softcal.checks import Floats
from softcal.csv_text import csv_text

FORMAT = 1
_ONLY_WHERE_ANY = ("held_out", "spreads", "left_out", "robot_errors", "warnings")
TRIALS = "trials.csv"
TRIAL_COLUMNS = ("number", "state", "loss", "seconds [s]", "n_factorisations", "reason")


def write_result(result: SearchResult, folder: Path) -> None:
    """Write the result's files into a folder; result.json last, so that it exists only beside complete tables.

    Raises
    ------
    StorageError
        Where a file cannot be written.
    """
    tables: dict[str, str] = {}
    for name, fit in fits_of(result).items():
        columns: dict[str, Floats] = {f"{c} [{fit.units[c]}]": values for c, values in fit.response.items()}
        families = {"measured": fit.measured, "simulated": fit.simulated, "band": fit.bands, "repeat": fit.repeats}
        for family, channels in families.items():
            columns |= {f"{family}.{c} [{fit.units[c]}]": values for c, values in channels.items()}
        # A value that was not measured is an empty cell.
        cells = ([float(value) if np.isfinite(value) else "" for value in values] for values in columns.values())
        tables[response_file(name)] = csv_text(list(columns), zip(*cells, strict=True))
    # The reported errors of an experiment: of markers and plates, and of all other channels.
    errors = {
        (name, of): fit.units[of] if of in fit.alone else "m"
        for name, fit in result.experiments.items()
        for of in dict.fromkeys((*fit.distances, *fit.alone))
    }
    heads = [f"{name} [{p.unit}]" for name, p in result.parameters.items()]
    heads += [f"loss of {name}" for name in result.experiments]
    heads += [f"error of {name}: {of} [{unit}]" for (name, of), unit in errors.items()]
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
            *(t.errors.get(name, {}).get(of, "") for name, of in errors),
        ]
        for t in result.trials
    ]
    tables[TRIALS] = csv_text([*TRIAL_COLUMNS, *heads], rows)
    for name, text in tables.items():
        write_text(folder / name, text)
    write_text(folder / RESULT, sealed(result_json(result), tables))


def result_json(result: SearchResult) -> dict[str, Any]:
    """The contents of result.json: the record, its errors by channel (`tension_rmse`) and its remarks as sentences.

    An experiment of one cable and one plate (paper A's) always has the errors of tension and pitch, null where they
    were not compared; any other has those alone that were.
    """
    document: dict[str, Any] = {
        "format": FORMAT,
        "converged": None,  # of a search that looks for no minimum
        **as_json(result),
    }
    document["experiments"] = {name: _errors(name, fit) for name, fit in document["experiments"].items()}
    document["held_out"] = {
        name: {**entry, **_errors(name, entry.pop("fit"))} for name, entry in document["held_out"].items()
    }
    if "axes" in document:
        document["extra"]["axes"] = document.pop("axes")
    document["warnings"] = [note["text"] for note in document["notes"] if note["tone"] == "warning"]
    document["notes"] = [note["text"] for note in document["notes"]]
    return {key: value for key, value in document.items() if value or key not in _ONLY_WHERE_ANY}


def response_file(experiment: str) -> str:
    """The name of an experiment's response table."""
    return f"response-{experiment}.csv"


def fits_of(result: SearchResult) -> dict[str, ExperimentFit]:
    """Every experiment of a result, fitted or predicted."""
    return {**result.experiments, **{name: one.fit for name, one in result.held_out.items()}}


def _errors(name: str, fit: dict[str, Any]) -> dict[str, Any]:
    by_channel, detrended = fit.pop("rmse"), fit.pop("rmse_detrended")
    of_paper_a = any("." not in channel for channel in by_channel)
    errors: dict[str, Any] = {}
    for channel in dict.fromkeys(("tension", "pitch", *by_channel) if of_paper_a else by_channel):
        errors[f"{channel}_rmse"] = by_channel.get(channel)
        errors[f"{channel}_rmse_detrended"] = detrended.get(channel)
    if (length := fit["length"]) is not None:
        for distance in fit["distances"].values():
            distance |= {f"{key}_percent": 100 * distance[key] / length for key in ("mean", "max", "rms")}
    return {**errors, **fit, "file": response_file(name)}
