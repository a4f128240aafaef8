"""The present activity of a search, in a file of its run folder that other processes may read.

    live.json   progress, stage, executor and workers; replaced as a whole, about once a second while the search works

    {"format": 1, "pid": 4711, "host": "bench", "began": "2026-11-23T06:00:00+00:00", "updated": "…", "ended": false,
     "done": 12, "total": 1000, "failed": 1, "stage": "", "executor": "2 processes of this machine",
     "workers": [{"name": "process 4712", "state": "busy", "done": 6}]}

It is for the eyes alone: nothing is ever resumed from it, and a search goes on where it cannot be written.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.results.store import write_text
from softcal.errors import StorageError
from softcal.executors.executor import Executor

if TYPE_CHECKING:
    from softcal.calibration.search.search import Observer, Progress

LIVE = "live.json"
_FORMAT = 1
_EVERY = 1.0  # [s]


@contextmanager
def told_live(folder: Path | None, executor: Executor, observer: Observer | None = None) -> Generator[Observer]:
    """An observer that passes progress on to another, and writes its last into a folder about once a second.

    Parameters
    ----------
    folder
        None writes nowhere.
    executor, observer
        Whose workers are listed, and who is told.
    """
    last: Progress | None = None

    def tell(progress: Progress) -> None:
        nonlocal last
        last = progress
        if observer is not None:
            observer(progress)

    if folder is None:
        yield tell
        return
    began, over = _now(), threading.Event()

    def write(ended: bool) -> None:
        # A full disk is told by what the search itself stores, a lost cluster by its calls.
        with contextlib.suppress(StorageError, RuntimeError, OSError):
            counts = {name: getattr(last, name, 0) for name in ("done", "total", "failed")}
            write_text(
                folder / LIVE,
                json.dumps(
                    {
                        "format": _FORMAT,
                        "pid": os.getpid(),
                        "host": socket.gethostname(),
                        "began": began,
                        "updated": _now(),
                        "ended": ended,
                        **counts,
                        "stage": "" if last is None else last.stage,
                        "executor": executor.told,
                        "workers": [asdict(one) for one in executor.workers],
                    }
                ),
            )

    def go_on() -> None:
        while not over.wait(_EVERY):
            write(ended=False)

    write(ended=False)
    thread = threading.Thread(target=go_on, name="softcal-live", daemon=True)
    thread.start()
    try:
        yield tell
    finally:
        over.set()
        thread.join()
        write(ended=True)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
