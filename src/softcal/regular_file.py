"""Whether a regular file is at a path, or what else: a pipe would be waited for, a device has no end."""

from __future__ import annotations

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
