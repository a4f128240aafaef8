"""Functions that the tests of executors have workers call; `shared` is what is shared by the calls."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Any


class Opened:
    """Leaves a file in a folder each time that it is unpickled."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        (self.folder / f"{os.getpid()}-{time.monotonic_ns()}").touch()


class Packed:
    """Counts how often it is pickled."""

    def __init__(self) -> None:
        self.times = 0

    def __getstate__(self) -> dict[str, Any]:
        self.times += 1
        return {}


def plus(shared: float, number: float) -> float:
    return shared + number


def slowly(shared: float, number: float) -> float:
    time.sleep(0.02)
    return shared + number


def who(shared: object, number: int) -> int:
    time.sleep(0.02)
    return os.getpid()


def raises(shared: object, number: int) -> None:
    raise KeyError(number)


def ends_the_worker(shared: object, number: int) -> int:
    if number == 2:
        os._exit(7)
    return number


def ends_the_worker_once(shared: Path, number: int) -> int:
    if number == 2 and not (shared / "been").exists():
        (shared / "been").touch()
        os._exit(7)
    return number


def hangs(shared: Path, number: int) -> int:
    if number == 2 and not (shared / "been").exists():
        (shared / "been").touch()
        time.sleep(600)
    return number


def hangs_second(shared: Path, number: int) -> int:
    """In whichever call is made second: Dask keeps no order among those that come at once."""
    try:
        (shared / "first").touch(exist_ok=False)
    except FileExistsError:
        hangs(shared, 2)
    return number


def slow(shared: object, seconds: float) -> None:
    time.sleep(seconds)


def has_no_disk(shared: object, number: int) -> int:
    if number == 2:
        raise OSError(28, "No space left on device")
    return number


def has_no_disk_here(shared: Path, number: int) -> int:
    """Which the first process to be asked has not."""
    first = shared / "first"
    with contextlib.suppress(FileExistsError), first.open("x") as file:  # two processes ask at once: one makes it
        file.write(str(os.getpid()))
    if first.read_text() == str(os.getpid()):
        raise OSError(28, "No space left on device")
    return number
