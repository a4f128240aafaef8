"""The files a project names: found beside it, remembered, hashed, and found again in a run's own copy."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from softcal.errors import Fault, StorageError


@dataclass
class InputFiles:
    """Resolves paths as they are written in a project file, and remembers which were asked for.

    folder: where the project file lies. copies: path as written -> path of its copy in `folder`, for a project that
    is read back from a run.
    """

    folder: Path
    copies: Mapping[str, str] = field(default_factory=dict[str, str])
    used: dict[str, Path] = field(default_factory=dict[str, Path])

    def find(self, written: str, kind: str) -> Path:
        """The path of a file that is there.

        Raises
        ------
        StorageError
            Where it is not.
        """
        path = self.folder / Path(self.copies.get(written, written)).expanduser()
        if not path.is_file():
            what = f"the {kind} is a folder" if path.is_dir() else f"there is no such {kind}"
            near = sorted(entry.name for entry in path.parent.glob("*") if entry.is_file())[:8]
            raise StorageError(
                Fault(
                    what, got=f"'{written}'", allowed=f"a file; beside it lie {', '.join(near)}" if near else "a file"
                )
            )
        self.used[written] = path
        return path

    def hashes(self) -> dict[str, str]:
        """SHA-256 of every file asked for, by its path as written."""
        return {written: sha256(path) for written, path in self.used.items()}


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal text."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
