"""One folder that is watched: read when a page asks, at most once a second, and by one thread."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, InvalidStateError
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from softcal.plugins.watch.run_reader import RunReader
from softcal.plugins.watch.twin import TwinKeeper
from softcal.plugins.watch.watched import WatchedRun, WatchedSearch

T = TypeVar("T")
LEAST = 0.9  # [s] between two readings
REST = 9.0  # times as long as a reading took: at most a tenth of a core


class Watch:
    """Data that all pages of a server share."""

    def __init__(self, folder: Path) -> None:
        self.reader = RunReader(folder)
        self.twins = TwinKeeper(folder)
        self._reading, self._one = asyncio.Lock(), threading.Lock()
        self._run: WatchedRun | None = None
        self._next = 0.0

    async def now(self) -> WatchedRun:
        """The run as it was read last, at most a second ago where that is cheap."""
        async with self._reading:
            began = time.monotonic()
            if self._run is None or began >= self._next:
                self._run = await self._by_thread(self.reader.read)
                took = time.monotonic() - began
                self._next = began + took + max(LEAST, REST * took)
            return self._run

    async def whole(self, search: WatchedSearch) -> WatchedSearch:
        """A search with its trials, which those of finished specimens lack."""
        async with self._reading:
            return await self._by_thread(lambda: self.reader.whole(search))

    async def _by_thread(self, read: Callable[[], T]) -> T:
        """What a thread reads, which the end of the program does not wait for, as it does for asyncio's own threads."""
        answer: Future[T] = Future()

        def run() -> None:
            with self._one, suppress(InvalidStateError):  # the page that asked is gone
                try:
                    answer.set_result(read())
                except Exception as error:  # noqa: BLE001  told to who asked
                    answer.set_exception(error)

        threading.Thread(target=run, name="softcal-reading", daemon=True).start()
        return await asyncio.wrap_future(answer)
