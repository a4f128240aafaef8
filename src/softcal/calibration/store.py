"""A run folder: the problem, every trial as soon as it is evaluated, and at the end the result.

    run.json        what is calibrated (hashes), how (settings), with what (versions)
    trials.sqlite   one row per trial, committed at once; with the arrays that a resumed search needs
    optuna.journal  the same trials for Optuna's own tools (method tpe)
    result.json, trials.csv, response-<experiment>.csv   see `result_files`

Nothing is ever overwritten unasked: a folder that is not empty is refused unless the run in it is to be resumed.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, Json, ValidationError, model_validator

from softcal.calibration.problem import SOFTCAL
from softcal.calibration.result import Trial
from softcal.calibration.stored import Amount, Count, Record, contradiction, damaged, read_record
from softcal.errors import Fault, StorageError

TRIALS, JOURNAL, RESULT = "trials.sqlite", "optuna.journal", "result.json"
_FORMAT = 1
_LARGEST_BATCH = 4096
_SCHEMA = """
CREATE TABLE IF NOT EXISTS trials (
    number INTEGER PRIMARY KEY, theta TEXT NOT NULL, state TEXT NOT NULL, loss REAL, reason TEXT NOT NULL,
    seconds REAL NOT NULL, n_solves INTEGER NOT NULL, n_factorisations INTEGER NOT NULL,
    experiment_losses TEXT NOT NULL, errors TEXT NOT NULL, elapsed REAL NOT NULL, payload BLOB
)
"""


@dataclass(frozen=True)
class StoredTrial:
    """A trial on disk.

    Attributes
    ----------
    trial
        The trial.
    n_solves
        Number of simulated trajectories that it took.
    elapsed
        Wall time of the run when it was recorded [s].
    payload
        Its arrays (see `payload.encode`), or None.
    """

    trial: Trial
    n_solves: int
    elapsed: float
    payload: bytes | None


class _Settings(Record):
    """The settings of a search; those not named here are only compared with the requested ones."""

    model_config = ConfigDict(extra="allow")

    batch: Annotated[int, Field(ge=1, le=_LARGEST_BATCH)] = 1


class _StoredRun(Record):
    identity: dict[str, str]
    settings: _Settings


class _StoredRow(Record):
    """A row of `trials`."""

    number: Count
    theta: Json[dict[str, float]]
    state: Literal["COMPLETE", "FAILED"]
    loss: float | None
    reason: str
    seconds: Amount
    n_solves: Count
    n_factorisations: Count
    experiment_losses: Json[dict[str, float]]
    errors: Json[dict[str, dict[str, float]]]
    elapsed: Amount
    payload: bytes | None

    @model_validator(mode="after")
    def _whole(self) -> _StoredRow:
        if (self.state == "COMPLETE") != (self.loss is not None):
            raise ValueError(f"trial {self.number} is {self.state}, and its loss is {self.loss}")
        return self


class RunStore:
    """An open run folder. Use `create` or `resume`, and close it (or use it in `with`).

    batch: the number of points that the search asked for at once when the run was begun.
    """

    def __init__(self, folder: Path, batch: int = 1) -> None:
        self.folder, self.batch = folder, batch
        # One that was closed in order has its rows in the file itself; SQLite would begin an empty one in its place.
        lost = [name for name in (JOURNAL, RESULT) if (folder / name).is_file()]
        if lost and not (folder / TRIALS).is_file():
            raise StorageError(Fault("the trials of the run are missing", str(folder / TRIALS), f"{lost[0]} beside it"))
        with storing(folder):
            self._trials = sqlite3.connect(folder / TRIALS, timeout=0.5, isolation_level=None)
            # Exclusive: two processes in one folder would each undo the other's search.
            self._trials.execute("PRAGMA locking_mode=EXCLUSIVE")
            self._trials.execute("PRAGMA journal_mode=WAL")
            self._trials.execute("PRAGMA synchronous=NORMAL")
            self._trials.execute(_SCHEMA)

    @classmethod
    def create(
        cls,
        folder: Path,
        *,
        identity: Mapping[str, str],
        settings: Mapping[str, Any],
        versions: Mapping[str, str],
        files: Mapping[str, str] | None = None,
    ) -> RunStore:
        """A new run. identity: hash by the name of what is hashed; files: texts to keep with the run, by file name.

        Raises
        ------
        StorageError
            Where the folder holds something already, or cannot be written.
        """
        with storing(folder):
            if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                raise StorageError(
                    Fault(
                        "the folder is not empty" if folder.is_dir() else "this is a file, not a folder",
                        where=str(folder),
                        attempt="another folder, or --resume to go on with the run in it",
                    )
                )
            folder.mkdir(parents=True, exist_ok=True)
        for name, text in (files or {}).items():
            write_text(folder / name, text)
        about = {"format": _FORMAT, "identity": dict(identity), "settings": dict(settings), "versions": dict(versions)}
        write_text(folder / "run.json", json.dumps(about, indent=2))
        return cls(folder, settings.get("batch", 1))

    @classmethod
    def resume(
        cls, folder: Path, *, identity: Mapping[str, str], settings: Mapping[str, Any], grows: bool = True
    ) -> RunStore:
        """The run in a folder, resumed with the settings it began with; `grows`: except the number of trials.

        Raises
        ------
        StorageError
            Where there is no run, or it calibrates something else; names every item that differs.
        """
        path = folder / "run.json"
        if not path.is_file():
            raise StorageError(Fault("there is no run to resume", where=str(folder), attempt="without --resume"))
        held = read_record(_StoredRun, path, "the record of the run", _FORMAT)
        held_identity, held_settings = held.identity, held.settings.model_dump()
        faults = [
            *_other_things(path, held_identity, identity),
            *_differences(
                "the run began with other settings", path, held_settings, settings, ignored=("batch", "trials")
            ),
        ]
        if not grows and held_settings.get("trials") != settings.get("trials"):
            faults += _differences(
                f"another number of trials is another {settings.get('method')}",
                path,
                {"trials": held_settings.get("trials")},
                {"trials": settings.get("trials")},
            )
        if faults:
            raise StorageError(faults)
        return cls(folder, held.settings.batch)

    def __enter__(self) -> RunStore:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the folder for other processes."""
        with storing(self.folder):
            self._trials.close()

    def append(self, stored: StoredTrial) -> None:
        """Store a trial; it is on disk when this returns.

        Raises
        ------
        StorageError
            For a full disk or a folder that no longer exists.
        """
        trial = stored.trial
        row = (
            trial.number,
            json.dumps(dict(trial.theta)),
            trial.state,
            trial.loss,
            trial.reason,
            trial.seconds,
            stored.n_solves,
            trial.n_factorisations,
            json.dumps(dict(trial.experiment_losses)),
            json.dumps({name: dict(held) for name, held in trial.errors.items()}),
            stored.elapsed,
            stored.payload,
        )
        with storing(self.folder / TRIALS):
            self._trials.execute("INSERT INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", row)

    def keep(self, number: int, payload: bytes) -> None:
        """Store other arrays of a trial in the place of its own, such as those with its derivatives.

        Raises
        ------
        StorageError
            For a full disk or a folder that no longer exists.
        """
        with storing(self.folder / TRIALS):
            self._trials.execute("UPDATE trials SET payload = ? WHERE number = ?", (payload, number))

    def stored(self) -> dict[int, StoredTrial]:
        """Every trial that is kept, by number.

        Raises
        ------
        StorageError
            Where the file cannot be read, or is damaged.
        """
        path, what = self.folder / TRIALS, "the trials of the run"
        columns = list(_StoredRow.model_fields)
        try:
            rows = self._trials.execute(f"SELECT {', '.join(columns)} FROM trials ORDER BY number").fetchall()
            held = [_StoredRow.model_validate(dict(zip(columns, row, strict=True))) for row in rows]
        except ValidationError as error:
            raise damaged(path, what, error) from error
        except sqlite3.Error as error:
            raise contradiction(path, what, str(error)) from error
        return {row.number: _stored(row) for row in held}


