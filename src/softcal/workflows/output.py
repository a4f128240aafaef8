"""Result folders and files: nothing is overwritten, and files are written completely or not at all."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from softcal.calibration.results.store import write_bytes
from softcal.errors import Fault, InputError, StorageError
from softcal.regular_file import whole_folder, write_whole
from softcal.report.style import encode

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ANOTHER = "another --out"


def require_free_folder(folder: Path) -> None:
    """Check before a long computation that a folder is new or empty, and that it can be written.

    Raises
    ------
    StorageError
        If it holds files, or cannot be written.
    """
    _require_empty(folder, ANOTHER)
    require_writable(folder)


def require_writable(folder: Path) -> None:
    """Check that files can be written into a folder that may not exist yet.

    Raises
    ------
    StorageError
        Where they cannot.
    """
    try:
        standing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
        with tempfile.TemporaryFile(dir=standing) as probe:
            probe.write(b"0" * 4096)
            probe.flush()
    except OSError as error:
        raise unwritable(folder, error) from error


def require_picture(file: Path) -> None:
    """Check before a long computation that a picture can be written.

    Raises
    ------
    InputError
        For a name without .png or .svg.
    StorageError
        If the file is there, or its folder cannot be written.
    """
    if file.suffix not in (".png", ".svg"):
        raise InputError(Fault("this is no image file", "picture", str(file), "a name with .png or .svg"))
    require_free_file(file)


def write_picture(figure: Figure, title: str, file: Path) -> None:
    """Write a figure as .png or .svg, by the name of its file.

    Parameters
    ----------
    figure
        The figure.
    title
        In the file's data.
    file
        See `require_picture`.
    """
    png, svg = encode(figure, title)
    write_bytes(file, png if file.suffix == ".png" else svg)


@contextmanager
def new_folder(folder: Path, attempt: str = ANOTHER) -> Generator[Path]:
    """A temporary folder, renamed to `folder` on success and removed on failure, with the parents made for it.

    Raises
    ------
    StorageError
        Where `folder` holds files already, or cannot be written.
    """
    _require_empty(folder, attempt)
    absent: list[Path] = []
    try:
        absent += [parent for parent in folder.absolute().parents if not parent.exists()]
        folder.parent.mkdir(parents=True, exist_ok=True)
        with whole_folder(folder) as part:
            yield part
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        for parent in absent:
            with suppress(OSError):  # it holds the folder, or something else by now
                parent.rmdir()


def require_free_file(path: Path) -> None:
    """Check that a file does not exist and can be written.

    Raises
    ------
    StorageError
        If it holds files, or cannot be written.
    """
    try:
        standing = path.exists()
    except OSError as error:
        raise unwritable(path, error) from error
    if standing:
        what = "the path of the file is a folder" if path.is_dir() else "the file exists"
        raise StorageError(Fault(f"{what}, and nothing is overwritten", str(path), attempt=ANOTHER))
    require_writable(path.parent)


def write_new_file(path: Path, text: str) -> None:
    """Write a new file, completely or not at all.

    Raises
    ------
    StorageError
        Where it exists already, or cannot be written.
    """
    require_free_file(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode("utf-8"))
    except OSError as error:
        raise unwritable(path, error) from error


def unwritable(path: Path, error: OSError) -> StorageError:
    """The error of a path that cannot be written."""
    return StorageError(
        Fault(
            "this cannot be written",
            str(path),
            error.strerror or str(error),
            "a folder with free space in which you may write",
        )
    )


def _require_empty(folder: Path, attempt: str) -> None:
    try:
        if folder.exists() and not folder.is_dir():
            raise StorageError(Fault("the path of the folder is a file", str(folder)))
        held = sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise unwritable(folder, error) from error
    if held:
        shown = ", ".join(held[:4]) + (", …" if len(held) > 4 else "")
        raise StorageError(
            Fault("the folder is not empty, and nothing is overwritten", str(folder), shown, attempt=attempt)
        )
