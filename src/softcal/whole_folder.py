"""A folder that is there with all its files or not at all, also where its process is killed meanwhile."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
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
        yield part
        part.chmod(0o755)
        if folder.is_dir():
            folder.rmdir()
        part.rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
