"""Progress display of a calibration without a terminal, as in a log: lines at intervals."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

from softcal.cli.printing import echo
from softcal.mechanics.path_watch import PathProgress, paths_watched

if TYPE_CHECKING:
    from softcal.calibration.search.search import Progress

LEAST, MOST = 10.0, 60.0  # [s] between two lines of one calibration
SHARE = 10  # a line for each tenth of the trials


class CalibrationLines:
    """Lines at the start of a calibration, at each tenth of its trials, at each stage after them, and at the end.

    None within 10 s of the last; one where a minute passed without.
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._begun: dict[str, float] = {}
        self._reported: dict[str, float] = {}
        self._tenth: dict[str, int] = {}
        self._waiting: dict[str, Progress] = {}  # the last unreported state of each
        self._last: tuple[str, Progress] | None = None  # None during the first simulation
        self._entered = self._since = now()
        self._watch = ExitStack()

    def __enter__(self) -> CalibrationLines:
        self._watch.enter_context(paths_watched(self.follow))
        return self

    def __exit__(self, *exception: object) -> None:
        self._watch.close()
        for label, state in list(self._waiting.items()):
            self._tell(label, state)

    def show(self, label: str, state: Progress) -> None:
        """Record the progress of a calibration."""
        now = self._now()
        self._last = label, state
        is_new = label not in self._begun
        if is_new:
            self._begun[label] = now
            for other, last in list(self._waiting.items()):
                self._tell(other, last)
        self._waiting[label] = state
        since = now - self._reported.get(label, now)
        is_further = _tenth(state) > self._tenth.get(label, 0)
        if is_new or state.stage or since >= MOST or (is_further and since >= LEAST):
            self._tell(label, state)

    def say(self, text: str) -> None:
        """Print a line of its own, in the place of those that wait."""
        self._waiting.clear()
        echo(text, err=True)

    def follow(self, path: PathProgress) -> None:
        """Say how far a load path of the present simulation is, where a minute passed without a line."""
        now = self._now()
        if self._last is None and now - self._since >= MOST:
            self._since = now
            echo(f"First simulation; load path at {path} ({now - self._entered:.0f} s)", err=True)
        elif self._last is not None and now - self._reported.get(self._last[0], now) >= MOST:
            self._tell(*self._last, path=f"; load path at {path}")

    def _tell(self, label: str, state: Progress, path: str = "") -> None:
        self._reported[label] = self._now()
        self._tenth[label] = _tenth(state)
        self._waiting.pop(label, None)
        best = "" if state.best_loss is None else f", best loss {state.best_loss:.6g}"
        failed = f", {state.failed} failed" if state.failed else ""
        stage = f"; {state.stage}" if state.stage else ""
        seconds = self._reported[label] - self._begun[label]
        echo(f"{label}: {state.count}{best}{failed}{stage}{path} ({seconds:.0f} s)", err=True)


def _tenth(state: Progress) -> int:
    """Number of tenths of the trials that are done."""
    return SHARE * state.done // state.total if state.total else 0
