"""Searches on a Dask cluster: as in one process, whoever is killed; and what is refused before anything starts."""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

import called
import pytest
from dask_cluster import DaskProcesses, dask_cluster, kill_group, wait_for_workers
from fake_twin import soft_necks_fail
from project_case import write_project
from test_calibration_run import problem_of, same

import softcal
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.results.trial_journal import stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search.search import Progress
from softcal.calibration.sweep import sweep
from softcal.cli import main
from softcal.errors import CalibrationError, InputError
from softcal.executors.each import LostCall, each, executor_on
from softcal.executors.executor import Patience
from softcal.executors.shared import call
from softcal.plugins.cluster import dask_executor
from softcal.plugins.cluster import slurm_executor as slurm
from softcal.plugins.cluster.slurm_executor import SlurmExecutor
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot

pytest.importorskip("distributed")
METHODS = [("least-squares", 30), ("grid", 16), ("tpe", 14)]


def slow_twin(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    time.sleep(0.05)
    return soft_necks_fail(robot, protocol, theta, sensitivities=sensitivities)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Generator[DaskProcesses]:
    with dask_cluster(tmp_path_factory.mktemp("dask")) as made:
        yield made


@pytest.mark.slow
def test_every_search_is_that_of_one_process(cluster: DaskProcesses) -> None:
    with executor_on(f"dask:{cluster.address}") as executor:
        for method, trials in METHODS:
            there = calibrate(problem_of(soft_necks_fail), method=method, trials=trials, workers=executor)
            same(there, calibrate(problem_of(soft_necks_fail), method=method, trials=trials))
        several = {"method": "least-squares", "trials": 30, "starts": 3}
        same(calibrate(problem_of(), **several, workers=executor), calibrate(problem_of(), **several))
        problem = problem_of(soft_necks_fail)
        axes = {p.label: (p.lower, 0.5 * (p.lower + p.upper), p.upper) for p in problem.space.parameters}
        there, here = sweep(problem, axes, workers=executor), sweep(problem, axes)
        assert [(t.number, t.state, t.theta, t.loss) for t in there.trials] == [
            (t.number, t.state, t.theta, t.loss) for t in here.trials
        ]
        assert sum(worker.done for worker in executor.workers) > 40


def run_cli(*arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "softcal", *map(str, arguments)], capture_output=True, text=True, check=False
    )


def test_a_tunnel_to_the_scheduler_is_enough(cluster: DaskProcesses) -> None:
    """This process asks no worker directly, so it need not reach their machines."""
    psutil = pytest.importorskip("psutil")
    with executor_on(f"dask:{cluster.address}") as executor:
        before = sum(worker.done for worker in executor.workers)
        calibrate(problem_of(soft_necks_fail), method="grid", trials=9, workers=executor)
        asked = {one.raddr.port for one in psutil.Process().net_connections("tcp") if one.raddr}
        at_work = {int(worker.name.rpartition(":")[2]) for worker in executor.workers}
        assert sum(worker.done for worker in executor.workers) == before + 9
    assert int(cluster.address.rpartition(":")[2]) in asked
    assert len(at_work) == 2
    assert not asked & at_work


@pytest.mark.long
def test_an_address_that_does_not_answer_starts_nothing(tmp_path: Path) -> None:
    project, out = write_project(tmp_path), tmp_path / "run"
    with socket.socket() as silent:  # takes connections, and says nothing
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        began = time.monotonic()
        done = run_cli("calibrate", project, "--out", out, "--on", f"dask:tcp://127.0.0.1:{silent.getsockname()[1]}")
        taken = time.monotonic() - began
    assert done.returncode == 2
    assert "--on: no Dask scheduler answers there" in done.stderr
    assert "Traceback" not in done.stderr
    assert not out.exists()
    assert taken < 30  # 8 s, and Python's start on a busy machine


@pytest.mark.slow
@pytest.mark.parametrize("address", ["tcp://127.0.0.1:1", "nonsense", "ftp://127.0.0.1:3", "tcp://no.such.host:8786"])
def test_an_address_of_nobody_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="no Dask scheduler answers there"), executor_on(f"dask:{address}"):
        pass


def test_the_number_of_workers_is_the_clusters(cluster: DaskProcesses) -> None:
    with pytest.raises(InputError, match="the cluster decides how many"), executor_on(f"dask:{cluster.address}", 3):
        pass


