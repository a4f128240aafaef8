"""A Dask cluster of the tests' own: its scheduler and its workers are processes of this machine, on the loopback."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Self


class DaskProcesses:
    """A scheduler and its workers, each a process group; all are killed at the end."""

    def __init__(self, folder: Path, allowed_failures: int = 3) -> None:
        self._allowed = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": str(allowed_failures)}
        self._folder, self._file = folder, folder / "scheduler.json"
        self.scheduler = self._started("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.workers: list[subprocess.Popen[bytes]] = []
        _wait(lambda: self._file.is_file() and self._file.read_text() != "", self.scheduler)
        self.address: str = json.loads(self._file.read_text())["address"]

    def add_worker(self, *options: str, path: Sequence[Path] = (), nanny: bool = True) -> subprocess.Popen[bytes]:
        """A further worker; path: where it finds modules before all others."""
        given = ("--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard", "--local-directory", str(self._folder))
        self.workers.append(self._started("worker", *given, *(() if nanny else ("--no-nanny",)), *options, path=path))
        return self.workers[-1]

    def _started(self, what: str, *options: str, path: Sequence[Path] = ()) -> subprocess.Popen[bytes]:
        found = os.pathsep.join([*map(str, path), *(one for one in sys.path if one)])
        with (self._folder / f"{what}.log").open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", "dask", what, "--scheduler-file", str(self._file), *options],
                env={
                    **os.environ,
                    **self._allowed,
                    "PYTHONPATH": found,
                    "OMP_NUM_THREADS": "1",
                    "NUMBA_NUM_THREADS": "1",
                },
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            kill_group(process)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def kill_group(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and all that it started."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()


@contextmanager
def dask_cluster(folder: Path, workers: int = 2, allowed_failures: int = 3) -> Generator[DaskProcesses]:
    """A cluster whose workers are there."""
    with DaskProcesses(folder, allowed_failures) as cluster:
        for _ in range(workers):
            cluster.add_worker()
        wait_for_workers(cluster.address, workers)
        yield cluster


def wait_for_workers(address: str, count: int) -> None:
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=120)


def _wait(there, process: subprocess.Popen[bytes]) -> None:
    for _ in range(1200):
        if there():
            return
        assert process.poll() is None, "the scheduler ended"
        time.sleep(0.1)
    raise AssertionError("the scheduler did not start")
