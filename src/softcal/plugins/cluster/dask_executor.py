"""Workers of a Dask cluster (dask.distributed, the extra `cluster`), on any number of machines."""

from __future__ import annotations

import concurrent.futures
import contextlib
import faulthandler
import logging
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, cast

from softcal.errors import Fault, ParameterError
from softcal.executors.executor import (
    TRIES,
    Executor,
    ExecutorLost,
    Patience,
    WorkerLost,
    WorkerState,
    register_executor,
)
from softcal.executors.shared import Parcel, UnableError, one_at_a_time, packed
from softcal.plugins.cluster.dask_client import (
    ANSWER,
    Cluster,
    code_hash,
    dask_client,
    dask_silenced,
    require_same_code,
)

if TYPE_CHECKING:
    import distributed

_LOOK = 1.0  # [s] between two questions to the scheduler for its workers
SILENCE = 300.0  # [s] without an answer of the scheduler after which it is given up
_LARGEST = "1GB"  # of what is shared, before Dask warns of its size


class RefusedError(Exception):
    """A call that one worker cannot do; another may. foreign: since it has another softcal."""

    def __init__(self, worker: str, why: str, foreign: bool = False) -> None:
        super().__init__(worker, why, foreign)
        self.worker, self.why, self.foreign = worker, why, foreign


@dataclass(eq=False)
class _Call:
    """A call without an outcome yet.

    refused: by which workers, and why. tries: how often it ended its worker. gone: how often its result was lost with
    its worker. alone: whether it is made with no other beside it.
    """

    function: Callable[..., Any]
    args: tuple[Any, ...]
    outcome: concurrent.futures.Future[Any] = field(default_factory=concurrent.futures.Future)
    refused: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    tries: int = 0
    gone: int = 0
    alone: bool = False