def copied_softcal(folder: Path) -> Path:
    """Another copy of softcal, which differs by a comment."""
    shutil.copytree(Path(softcal.__file__).parent, folder / "softcal", ignore=shutil.ignore_patterns("__pycache__"))
    with (folder / "softcal" / "errors.py").open("a") as file:
        file.write("# another version\n")
    return folder


@pytest.mark.slow
def test_workers_with_another_softcal_are_refused(tmp_path: Path) -> None:
    other = copied_softcal(tmp_path / "other")
    with DaskProcesses(tmp_path) as cluster:
        cluster.add_worker(path=[other])
        wait_for_workers(cluster.address, 1)
        with pytest.raises(InputError) as told, executor_on(f"dask:{cluster.address}"):
            pass
        text = str(told.value)
        assert "has another version than this process" in text
        assert "softcal's code" in text
        assert "all machines must have the same code of softcal" in text


@pytest.mark.long
def test_workers_with_another_softcal_that_come_later_take_no_part(tmp_path: Path) -> None:
    other = copied_softcal(tmp_path / "other")
    with DaskProcesses(tmp_path) as cluster:
        cluster.add_worker()
        wait_for_workers(cluster.address, 1)
        with executor_on(f"dask:{cluster.address}") as executor:
            for _ in range(3):
                cluster.add_worker(path=[other])
            wait_for_workers(cluster.address, 4)
            there = calibrate(problem_of(soft_necks_fail), method="grid", trials=16, workers=executor)
            time.sleep(1.1)  # so long the executor believes what it knows of the workers
            assert sorted(worker.done for worker in executor.workers) == [0, 0, 0, 16]
    same(there, calibrate(problem_of(soft_necks_fail), method="grid", trials=16))


class RandomKiller:
    """Kills a process at work after some random number of trials, at a random instant; its nanny starts another."""

    def __init__(self, cluster: DaskProcesses) -> None:
        self._cluster, self._chance = cluster, random.Random(4)
        self._next, self.killed = 5, 0

    def __call__(self, progress: Progress) -> None:
        if progress.done >= self._next:
            self._next = progress.done + self._chance.randint(10, 40)
            threading.Timer(self._chance.uniform(0.0, 0.1), self.kill).start()

    def kill(self) -> None:
        at_work = [pid for worker in self._cluster.workers for pid in children(worker.pid)]
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._chance.choice(at_work), signal.SIGKILL)
            self.killed += 1


def children(pid: int) -> list[int]:
    """The processes at work that a nanny has started."""
    psutil = pytest.importorskip("psutil")
    found: list[int] = []
    for one in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            if "resource_tracker" not in " ".join(one.cmdline()):
                found.append(one.pid)
    return found


@pytest.mark.long
def test_workers_that_are_killed_at_random_change_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    options: dict[str, Any] = {"method": "tpe", "trials": 300}
    with dask_cluster(tmp_path) as cluster, executor_on(f"dask:{cluster.address}") as executor:
        killer = RandomKiller(cluster)
        found = calibrate(problem_of(slow_twin), **options, workers=executor, store=folder, progress=killer)
    assert killer.killed >= 5
    assert not [trial.reason for trial in found.trials if "tried" in trial.reason]
    same(found, calibrate(problem_of(soft_necks_fail), **options))
    assert [trial.number for trial in load_result(folder).trials] == list(range(300))


@pytest.mark.long
def test_processes_of_this_machine_that_are_killed_at_random_change_nothing(tmp_path: Path) -> None:
    options: dict[str, Any] = {"method": "tpe", "trials": 120}
    killed: list[int] = []

    def kill(progress: Progress) -> None:
        if progress.done % 15 == 0 and not progress.stage:
            killed.append(max(children(os.getpid())))
            os.kill(killed[-1], signal.SIGKILL)

    found = calibrate(problem_of(slow_twin), **options, workers=2, progress=kill)
    assert len(set(killed)) == 8
    same(found, calibrate(problem_of(soft_necks_fail), **options))
    assert not set(children(os.getpid())) & set(killed)


