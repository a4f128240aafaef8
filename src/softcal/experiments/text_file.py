"""Reading a text file of any size in blocks of lines, with detection of its encoding and a hash of its bytes."""

from __future__ import annotations

import codecs
import contextlib
import hashlib
import io
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from softcal.errors import DatasetError, Fault, StorageError

_BLOCK = 1 << 20  # bytes
_LONGEST_LINE = 1_000_000  # characters


@dataclass(frozen=True)
class TextFile:
    """A text file; n_lines: number of lines, including an unterminated last one."""

    path: Path
    sha256: str
    encoding: str
    n_lines: int

    def blocks(self) -> Iterator[tuple[int, list[str]]]:
        """The lines in blocks, without line ends, each block with the number of its first line (from 1).

        Raises
        ------
        StorageError
            If the file can no longer be read.
        DatasetError
            For a line of more than a million characters, as in a file without line ends.
        """
        number = 1
        for lines in _blocks(self.path, self.encoding):
            yield number, lines
            number += len(lines)


def open_text(path: Path) -> TextFile:
    """Read a file once to determine its encoding (UTF-8, else UTF-16 or Latin-1), hash and number of lines.

    Raises
    ------
    StorageError
        Where it cannot be read.
    DatasetError
        If it is not text, or has a line of more than a million characters.
    """
    with _reading(path) as file:
        raw = file.read(400)
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        what, got = "the file is not text", "an archive, such as a workbook of a spreadsheet"
        raise DatasetError(Fault(what, str(path), got, "text such as CSV", "save the sheet as CSV"))
    encodings = ["utf-8-sig", "latin-1"]
    first, second = raw[::2].count(0), raw[1::2].count(0)
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        encodings = ["utf-16"]
    elif max(first, second) > len(raw) // 4 > 4 * min(first, second):  # Latin text in UTF-16: every second byte is zero
        encodings = ["utf-16-be" if first > second else "utf-16-le"]
    for encoding in encodings:
        digest = hashlib.sha256()
        try:
            n_lines = sum(len(lines) for lines in _blocks(path, encoding, digest.update))
        except UnicodeDecodeError:
            continue
        return TextFile(path, digest.hexdigest(), encoding, n_lines)
    raise DatasetError(
        Fault("the file is not text", where=str(path), allowed="UTF-8, Latin-1 or UTF-16 text such as CSV or TXT")
    )


def _blocks(path: Path, encoding: str, seen: Callable[[bytes], object] = bytes) -> Iterator[list[str]]:
    """Lines, block by block; seen: called with the bytes of each block."""
    rest, number = "", 0
    decode = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder(encoding)(), translate=True).decode
    with _reading(path) as file:
        while raw := file.read(_BLOCK):
            seen(raw)
            *lines, rest = (rest + decode(raw)).split("\n")
            if len(max((*lines, rest), key=len)) > _LONGEST_LINE:
                numbered = enumerate((*lines, rest), start=number + 1)
                long = next(i for i, line in numbered if len(line) > _LONGEST_LINE)
                what, allowed = "the line is too long for a row of a table", f"at most {_LONGEST_LINE} characters"
                raise DatasetError(Fault(what, f"{path}, line {long}", allowed=allowed))
            number += len(lines)
            yield lines
    *lines, rest = (rest + decode(b"", final=True)).split("\n")
    yield [*lines, rest] if rest else lines


@contextlib.contextmanager
def _reading(path: Path) -> Generator[BinaryIO]:
    what = "the data file cannot be read"
    if path.exists() and not path.is_file():
        raise StorageError(Fault(what, where=str(path), got="a folder or a device", allowed="a file"))
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise StorageError(Fault(what, where=str(path), got=error.strerror or str(error))) from error
