"""Workers of a Dask cluster (dask.distributed, the extra `cluster`), on any number of machines."""

from __future__ import annotations

import asyncio
import concurrent.futures
import contextlib
import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from sysconfig import get_python_version
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

from softcal.errors import Fault, InputError, ParameterError
from softcal.executors.code import code_hash
from softcal.executors.executor import (
    TRIES,
    Executor,
    ExecutorLost,
    WorkerLost,
    WorkerState,
    patience,
    register_executor,
)
from softcal.executors.shared import Parcel, UnableError, packed

if TYPE_CHECKING:
    import distributed

_ANSWER = 5.0  # [s] that a scheduler has to answer
_LARGEST = "1GB"  # of what is shared, before Dask warns of its size


class Cluster(Protocol):
    """What one of Dask's clusters offers that was started for this run."""

    def close(self) -> object:
        """End its workers and its scheduler."""


class RefusedError(Exception):
    """A call that one worker cannot do; another may."""

    def __init__(self, worker: str, why: str) -> None:
        super().__init__(worker, why)
        self.worker, self.why = worker, why


@dataclass
class _Call:
    """A call, until its outcome is told.

    refused: why, by worker. tries: how often it ended its worker. alone: whether it is made with no other beside it.
    """

    function: Callable[..., Any]
    args: tuple[Any, ...]
    outcome: concurrent.futures.Future[Any] = field(default_factory=concurrent.futures.Future)
    refused: dict[str, str] = field(default_factory=dict[str, str])
    tries: int = 0
    alone: bool = False


