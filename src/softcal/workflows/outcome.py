"""The outcome of every search of a project beside its result: its folder, its page, and the signal that stopped it."""

from __future__ import annotations

from abc import ABC
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from softcal.errors import Fault, StorageError
from softcal.workflows.watching import WatchedPage, watch_run


@dataclass(frozen=True)
class Outcome(ABC):
    """A search of a project, done or stopped.

    Attributes
    ----------
    folder
        Where it is kept, or None.
    stopped_by
        What stopped it before its end, Ctrl-C or another signal; what was found by then is there.
    """

    _: KW_ONLY
    folder: Path | None
    stopped_by: KeyboardInterrupt | None = None

    @property
    def interrupted(self) -> bool:
        """Whether it was stopped before its end."""
        return self.stopped_by is not None

    def watch(self) -> WatchedPage:
        """Its page, without waiting; see `watch_run`.

        Raises
        ------
        StorageError
            Where it is kept in no folder.
        InputError
            As `watch_run`.
        """
        if self.folder is None:
            raise StorageError(Fault("there is no folder to show", "watch", attempt="out, a folder of the run"))
        return watch_run(self.folder)
