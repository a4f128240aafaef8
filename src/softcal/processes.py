"""Programs that are run as processes of their own, and ended with all that they started: when they take too long, when
softcal is stopped, and when it is killed.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

# It reads the group that it is to end, and then to the end of its pipe, which the system closes with its writer.
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
    """Run a program in a folder, what it says going to a file: its exit code, or None where it was ended after
    `timeout` [s]; below zero for a signal.

    Raises
    ------
    OSError
        Where it cannot be started.
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
    """Run a program that is told something on its standard input: its exit code and what it says.

    Raises
    ------
    OSError
        Where it cannot be started.
    TimeoutExpired
        Where it was ended after `timeout` [s].
    """
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with _guarded(command, cwd=folder, env=environment, text=True, **pipes) as process:
        output, errors = process.communicate(told, timeout)
        return subprocess.CompletedProcess(command, process.returncode, output, errors)


@contextlib.contextmanager
def _guarded(command: Sequence[str], **options: Any) -> Generator[subprocess.Popen[Any]]:
    """A program at work, which ends with this block, and with this process even where that is killed."""
    # The watch has the whole of the pipe's life: it is there before the program, and it is ended first.
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
