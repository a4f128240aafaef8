"""External programs in separate process groups, terminated on timeout, and when softcal is stopped or killed."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

# Reads the process group to terminate, then blocks on its pipe until the system closes it when the parent ends.
_WATCH = """
import os, signal, sys
group = sys.stdin.readline()
sys.stdin.read()
if group:
    getattr(os, "killpg", os.kill)(int(group), getattr(signal, "SIGKILL", signal.SIGTERM))
"""


def exit_code(
    command: Sequence[str], folder: Path, log: Path, *, timeout: float, environment: Mapping[str, str] | None = None
) -> int | None:
    """Run a program in a folder with its output in a file: its exit code (negative for a signal), or None on timeout
    after `timeout` [s].

    Raises
    ------
    OSError
        If it cannot be started.
    """
    with (
        log.open("wb") as said,
        _guarded(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=said,
            stderr=subprocess.STDOUT,
        ) as process,
    ):
        try:
            return process.wait(timeout)
        except subprocess.TimeoutExpired:
            return None


def run(
    command: Sequence[str],
    *,
    timeout: float,
    told: str = "",
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
) -> subprocess.CompletedProcess[str]:
    """Run a program with text on its standard input: its exit code and output.

    Raises
    ------
    OSError
        If it cannot be started.
    TimeoutExpired
        If it was terminated after `timeout` [s].
    """
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with _guarded(command, cwd=folder, env=environment, text=True, **pipes) as process:
        output, errors = process.communicate(told, timeout)
        return subprocess.CompletedProcess(command, process.returncode, output, errors)


@contextlib.contextmanager
def beside(command: Sequence[str], *, patience: float = 5.0) -> Generator[subprocess.Popen[str]]:
    """A program that runs during this block, with its output to be read; at the end it is asked to stop, and terminated
    after `patience` [s].

    Raises
    ------
    OSError
        If it cannot be started.
    """
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with _guarded(command, text=True, errors="replace", **pipes) as process:
        try:
            yield process
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(patience)


@contextlib.contextmanager
def _guarded(command: Sequence[str], **options: Any) -> Generator[subprocess.Popen[Any]]:
    """A running program, terminated at the end of this block, and with this process even if that is killed."""
    # The watchdog is started before the program and stopped first, so that it covers the program's whole life.
    with subprocess.Popen(
        [sys.executable, "-I", "-S", "-c", _WATCH], bufsize=0, stdin=subprocess.PIPE, start_new_session=True
    ) as watch:
        try:
            with subprocess.Popen(command, start_new_session=True, **options) as process:
                try:
                    assert watch.stdin is not None  # noqa: S101
                    with contextlib.suppress(BrokenPipeError):  # a watch that died: the program is still ended here
                        watch.stdin.write(f"{process.pid}\n".encode())
                    yield process
                finally:
                    _end(process)
        finally:
            watch.kill()


def _end(process: subprocess.Popen[Any]) -> None:
    if process.poll() is not None:
        return
    with contextlib.suppress(ProcessLookupError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
    process.wait()
