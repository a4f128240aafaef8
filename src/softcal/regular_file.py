"""Whether a regular file is at a path, or what else: a pipe would be waited for, a device has no end.

Files of a run's folder, which a stranger may have made, are opened by `own_file` alone, and written by `write_whole`.
A `whole_folder` is there with all its files or not at all, also where its process is killed meanwhile.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import stat
import tempfile
from collections.abc import Generator, Iterable
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

from softcal.errors import Fault, StorageError

NOTHING, FOLDER = "no such file", "a folder"
OTHER_KINDS = {
    stat.S_IFDIR: FOLDER,
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}
"""Type of what is at a path (`stat.S_IFMT`), where it is no regular file -> its name."""


def not_a_file(path: Path) -> str:
    """Why a path is no regular file, in words such as "a folder"; "" where it is one."""
    try:
        found = path.stat()
        kind = stat.S_IFMT(found.st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return NOTHING
    except (OSError, ValueError) as error:  # such as a name of more letters than the system allows, or a NUL in it
        return str(getattr(error, "strerror", None) or error).lower()
    if stat.S_ISREG(kind):
        return "a file of the system" if found.st_dev in _of_the_system() else ""
    return OTHER_KINDS.get(kind, "no file")


@cache
def _of_the_system() -> frozenset[int]:
    """The devices whose files the system makes as they are read: some, as /proc/kmsg, are waited for."""
    return frozenset(os.stat(place).st_dev for place in ("/proc", "/sys") if os.path.ismount(place))


def own_file(path: str, flags: int) -> int:
    """The `opener` of `open` for a file of a run's folder: a regular file, and no link, which could lead anywhere.

    Raises
    ------
    OSError
        Where the path is a link or no regular file, or cannot be opened.
    """
    if os.path.islink(path):
        raise OSError(errno.ELOOP, "a link to another file", path)
    # O_NOFOLLOW: of a link that is made in this moment; O_NONBLOCK: a pipe would be waited for.
    number = os.open(path, flags | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0), 0o666)
    kind = stat.S_IFMT(os.fstat(number).st_mode)
    if kind != stat.S_IFREG:
        os.close(number)
        raise OSError(errno.EINVAL, OTHER_KINDS.get(kind, "no file"), path)
    return number


def read_own(path: Path, most: int) -> bytes:
    """The bytes of a file of a run's folder.

    Raises
    ------
    OSError
        As `own_file`, and for one of more than `most` bytes.
    """
    with open(path, "rb", opener=own_file) as file:
        if os.fstat(file.fileno()).st_size <= most and len(held := file.read(most + 1)) <= most:
            return held
    raise OSError(errno.EFBIG, f"more than {most} bytes", str(path))


def is_inside(path: Path, folder: Path) -> bool:
    """Whether a path is in a folder, with no link on it that leads out of the folder."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False


def require_inside(folder: Path, places: Iterable[str]) -> None:
    """Check that no link at places in a folder, which a stranger may have made, leads out of it.

    Raises
    ------
    StorageError
        Where one does, with all of them.
    """
    what, allowed = "this lies outside the folder", f"what is in {folder}, and no link out of it"
    if out := [folder / place for place in places if not is_inside(folder / place, folder)]:
        raise StorageError([Fault(what, str(path), allowed=allowed) for path in out])


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: what was there before, or a link in its place, is replaced.

    Raises
    ------
    OSError
        Where it cannot be written.
    """
    part = path.with_name(path.name + ".part")
    try:
        part.unlink(missing_ok=True)  # of a process that was killed, or a link, which is not written through
        with part.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except OSError:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise


@contextmanager
def whole_folder(folder: Path) -> Generator[Path]:
    """A temporary folder beside `folder`, which is new or empty: renamed to it on success, removed on failure.

    Raises
    ------
    OSError
        Where it cannot be made or renamed.
    """
    part = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        part.chmod(0o700)  # whatever the mask: else its files could neither be written nor removed
        yield part
        part.chmod(0o755)
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    finally:
        shutil.rmtree(part, onerror=_remove_closed)


def _remove_closed(_: object, path: str, error: object) -> None:
    """Remove a folder that the mask of rights has closed: nothing could be written into it."""
    with suppress(OSError):
        os.rmdir(path)
