"""Whether a regular file is at a path, or what else: a pipe would be waited for, a device has no end.

Files of a run's folder, which a stranger may have made, are opened by `own_file` alone, and written by `write_whole`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path

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
    """What is at a path in the place of a file to be read; nothing where it is a file."""
    try:
        kind = stat.S_IFMT(path.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return NOTHING
    except (OSError, ValueError) as error:  # such as a name of more letters than the system allows, or a NUL in it
        return str(getattr(error, "strerror", None) or error).lower()
    return "" if stat.S_ISREG(kind) else OTHER_KINDS.get(kind, "no file")


def own_file(path: str, flags: int) -> int:
    """The `opener` of `open` for a file of a run's folder: a regular file, and no link, which could lead anywhere.

    Raises
    ------
    OSError
        Where it is none, or cannot be opened.
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
    """Whether a path is in a folder, and no link leads out of it."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False


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
