"""The files a project names: found beside it, recorded, hashed, and found again in a run's own copy."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from softcal.errors import Fault, StorageError
from softcal.limits import Limit
from softcal.regular_file import OTHER_KINDS, not_a_file


@dataclass
class InputFiles:
    """Resolves paths as written in a project file, and records those requested.

    folder: the project file's folder. copies: path as written -> path of its copy in `folder`, for a project that is
    read back from a run, which has no other files; None otherwise.
    """

    folder: Path
    copies: Mapping[str, str] | None = None
    used: dict[str, Path] = field(default_factory=dict[str, Path])

    def find(self, written: str, kind: str, limit: Limit | None = None) -> Path:
        """The path of an existing file, not larger than its kind may be.

        Parameters
        ----------
        written
            Path as written in the project file.
        kind
            Kind of the file, such as "mesh file", for messages.
        limit
            Largest allowed size.

        Raises
        ------
        StorageError
            Where it does not exist, or is too large, or the run has no copy of it.
        """
        if self.copies is not None and written not in self.copies:
            raise StorageError(Fault(f"the run has no copy of the {kind}", got=shortened(written)))
        try:
            path = self.folder / (Path(written).expanduser() if self.copies is None else self.copies[written])
        except RuntimeError as error:  # a home that does not exist
            raise StorageError(Fault(f"there is no such {kind}", got=shortened(written), allowed="a file")) from error
        if found := not_a_file(path):
            try:
                near = sorted(entry.name for entry in path.parent.iterdir() if entry.is_file())[:8]
            except OSError:
                near = []
            raise StorageError(
                Fault(
                    f"the {kind} is {found}" if found in OTHER_KINDS.values() else f"there is no such {kind}",
                    got=shortened(written),
                    allowed=f"a regular file; beside it lie {', '.join(near)}" if near else "a regular file",
                )
            )
        if limit is not None:
            require_file(path, kind, limit)
        self.used[written] = path
        return path

    def mesh(self, body: str) -> str | None:
        """Path in `folder` of the run's copy of a body's generated mesh."""
        return None if self.copies is None else self.copies.get(stored_mesh(body))

    def hashes(self) -> dict[str, str]:
        """SHA-256 of every requested file, by its path as written."""
        return {written: sha256(path) for written, path in self.used.items()}


def stored_mesh(body: str) -> str:
    """Name of a body's generated mesh in a run."""
    return f"mesh of {body}"


def require_file(path: Path, kind: str, limit: Limit) -> None:
    """Check that a file exists and is not larger than its kind may be.

    Parameters
    ----------
    path
        Path of the file.
    kind
        Kind of the file, such as "mesh file", for messages.
    limit
        Largest allowed size.

    Raises
    ------
    StorageError
        Where there is none, or it is too large.
    """
    if found := not_a_file(path):
        raise StorageError(
            Fault(f"the {kind} cannot be read", shortened(str(path)).strip("'"), found, "a regular file")
        )
    try:
        size = path.stat().st_size
    except OSError as error:
        raise StorageError(Fault(f"the {kind} cannot be read", str(path), error.strerror or str(error))) from error
    if fault := limit.fault(size, str(path)):
        raise StorageError(replace(fault, what=f"the {kind} is too large"))


def shortened(text: str) -> str:
    """Text in quotes for a message, its middle left out where it is long."""
    return f"'{text}'" if len(text) <= 80 else f"'{text[:40]}…{text[-30:]}' ({len(text)} characters)"


def sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, as hexadecimal text."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