def _stored(row: _StoredRow) -> StoredTrial:
    trial = Trial(
        row.number,
        row.theta,
        row.state,
        row.loss,
        row.reason,
        row.seconds,
        row.n_factorisations,
        row.experiment_losses,
        row.errors,
    )
    return StoredTrial(trial, row.n_solves, row.elapsed, row.payload)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    StorageError
        Where it cannot be written; what was there before is then still there.
    """
    partial = path.with_name(path.name + ".part")
    with storing(path):
        try:
            with partial.open("w", encoding="utf-8", newline="") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            partial.replace(path)
        except OSError:
            partial.unlink(missing_ok=True)
            raise


@contextlib.contextmanager
def storing(path: Path) -> Generator[None]:
    """Turn an error of the operating system into one sentence about `path`.

    Raises
    ------
    StorageError
        In the place of OSError and sqlite3.Error.
    """
    try:
        yield
    except sqlite3.OperationalError as error:
        attempt = "wait for the other calibration in this folder" if "locked" in str(error) else ""
        raise StorageError(Fault("the run cannot be kept", where=str(path), got=str(error), attempt=attempt)) from error
    except sqlite3.DatabaseError as error:  # such as a file that was cut short
        file = path / TRIALS if path.is_dir() else path
        attempt = "a copy of it that is whole, or a new run: another --out, without --resume"
        raise StorageError(Fault("the trials of the run cannot be read", str(file), str(error), "", attempt)) from error
    except (OSError, sqlite3.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise StorageError(
            Fault("the run cannot be kept", where=str(path), got=reason, attempt="a folder that can be written to")
        ) from error


def _other_things(path: Path, held: Mapping[str, str], given: Mapping[str, str]) -> list[Fault]:
    """The items in which the identity differs; of another engine one fault, since its settings then differ all
    together.
    """
    what, engines = "the run calibrates something else", (held.get("engine", SOFTCAL), given.get("engine", SOFTCAL))
    if engines[0] == engines[1]:
        return _differences(what, path, held, given)
    held, given = (
        {key: value for key, value in one.items() if key != "engine" and not key.startswith("engines.")}
        for one in (held, given)
    )
    other = Fault(
        "the run was made with another engine",
        str(path),
        got=engines[1],
        allowed=engines[0],
        attempt=f"--engine {engines[0]}",
    )
    return [other, *_differences(what, path, held, given)]


def _differences(
    what: str, path: Path, held: Mapping[str, Any], given: Mapping[str, Any], *, ignored: tuple[str, ...] = ()
) -> list[Fault]:
    return [
        Fault(f"{what}: {name}", str(path), got=_short(given.get(name)), allowed=_short(held.get(name)))
        for name in dict.fromkeys([*held, *given])
        if name not in ignored and held.get(name) != given.get(name)
    ]


def _short(value: object) -> str:
    text = "nothing" if value is None else str(value)
    return f"{text[:12]}…" if len(text) > 24 else text
