"""Processes of this machine."""

from __future__ import annotations

import concurrent.futures
import contextlib
import multiprocessing
import os
import queue
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from numbers import Integral
from pathlib import Path
from typing import Any, NoReturn

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
from softcal.executors.shared import ParcelFile, UnableError, packed
from softcal.limits import LIMITS
from softcal.processes import SAFE

_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_NUMPY_ALONE = {"OPENBLAS_NUM_THREADS": "1"}  # its threads would wait for work on the cores that MKL's need
_START = 300.0  # [s] that a process may take to start
_LOOK = 1.0  # [s] between looks at whether a call takes too long
_STARTS = 3  # a worker that ends so often before it can take a call will always do so


@register_executor
class LocalExecutor(Executor):
    """Calls in processes of this machine, which start with the first call.

    They are fresh interpreters (spawned, since a fork would copy locks that MKL's and Numba's threads may hold) with
    cores // workers threads each. They end with this process, however it ends. Each has a pool of its own, so that
    the call is known in which a process ended.

    Parameters
    ----------
    workers
        Number of processes.
    limit
        Seconds after which a call counts as hanging; None: twenty times the longest call so far, at least ten
        minutes, and six hours before the first call has ended.

    Raises
    ------
    ParameterError
        Where `workers` is no integer, less than one or too large.
    """

    name = "local"
    summary = "processes of this machine"

    def __init__(self, workers: int = 1, *, limit: float | None = None) -> None:
        if isinstance(workers, bool) or not isinstance(workers, Integral) or workers < 1:
            raise ParameterError(Fault("there must be a worker", "workers", got=repr(workers), allowed="1 or more"))
        if fault := LIMITS["workers"].fault(workers):
            raise ParameterError(fault)
        self._processes = [_Process() for _ in range(workers)]
        self._idle: queue.SimpleQueue[_Process] = queue.SimpleQueue()
        for process in self._processes:
            self._idle.put(process)
        self._patience, self._longest = Patience(limit), 0.0
        self._threads: concurrent.futures.ThreadPoolExecutor | None = None
        self._stack = contextlib.ExitStack()
        self._folder: Path | None = None
        self._closed = False

    @classmethod
    def at(cls, address: str, workers: int | None) -> LocalExecutor:
        """So many processes, one by default.

        Raises
        ------
        ParameterError
            Where there is an address.
        """
        if address:
            raise ParameterError(Fault("processes of this machine have no address", "--on", f"'local:{address}'"))
        return cls(workers or 1)

    @property
    def count(self) -> int:
        return len(self._processes)

    @property
    def workers(self) -> Sequence[WorkerState]:
        return tuple(process.told for process in self._processes if process.pid)

    @property
    def told(self) -> str:
        return f"{self.count} process{'es' if self.count > 1 else ''} of this machine"

    @property
    def here(self) -> bool:
        return True

    def sent(self, what: object) -> ParcelFile:
        parcel = packed(what)
        if self._folder is None:
            self._folder = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="softcal-")))
        path = self._folder / parcel.digest
        if not path.exists():
            path.write_bytes(parcel.data)
        return ParcelFile(path, parcel.digest)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> concurrent.futures.Future[Any]:
        if self._threads is None:
            self._stack.enter_context(_environment_of_workers(max(1, (os.cpu_count() or 1) // self.count)))
            resource_tracker.ensure_running()  # else the first worker starts it, which would unblock its signals
            self._threads = concurrent.futures.ThreadPoolExecutor(self.count, thread_name_prefix="softcal-worker")
        return self._threads.submit(self._made, fn, args, kwargs)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers; without `wait`, at once, whatever they do."""
        self._closed = not wait
        if self._threads is not None:
            self._threads.shutdown(wait=False, cancel_futures=cancel_futures)
            if not wait:
                for process in self._processes:
                    process.kill()
            self._threads.shutdown(wait=True)
        for process in self._processes:
            process.end()
        self._stack.close()

    def __exit__(self, *exception: object) -> None:
        # Nobody waits any more for what is still being computed.
        self.shutdown(wait=False, cancel_futures=True)

    def _limit(self) -> float:
        return self._patience.after(self._longest)

    def _made(self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any]) -> Any:
        process, why = self._idle.get(), ""
        try:
            for _ in range(TRIES):
                process.start(self._limit())
                if self._closed:  # nobody waits for it
                    break
                began = time.perf_counter()
                try:
                    result = process.call(function, args, kwargs, self._limit)
                except BrokenProcessPool:
                    why = "its worker process ended unexpectedly, perhaps for lack of memory"
                except TimeoutError:
                    why = f"it had not ended after {self._limit():.0f} s"
                    process.kill()
                except UnableError as error:
                    why = f"the machine could not do it ({error})"
                else:
                    self._longest = max(self._longest, time.perf_counter() - began)
                    return result
            raise WorkerLost(f"It was tried {TRIES} times, and {why}.")
        finally:
            self._idle.put(process)


class _Process:
    """A worker process, started again where it has ended."""

    def __init__(self) -> None:
        self._pool: concurrent.futures.ProcessPoolExecutor | None = None
        self._busy, self._done = False, 0
        self.pid = 0

    @property
    def told(self) -> WorkerState:
        return WorkerState(f"process {self.pid}", "busy" if self._busy else "idle", self._done)

    def start(self, limit: float) -> None:
        """Have a process that can take a call; limit [s]: how long one that is there may take to answer.

        Raises
        ------
        ExecutorLost
            Where it ends as it starts.
        """
        for _ in range(_STARTS):
            if self._pool is None:
                self._pool = concurrent.futures.ProcessPoolExecutor(
                    1, mp_context=multiprocessing.get_context("spawn"), initializer=_begin
                )
            try:
                with _born_deaf():
                    asked = self._pool.submit(os.getpid)
                self.pid = asked.result(limit if self.pid else _START)
            except BrokenProcessPool:
                self.end()
            except TimeoutError:
                self.kill()
                self.end()
            else:
                return
        raise ExecutorLost(
            f"A worker process ended {_STARTS} times as it started. Try: a script that begins its work below "
            "if __name__ == '__main__':, and enough memory."
        )

    def call(
        self, function: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any], limit: Callable[[], float]
    ) -> Any:
        """function(*args, **kwargs) in the process; limit [s]: asked again and again, since others may end meanwhile.

        Raises
        ------
        BrokenProcessPool
            Where the process ended.
        TimeoutError
            Where it took longer than the limit [s].
        """
        assert self._pool is not None  # noqa: S101
        self._busy = True
        try:
            asked, began = self._pool.submit(function, *args, **kwargs), time.perf_counter()
            while not concurrent.futures.wait([asked], _LOOK).done:
                if time.perf_counter() - began > limit():
                    raise TimeoutError
            result = asked.result()
        except BrokenProcessPool:
            self.end()
            raise
        finally:
            self._busy = False
        self._done += 1
        return result

    def kill(self) -> None:
        """End the process at once."""
        if self.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, getattr(signal, "SIGKILL", signal.SIGTERM))

    def end(self) -> None:
        """End the process once it is idle."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool, self.pid = None, 0


@contextlib.contextmanager
def _environment_of_workers(threads: int) -> Generator[None]:
    """Workers read these as they start, and when their libraries are loaded, so they must be set before."""
    variables = {**SAFE, **_NUMPY_ALONE, **dict.fromkeys(_THREAD_VARIABLES, str(threads))}
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _born_deaf() -> Generator[None]:
    """Block Ctrl-C for the processes that are started in here, until they can say that they ignore it.

    Not by ignoring it here meanwhile: what is ignored is lost, what is blocked waits.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin() -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Ctrl-C reaches the whole process group; only the parent answers it, so that no trial is recorded incompletely.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def _end_with_parent() -> NoReturn:
    """Wait for the end of the parent, by whatever signal, and end with it: nobody else would ask for the answer."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
