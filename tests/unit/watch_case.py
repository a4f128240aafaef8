"""Run folders as a search writes them, made up for the tests of the page."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend

HOST = socket.gethostname()
NOW = datetime(2026, 5, 4, 12, 0, 0, tzinfo=UTC)


def gone() -> int:
    """The number of a process that ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def write_json(path: Path, record: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(record), encoding="utf-8")


def write_run(folder: Path, labels: Sequence[str] = ("joint",), name: str = "a bar", trials: int | None = 20) -> Path:
    """A run folder whose searches have not begun."""
    write_json(
        folder / "run.json",
        {"format": 1, "project": name, "calibrations": list(labels), "created": NOW.isoformat(), "values": {}},
    )
    for label in labels:
        about = {"format": 1, "identity": {"robot": "0"}, "settings": {"method": "tpe", "trials": trials, "batch": 1}}
        write_json(folder / "calibrations" / label / "run.json", about)
    return folder


def add_trials(
    folder: Path, losses: Sequence[float | None], name: str = "bar.youngs_modulus", reason: str = "it broke."
) -> None:
    """Trials of a search, in the journal in its folder; a loss of None FAILED."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    storage = JournalStorage(JournalFileBackend(str(folder / "optuna.journal")))
    study = optuna.create_study(storage=storage, study_name="softcal", load_if_exists=True)
    states = optuna.trial.TrialState
    for loss in losses:
        count = len(study.get_trials(deepcopy=False))
        study.add_trial(
            optuna.trial.create_trial(
                state=states.FAIL if loss is None else states.COMPLETE,
                value=loss,
                params={name: 1e6 + 1e4 * count},
                distributions={name: optuna.distributions.FloatDistribution(1e5, 4e7, log=True)},
                user_attrs={
                    "number": count,
                    "reason": reason if loss is None else "",
                    "seconds": 0.5,
                    "n_solves": 1,
                    "n_factorisations": 9,
                    "experiment_losses": {},
                    "errors": {},
                    "elapsed": 2.0 * (count + 1),
                    "arrays": False,
                },
            )
        )


def live_record(pid: int, host: str, *, age: float = 0.0, now: datetime = NOW, **changes: Any) -> dict[str, Any]:
    """A sign of life that was given so many seconds ago."""
    moment = now - timedelta(seconds=age)
    record = {
        "format": 1, "pid": pid, "host": host, "began": (now - timedelta(seconds=600)).isoformat(),
        "updated": moment.isoformat(), "done": 3, "total": 20, "failed": 1, "stage": "",
        "executor": "local: 2 processes",
        "workers": [{"name": "worker 0", "state": "busy", "done": 2}, {"name": "worker 1", "state": "idle", "done": 1}],
    }  # fmt: skip
    return {**record, **changes}


RESULT = {
    "format": 1,
    "parameters": {
        "bar.youngs_modulus": {"value": 1.3e6, "unit": "Pa", "interval": [1.2e6, 1.4e6], "at_bound": False},
        "front.slack": {"value": 0.005, "unit": "m", "interval": None, "at_bound": True},
    },
    "loss": 0.25,
    "status": "All 20 trials were run.",
    "notes": ["The slack is at a bound."],
}


def write_fleet(folder: Path, **states: str | None) -> Path:
    """A fleet's folder with specimens that are DONE, FAILED, in work ("WORK") or waiting (None)."""
    write_json(folder / "fleet.json", {"format": 1, "specimens": list(states), "created": NOW.isoformat()})
    for name, state in states.items():
        if state is not None:
            place = write_run(folder / "specimens" / name, labels=["joint"]) / "calibrations" / "joint"
            add_trials(place, [3.0, 2.0])
        if state in ("DONE", "FAILED"):
            done = state == "DONE"
            record = {"specimen": name, "state": state, "reason": "" if done else "all trials failed.", "seconds": 4.0}
            more = {"loss": 0.5, "parameters": RESULT["parameters"] if done else {}, "warnings": []}
            write_json(folder / "specimens" / f"{name}.json", {**record, **more})
    return folder
