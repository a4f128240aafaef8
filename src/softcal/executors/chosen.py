"""The executor that a caller chose: by `--on`, or as a number of processes."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from typing import Annotated

from softcal.declare import checked_arguments
from softcal.errors import Fault, ParameterError
from softcal.executors.executor import EXECUTORS, Executor
from softcal.executors.kinds.local import LocalExecutor
from softcal.limits import LIMITS

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
