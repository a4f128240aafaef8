"""The trials of a run: a journal file of Optuna's, which its own tools open and others read while it is written.

Every trial is one line, written at once, in the study "softcal"; what Optuna has no place for is among its user
attributes.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

from pydantic import ValidationError, model_validator

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.results.result import Trial
from softcal.calibration.results.stored import Amount, Count, Record, contradiction, damaged, digest
from softcal.errors import Fault, StorageError
from softcal.regular_file import own_file

if TYPE_CHECKING:
    import optuna

JOURNAL, ARRAYS = "optuna.journal", "arrays"
STUDY = "softcal"
_WHAT = "the trials of the run"
BEGIN = b'{"op_code"'  # of every journal of Optuna's
_NEW_TRIAL, _STATES = 4, {1: "COMPLETE", 3: "FAIL"}  # of Optuna's journals
LONGEST_LINE = 2**24  # bytes; those of hundreds of experiments have some ten thousand
_STEP = 2**16
# What Optuna raises for a journal that is none, or is damaged.
BROKEN = (ValueError, LookupError, TypeError, AttributeError, AssertionError, ArithmeticError, RuntimeError)


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
    arrays
        The file with its arrays (see `payload.encode`), or None where they are not kept.
    """

    trial: Trial
    n_solves: int
    elapsed: float
    arrays: Path | None


class _StoredRow(Record):
    """A trial as it is read: Optuna's own fields and softcal's attributes."""

    number: Count
    theta: dict[str, float]
    state: Literal["COMPLETE", "FAIL"]
    loss: float | None
    reason: str
    seconds: Amount
    n_solves: Count
    n_factorisations: Count
    experiment_losses: dict[str, float]
    errors: dict[str, dict[str, float]]
    elapsed: Amount
    arrays: bool
    sha256: str | None = None  # of the rest; earlier trials have none

    @model_validator(mode="after")
    def _whole(self) -> _StoredRow:
        if self.sha256 not in (None, digest(self.model_dump(exclude={"sha256"}))):
            raise ValueError(f"trial {self.number} was changed after it was told")
        if (self.state == "COMPLETE") != (self.loss is not None):
            raise ValueError(f"trial {self.number} is {self.state}, and its loss is {self.loss}")
        return self


class TrialJournal:
    """The journal of a run folder. Reading needs no lock, writes nothing, and goes on where it ended before.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._rows: dict[int, StoredTrial] = {}
        self._n_read = 0
        self._study: int | None = None
        with self._reading():
            open(path, "rb", opener=own_file).close()
            from optuna.storages import JournalStorage
            from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

            class NoLock(JournalFileOpenLock):
                def acquire(self) -> bool:
                    return True

                def release(self) -> None:
                    pass

            self._storage = JournalStorage(JournalFileBackend(str(path), lock_obj=NoLock(str(path))))

    def begin(self) -> None:
        """Make the study where the file is new.

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        import optuna

        optuna.logging.set_verbosity(optuna.logging.WARNING)
        with self._whole():
            if self._found() is None:
                self._study = self._storage.create_new_study([optuna.study.StudyDirection.MINIMIZE], STUDY)

    def append(self, stored: StoredTrial, space: SearchSpace) -> None:
        """Add a trial; it is on disk when this returns.

        Raises
        ------
        OSError
            Where the file cannot be written.
        """
        import optuna

        trial, now = stored.trial, datetime.now()
        state = optuna.trial.TrialState.FAIL if trial.loss is None else optuna.trial.TrialState.COMPLETE
        theirs = optuna.trial.FrozenTrial(
            number=-1,  # the storage numbers them itself
            trial_id=-1,
            state=state,
            value=trial.loss,
            datetime_start=now - timedelta(seconds=trial.seconds),
            datetime_complete=now,
            params=dict(trial.theta),
            distributions=distributions(space),
            user_attrs={"number": trial.number, **attributes(stored)},
            system_attrs={},
            intermediate_values={},
        )
        with self._whole():
            study = self._storage.get_study_id_from_name(STUDY)
            self._storage.create_new_trial(study, template_trial=theirs)

    def read(self) -> Mapping[int, StoredTrial]:
        """Every trial, by number.

        Raises
        ------
        StorageError
            Where the file cannot be read, or is damaged.
        """
        with self._reading():
            if (study := self._found()) is None:
                return {}
            held = self._storage.get_all_trials(study, deepcopy=False)
            for frozen in held[self._n_read :]:
                stored = as_stored(frozen, frozen.user_attrs, self._path.parent)
                if stored.trial.number in self._rows:
                    raise contradiction(self._path, _WHAT, f"trial {stored.trial.number} occurs twice")
                self._rows[stored.trial.number] = stored
            self._n_read = len(held)
        return dict(sorted(self._rows.items()))

    def _found(self) -> int | None:
        """Optuna's number of the study, or None before it is made."""
        if self._study is None:
            with contextlib.suppress(KeyError):
                self._study = self._storage.get_study_id_from_name(STUDY)
        return self._study

    @contextlib.contextmanager
    def _reading(self) -> Generator[None]:
        try:
            with self._whole():
                yield
        except OSError as error:
            raise StorageError(
                Fault(f"{_WHAT} cannot be read", str(self._path), error.strerror or str(error))
            ) from error

    @contextlib.contextmanager
    def _whole(self) -> Generator[None]:
        """Turn what is raised for a damaged journal into a sentence."""
        try:
            yield
        except ValidationError as error:
            raise damaged(self._path, _WHAT, error) from error
        except BROKEN as error:
            attempt = "a copy of it that is whole, or a new run: another --out, without --resume"
            got = str(error) or type(error).__name__
            raise StorageError(Fault(f"{_WHAT} cannot be read", str(self._path), got, attempt=attempt)) from error


