"""The connection to a Dask scheduler, what Dask logs of it, and whether its workers have this softcal."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import hashlib
import logging
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from sysconfig import get_python_version
from typing import TYPE_CHECKING, Any, Protocol, cast

import softcal
from softcal.errors import Fault, InputError
from softcal.extras import require_extra

if TYPE_CHECKING:
    import distributed

ANSWER = 5.0  # [s] that a scheduler has to answer


class Cluster(Protocol):
    """The interface of a Dask cluster that was started for this run."""

    def close(self) -> object:
        """End its workers and its scheduler."""


def dask_client(scheduler: str | Cluster, address: str) -> distributed.Client:
    """A client of a scheduler, by its address or as a cluster of this process.

    Raises
    ------
    InputError
        Where Dask is not installed, or no scheduler answers.
    """
    require_extra("cluster", "distributed", where="--on")
    import distributed

    try:
        if isinstance(scheduler, str):
            # A client of Dask's waits for ever for one that takes the connection and says nothing.
            with concurrent.futures.ThreadPoolExecutor(1) as thread:  # a notebook's own has an event loop already
                thread.submit(asyncio.run, _identity(scheduler)).result()
        return distributed.Client(scheduler, timeout=ANSWER, set_as_default=False, name="softcal")
    except (OSError, TimeoutError, ValueError, RuntimeError, TypeError) as error:
        why = str(error).splitlines()[0] if str(error) else f"no answer within {ANSWER:.0f} s"
        attempt = "dask scheduler on that machine, and its address as it prints it"
        raise InputError(
            Fault("no Dask scheduler answers there", "--on", f"'dask:{address}' ({why})", "", attempt)
        ) from error


async def _identity(address: str) -> None:
    """Ask who is at an address.

    Raises
    ------
    OSError, TimeoutError, ValueError
        Where nobody answers, the address makes no sense, or it is no scheduler's.
    """
    from distributed import Security, rpc

    asked = rpc(address, connection_args=Security().get_connection_args("client"))
    try:
        found: dict[str, Any] = await asyncio.wait_for(asked.identity(), ANSWER)  # pyright: ignore[reportAssignmentType]
    finally:
        await asked.close_rpc()
    if found.get("type") != "Scheduler":
        raise ValueError(f"a Dask {str(found.get('type')).lower()}")


def require_same_code(client: distributed.Client, address: str) -> None:
    """Raise where a worker has another softcal or another Python than this process; all such workers at once.

    softcal is compared by its code and not by its version: that of a state between two releases names the commit, or
    the day, at which it was installed.

    Raises
    ------
    InputError
        As said.
    """
    asked: list[tuple[str, Callable[..., Any]]] = [("Python", get_python_version), ("softcal's code", code_hash)]
    faults: dict[str, Fault] = {}
    for what, function in asked:
        own = function()
        asked_now = [worker for worker in client.scheduler_info(n_workers=-1)["workers"] if worker not in faults]
        told = _answers(client, function, asked_now)
        if not told:  # no worker yet, or one that does not answer: the code is compared with every call
            break
        for worker, found in told.items():
            if isinstance(found, BaseException):
                faults[worker] = Fault(f"the worker {worker} has no usable softcal", "--on", str(found), str(own))
            elif found != own:
                shown = (f"{what} {one}" for one in (found, own))
                faults[worker] = Fault(f"the worker {worker} has another version than this process", "--on", *shown)
    if faults:
        same = Fault("all machines must have the same code of softcal", "--on", f"'dask:{address}'")
        raise InputError([*faults.values(), same])


def _answers(client: distributed.Client, function: Callable[..., Any], workers: list[str]) -> dict[str, Any]:
    """The answer of each worker; without workers that do not answer, which are asked again with every call."""
    found: dict[str, Any] = {}

    def ask() -> None:
        with contextlib.suppress(Exception):  # the connection is closed while it waits
            found.update(cast("dict[str, Any]", client.run(function, workers=workers, on_error="return")))

    asking = threading.Thread(target=ask, daemon=True)  # a worker that is stopped never answers
    asking.start()
    asking.join(ANSWER)
    return dict(found)


@cache
def code_hash() -> str:
    """The first twelve characters of the SHA-256 of all modules of this installation, in the order of their names."""
    home = Path(softcal.__file__).parent
    found = hashlib.sha256()
    for path in sorted(home.rglob("*.py")):
        found.update(path.relative_to(home).as_posix().encode())
        found.update(path.read_bytes())
    return found.hexdigest()[:12]


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
