"""Helpers of softcal and external programs in process groups of their own, terminated on timeout, and when softcal is
stopped or killed.

No Python that is started here takes modules from the present folder, which may be a stranger's project.
"""

from __future__ import annotations

import contextlib
import os
import signal
import site
import subprocess
import sys
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

SAFE = {"PYTHONSAFEPATH": "1"}
"""Variable with which a Python, and what it starts, does not take modules from the present folder."""

# Blocks on its pipe until the system closes it when the parent ends, then terminates its process group.
_WATCH = "import os, signal, sys; sys.stdin.read(); os.killpg(0, signal.SIGKILL)"


def exit_code(
    command: Sequence[str], folder: Path, log: Path, *, timeout: float, environment: Mapping[str, str] | None = None
) -> int | None:
    """Run a program in a folder with its output in a file: its exit code (negative for a signal), or None on timeout.

    Parameters
    ----------
    command
        Program and arguments.
    folder
        Where it runs.
    log
        File for its output.
    timeout
        Limit [s].
    environment
        Its environment; None for that of this process.

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

    Parameters
    ----------
    command
        Program and arguments.
    timeout
        Limit [s].
    told
        Text on its standard input.
    folder
        Where it runs; None for the present one.
    environment
        See `exit_code`.

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


def run_module(module: str, *arguments: str, timeout: float, told: str = "") -> subprocess.CompletedProcess[str]:
    """See `run`; runs a module of softcal as by `python -m`.

    Parameters
    ----------
    module
        Name of the module.
    arguments
        Its arguments.
    timeout, told
        See `run`.

    Raises
    ------
    OSError, TimeoutExpired
        See `run`.
    """
    return run(_command(module, arguments), timeout=timeout, told=told, environment=_environment())


@contextlib.contextmanager
def beside(module: str, *arguments: str, patience: float = 5.0) -> Generator[subprocess.Popen[str]]:
    """A module of softcal that runs as `python -m` during this block, with its output to be read; at the end it is
    asked to stop, and terminated after `patience` [s].

    Raises
    ------
    OSError
        If it cannot be started.
    """
    pipes: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    command, environment = _command(module, arguments), _environment()
    with _guarded(command, env=environment, text=True, errors="replace", **pipes) as process:
        try:
            yield process
        finally:
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(patience)


def _command(module: str, arguments: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", module, *arguments]


def _environment() -> dict[str, str]:
    """The environment of a Python that has this softcal, also one that is not installed, and the same plugins."""
    source = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    # What is installed stays behind the standard library; an empty entry would be the present folder.
    paths = [
        *([] if source in site.getsitepackages() else [source]),
        *os.environ.get("PYTHONPATH", "").split(os.pathsep),
    ]
    return {**os.environ, **SAFE, "PYTHONPATH": os.pathsep.join(filter(None, paths))}


@contextlib.contextmanager
def _guarded(command: Sequence[str], **options: Any) -> Generator[subprocess.Popen[Any]]:
    """A running program, terminated at the end of this block, and with this process even if that is killed."""
    # The program joins the group of its watch as it starts: there is no moment in which nothing would end it. A child
    # holds the watch's pipe until it has joined.
    with subprocess.Popen([sys.executable, "-I", "-S", "-c", _WATCH], stdin=subprocess.PIPE, process_group=0) as watch:
        try:
            with subprocess.Popen(command, process_group=watch.pid, **options) as process:
                try:
                    yield process
                finally:
                    if process.poll() is None:
                        with contextlib.suppress(ProcessLookupError):
                            os.killpg(watch.pid, signal.SIGKILL)
                        process.wait()
        finally:
            watch.kill()
