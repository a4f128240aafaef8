"""What every executor promises: results in order, one copy of what is shared, and lost workers that cost one call."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator
from pathlib import Path

import called
import pytest
from dask_cluster import dask_cluster, wait_for_workers

from softcal.errors import CalibrationError, ParameterError
from softcal.executors.each import LostCall, each, executor_on, results
from softcal.executors.executor import EXECUTORS, Executor, Patience, WorkerLost, register_executor
from softcal.executors.kinds.local import LocalExecutor
from softcal.plugins.cluster.dask_executor import DaskExecutor

NUMBERS = [(k,) for k in range(6)]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    pytest.importorskip("distributed")
    with dask_cluster(tmp_path_factory.mktemp("dask")) as cluster:
        yield cluster.address


@pytest.fixture(params=["local", "dask"])
def executor(request: pytest.FixtureRequest) -> Generator[Executor]:
    if request.param == "local":
        with executor_on("local", 2) as made:
            yield made
    else:
        with executor_on(f"dask:{request.getfixturevalue('address')}") as made:
            yield made


@pytest.fixture(params=["local", "dask"])
def impatient(request: pytest.FixtureRequest) -> Generator[Executor]:
    """One that takes a call of more than two seconds for a hanging one."""
    if request.param == "local":
        made: Executor = LocalExecutor(2, limit=2.0)
    else:
        made = DaskExecutor(request.getfixturevalue("address"), limit=2.0)
    with made:
        yield made


def test_results_come_in_the_order_of_the_calls(executor: Executor) -> None:
    assert list(each(executor, called.plus, 10.0, NUMBERS)) == [10.0, 11.0, 12.0, 13.0, 14.0, 15.0]
    assert executor.count == 2
    assert sum(worker.done for worker in executor.workers) == 6


def test_the_workers_are_other_processes_and_share_the_calls(executor: Executor) -> None:
    found = set(each(executor, called.who, None, [(k,) for k in range(40)]))
    assert os.getpid() not in found
    assert len(found) == 2


def test_what_is_shared_is_opened_once_in_each_worker(executor: Executor, tmp_path: Path) -> None:
    for _ in range(2):
        list(each(executor, called.who, called.Opened(tmp_path), [(k,) for k in range(20)]))
    opened = [path.name.partition("-")[0] for path in tmp_path.iterdir()]
    assert opened
    assert len(opened) == len(set(opened))


def test_what_is_shared_again_is_not_packed_again(executor: Executor) -> None:
    whole = called.Packed()
    for _ in range(3):
        assert list(each(executor, called.who, whole, [(0,)]))
    assert whole.times == 1


def test_what_a_call_raises_is_raised(executor: Executor) -> None:
    with pytest.raises(KeyError, match="0"):
        list(each(executor, called.raises, None, NUMBERS))


def test_a_worker_that_ends_costs_no_call(executor: Executor, tmp_path: Path) -> None:
    assert list(each(executor, called.ends_the_worker_once, tmp_path, NUMBERS)) == [0, 1, 2, 3, 4, 5]


@pytest.mark.slow
def test_a_call_that_ends_every_worker_is_lost_alone(executor: Executor) -> None:
    found = list(each(executor, called.ends_the_worker, None, NUMBERS))
    assert isinstance(found[2], LostCall)
    assert "its worker process ended unexpectedly, perhaps for lack of memory" in found[2].why
    assert found[:2] + found[3:] == [0, 1, 3, 4, 5]
    with pytest.raises(WorkerLost, match="ended unexpectedly"):
        list(results(executor, called.ends_the_worker, None, [(2,)]))


def test_a_call_that_hangs_is_made_again(impatient: Executor, tmp_path: Path) -> None:
    assert list(each(impatient, called.hangs, tmp_path, NUMBERS)) == [0, 1, 2, 3, 4, 5]
    assert (tmp_path / "been").exists()


def test_a_call_that_no_machine_can_do_says_why(executor: Executor) -> None:
    found = list(each(executor, called.has_no_disk, None, NUMBERS))
    assert isinstance(found[2], LostCall)
    assert "No space left on device" in found[2].why
    assert found[:2] + found[3:] == [0, 1, 3, 4, 5]


def test_what_cannot_be_pickled_is_said_in_a_sentence(executor: Executor) -> None:
    with pytest.raises(CalibrationError, match=r"cannot be handed to other processes.*one worker"):
        list(each(executor, called.plus, threading.Lock(), NUMBERS))


def test_a_generator_that_is_left_cancels_what_has_not_begun(executor: Executor) -> None:
    calls = each(executor, called.slowly, 0.0, [(k,) for k in range(2000)])
    assert next(calls) == 0.0
    calls.close()
    assert list(each(executor, called.plus, 1.0, NUMBERS[:2])) == [1.0, 2.0]
    assert sum(worker.done for worker in executor.workers) < 1000


def test_one_process_of_this_machine_is_this_process() -> None:
    with executor_on("local") as alone:
        assert set(each(alone, called.who, None, NUMBERS)) == {os.getpid()}


def test_on_a_full_disk_another_worker_takes_the_call(address: str, tmp_path: Path) -> None:
    wait_for_workers(address, 2)  # a test before may have ended one, which starts again
    with executor_on(f"dask:{address}") as executor:
        assert list(each(executor, called.has_no_disk_here, tmp_path, NUMBERS)) == [0, 1, 2, 3, 4, 5]


def test_a_worker_stopped_by_a_signal_is_replaced() -> None:
    """A stopped process answers nothing, and does not end by itself."""
    with LocalExecutor(1, limit=2.0) as executor:
        pid = executor.submit(os.getpid).result()
        os.kill(pid, signal.SIGSTOP)
        assert executor.submit(os.getpid).result(60) != pid


@pytest.mark.parametrize(
    ("on", "told"),
    [
        ("cloud", "no such executor"),
        ("dask", "address of the scheduler is missing"),
        ("local:3", "have no address"),
    ],
)
def test_a_place_that_there_is_not(on: str, told: str) -> None:
    with pytest.raises(ParameterError, match=told), executor_on(on):
        pass


@pytest.mark.parametrize("kind", [3, type("Half", (Executor,), {"name": "half"})], ids=["number", "half"])
def test_what_is_no_executor_is_not_registered(kind: Callable[..., object]) -> None:
    with pytest.raises(ParameterError, match=r"not an executor|lacks something"):
        register_executor(kind)
    assert "half" not in EXECUTORS


@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_is_told_alike_by_any_number_of_processes(workers: int) -> None:
    with executor_on("local", workers) as executor:
        found = list(each(executor, called.has_no_disk, None, NUMBERS))
    assert isinstance(found[2], LostCall)
    assert "machine could not do it ([Errno 28] No space left on device)" in found[2].why
    assert found[:2] + found[3:] == [0, 1, 3, 4, 5]


def test_how_long_is_long() -> None:
    assert [Patience().after(longest) for longest in (0.0, 1.0, 100.0)] == [6 * 3600.0, 600.0, 2000.0]
    assert Patience(3.0).after(0.0) == Patience(3.0).after(100.0) == 3.0
