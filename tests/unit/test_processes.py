"""Programs of their own end with the process that started them, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from softcal.processes import exit_code, run

# Starts a program that starts another, as SOFA's launcher does; both say who they are and sleep.
SLEEPER = "sleep 100 & echo $$ $! > started.tmp; mv started.tmp started; wait"
BY_LOG = "exit_code(COMMAND, Path('.'), Path('log'), timeout=100)"
BY_PIPES = "run(COMMAND, timeout=100)"
PARENT = """
from pathlib import Path
from softcal.processes import exit_code, run
COMMAND = ["sh", "-c", {command!r}]
{call}
"""


def are_running(numbers: list[int]) -> bool:
    states = [Path(f"/proc/{number}/stat") for number in numbers]
    return any(state.exists() and state.read_text().rpartition(")")[2].split()[0] != "Z" for state in states)


def wait_for(what, seconds: float = 20.0) -> bool:
    until = time.monotonic() + seconds
    while not what() and time.monotonic() < until:
        time.sleep(0.02)
    return what()


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")
@pytest.mark.parametrize("call", [BY_LOG, BY_PIPES])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_they_end_with_a_process_that_is_killed(tmp_path: Path, call: str, number: int):
    code = PARENT.format(command=SLEEPER, call=call)
    parent = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path)
    try:
        assert wait_for((tmp_path / "started").exists), "they were never started"
        started = [int(word) for word in (tmp_path / "started").read_text().split()]
        assert are_running(started)
        parent.send_signal(number)
        assert parent.wait(20) == -number
        try:
            assert wait_for(lambda: not are_running(started))
        finally:
            for one in started:
                if are_running([one]):
                    os.kill(one, signal.SIGKILL)
    finally:
        parent.kill()
        parent.wait()


def test_they_end_when_they_take_too_long(tmp_path: Path):
    command = ["sh", "-c", SLEEPER]
    assert exit_code(command, tmp_path, tmp_path / "log", timeout=0.3) is None
    started = [int(word) for word in (tmp_path / "started").read_text().split()]
    assert wait_for(lambda: not are_running(started), 5.0)  # a signal takes its time
    (tmp_path / "started").unlink()
    with pytest.raises(subprocess.TimeoutExpired):
        run(command, timeout=0.3, folder=tmp_path)
    again = [int(word) for word in (tmp_path / "started").read_text().split()]
    assert wait_for(lambda: not are_running(again), 5.0)


def test_what_they_are_told_and_say(tmp_path: Path):
    done = run(["sh", "-c", "read line; echo got $line; pwd; echo $WORD >&2; exit 3"], timeout=20, told="a line\n",
               folder=tmp_path, environment={**os.environ, "WORD": "a word"})  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (3, f"got a line\n{tmp_path}\n", "a word\n")
    assert exit_code(["sh", "-c", "echo said; kill -9 $$"], tmp_path, tmp_path / "log", timeout=20) == -9
    assert (tmp_path / "log").read_text() == "said\n"
    with pytest.raises(OSError, match="nowhere"):
        run([str(tmp_path / "nowhere")], timeout=1)