@pytest.mark.slow
def test_the_schedulers_death_costs_nothing_that_was_told(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    options: dict[str, Any] = {"method": "tpe", "trials": 60, "store": folder}
    with dask_cluster(tmp_path) as cluster, executor_on(f"dask:{cluster.address}") as executor:

        def kill(progress: Any) -> None:
            if progress.done == 20:
                kill_group(cluster.scheduler)

        with pytest.raises(CalibrationError, match=r"scheduler at .* no longer answers.*resume"):
            calibrate(problem_of(slow_twin), **options, workers=executor, progress=kill)
    resumed = calibrate(problem_of(soft_necks_fail), **options, resume=True)
    same(resumed, calibrate(problem_of(soft_necks_fail), method="tpe", trials=60))


@pytest.mark.long
def test_a_scheduler_that_falls_silent_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is stopped, not ended: its connection stays, and Dask waits."""
    monkeypatch.setattr(dask_executor, "SILENCE", 3.0)
    folder = tmp_path / "run"
    stopped: list[float] = []
    with dask_cluster(tmp_path) as cluster:

        def stop(progress: Any) -> None:
            if progress.done == 8 and not stopped:
                os.killpg(cluster.scheduler.pid, signal.SIGSTOP)
                stopped.append(time.monotonic())

        with pytest.raises(CalibrationError, match=r"scheduler at .* no longer answers.*resume"):
            with executor_on(f"dask:{cluster.address}") as executor:
                calibrate(problem_of(slow_twin), method="tpe", trials=40, store=folder, workers=executor, progress=stop)
        assert time.monotonic() - stopped[0] < 60  # 3 s, the ends of the connection, and a busy machine
    assert len(stored_trials(folder)) >= 8


@pytest.mark.long
def test_calls_that_wait_to_be_made_alone_are_told_of_the_schedulers_death(tmp_path: Path) -> None:
    """Each ended its worker, among others that had not ended yet when the scheduler did."""
    with dask_cluster(tmp_path, allowed_failures=0) as cluster, executor_on(f"dask:{cluster.address}") as executor:
        parcel = executor.share(tmp_path)
        slow = executor.submit(call, parcel, called.slow, 60)
        lost = [executor.submit(call, parcel, called.ends_the_worker, 2) for _ in range(3)]
        deadline = time.monotonic() + 60
        while len(executor._suspects) < 2 and time.monotonic() < deadline:
            time.sleep(0.1)
        assert len(executor._suspects) >= 2
        kill_group(cluster.scheduler)
        for future in (slow, *lost):
            with pytest.raises(CalibrationError, match=r"no longer answers|ended unexpectedly"):
                future.result(60)


def test_one_worker_that_cannot_do_a_call_is_asked_three_times(tmp_path: Path) -> None:
    with dask_cluster(tmp_path, workers=1) as cluster, executor_on(f"dask:{cluster.address}") as executor:
        found = list(each(executor, called.has_no_disk, None, [(k,) for k in range(4)]))
    assert isinstance(found[2], LostCall)
    assert "It was tried 3 times, and no worker could do it: tcp://" in found[2].why
    assert found[:2] + found[3:] == [0, 1, 3]


@pytest.mark.long
def test_a_stopped_worker_does_not_hold_up_the_start(tmp_path: Path) -> None:
    with dask_cluster(tmp_path) as cluster:
        (stopped,) = children(cluster.workers[0].pid)
        os.kill(stopped, signal.SIGSTOP)
        began = time.monotonic()
        with executor_on(f"dask:{cluster.address}") as executor:
            assert executor.count == 2
            assert time.monotonic() - began < 40  # three questions, and a busy machine


@pytest.mark.slow
@pytest.mark.parametrize("on", ["dask", "local"])
def test_how_long_a_call_may_take_is_learned_from_others(
    on: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with contextlib.ExitStack() as stack:
        # Four calls are handed over to a worker of a cluster before any has ended, so the second goes by its own.
        if on == "dask":
            on = f"dask:{stack.enter_context(dask_cluster(tmp_path, workers=1)).address}"
        executor = stack.enter_context(executor_on(on, 2 if on == "local" else None))
        monkeypatch.setattr(executor, "_patience", Patience(shortest=2.0))
        assert list(each(executor, called.hangs_second, tmp_path, [(k,) for k in range(12)])) == list(range(12))
    assert (tmp_path / "been").exists()


SBATCH = """#!/bin/sh
# A queue of one machine: a job begins at once.
for last; do :; done
cp "$last" "$last.job" 2>/dev/null; script="{folder}/job-$$.sh"; cp "$last" "$script"
setsid sh "$script" >"$script.log" 2>&1 &
echo $! >>"{folder}/jobs"
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
echo "$@" >>"{folder}/cancelled"
kill -9 -- "-$1"
"""


def skip_without(*modules: str) -> None:
    """Without importing them: dask-jobqueue replaces the answer to Ctrl-C as it is imported."""
    for module in modules:
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")


@pytest.fixture
def queue(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with an sbatch and an scancel of its own."""
    skip_without("dask_jobqueue", "cryptography")
    folder = tmp_path / "queue"
    folder.mkdir()
    for name, text in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (folder / name).write_text(text.format(folder=folder))
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(one for one in sys.path if one))
    monkeypatch.setitem(slurm._DEFAULTS, "shared_temp_directory", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    return folder


@pytest.mark.slow
def test_jobs_of_a_queue_give_the_same_and_are_cancelled(queue: Path) -> None:
    answer = signal.getsignal(signal.SIGINT)
    with executor_on("slurm:long", 1) as executor:
        assert signal.getsignal(signal.SIGINT) is answer
        assert isinstance(executor, SlurmExecutor)
        assert executor.told.startswith("the Dask cluster at tls://")
        there = calibrate(problem_of(soft_necks_fail), method="grid", trials=9, workers=executor)
    same(there, calibrate(problem_of(soft_necks_fail), method="grid", trials=9))
    (script,) = queue.glob("job-*.sh")
    assert "#SBATCH -p long" in script.read_text()
    assert "\nexport PYTHONSAFEPATH=1\n" in script.read_text()  # the job's folder may be a stranger's project
    jobs, cancelled = ((queue / name).read_text().split() for name in ("jobs", "cancelled"))
    assert set(jobs) <= set(cancelled)


@pytest.mark.slow
def test_dasks_own_words_are_heard_again_when_the_last_executor_is_closed(cluster: DaskProcesses) -> None:
    logs = [logging.getLogger(f"distributed.{name}") for name in ("client", "core", "comm", "scheduler")]
    before = [log.level for log in logs]
    logs[1].setLevel(logging.ERROR)
    try:
        first, second = (executor_on(f"dask:{cluster.address}") for _ in range(2))
        first.__enter__(), second.__enter__()
        first.__exit__(None, None, None)
        assert {log.level for log in logs} == {logging.CRITICAL}
        second.__exit__(None, None, None)
        with pytest.raises(InputError), executor_on("dask:tcp://127.0.0.1:1"):
            pass
        assert [log.level for log in logs] == [before[0], logging.ERROR, *before[2:]]
    finally:
        logs[1].setLevel(before[1])


def test_dask_is_silenced_although_its_import_sets_its_loggers() -> None:
    """In a process of its own: here others have imported it."""
    told = "import logging; from softcal.plugins.cluster.dask_client import dask_silenced\n"
    told += "with dask_silenced():\n import distributed; print(logging.getLogger('distributed.client').level)\n"
    told += "print(logging.getLogger('distributed.client').level)"
    done = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    inside, after = map(int, done.stdout.split())
    assert inside == logging.CRITICAL
    assert after < logging.CRITICAL


def test_without_dask_jobqueue_a_queue_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    skip_without("distributed")
    monkeypatch.setitem(sys.modules, "dask_jobqueue", None)
    told = r"--on: this needs dask_jobqueue, which is not installed; got 'slurm'. Try: pip install 'softcal\[cluster\]'"
    with pytest.raises(InputError, match=told), executor_on("slurm"):
        pass


@pytest.mark.parametrize("on", ["slurm:a\nb", "slurm:a\r#SBATCH -t 1", "slurm:a --wrap=b", "sl\0urm", "local:\t"])
def test_a_queue_is_one_word_in_one_line(on: str) -> None:
    told = r"--on: this is no (executor|queue); got|on: a zero byte is no text"
    with pytest.raises(InputError, match=told), executor_on(on):
        pass


def test_without_a_queue_on_this_machine_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    skip_without("dask_jobqueue")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(InputError, match="sbatch is not on this machine"), executor_on("slurm"):
        pass


def test_without_dask_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch, capsys, tmp_path) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", str(write_project(tmp_path)), "--out", str(tmp_path / "run"), "--on", "dask:tcp://a:1"])
    assert ended.value.code == 2
    assert "pip install 'softcal[cluster]'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()
