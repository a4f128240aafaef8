"""What Dask logs of lost connections, which softcal says in a sentence; silenced while a cluster is used."""

from __future__ import annotations

import logging
import threading
from collections.abc import Generator
from contextlib import contextmanager, suppress
from importlib import import_module

_NAMES = ("distributed.client", "distributed.core", "distributed.comm", "distributed.scheduler")
_lock = threading.Lock()
_before: list[dict[str, int]] = []  # the levels that each use of a cluster found; the first is the last to go


@contextmanager
def dask_silenced() -> Generator[None]:
    """Silence Dask within this block; the levels of its loggers are restored when the last such block ends."""
    with suppress(ModuleNotFoundError):
        import_module("distributed")  # which sets the levels itself
    with _lock:
        _before.append({name: logging.getLogger(name).level for name in _NAMES})
        for name in _NAMES:
            logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        with _lock:
            levels = _before.pop()
            if not _before:
                for name, level in levels.items():
                    logging.getLogger(name).setLevel(level)
