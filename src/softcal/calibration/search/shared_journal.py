"""The journal file of shared studies: opened by Optuna under a lock of the system, and looked at before it is."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.results.file_lock import hold, lock
from softcal.calibration.results.trial_journal import BEGIN, LONGEST_LINE, cut_to_whole_lines
from softcal.errors import Fault, StorageError
from softcal.regular_file import not_a_file

if TYPE_CHECKING:
    import optuna

MOST_BYTES = 2**30  # of a journal; that of a hundred thousand trials has less than half of it
NO_JOURNAL, ANOTHER = "this file is no journal of a study", "journal:FILE of a new file, or of a study's"


def is_new_journal(path: Path) -> bool:
    """Whether a journal does not exist yet; none is created, and an existing one is not changed.

    Raises
    ------
    StorageError
        Where it cannot be created, or an existing file is no journal.
    ValueError, RecursionError
        Where the last line of an existing journal is damaged.
    OSError
        Where an existing journal cannot be read, written or locked.
    """
    if not_a_file(path):
        folder = path.resolve().parent
        try:
            with tempfile.TemporaryFile(dir=folder) as file:
                lock(file)
        except OSError as error:
            got = error.strerror or str(error)
            raise StorageError(Fault("no file can be made and locked in this folder", str(folder), got)) from error
        return True
    _require_journal(path)
    with contextlib.suppress(BlockingIOError):  # of another process that writes
        hold(path).close()
    return False


def open_journal(path: Path) -> optuna.storages.BaseStorage:
    """Optuna's storage in a file, made if it is not there.

    Raises
    ------
    StorageError
        Where a file is there that is no journal.
    OSError, *BROKEN
        Where it cannot be read or made; where one of its lines is damaged.
    """
    from optuna.storages import JournalStorage
    from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock

    if not not_a_file(path):
        _require_journal(path)

    class HeldFile(JournalFileOpenLock):
        """The operating system holds it, on the file itself, so that none is left where a process is killed."""

        def acquire(self) -> bool:
            self._file = hold(path, wait=True)
            try:
                cut_to_whole_lines(path)
            except BaseException:
                self._file.close()
                raise
            return True

        def release(self) -> None:
            self._file.close()

    return JournalStorage(JournalFileBackend(str(path), lock_obj=HeldFile(str(path))))


def _require_journal(path: Path) -> None:
    """Raise an error if a file is no journal: it belongs to the user, and nothing is written into it.

    Only its beginning and its last line are checked; Optuna reads the lines between, and reports their faults.

    Raises
    ------
    StorageError, ValueError, RecursionError
        Where it is no journal, or its last line is damaged.
    OSError
        Where it cannot be read.
    """
    first = last = b""
    with path.open("rb") as file:
        is_large = os.fstat(file.fileno()).st_size > MOST_BYTES
        while not is_large and (line := file.readline(LONGEST_LINE)):
            first = first or line
            is_large = len(line) == LONGEST_LINE
            last = line if line.endswith(b"\n") else last  # one without an end may be written at this moment
    if is_large or (first and not (first.startswith(BEGIN) and first.endswith(b"\n"))):
        raise StorageError(Fault(NO_JOURNAL, str(path), attempt=ANOTHER))
    if last:
        json.loads(last)
