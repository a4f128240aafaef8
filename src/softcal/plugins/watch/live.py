"""The sign of life of a search, `live.json` in its folder, which the search replaces while it works."""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Literal

from softcal.calibration.search.live import LIVE
from softcal.plugins.watch.reading import clean, count, read_record

LONG = 60.0  # [s] without a sign of life
SignCourse = Literal["running", "left", "silent"]
_ROUNDING = timedelta(seconds=3)  # of the times at which a process, and the search in it, began


@dataclass(frozen=True)
class WorkerSign:
    """One worker of a search: its name, "busy", "idle" or "lost", and how many evaluations it has done."""

    name: str
    state: str
    done: int


@dataclass(frozen=True)
class LiveSign:
    """The last sign of life of a search.

    Attributes
    ----------
    pid, host
        The process and its machine.
    began, updated
        When the search began, and when it wrote this sign.
    done, total, failed
        Numbers of trials; None where the sign lacks them.
    stage
        Name of the computation, if it is no trial; else "".
    executor
        Name of the executor; "" where the sign lacks it.
    workers
        Workers of the search; empty where the sign lacks them.
    ended
        Whether this is the search's last sign.
    """

    pid: int | None
    host: str
    began: datetime | None
    updated: datetime | None
    done: int | None
    total: int | None
    failed: int | None
    stage: str
    executor: str
    workers: tuple[WorkerSign, ...]
    ended: bool = False

    def age(self, now: datetime) -> float:
        """Age of the sign [s]; 0 where its time is missing."""
        return 0.0 if self.updated is None else max((now - self.updated).total_seconds(), 0.0)

    @property
    def is_here(self) -> bool:
        """Whether the process belongs to this machine, which then knows whether it still exists."""
        return self.pid is not None and self.host in ("", socket.gethostname())

    def is_at_work(self, now: datetime) -> bool:
        """Whether the process works: its last sign is recent, or a process with its id is older than the search."""
        if self.ended or (self.is_here and not self.has_process):
            return False
        return self.age(now) <= LONG or (self.is_here and self._is_the_one)

    def course(self, now: datetime) -> SignCourse:
        """State of the search's process: running, left, or silent, where nothing is known."""
        if self.is_at_work(now):
            return "running"
        return "left" if self.ended or (self.is_here and not self.has_process) else "silent"

    @property
    def _is_the_one(self) -> bool:
        """Whether the process with this id was started before the search began: the id was not used again."""
        started = None if self.pid is None else process_start(self.pid)
        return started is not None and self.began is not None and started <= self.began + _ROUNDING

    @property
    def has_process(self) -> bool:
        """Whether this machine has a process with this id."""
        return self.is_here and self.pid is not None and process_exists(self.pid)


def process_exists(pid: int) -> bool:
    """Whether this machine has a process with this id that has not ended."""
    if pid <= 0:
        return False
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):  # another user's is there; no process has a number beyond the system's
        return pid < 2**31
    with contextlib.suppress(OSError, IndexError):  # a process that ended and that nobody has waited for
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return True


def process_start(pid: int) -> datetime | None:
    """Start of a process of this machine, to a second; None where the system has no record of it."""
    try:
        ticks = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[19])
        lines = Path("/proc/stat").read_text().splitlines()
        booted = int(next(line.split()[1] for line in lines if line.startswith("btime ")))
        return datetime.fromtimestamp(booted + ticks / os.sysconf("SC_CLK_TCK"), UTC)
    except (OSError, ValueError, IndexError, StopIteration):
        return None


def read_live(folder: Path, place: str = LIVE) -> LiveSign | None:
    """The sign of life at a place in a run's folder; None where there is none.

    Raises
    ------
    Unreadable
        Where the file is damaged.
    """
    record = read_record(folder, place)
    return None if record is None else live_sign(record)


def live_sign(record: Mapping[str, Any]) -> LiveSign:
    """The sign of life that a record holds."""
    workers = record.get("workers")
    return LiveSign(
        count(record.get("pid")),
        clean(record.get("host")),
        moment(record.get("began")),
        moment(record.get("updated")),
        count(record.get("done")),
        count(record.get("total")),
        count(record.get("failed")),
        clean(record.get("stage"), 200),
        clean(record.get("executor"), 200),
        tuple(
            WorkerSign(clean(one.get("name"), 100), clean(one.get("state"), 20), count(one.get("done")) or 0)
            for one in (workers if isinstance(workers, list) else [])
            if isinstance(one, Mapping)
        ),
        record.get("ended") is True,
    )


def moment(value: object) -> datetime | None:
    """A moment that is written as ISO 8601; one without a zone is in UTC."""
    if not isinstance(value, str):
        return None
    with contextlib.suppress(ValueError, OverflowError):
        when = datetime.fromisoformat(value)
        return when.replace(tzinfo=UTC) if when.tzinfo is None else when.astimezone(UTC)
    return None
