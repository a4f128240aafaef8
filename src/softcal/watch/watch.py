"""One folder that is watched: read when a page asks, at most once a second, and by one thread."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from softcal.watch.run_reader import RunReader
from softcal.watch.twin import TwinKeeper
from softcal.watch.watched import WatchedRun, WatchedSearch

LEAST = 0.9  # [s] between two readings
REST = 9.0  # times as long as a reading took: at most a tenth of a core


class Watch:
    """What all pages of a server share."""

    def __init__(self, folder: Path) -> None:
        self.reader = RunReader(folder)
        self.twins = TwinKeeper(folder)
        self._reading = asyncio.Lock()
        self._run: WatchedRun | None = None
        self._next = 0.0

    async def now(self) -> WatchedRun:
        """The run as it was read last, at most a second ago where that is cheap."""
        async with self._reading:
            began = time.monotonic()
            if self._run is None or began >= self._next:
                self._run = await asyncio.to_thread(self.reader.read)
                took = time.monotonic() - began
                self._next = began + took + max(LEAST, REST * took)
            return self._run

    async def whole(self, search: WatchedSearch) -> WatchedSearch:
        """A search with its trials, which those of finished specimens lack."""
        async with self._reading:
            return await asyncio.to_thread(self.reader.whole, search)
