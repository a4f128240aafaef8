"""A file that one process holds, by the operating system: one that is killed leaves nothing that others wait for."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from softcal.errors import Fault, StorageError
from softcal.regular_file import own_file

_FAR = 2**40  # the byte that is locked on Windows, where others cannot read what is


def hold(path: Path, *, wait: bool = False, opener: Callable[[str, int], int] | None = None) -> BinaryIO:
    """Open a file to append to it, made if it is not there, and hold it until it is closed; others can read it.

    Parameters
    ----------
    path
        The file.
    wait
        Until another process has released it.
    opener
        As that of `open`.

    Raises
    ------
    BlockingIOError
        Where another process holds it, and this one does not wait.
    OSError
        Where it cannot be opened, or its file system has no locks.
    """
    file = open(path, "ab", opener=opener)
    try:
        lock(file, wait=wait)
    except BaseException:
        file.close()
        raise
    return file


def hold_in(path: Path, what: str, other: str) -> BinaryIO:
    """The lock of a folder, by a file in it: see `hold`.

    Parameters
    ----------
    path
        The file.
    what, other
        What is kept in the folder, and what another process does there.

    Raises
    ------
    StorageError
        If another process holds it.
    OSError
        If the file cannot be opened, or the file system has no locks.
    """
    try:
        return hold(path, opener=own_file)
    except BlockingIOError as error:
        attempt = f"wait for the other {other} in this folder"
        fault = Fault(f"the {what} cannot be kept", str(path.parent), "a folder locked by another process", "", attempt)
        raise StorageError(fault) from error


def lock(file: BinaryIO, *, wait: bool = False) -> None:
    """Hold a file that is open to be written, until it is closed.

    Raises
    ------
    OSError
        See `hold`.
    """
    if sys.platform == "win32":
        import msvcrt

        file.seek(_FAR)
        try:
            msvcrt.locking(file.fileno(), msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(str(error)) from error
    else:
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