@register_executor
class DaskExecutor(Executor):
    """Calls by the workers of a Dask cluster that is there already.

    What is shared is the result of a task of its own, so that the scheduler makes it again where its holder ends. A
    worker that ends, or stops to answer, costs the call that it was making, which the scheduler gives to another.

    Parameters
    ----------
    address
        Of the scheduler, such as "tcp://host:8786".
    limit
        Seconds after which a call counts as hanging; None: twenty times the longest so far, ten minutes at least.
    cluster
        What is closed with it.

    Raises
    ------
    InputError
        Where Dask is not installed, no scheduler answers, or its workers have another softcal.
    """

    name = "dask"
    summary = "the workers of a Dask cluster: dask:ADDRESS of its scheduler"

    def __init__(self, address: str, *, limit: float | None = None, cluster: Cluster | None = None) -> None:
        self._cluster, self._limit, self._longest = cluster, limit, 0.0
        self._address, self._client = address, _client(address if cluster is None else cluster, address)
        self._kept: dict[str, distributed.Future[Any]] = {}
        self._awaited: set[distributed.Future[Any]] = set()
        self._suspects: deque[_Call] = deque()
        self._lock = threading.Lock()
        self._done: Counter[str] = Counter()
        try:
            _require_same_code(self._client, address)
        except BaseException:
            self._client.close()
            raise

    @classmethod
    def at(cls, address: str, workers: int | None) -> DaskExecutor:
        """The workers of the scheduler at an address.

        Raises
        ------
        ParameterError
            Where there is none, or a number of workers, which is the cluster's to choose.
        InputError
            As the class.
        """
        faults: list[Fault] = []
        if not address:
            faults.append(Fault("the address of the scheduler is missing", "--on", "'dask'", "dask:tcp://HOST:8786"))
        if workers is not None:
            what = "the cluster decides how many workers there are"
            faults.append(Fault(what, "--workers", str(workers), attempt="without --workers"))
        if faults:
            raise ParameterError(faults)
        return cls(address)

    @property
    def count(self) -> int:
        return max(1, len(self._there()))

    @property
    def told(self) -> str:
        return f"the Dask cluster at {self._address}"

    @property
    def workers(self) -> Sequence[WorkerState]:
        there = self._there()
        states = [
            WorkerState(name, "busy" if held.get("metrics", {}).get("executing") else "idle", self._done[name])
            for name, held in there.items()
        ]
        return (*states, *(WorkerState(name, "lost", n) for name, n in self._done.items() if name not in there))

    def share(self, what: object) -> distributed.Future[Any]:
        parcel = packed(what)
        if parcel.digest not in self._kept:
            import dask.config

            with dask.config.set({"distributed.admin.large-graph-warning-threshold": _LARGEST}):
                self._kept[parcel.digest] = self._client.submit(_itself, parcel, key=f"softcal-{parcel.digest}")
        return self._kept[parcel.digest]

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        one = _Call(partial(fn, **kwargs) if kwargs else fn, args)
        self._try(one)
        return one.outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; calls that were not finished are cancelled."""
        with contextlib.suppress(Exception):  # a scheduler that is gone has nothing left to cancel
            self._client.cancel([*self._awaited, *self._kept.values()])
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()

    def _try(self, one: _Call) -> None:
        """Have a call made, by a worker that has not refused it."""
        others = [name for name in self._there() if name not in one.refused] if one.refused else []
        options: dict[str, Any] = {"workers": others, "allow_other_workers": True} if others else {}
        limit = self._limit or patience(self._longest)
        future = self._client.submit(_at_worker, code_hash(), limit, one.function, *one.args, pure=False, **options)
        with self._lock:
            self._awaited.add(future)
        one.outcome.add_done_callback(lambda told: future.cancel() if told.cancelled() else None)
        future.add_done_callback(partial(self._ended, one))

    def _there(self) -> dict[str, dict[str, Any]]:
        """What the scheduler knows of its workers, by address; nothing where it is gone, which the calls tell."""
        with contextlib.suppress(OSError, RuntimeError, TimeoutError):
            return self._client.scheduler_info(n_workers=-1).get("workers", {})
        return {}

    def _ended(self, one: _Call, future: distributed.Future[Any]) -> None:
        """Told by Dask, in a thread of its own, that a call is over in whatever way."""
        again = self._told(one, future)
        if again == "elsewhere":
            self._try(one)
        with self._lock:
            self._awaited.discard(future)
            if again == "alone":
                self._suspects.append(one)
            # Where a worker ends, Dask suspects every call that it had; alone, only the culprit ends it again.
            suspect = self._suspects.popleft() if self._suspects and not self._awaited else None
        if suspect is not None:
            suspect.alone = True
            self._try(suspect)

    def _told(self, one: _Call, future: distributed.Future[Any]) -> Literal["", "elsewhere", "alone"]:
        """Tell what came of a call; or how it is to be made again."""
        from distributed import KilledWorker

        if one.outcome.cancelled():
            return ""
        error: BaseException | None = None
        try:
            if future.status == "finished":
                worker, seconds, result = future.result()  # made again by Dask where its holder has ended meanwhile
                self._done[worker] += 1
                self._longest = max(self._longest, seconds)
                self._tell(one, result)
                return ""
            if future.status == "error":
                error = cast("BaseException | None", future.exception())
        except Exception as lost:  # noqa: BLE001  Dask's own errors of a connection that is gone have no common class
            logging.getLogger(__name__).debug("a result was lost: %s", lost)
        if isinstance(error, RefusedError):
            one.refused[error.worker] = error.why
            if len(one.refused) < min(TRIES, max(2, self.count)):
                return "elsewhere"
            told = "; ".join(f"{worker}: {why}" for worker, why in one.refused.items())
            error = WorkerLost(f"It was tried on {len(one.refused)} workers, and none could do it: {told}.")
        elif isinstance(error, KilledWorker):
            one.tries += error.allowed_failures + 1
            if not one.alone:
                return "alone"
            error = WorkerLost(
                f"It was tried {one.tries} times, and its worker process ended unexpectedly, perhaps for lack of "
                "memory."
            )
        self._tell(one, error=self._meaning(error))
        return ""

    def _tell(self, one: _Call, result: Any = None, error: BaseException | None = None) -> None:
        with contextlib.suppress(concurrent.futures.InvalidStateError):  # cancelled in this moment
            if error is None:
                one.outcome.set_result(result)
            else:
                one.outcome.set_exception(error)

    def _meaning(self, error: BaseException | None) -> BaseException:
        """What came of a call that has no result, as softcal's error."""
        if error is None:
            return ExecutorLost(
                f"The scheduler at {self._address} no longer answers. What was told so far is kept. Try: start it "
                "again, and resume."
            )
        if isinstance(error, ImportError):
            return ExecutorLost(f"A worker cannot import what it is asked to do: {error}. Try: the same installation.")
        return error


