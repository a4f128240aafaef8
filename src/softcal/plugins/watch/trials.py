"""The trials of a search that may still run, from the journal in its folder."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from pathlib import Path

from softcal.calibration.results.result import Trial
from softcal.calibration.results.trial_journal import JOURNAL, LONGEST_LINE, StoredTrial, trial_of_line
from softcal.limits import LIMITS
from softcal.plugins.watch.reading import Unreadable, clean, finite, inside, numbers
from softcal.regular_file import own_file

MOST_BYTES = 2**28  # of a journal
MOST_VALUES = 1_000_000  # of parameters, in all trials


class TrialReader:
    """Reads a journal again and again, each time only what is new in it."""

    def __init__(self, folder: Path, place: str = JOURNAL) -> None:
        self._folder, self._place = folder, place
        self._forget()

    def read(self) -> tuple[Trial, ...]:
        """Every trial that is done, in order.

        Raises
        ------
        Unreadable
            Where the journal is damaged, or larger than any of softcal's.
        """
        path = inside(self._folder, self._place)
        if path is None:
            self._forget()
            return ()
        try:
            with open(path, "rb", opener=own_file) as file:
                about = os.fstat(file.fileno())
                if self._file != (about.st_dev, about.st_ino) or about.st_size < self._end:
                    self._forget()
                    self._file = (about.st_dev, about.st_ino)
                if about.st_size > MOST_BYTES:
                    raise Unreadable(f"{JOURNAL} cannot be read: it has more than {MOST_BYTES} bytes.")
                file.seek(self._end)
                while (line := file.readline(LONGEST_LINE)).endswith(b"\n"):
                    self._add(trial_of_line(line, path.parent))
                    self._end += len(line)
                if len(line) == LONGEST_LINE:
                    raise ValueError("a line is too long")
        except Unreadable:
            self._forget()
            raise
        except (OSError, ValueError, LookupError, TypeError, RecursionError) as error:
            self._forget()
            raise Unreadable(f"{JOURNAL} cannot be read: it is damaged.") from error
        return tuple(self._found[number] for number in sorted(self._found))

    def _add(self, stored: StoredTrial | None) -> None:
        if stored is None:
            return
        # Texts that can be shown, numbers that are finite, names that are kept once.
        loss = finite(stored.trial.loss)
        trial = replace(
            stored.trial,
            theta={sys.intern(name): value for name, value in numbers(stored.trial.theta).items()},
            loss=loss,
            state="FAILED" if loss is None else "COMPLETE",
            reason=sys.intern(clean(stored.trial.reason)),
            experiment_losses={},
            errors={},
        )
        if trial.number in self._found:
            raise ValueError(f"trial {trial.number} occurs twice")
        self._n_values += len(trial.theta)
        if len(self._found) >= LIMITS["trials"].most or self._n_values > MOST_VALUES:
            raise Unreadable(f"{JOURNAL} has more trials than the page shows.")
        self._found[trial.number] = trial
        self.seconds = max(self.seconds, stored.elapsed)  # of the search when the last trial was recorded

    def _forget(self) -> None:
        self._file: tuple[int, int] | None = None
        self._end, self._n_values, self.seconds = 0, 0, 0.0
        self._found: dict[int, Trial] = {}
