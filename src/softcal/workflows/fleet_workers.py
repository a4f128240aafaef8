"""Calls in worker processes, in order; a stand-in with the shape of softcal's executors."""

from __future__ import annotations

import concurrent.futures
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

_THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Lost:
    """A call whose worker died."""

    sentence: str


_here: dict[str, Any] = {}


def _begin(function: Any, shared: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _here["function"], _here["shared"] = function, shared


def _call(call: tuple[Any, ...]) -> Any:
    return _here["function"](_here["shared"], *call)


def each(workers: int, function: Callable[..., Any], shared: Any, calls: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    """What function(shared, *call) returned, in the order of the calls."""
    if workers == 1:
        for call in calls:
            yield function(shared, *call)
        return
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    context = multiprocessing.get_context("spawn")
    pool = concurrent.futures.ProcessPoolExecutor(workers, context, _begin, (function, shared))
    try:
        for future in [pool.submit(_call, call) for call in calls]:
            try:
                yield future.result()
            except BrokenProcessPool:
                yield Lost("The worker process died.")
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
