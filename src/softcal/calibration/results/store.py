"""A run folder: the problem, every trial as soon as it is evaluated, and at the end the result.

    run.json        what is calibrated (hashes), how (settings), with what (versions)
    optuna.journal  every trial, a line each, written at once; Optuna's own tools open it (see `trial_journal`)
    arrays/         <number>.npz: the arrays of a trial that a resumed search needs
    result.json, trials.csv, response-<experiment>.csv   see `result_files`

Nothing is ever overwritten unasked: a folder that is not empty is refused unless the run in it is to be resumed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import ConfigDict, Field

from softcal.calibration.problem.fingerprint import differences, identity_faults
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.results.file_lock import hold_in
from softcal.calibration.results.result import Trial
from softcal.calibration.results.stored import Record, read_record, sealed
from softcal.calibration.results.trial_journal import ARRAYS, JOURNAL, StoredTrial, TrialJournal, arrays_file, mend
from softcal.errors import Fault, StorageError
from softcal.regular_file import require_inside, whole_folder, write_whole

RECORD, RESULT = "run.json", "result.json"
_FORMAT = 2
_EARLIER = "trials.sqlite"  # where runs of format 1 have their trials
_LARGEST_BATCH = 4096


class _Settings(Record):
    """The settings of a search; those not named here are only compared with the requested ones."""

    model_config = ConfigDict(extra="allow")

    batch: Annotated[int, Field(ge=1, le=_LARGEST_BATCH)] = 1


class _StoredRun(Record):
    identity: dict[str, str]
    settings: _Settings


class RunStore:
    """An open run folder, held by this process alone. Use `create` or `resume`, and close it (or use it in `with`).

    space: the parameters that are searched; batch: the number of points that the search asked for at once when the run
    was begun.

    Raises
    ------
    StorageError
        Where another process has it open, it cannot be written, or its trials are damaged.
    """

    def __init__(self, folder: Path, space: SearchSpace, batch: int = 1) -> None:
        self.folder, self.batch = folder, batch
        self._space, self._path = space, folder / JOURNAL
        if lost := [name for name in (ARRAYS, RESULT) if (folder / name).exists() and not self._path.exists()]:
            raise StorageError(Fault("the trials of the run are missing", str(self._path), f"{lost[0]} beside it"))
        require_inside(folder, (ARRAYS,))
        with storing(self._path):
            # Two processes in one folder would each undo the other's search.
            self._file = hold_in(folder / JOURNAL, "run", "calibration")
            try:
                mend(self._path)
                self._journal = TrialJournal(self._path)
                self._journal.begin()
            except BaseException:
                self._file.close()
                raise

    @classmethod
    def create(
        cls,
        folder: Path,
        space: SearchSpace,
        *,
        identity: Mapping[str, str],
        settings: Mapping[str, Any],
        versions: Mapping[str, str],
        files: Mapping[str, str] | None = None,
    ) -> RunStore:
        """A new run.

        Parameters
        ----------
        folder, space
            The run's folder, and the search space.
        identity
            Hash by the name of what is hashed.
        settings, versions
            Settings of the search, and versions of packages, by name.
        files
            Texts to keep with the run, by file name.

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
            folder.parent.mkdir(parents=True, exist_ok=True)
        about = {"format": _FORMAT, "identity": dict(identity), "settings": dict(settings), "versions": dict(versions)}
        # A process that is killed here leaves nothing that a resumed run would refuse.
        with storing(folder), whole_folder(folder) as part:
            for name, text in {**(files or {}), RECORD: sealed(about)}.items():
                write_text(part / name, text)
        return cls(folder, space, settings.get("batch", 1))

    @classmethod
    def resume(
        cls,
        folder: Path,
        space: SearchSpace,
        *,
        identity: Mapping[str, str],
        settings: Mapping[str, Any],
        grows: bool = True,
    ) -> RunStore:
        """The run in a folder, resumed with the settings it began with.

        Parameters
        ----------
        folder, space
            The run's folder, and the search space.
        identity, settings
            As of `create`; they must be those of the run.
        grows
            Whether the number of trials may be another.

        Raises
        ------
        StorageError
            Where there is no run, or it calibrates something else; names every item that differs.
        """
        path = folder / RECORD
        if not path.is_file():
            raise StorageError(Fault("there is no run to resume", where=str(folder), attempt="without --resume"))
        if (folder / _EARLIER).exists():
            raise StorageError(
                Fault(
                    "the run is of an earlier version of softcal, and cannot be resumed by this one",
                    str(folder / _EARLIER),
                    attempt="a new run: another --out, without --resume; its report and its results can be read",
                )
            )
        held = read_record(_StoredRun, path, "the record of the run", _FORMAT)
        held_identity, held_settings = held.identity, held.settings.model_dump()
        faults = [
            *identity_faults("the run", str(path), held_identity, identity),
            *differences(
                "the run began with other settings", str(path), held_settings, settings, ignored=("batch", "trials")
            ),
        ]
        if not grows and held_settings.get("trials") != settings.get("trials"):
            faults += differences(
                f"another number of trials is another {settings.get('method')}",
                str(path),
                {"trials": held_settings.get("trials")},
                {"trials": settings.get("trials")},
            )
        if faults:
            raise StorageError(faults)
        return cls(folder, space, held.settings.batch)

    def __enter__(self) -> RunStore:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the folder for other processes."""
        with storing(self.folder):
            self._file.close()

    def append(self, trial: Trial, *, n_solves: int, elapsed: float, arrays: bytes | None = None) -> None:
        """Store a trial, its arrays first; it is on disk when this returns.

        Parameters
        ----------
        trial
            The trial.
        n_solves, elapsed
            Trajectories solved for it, and time [s] since the search began.
        arrays
            What it predicts, as of `encode`.

        Raises
        ------
        StorageError
            For a full disk or a folder that no longer exists.
        """
        place = arrays_file(self.folder, trial.number)
        if arrays is not None:
            self.keep(trial.number, arrays)
        with storing(self._path):
            # Optuna would begin another file in the place of one that was removed.
            if not os.path.samestat(os.fstat(self._file.fileno()), self._path.stat()):
                raise OSError("it was replaced by another file")
            stored = StoredTrial(trial, n_solves, elapsed, None if arrays is None else place)
            self._journal.append(stored, self._space)

    def keep(self, number: int, arrays: bytes) -> None:
        """Store the arrays of a trial, in the place of those it has, such as without its derivatives.

        Raises
        ------
        StorageError
            For a full disk or a folder that no longer exists.
        """
        place = arrays_file(self.folder, number)
        with storing(place):
            place.parent.mkdir(exist_ok=True)
        write_bytes(place, arrays)

    def stored(self) -> Mapping[int, StoredTrial]:
        """Every trial that is kept, by number.

        Raises
        ------
        StorageError
            Where the file cannot be read, or is damaged.
        """
        return self._journal.read()


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    StorageError
        Where it cannot be written; what was there before is then still there.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """See `write_text`; for bytes.

    Raises
    ------
    StorageError
        Where it cannot be written; what was there before is then still there.
    """
    with storing(path):
        write_whole(path, content)


@contextlib.contextmanager
def storing(path: Path) -> Generator[None]:
    """Turn an error of the operating system into one sentence about `path`.

    Raises
    ------
    StorageError
        In the place of OSError.
    """
    try:
        yield
    except OSError as error:
        raise StorageError(
            Fault(
                "the run cannot be kept",
                where=str(path),
                got=error.strerror or str(error),
                attempt="a folder that can be written to",
            )
        ) from error
