"""Programs of their own end with the process that started them, however that ends."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import softcal
from softcal.executors.kinds.local import LocalExecutor
from softcal.processes import exit_code, run, run_module
from softcal.workflows.watching import watch_run

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


# Is killed in the moment in which it has started a program.
KILLED_AT_ONCE = """
import os, signal, subprocess
from pathlib import Path
from softcal import processes
class Popen(subprocess.Popen):
    def __init__(self, command, **options):
        super().__init__(command, **options)
        if command == ["sleep", "100"]:
            Path("started").write_text(str(self.pid))
            os.kill(os.getpid(), signal.SIGKILL)
subprocess.Popen = Popen
processes.run(["sleep", "100"], timeout=100)
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


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")
def test_they_end_with_a_process_that_is_killed_as_it_starts_them(tmp_path: Path):
    done = subprocess.run([sys.executable, "-c", KILLED_AT_ONCE], cwd=tmp_path, check=False)
    assert done.returncode == -signal.SIGKILL
    started = [int((tmp_path / "started").read_text())]
    try:
        assert wait_for(lambda: not are_running(started))
    finally:
        if are_running(started):
            os.kill(started[0], signal.SIGKILL)


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


PLANTED = ("json", "multiprocessing", "numpy", "pickle", "random", "socket", "softcal", "yaml")


@pytest.fixture
def strangers_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The present folder, with modules that say so where they are run."""
    for name in PLANTED:
        (tmp_path / f"{name}.py").write_text(
            f"import os\nos.makedirs({str(tmp_path / f'{name}-was-run')!r}, exist_ok=True)\n"
        )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_there(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("*-was-run"))


def a_helper() -> None:
    assert run_module("softcal.geometry.gmsh_worker", "nowhere", timeout=60, told="{").returncode == 1


def a_page() -> None:
    pytest.importorskip("nicegui", reason="the extra `watch` is not installed")
    with pytest.raises(softcal.InputError, match="there is no such folder; got a file"):
        watch_run("numpy.py")


def workers() -> None:
    with LocalExecutor(2) as executor:
        assert executor.submit(os.getcwd).result(60) == os.getcwd()


@pytest.mark.parametrize("start", [a_helper, a_page, workers])
def test_no_module_of_the_present_folder_is_run(strangers_folder: Path, start):
    start()
    assert run_there(strangers_folder) == []


def test_no_module_of_the_present_folder_is_run_by_the_module_as_a_command(strangers_folder: Path):
    """But one called softcal, and those of the standard library that Python imports before it."""
    (strangers_folder / "softcal.py").unlink()
    done = subprocess.run([sys.executable, "-m", "softcal", "check", "project.yaml"], capture_output=True, check=False)
    assert done.returncode == 2, done.stderr
    assert run_there(strangers_folder) == []


STARTING = re.compile(
    r"sys\.executable|\bsubprocess\.(?!TimeoutExpired\b|CompletedProcess\b)|\bget_context\(|ProcessPoolExecutor\("
    r"|\bos\.(system|popen|fork|forkpty|posix_spawn|spawn\w+|exec\w+)\("
    r"|from (subprocess|multiprocessing)\b(?! import resource_tracker)"
)
# The pool of workers, and the question which Python SOFA's bindings are for.
ELSEWHERE = {"executors/kinds/local.py", "plugins/sofa/install.py"}


def test_processes_are_started_in_one_place():
    source = Path(softcal.__file__).parent
    starts = {
        path.relative_to(source).as_posix()
        for path in source.rglob("*.py")
        if STARTING.search(path.read_text(encoding="utf-8"))
    }
    assert starts == {"processes.py", *ELSEWHERE}