@register_executor
class DaskExecutor(Executor):
    """Calls by the workers of an existing Dask cluster.

    A shared object is the result of a task, so that the scheduler computes it again where the worker with it ends. A
    worker that ends, or stops to answer, costs its current call, which the scheduler gives to another worker.

    Parameters
    ----------
    address
        Address of the scheduler, such as "tcp://host:8786".
    limit
        Seconds after which a call counts as hanging; None: twenty times the longest call so far, at least ten
        minutes, and six hours for a worker's first call that began before any had ended.
    cluster
        The cluster that is closed with the executor.

    Raises
    ------
    InputError
        Where Dask is not installed, no scheduler answers, or its workers have another softcal.
    """

    name = "dask"
    summary = "the workers of a Dask cluster: dask:ADDRESS of its scheduler"

    def __init__(self, address: str, *, limit: float | None = None, cluster: Cluster | None = None) -> None:
        self._cluster, self._patience, self._longest = cluster, Patience(limit), 0.0
        self._address = address
        with contextlib.ExitStack() as stack:
            stack.enter_context(dask_silenced())
            self._client = dask_client(address if cluster is None else cluster, address)
            try:
                require_same_code(self._client, address)
            except BaseException:
                self._client.close()
                raise
            self._silenced = stack.pop_all()
        self._kept: dict[str, distributed.Future[Any]] = {}
        self._awaited: set[distributed.Future[Any]] = set()
        self._suspects: deque[_Call] = deque()
        self._foreign: set[str] = set()
        self._closing = False
        self._there: dict[str, dict[str, Any]] = {}
        self._open: set[_Call] = set()
        self._lock = threading.Lock()
        self._done: Counter[str] = Counter()
        self._over = threading.Event()
        with contextlib.suppress(Exception):
            self._look()
        threading.Thread(target=self._watch, daemon=True).start()

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
        return max(1, len(self._there))

    @property
    def told(self) -> str:
        return f"the Dask cluster at {self._address}"

    @property
    def workers(self) -> Sequence[WorkerState]:
        there = self._there
        states = [
            WorkerState(name, "busy" if held.get("metrics", {}).get("executing") else "idle", self._done[name])
            for name, held in there.items()
        ]
        return (*states, *(WorkerState(name, "lost", n) for name, n in list(self._done.items()) if name not in there))

    def sent(self, what: object) -> distributed.Future[Any]:
        parcel = packed(what)
        if parcel.digest not in self._kept:
            import dask.config

            with dask.config.set({"distributed.admin.large-graph-warning-threshold": _LARGEST}):
                self._kept[parcel.digest] = self._client.submit(_itself, parcel, key=f"softcal-{parcel.digest}")
        return self._kept[parcel.digest]

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        one = _Call(partial(fn, **kwargs) if kwargs else fn, args)
        self._open.add(one)
        one.outcome.add_done_callback(lambda told: self._open.discard(one))
        self._try(one)
        return one.outcome

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; calls that were not finished are cancelled."""
        self._closing = True
        self._over.set()
        with self._silenced:
            with contextlib.suppress(Exception):  # a scheduler that is gone has nothing left to cancel
                self._look()  # nor has one that is silent, which would be waited for for ever
                self._client.cancel([*self._awaited, *self._kept.values()])
            with contextlib.suppress(TimeoutError):
                self._client.close()
            if self._cluster is not None:
                self._cluster.close()

    def _try(self, one: _Call) -> bool:
        """Have a call made, by a worker that has not refused it; False where none can be asked any more."""
        avoided = {worker for worker, _ in one.refused} | self._foreign
        others = [name for name in self._there if name not in avoided] if avoided else []
        options: dict[str, Any] = {"workers": others, "allow_other_workers": True} if others else {}
        if self._over.is_set() or self._client.status != "running":  # it would take the call, and never tell of it
            self._tell(one, error=self._meaning(None))
            return False
        asked = _Asked(code_hash(), self._client.id, self._patience, self._longest)
        future = self._client.submit(_at_worker, asked, one.function, *one.args, pure=False, **options)
        with self._lock:
            self._awaited.add(future)
        one.outcome.add_done_callback(lambda told: future.cancel() if told.cancelled() else None)
        future.add_done_callback(partial(self._ended, one))
        return True

    def _look(self) -> None:
        """Ask the scheduler what it knows of its workers, by address.

        Raises
        ------
        Exception
            Dask's own, which have no common class, where it does not answer in time.
        """
        client: Any = self._client
        self._there = client.sync(client.scheduler.identity, n_workers=-1, callback_timeout=ANSWER)["workers"]

    def _watch(self) -> None:
        """Keep up with the workers until the end, and give up a scheduler that is connected and says nothing more: Dask
        would wait for it for ever.
        """
        answered = time.monotonic()
        while not self._over.wait(_LOOK):
            try:
                self._look()
                answered = time.monotonic()
            except Exception:  # noqa: BLE001  of one that is gone; the calls tell
                self._there = {}
            if time.monotonic() - answered > SILENCE:
                self._over.set()
                for one in list(self._open):
                    self._tell(one, error=self._meaning(None))

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
        while (suspect := self._next_suspect()) is not None:
            suspect.alone = True
            if self._try(suspect):
                break

    def _next_suspect(self) -> _Call | None:
        with self._lock:
            while self._suspects and not self._awaited:
                suspect = self._suspects.popleft()
                if not suspect.outcome.cancelled():
                    return suspect
        return None

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
        if error is None and self._client.status == "running" and not self._closing and one.gone < TRIES:
            one.gone += 1
            return "elsewhere"
        if isinstance(error, RefusedError):
            if error.foreign:
                self._foreign.add(error.worker)
                if any(name not in self._foreign for name in self._there):
                    return "elsewhere"
                error = ExecutorLost(f"Every worker has another softcal; {error.worker}: {error.why}.")
            else:
                one.refused.append((error.worker, error.why))
                if len(one.refused) < TRIES:
                    return "elsewhere"
                told = "; ".join(dict.fromkeys(f"{worker}: {why}" for worker, why in one.refused))
                error = WorkerLost(f"It was tried {len(one.refused)} times, and no worker could do it: {told}.")
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
        """The outcome of a call without a result, as softcal's error."""
        if error is None:
            return ExecutorLost(
                f"The scheduler at {self._address} no longer answers. What was told so far is kept. Try: start it "
                "again, and resume."
            )
        if isinstance(error, ImportError):
            return ExecutorLost(f"A worker cannot import what it is asked to do: {error}. Try: the same installation.")
        return error


def _itself(parcel: Parcel) -> Parcel:
    return parcel


@dataclass(frozen=True)
class _Asked:
    """The data sent to a worker with a call: softcal's code, the client, and the limit of time.

    longest: of the client's calls that had ended when it was handed over [s], 0 where none had.
    """

    code: str
    client: str
    patience: Patience
    longest: float


_own_longest: dict[str, float] = {}  # in a worker: client -> its longest call here [s]


def _at_worker(asked: _Asked, function: Callable[..., Any], *args: Any) -> tuple[str, float, Any]:
    """A call at a worker: the worker's address, the seconds that it took, and its result.

    Raises
    ------
    RefusedError
        Where this worker cannot do it.
    """
    from distributed import get_worker

    worker, began = get_worker().address, time.perf_counter()
    if asked.code != code_hash():
        why = f"its softcal has other code than that of the run, {code_hash()} and not {asked.code}"
        raise RefusedError(worker, why, foreign=True)
    try:
        with one_at_a_time:
            # Others of the calls that were handed over with this one may have ended here meanwhile.
            longest = max(asked.longest, _own_longest.get(asked.client, 0.0))
            with _ended_after(asked.patience.after(longest)):
                result = function(*args)
            seconds = time.perf_counter() - began
            _own_longest[asked.client] = max(longest, seconds)
    except UnableError as error:
        raise RefusedError(worker, str(error)) from error
    return worker, seconds, result


@contextlib.contextmanager
def _ended_after(limit: float) -> Generator[None]:
    """End this process where the block takes longer than a limit [s], even in code that never returns to Python."""
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(limit, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