def arrays_file(folder: Path, number: int) -> Path:
    """The file with the arrays of a trial in a run folder."""
    return folder / ARRAYS / f"{number}.npz"


def stored_trials(folder: Path) -> Mapping[int, StoredTrial]:
    """Every trial in a run folder, by number, also while another process writes there; none before the first.

    Raises
    ------
    StorageError
        Where the file cannot be read, or is damaged.
    """
    path = folder / JOURNAL
    return TrialJournal(path).read() if path.exists() else {}


def trial_of_line(line: bytes, folder: Path) -> StoredTrial | None:
    """The trial that a line of a run's journal adds; None where it adds none. Without Optuna, which keeps all of them.

    Raises
    ------
    ValueError, LookupError, TypeError
        Where it is no line of softcal's.
    """
    entry = json.loads(line)
    if entry["op_code"] != _NEW_TRIAL:
        return None
    state = _STATES[entry["state"]]
    return _as_stored(entry["params"], state, entry["value"], entry["user_attrs"], folder)


def mend(path: Path) -> None:
    """Cut off a last line that a process did not write to its end: it was never said to be there.

    Raises
    ------
    OSError
        Where the file cannot be written.
    StorageError
        Where it is no journal, or its last whole line is damaged; it is not cut then.
    """
    with open(path, "r+b", opener=own_file) as file:
        first = file.readline(LONGEST_LINE).rstrip(b"\0")  # which a loss of power leaves
        try:
            end, last = _whole_lines(file)
            if not (first.startswith(BEGIN) or BEGIN.startswith(first)):
                raise ValueError("it is no journal of a study")
            if last:
                json.loads(last)
        except (ValueError, RecursionError) as error:
            raise contradiction(path, _WHAT, f"its first or its last line is damaged ({error})") from error
        file.truncate(end)


def cut_to_whole_lines(path: Path) -> None:
    """Cut off a last line that does not end.

    Raises
    ------
    OSError
        Where the file cannot be written.
    ValueError
        Where a line is longer than any of a journal.
    """
    with path.open("r+b") as file:
        file.truncate(_whole_lines(file)[0])


def _whole_lines(file: BinaryIO) -> tuple[int, bytes]:
    """End of the last whole line of a file, and the line without its newline.

    Raises
    ------
    ValueError
        Where a line is longer than any of a journal.
    """
    place, tail, end = file.seek(0, os.SEEK_END), b"", 0
    while place > 0 and b"\n" not in tail[: max(end - 1, 0)]:
        if len(tail) > LONGEST_LINE:
            raise ValueError(f"a line has more than {LONGEST_LINE} bytes")
        step = min(place, max(_STEP, len(tail)))
        place = file.seek(place - step)
        tail = file.read(step) + tail
        end = tail.rfind(b"\n") + 1
    return place + end, tail[: max(end - 1, 0)].rpartition(b"\n")[2]


def attributes(stored: StoredTrial) -> dict[str, Any]:
    """Record of a trial in Optuna's user attributes, with the digest of all its data."""
    trial = stored.trial
    held = {
        "reason": trial.reason,
        "seconds": trial.seconds,
        "n_solves": stored.n_solves,
        "n_factorisations": trial.n_factorisations,
        "experiment_losses": dict(trial.experiment_losses),
        "errors": {name: dict(held) for name, held in trial.errors.items()},
        "elapsed": stored.elapsed,
        "arrays": stored.arrays is not None,
    }
    state = "FAIL" if trial.loss is None else "COMPLETE"
    whole = {**held, "number": trial.number, "theta": dict(trial.theta), "state": state, "loss": trial.loss}
    return {**held, "sha256": digest(whole)}


def as_stored(frozen: optuna.trial.FrozenTrial, held: Mapping[str, Any], folder: Path) -> StoredTrial:
    """A trial of Optuna's as one of softcal's.

    Parameters
    ----------
    frozen, held
        The trial, and its number with softcal's attributes of it.
    folder
        The run's.

    Raises
    ------
    ValidationError
        Where attributes are missing, or are others than softcal's.
    """
    loss: Any = frozen.values[0] if frozen.values is not None and len(frozen.values) == 1 else frozen.values
    return _as_stored(frozen.params, frozen.state.name, loss, held, folder)


def _as_stored(
    theta: Mapping[str, Any], state: str, loss: float | None, held: Mapping[str, Any], folder: Path
) -> StoredTrial:
    row = _StoredRow.model_validate({**held, "theta": theta, "state": state, "loss": loss})
    trial = Trial(
        row.number,
        row.theta,
        "COMPLETE" if row.state == "COMPLETE" else "FAILED",
        row.loss,
        row.reason,
        row.seconds,
        row.n_factorisations,
        row.experiment_losses,
        row.errors,
    )
    return StoredTrial(trial, row.n_solves, row.elapsed, arrays_file(folder, row.number) if row.arrays else None)


def distributions(space: SearchSpace) -> dict[str, optuna.distributions.BaseDistribution]:
    """The search space as Optuna sees it."""
    import optuna

    return {
        p.label: optuna.distributions.FloatDistribution(p.lower, p.upper, log=p.scale == "log")
        for p in space.parameters
    }
