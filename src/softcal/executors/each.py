"""The executor that a caller chose, by `--on` or as a number of processes; and many calls that share one object, their
results in the order of the calls.
"""

from __future__ import annotations

import concurrent.futures
from collections import deque
from collections.abc import Callable, Generator, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from typing import Annotated, Any

from softcal.declare import checked_arguments
from softcal.errors import Fault, ParameterError
from softcal.executors.executor import EXECUTORS, Executor, WorkerLost
from softcal.executors.kinds.local import LocalExecutor
from softcal.executors.shared import call
from softcal.limits import LIMITS

_AHEAD = 4  # calls handed over for each worker
Workers = Annotated[int, LIMITS["workers"]] | Executor
"""A number of processes, or an executor."""


@contextmanager
def executor_of(workers: int | Executor) -> Generator[Executor]:
    """An executor, left open; or, closed at the end, that of so many processes of this machine.

    Raises
    ------
    ParameterError
        For less than one process.
    """
    if isinstance(workers, Executor):
        yield workers
        return
    with LocalExecutor(workers) as own:
        yield own


@checked_arguments
@contextmanager
def executor_on(on: str, workers: Annotated[int, LIMITS["workers"]] | None = None) -> Generator[Executor]:
    """The executor that `NAME` or `NAME:ADDRESS` names, such as "local" or "dask:tcp://host:8786", closed at the end.

    workers: their number, where it is for the executor to choose; None for its default.

    Raises
    ------
    ParameterError
        Where there is no such executor.
    InputError
        Where it cannot be had.
    """
    if not on.isprintable():
        raise ParameterError(Fault("this is no executor", "--on", repr(on), "NAME or NAME:ADDRESS, in one line"))
    name, _, address = on.partition(":")
    with EXECUTORS.named(name.strip(), "--on").at(address.strip(), workers) as executor:
        yield executor


@dataclass(frozen=True)
class LostCall:
    """In the place of a result: why the call has none, as a sentence."""

    why: str


def each(
    executor: Executor, function: Callable[..., Any], shared: object, calls: Iterable[tuple[Any, ...]]
) -> Generator[Any]:
    """Results of function(shared, *args) for the args of each call, in order, each as soon as it is complete.

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
        yield from (here(function, shared, *args) for args in calls)
        return
    parcel, waiting = executor.share(shared), iter(calls)
    futures: deque[concurrent.futures.Future[Any]] = deque()  # in the order of the calls
    unfinished: set[concurrent.futures.Future[Any]] = set()
    try:
        while True:
            # A few for each worker, not all: how long a call may take is known when others have ended.
            for args in islice(waiting, max(0, _AHEAD * executor.count - len(unfinished))):
                futures.append(executor.submit(call, parcel, function, *args))
                unfinished.add(futures[-1])
            if not futures:
                return
            while futures and futures[0].done():
                try:
                    result = futures.popleft().result()
                except WorkerLost as error:
                    result = LostCall(str(error))
                yield result
            unfinished = {one for one in unfinished if not one.done()}
            if futures and not futures[0].done():
                concurrent.futures.wait(unfinished, return_when=concurrent.futures.FIRST_COMPLETED)
    finally:
        for future in futures:
            future.cancel()


def here(function: Callable[..., Any], *args: Any) -> Any:
    """function(*args) in this process; a machine that cannot do it is `LostCall`, as with workers."""
    try:
        return function(*args)
    except (OSError, MemoryError) as error:
        return LostCall(f"The machine could not do it ({str(error) or type(error).__name__}).")


def results(
    executor: Executor, function: Callable[..., Any], shared: object, calls: Iterable[tuple[Any, ...]]
) -> Generator[Any]:
    """See `each`; every call must have a result.

    Parameters
    ----------
    executor, function, shared, calls
        See `each`.

    Raises
    ------
    WorkerLost
        Where one has none.
    """
    for found in each(executor, function, shared, calls):
        if isinstance(found, LostCall):
            raise WorkerLost(found.why)
        yield found
