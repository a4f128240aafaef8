"""Many calls that share one object, their results in the order of the calls."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from typing import Any

from softcal.executors.executor import Executor, WorkerLost
from softcal.executors.shared import call


@dataclass(frozen=True)
class Lost:
    """In the place of a result: why the call has none, as a sentence."""

    why: str


def each(
    executor: Executor, function: Callable[..., Any], shared: object, calls: Iterable[tuple[Any, ...]]
) -> Generator[Any]:
    """function(shared, *args) for the args of each call, in their order, each as soon as it is there.

    Calls that are not finished when the generator is closed are cancelled.

    Parameters
    ----------
    executor
        Where the calls are made.
    function
        A function that the workers can import.
    shared
        The object that all calls have in common: it is sent to a worker once.
    calls
        The other arguments of each.

    Raises
    ------
    ExecutorLost
        Where no more calls can be made.
    CalibrationError
        Where the shared object cannot be pickled.
    Exception
        What the function raises.
    """
    if executor.alone:
        yield from (function(shared, *args) for args in calls)
        return
    parcel = executor.share(shared)
    futures = [executor.submit(call, parcel, function, *args) for args in calls]
    try:
        for future in futures:
            try:
                yield future.result()
            except WorkerLost as error:
                yield Lost(str(error))
    finally:
        for future in futures:
            future.cancel()


def results(
    executor: Executor, function: Callable[..., Any], shared: object, calls: Iterable[tuple[Any, ...]]
) -> Generator[Any]:
    """As `each`, where every call must have a result.

    Raises
    ------
    WorkerLost
        Where one has none.
    """
    for found in each(executor, function, shared, calls):
        if isinstance(found, Lost):
            raise WorkerLost(found.why)
        yield found
