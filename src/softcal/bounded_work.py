"""Limits of time and memory of work on what others have written, which may take more than it looks like."""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path


class TimeUp(BaseException):
    """The end of a `time_limit`; not an Exception, of which libraries catch some."""


@contextmanager
def time_limit(seconds: float) -> Generator[None]:
    """Work in Python that has an end.

    Raises
    ------
    TimeUp
        Where it takes longer.
    """
    thread, done = threading.get_ident(), threading.Event()

    def watch() -> None:
        clocks = (time.monotonic, time.process_time)  # at full load a process gets less than the clock says
        start = [clock() for clock in clocks]
        while not done.wait(0.1):
            if min(clock() - begin for clock, begin in zip(clocks, start, strict=True)) > seconds:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(TimeUp))
                return

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield
    finally:
        done.set()
        watcher.join()


@contextmanager
def memory_limit(more: float) -> Generator[None]:
    """Work during which this process may have so many bytes more than now: beyond, a MemoryError is raised. Linux alone
    has such a limit.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[0])
    most = pages * resource.getpagesize() + int(more)
    before, hard = resource.getrlimit(resource.RLIMIT_AS)
    least = min(one for one in (most, before, hard) if one != resource.RLIM_INFINITY)
    resource.setrlimit(resource.RLIMIT_AS, (least, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (before, hard))
