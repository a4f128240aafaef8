"""Ctrl-C at the worst moments: while a trial is kept, while workers start, while the run folder is made."""

from __future__ import annotations

import contextlib
import multiprocessing.util
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from project_case import write_project
from test_calibration_run import problem_of, same

from softcal.calibration.results import store as storing
from softcal.calibration.results.store import RunStore
from softcal.calibration.results.trial_journal import TrialJournal, stored_trials
from softcal.calibration.run import calibrate
from softcal.calibration.search.interrupts import (
    STOP_SIGNALS,
    Stop,
    StopSignal,
    exit_code,
    interrupts_held,
    stop_signals_raised,
    stoppable,
)
from softcal.calibration.search.search import Progress
from softcal.errors import CalibrationError
from softcal.project.project import load
from softcal.workflows.calibration import calibrate as calibrate_project


def press_ctrl_c() -> None:
    signal.raise_signal(signal.SIGINT)


def test_a_held_interrupt_comes_afterwards_and_once() -> None:
    done: list[str] = []

    def work() -> None:
        with interrupts_held():
            press_ctrl_c()
            press_ctrl_c()
            done.append("all of it")
        done.append("what follows")

    answer = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["all of it"]
    assert signal.getsignal(signal.SIGINT) is answer


def test_held_within_held_it_comes_after_the_outer() -> None:
    done: list[str] = []

    def work() -> None:
        with interrupts_held():
            with interrupts_held():
                press_ctrl_c()
            done.append("outer")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["outer"]


def test_who_answered_before_is_asked_and_who_ignored_still_does(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: asked.append(number))
    try:
        with interrupts_held():
            press_ctrl_c()
            assert asked == []
        assert asked == [signal.SIGINT]
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        with interrupts_held():
            press_ctrl_c()
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_stop_signals_are_raised_held_and_noted_as_ctrl_c_is(number: signal.Signals) -> None:
    done: list[str] = []
    stops: list[Stop] = []

    def work() -> None:
        with stop_signals_raised(), stoppable() as stop:
            stops.append(stop)
            with interrupts_held():
                signal.raise_signal(number)
                done.append("all of it")
            done.append("what follows")

    before = signal.signal(number, signal.SIG_DFL)
    try:
        with pytest.raises(StopSignal, match=number.name) as stopped:
            work()
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, before)
    assert stops[0].by is stopped.value
    assert exit_code(stopped.value) == 128 + number
    assert exit_code(KeyboardInterrupt()) == 130
    assert done == ["all of it"]


class LockOfPython:
    """Ctrl-C while it is released, as in `threading.Condition.wait`: then it is released a second time."""

    def __enter__(self) -> None: ...

    def __exit__(self, *problem: object) -> None:
        raise RuntimeError("release unlocked lock")


def test_what_fails_because_of_a_stop_is_the_stop_and_other_failures_stay() -> None:
    with pytest.raises(KeyboardInterrupt), stoppable(), stoppable(), LockOfPython():
        press_ctrl_c()
    with pytest.raises(RuntimeError, match="release unlocked lock"), stoppable(), LockOfPython():
        pass

    def fail_after_a_stop() -> None:
        with stoppable():
            with contextlib.suppress(KeyboardInterrupt):
                press_ctrl_c()
            raise ValueError("after it")

    with pytest.raises(ValueError, match="after it"):
        fail_after_a_stop()


