"""The trials of a search that may still run, from the journal in its folder."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from softcal.calibration.result import Trial
from softcal.calibration.trial_journal import JOURNAL, StoredTrial, TrialJournal
from softcal.errors import StorageError
from softcal.watch.reading import Unreadable, clean, finite, inside, numbers


class TrialReader:
    """Reads a journal again and again, each time only what is new in it."""

    def __init__(self, folder: Path, place: str = JOURNAL) -> None:
        self._folder, self._place = folder, place
        self._journal: TrialJournal | None = None
        self._file: tuple[int, int] | None = None
        self._size = -1
        self._found: dict[int, Trial] = {}
        self.seconds = 0.0  # of the search when the last trial was recorded

    def read(self) -> tuple[Trial, ...]:
        """Every trial that is done, in order.

        Raises
        ------
        Unreadable
            Where the journal is damaged.
        """
        path = inside(self._folder, self._place)
        if path is None:
            self._forget()
            return ()
        try:
            about = path.stat()
            if self._file != (about.st_dev, about.st_ino) or about.st_size < self._size:
                self._forget()
                self._file = (about.st_dev, about.st_ino)
            if about.st_size != self._size:
                self._journal = self._journal or TrialJournal(path)
                held = self._journal.read()
                self._found |= {number: _shown(held[number]) for number in held.keys() - self._found.keys()}
                self.seconds = max((one.elapsed for one in held.values()), default=0.0)
                self._size = about.st_size
        except (StorageError, OSError) as error:
            self._forget()
            raise Unreadable(f"{JOURNAL} cannot be read: it is damaged.") from error
        return tuple(self._found[number] for number in sorted(self._found))

    def _forget(self) -> None:
        self._journal, self._file, self._size, self._found, self.seconds = None, None, -1, {}, 0.0


def _shown(stored: StoredTrial) -> Trial:
    """A trial whose texts can be shown, and whose numbers are finite."""
    trial = stored.trial
    loss = finite(trial.loss)
    state = "FAILED" if loss is None else "COMPLETE"
    return replace(trial, theta=numbers(trial.theta), loss=loss, state=state, reason=clean(trial.reason))
