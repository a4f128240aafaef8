"""A folder that is there with all its files or not at all, also where its process is killed meanwhile."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path


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
