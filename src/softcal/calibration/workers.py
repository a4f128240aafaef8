"""Evaluations in worker processes, or in this one when there is one worker; results in the order of the proposals."""

from __future__ import annotations

import concurrent.futures
import contextlib
import copyreg
import io
import multiprocessing
import os
import pickle
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from types import MappingProxyType
from typing import Any, NoReturn

from softcal.calibration.interrupts import interrupts_held
from softcal.calibration.optimiser import Proposal
from softcal.calibration.problem import Contribution, Evaluation, Problem
from softcal.errors import CalibrationError, Fault, ParameterError
from softcal.materials.catalogue import LAWS, register_law
from softcal.mechanics.elements import ELEMENTS, register_element
from softcal.sensing.sensor import SENSORS, register_sensor

_WORTH = 2.0  # [s]: an evaluation by itself that takes less is not worth the start of processes
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")


class Evaluator:
    """Evaluates a problem at many points with `workers` processes.

    The workers are fresh interpreters (spawned, since a fork would copy locks that MKL's and Numba's threads may hold)
    with cores // workers threads each. They end with this process, however it ends.

    Raises
    ------
    ParameterError
        For less than one worker.
    """

    def __init__(self, problem: Problem, *, workers: int, jacobian: bool) -> None:
        if workers < 1:
            raise ParameterError(Fault("there must be a worker", "workers", got=str(workers), allowed="1 or more"))
        self._problem, self._workers, self._jacobian = problem, workers, jacobian
        self._pool: concurrent.futures.ProcessPoolExecutor | None = None
        self._stack = contextlib.ExitStack()
        self._seconds = 0.0  # of the last evaluation by itself

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *exception: object) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
        self._stack.close()

    def evaluate(self, proposals: Sequence[Proposal]) -> Iterator[tuple[Proposal, Evaluation]]:
        """Each proposal with its evaluation, in order, as soon as it is there.

        Raises
        ------
        CalibrationError
            Where a worker died.
        """
        alone = len(proposals) == 1 and self._pool is None and self._seconds < _WORTH
        if self._workers == 1 or alone:
            for proposal in proposals:
                evaluation = self._problem.evaluate(proposal.theta, jacobian=self._jacobian)
                self._seconds = evaluation.seconds
                yield proposal, evaluation
            return
        try:
            # Submitting starts workers; a worker whose parent is interrupted meanwhile receives its input incompletely.
            with interrupts_held(), _born_deaf():
                pool = self._pool or self._start()
                # Where there are fewer points than workers, these share the trajectories of each.
                submit = self._submit_shared if len(proposals) < self._workers else self._submit
                awaited = [submit(pool, dict(proposal.theta)) for proposal in proposals]
            for proposal, evaluation in zip(proposals, awaited, strict=True):
                yield proposal, evaluation()
        except BrokenProcessPool as error:
            raise CalibrationError(
                f"A worker process ended unexpectedly at trial {proposals[0].number} or soon after, perhaps for lack "
                f"of memory. The trials so far are kept. Try: fewer workers than {self._workers}, and resume."
            ) from error

    def _submit(self, pool: concurrent.futures.Executor, theta: dict[str, float]) -> Callable[[], Evaluation]:
        return pool.submit(_evaluate, theta, self._jacobian).result

    def _submit_shared(self, pool: concurrent.futures.Executor, theta: dict[str, float]) -> Callable[[], Evaluation]:
        began = time.perf_counter()
        numbers = range(len(self._problem.trajectories(theta)))
        parts = [pool.submit(_part, theta, number, self._jacobian) for number in numbers]

        def joined() -> Evaluation:
            done = [part.result() for part in parts]
            return self._problem.joined(theta, done, time.perf_counter() - began)

        return joined

    def _start(self) -> concurrent.futures.ProcessPoolExecutor:
        self._stack.enter_context(_threads_per_worker(max(1, (os.cpu_count() or 1) // self._workers)))
        self._pool = concurrent.futures.ProcessPoolExecutor(
            self._workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(_pickled((LAWS.registered, ELEMENTS.registered, SENSORS.registered)), _pickled(self._problem)),
        )
        return self._pool


@contextlib.contextmanager
def _threads_per_worker(threads: int) -> Generator[None]:
    """Workers read these when their libraries are loaded, so they must be set before the workers start."""
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, str(threads)))
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
    resource_tracker.ensure_running()  # else the first worker's start starts it, and that ends with an unblocking
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _pickled(what: object) -> bytes:
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer)
    # Frozen mappings have no pickle of their own; a table of this pickler's leaves that of the process alone.
    pickler.dispatch_table = {**copyreg.dispatch_table, MappingProxyType: _pickle_mapping}
    try:
        pickler.dump(what)
    except (pickle.PicklingError, AttributeError) as error:
        raise CalibrationError(
            f"What is calibrated cannot be handed to other processes: {error}. Try: one worker, or the class in a "
            "module that Python can import."
        ) from error
    return buffer.getvalue()


def _pickle_mapping(mapping: Any) -> tuple[Any, ...]:
    return MappingProxyType, (dict(mapping),)


_here: dict[str, Problem] = {}


def _begin(registered: bytes, problem: bytes) -> None:
    threading.Thread(target=_end_with_parent, daemon=True).start()
    # Ctrl-C reaches the whole process group; only the parent answers it, so that no trial is recorded incompletely.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    laws, elements, sensors = pickle.loads(registered)
    for law in laws:
        register_law(law)
    for element in elements:
        register_element(element)
    for sensor in sensors:
        register_sensor(sensor)
    _here["problem"] = pickle.loads(problem)


def _end_with_parent() -> NoReturn:
    """Wait for the end of the parent, by whatever signal, and end with it: nobody else would ask for the answer."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)


def _evaluate(theta: dict[str, float], jacobian: bool) -> Evaluation:
    return _here["problem"].evaluate(theta, jacobian=jacobian)


def _part(theta: dict[str, float], number: int, jacobian: bool) -> Contribution:
    problem = _here["problem"]
    return problem.part(theta, problem.trajectories(theta)[number], jacobian=jacobian)
