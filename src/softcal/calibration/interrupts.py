"""Ctrl-C held back for the moments in which it would leave something half done."""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def interrupts_held() -> Generator[None]:
    """Let a Ctrl-C that comes in here wait for the end, and come then.

    Only the main thread is ever interrupted, so in others this does nothing.
    """
    answer = signal.getsignal(signal.SIGINT)
    # None: a handler from outside Python, which could not be put back.
    if threading.current_thread() is not threading.main_thread() or answer is None:
        yield
        return
    came = threading.Event()
    signal.signal(signal.SIGINT, lambda number, frame: came.set())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, answer)
        if came.is_set():
            signal.raise_signal(signal.SIGINT)
