"""The trials of a search that may still run, from the journal in its folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from softcal.calibration.result import Trial
from softcal.calibration.store import JOURNAL
from softcal.watch.reading import Unreadable, clean, finite, inside, numbers

STUDY = "softcal"


class TrialReader:
    """Reads a journal again and again, each time only what is new in it."""

    def __init__(self, folder: Path, place: str = JOURNAL) -> None:
        self._folder, self._place = folder, place
        self._storage: Any = None
        self._file: tuple[int, int] | None = None
        self._size = -1
        self._found: dict[int, Trial] = {}

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
                self._add(path)
                self._size = about.st_size
        except Exception as error:
            self._forget()
            raise Unreadable(f"{JOURNAL} cannot be read: it is damaged.") from error
        return tuple(self._found[number] for number in sorted(self._found))

    def _forget(self) -> None:
        self._storage, self._file, self._size, self._found = None, None, -1, {}

    def _add(self, path: Path) -> None:
        from optuna.storages import JournalStorage
        from optuna.storages.journal import JournalFileBackend

        if self._storage is None:
            self._storage = JournalStorage(JournalFileBackend(str(path)))
        studies = {study.study_name: study._study_id for study in self._storage.get_all_studies()}  # noqa: SLF001
        if STUDY not in studies:
            return
        for frozen in self._storage.get_all_trials(studies[STUDY], deepcopy=False):
            if frozen.number not in self._found and frozen.state.is_finished():
                self._found[frozen.number] = _trial(frozen)


def _trial(frozen: Any) -> Trial:
    loss = finite(frozen.value)
    return Trial(
        frozen.number,
        numbers(frozen.params),
        "FAILED" if loss is None else "COMPLETE",
        loss,
        clean(frozen.user_attrs.get("reason")),
        finite(frozen.user_attrs.get("seconds")) or 0.0,
        experiment_losses=numbers(frozen.user_attrs.get("experiment_losses")),
    )