def _client(scheduler: str | Cluster, address: str) -> distributed.Client:
    """A client of a scheduler, by its address or as a cluster of this process.

    Raises
    ------
    InputError
        Where Dask is not installed, or no scheduler answers.
    """
    try:
        import distributed
    except ModuleNotFoundError as error:
        what = f"this needs {error.name}, which is not installed"
        raise InputError(Fault(what, "--on", attempt="pip install 'softcal[cluster]'")) from error
    # What Dask logs of a lost connection is said by softcal in a sentence.
    for name in ("distributed.client", "distributed.core", "distributed.comm", "distributed.scheduler"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        if isinstance(scheduler, str):
            # A client of Dask's waits for ever for one that takes the connection and says nothing.
            with concurrent.futures.ThreadPoolExecutor(1) as thread:  # a notebook's own has an event loop already
                thread.submit(asyncio.run, _identity(scheduler)).result()
        return distributed.Client(scheduler, timeout=_ANSWER, set_as_default=False, name="softcal")
    except (OSError, TimeoutError, ValueError, RuntimeError, TypeError) as error:
        why = str(error).splitlines()[0] if str(error) else f"no answer within {_ANSWER:.0f} s"
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
        found: dict[str, Any] = await asyncio.wait_for(asked.identity(), _ANSWER)  # pyright: ignore[reportAssignmentType]
    finally:
        await asked.close_rpc()
    if found.get("type") != "Scheduler":
        raise ValueError(f"a Dask {str(found.get('type')).lower()}")


def _require_same_code(client: distributed.Client, address: str) -> None:
    """Raise where a worker has another softcal or another Python than this process; all such workers at once.

    Raises
    ------
    InputError
        As said.
    """
    ours = (get_python_version(), version("softcal"), code_hash())
    asked: list[tuple[str, Callable[..., Any], tuple[str, ...]]] = [
        ("Python", get_python_version, ()),
        ("softcal", version, ("softcal",)),
        ("softcal's code", code_hash, ()),
    ]
    faults: dict[str, Fault] = {}
    for (what, function, args), own in zip(asked, ours, strict=True):
        asked_now = _still_asked(client, faults)
        told = cast("dict[str, Any]", client.run(function, *args, workers=asked_now, on_error="return"))
        for worker, found in told.items():
            if isinstance(found, BaseException):
                faults[worker] = Fault(f"the worker {worker} has no usable softcal", "--on", str(found), str(own))
            elif found != own:
                shown = (f"{what} {one}" for one in (found, own))
                faults[worker] = Fault(f"the worker {worker} has another version than this process", "--on", *shown)
    if faults:
        same = Fault("the same softcal must be on all machines", "--on", f"'dask:{address}'")
        raise InputError([*faults.values(), same])


def _still_asked(client: distributed.Client, faults: dict[str, Fault]) -> list[str]:
    return [worker for worker in client.scheduler_info(n_workers=-1)["workers"] if worker not in faults]


def _itself(parcel: Parcel) -> Parcel:
    return parcel


def _at_worker(code: str, limit: float | None, function: Callable[..., Any], *args: Any) -> tuple[str, float, Any]:
    """A call at a worker: the worker's address, the seconds that it took, and its result.

    Raises
    ------
    RefusedError
        Where this worker cannot do it.
    """
    from distributed import get_worker

    worker, began = get_worker().address, time.perf_counter()
    if code != code_hash():
        raise RefusedError(worker, f"its softcal has other code than that of the run, {code_hash()} and not {code}")
    try:
        with _ended_after(limit):
            result = function(*args)
    except UnableError as error:
        raise RefusedError(worker, str(error)) from error
    return worker, time.perf_counter() - began, result


@contextlib.contextmanager
def _ended_after(limit: float | None) -> Any:
    """End this process where the block takes longer than a limit [s], even in code that never returns to Python."""
    import faulthandler
    import os

    if limit is None:
        yield
        return
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(limit, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