class PressedAtItsEnd:
    """Asks to stop in its finalizer, where Python drops what is raised."""

    def __init__(self, number: signal.Signals) -> None:
        self._number = number

    def __del__(self) -> None:
        signal.raise_signal(self._number)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize(
    ("number", "by"), [(signal.SIGINT, "the user"), (signal.SIGTERM, "SIGTERM"), (signal.SIGHUP, "SIGHUP")]
)
def test_a_stop_that_is_raised_where_python_drops_it_ends_the_search(number: signal.Signals, by: str) -> None:
    doomed = [PressedAtItsEnd(number)]

    def drop(progress: Progress) -> None:
        if progress.done == 2:
            doomed.clear()

    before = signal.getsignal(number)
    if number != signal.SIGINT:
        signal.signal(number, signal.SIG_DFL)
    try:
        with stop_signals_raised():
            result = calibrate(problem_of(), method="grid", trials=9, progress=drop)
    finally:
        signal.signal(number, before)
    assert f"Stopped by {by} after 2 of at most 9" in result.status


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_the_caller_has_set_to_be_ignored_stays_ignored(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with stop_signals_raised(), stoppable() as stop, interrupts_held():
            signal.raise_signal(number)
        assert stop.by is None
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("k", range(6))
def test_a_stop_while_handlers_are_changed_leaves_them_as_they_were(k: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Else one of them would go on noting signals for a work that has ended: they would be lost."""
    real, calls = signal.signal, 0

    def changed(number: int, handler: Any) -> Any:
        nonlocal calls
        before = real(number, handler)
        calls += 1
        if calls == k + 1:
            signal.raise_signal(signal.SIGTERM)
        return before

    def hold() -> None:
        with interrupts_held():
            pass

    before = real(signal.SIGTERM, signal.SIG_DFL), real(signal.SIGHUP, signal.SIG_DFL)
    try:
        with stop_signals_raised():
            handlers = [signal.getsignal(number) for number in STOP_SIGNALS]
            with monkeypatch.context() as patch:
                patch.setattr(signal, "signal", changed)
                with pytest.raises(StopSignal, match="SIGTERM"):
                    hold()
            assert calls >= k + 1
            assert [signal.getsignal(number) for number in STOP_SIGNALS] == handlers
    finally:
        for number, handler in zip((signal.SIGTERM, signal.SIGHUP), before, strict=True):
            real(number, handler)


def test_in_other_threads_nothing_is_held() -> None:
    done: list[object] = []

    def elsewhere() -> None:
        with interrupts_held():
            done.append(signal.getsignal(signal.SIGINT))

    answer = signal.getsignal(signal.SIGINT)
    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert done == [answer]


class Trap:
    """Presses Ctrl-C just after a function has done its work, the first time that it is called once armed."""

    def __init__(self, patch: pytest.MonkeyPatch, owner: object, name: str) -> None:
        self.armed, self.sprung = False, False
        real: Callable[..., Any] = getattr(owner, name)

        def caught(*arguments: Any, **options: Any) -> Any:
            answer = real(*arguments, **options)
            if self.armed and not self.sprung:
                self.sprung = True
                press_ctrl_c()
            return answer

        patch.setattr(owner, name, caught)

    def arm(self, progress: Progress) -> None:
        self.armed = progress.done == 2


@pytest.mark.parametrize(
    ("owner", "name"),
    [(RunStore, "append"), (os, "fsync"), (RunStore, "keep"), (TrialJournal, "append")],
    ids=["kept", "on disk", "arrays", "journal"],
)
def test_a_trial_is_kept_whole_wherever_the_interrupt_comes(
    owner: object, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    options: dict[str, Any] = {"method": "tpe", "trials": 6, "seed": 4}  # the third is the best so far
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        trap = Trap(patch, owner, name)
        result = calibrate(problem_of(), **options, store=folder, progress=trap.arm)
    assert trap.sprung
    assert "Stopped by the user after 3 of at most 6" in result.status
    assert len(result.trials) == 3
    assert list(stored_trials(folder)) == [0, 1, 2]
    assert not list(folder.glob("*.lock*"))
    same(calibrate(problem_of(), **options), calibrate(problem_of(), **options, store=folder, resume=True))


def test_a_run_that_is_stopped_while_its_folder_is_made_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run"
    with monkeypatch.context() as patch:
        trap = Trap(patch, storing, "write_text")
        trap.armed = True
        with pytest.raises(KeyboardInterrupt):
            calibrate(problem_of(), method="grid", trials=9, store=folder, files={"notes.txt": "of the run"})
    assert trap.sprung
    resumed = calibrate(problem_of(), method="grid", trials=9, store=folder, resume=True)
    same(calibrate(problem_of(), method="grid", trials=9), resumed)


def spawning(patch: pytest.MonkeyPatch, then: Callable[[int], None]) -> None:
    """Have `then` called with the id of every process just after its birth, before it is told what it is to do."""
    real = multiprocessing.util.spawnv_passfds

    def spawned(*arguments: Any) -> int:
        pid = real(*arguments)
        then(pid)
        return pid

    patch.setattr(multiprocessing.util, "spawnv_passfds", spawned)


def test_workers_hear_no_ctrl_c_from_their_birth_on(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pressing: list[threading.Thread] = []

    def press_for_a_second(pid: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            for _ in range(50):
                os.kill(pid, signal.SIGINT)
                time.sleep(0.02)

    def begin(pid: int) -> None:
        pressing.append(threading.Thread(target=press_for_a_second, args=(pid,)))
        pressing[-1].start()

    with monkeypatch.context() as patch:
        spawning(patch, begin)
        found = calibrate(problem_of(), method="grid", trials=16, workers=2)
    for thread in pressing:
        thread.join()
    assert len(pressing) >= 2
    assert capfd.readouterr().err == ""
    same(calibrate(problem_of(), method="grid", trials=16), found)


def test_interrupted_while_it_starts_workers_it_starts_them_whole_and_stops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    options: dict[str, Any] = {"method": "grid", "trials": 16}
    born: list[int] = []

    def press_elsewhere() -> None:
        """In another thread, which the system may choose when the main one blocks the signal."""
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        press_ctrl_c()

    def press(pid: int) -> None:
        born.append(pid)
        if len(born) > 1:  # the workers start side by side, the others perhaps when the search has stopped
            return
        thread = threading.Thread(target=press_elsewhere)
        thread.start()
        thread.join()

    with monkeypatch.context() as patch:
        spawning(patch, press)
        with pytest.raises(CalibrationError, match=r"Stopped by the user before any trial could be completed"):
            calibrate(problem_of(), **options, workers=2, store=tmp_path / "run")
    assert born
    assert capfd.readouterr().err == ""
    same(calibrate(problem_of(), **options), calibrate(problem_of(), **options, store=tmp_path / "run", resume=True))


@pytest.mark.slow
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3, 0.6, 1.2])
def test_a_real_ctrl_c_while_workers_start(delay: float, tmp_path: Path) -> None:
    path, out = write_project(tmp_path / "p"), tmp_path / "run"
    command = [sys.executable, "-m", "softcal", "calibrate", str(path), "--out", str(out), "--no-report"]
    command += ["--method", "tpe", "--trials", "4000", "--workers", "2"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    folder = out / "calibrations" / "pull"
    deadline = time.monotonic() + 60
    while not (folder / "optuna.journal").is_file() and time.monotonic() < deadline:  # the last before the workers
        assert process.poll() is None, process.communicate()
        time.sleep(0.005)
    time.sleep(delay)
    os.killpg(process.pid, signal.SIGINT)  # to the whole group, as a terminal does
    try:
        _, err = process.communicate(timeout=120)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130, err
    assert "Traceback" not in err
    n_before = len(stored_trials(folder))
    found = calibrate_project(load(path), out=out, resume=True, method="tpe", trials=n_before + 2)
    assert len(found.headline.trials) == n_before + 2
