"""What stands in the place of any file: no file of any kind that softcal reads."""

from __future__ import annotations

import functools
import gzip
import io
import os
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

NOISE = np.random.default_rng(1).bytes(20_000)
Place = Callable[[Path], None]


def holding(raw: bytes) -> Place:
    """Writes these bytes."""
    return lambda path: [path.unlink(missing_ok=True), path.write_bytes(raw)][0]


def sparse(path: Path) -> None:
    """Five gigabytes of NUL, which take no space."""
    path.unlink(missing_ok=True)
    with path.open("wb") as file:
        file.truncate(5 << 30)


@functools.cache
def archive() -> bytes:
    """A gigabyte of blanks in an archive of one megabyte."""
    raw = io.BytesIO()
    with zipfile.ZipFile(raw, "w", zipfile.ZIP_DEFLATED) as whole, whole.open("x", "w") as member:
        for _ in range(1000):
            member.write(b" " * (1 << 20))
    return raw.getvalue()


def zipped(path: Path) -> None:
    holding(archive())(path)


def in_place(make: Callable[[Path], object]) -> Place:
    """Removes the file, and makes something in its place."""
    return lambda path: [path.unlink(missing_ok=True), make(path)][0]


HOSTILE: Mapping[str, Place] = {
    "nothing": holding(b""),
    "blanks": holding(b" \n\t\n" * 500),
    "NUL": holding(b"\0" * 4000),
    "noise": holding(NOISE),
    "UTF-16": holding("Time [s],Force [N]\n0,1\n".encode("utf-16")),
    "Latin-1": holding("Zeit,Kraft für Prüfung °\n0,1\n".encode("latin-1") * 50),
    "one long line": holding(b"7," * 3_000_000),
    "many brackets": holding(b"[" * 200_000),
    "many braces": holding(b'{"a":' * 100_000),
    "an anchor that doubles": holding(
        b"a: &a [x, x]\n" + b"".join(b"%c: &%c [*%c, *%c]\n" % (c + 1, c + 1, c, c) for c in range(97, 121))
    ),
    "entities that double": holding(
        b'<?xml version="1.0"?><!DOCTYPE l [<!ENTITY a0 "ha">'
        + b"".join(b'<!ENTITY a%d "&a%d;&a%d;">' % (i + 1, i, i) for i in range(30))
        + b"]><VTKFile>&a30;</VTKFile>"
    ),
    "an object of Python": holding(b"!!python/object/apply:os.system ['touch owned']\n"),
    "a pickle": holding(b"cos\nsystem\n(S'touch owned'\ntR."),
    "compressed": holding(gzip.compress(b"0" * 50_000_000)),
    "an archive": zipped,
    "five gigabytes": sparse,
    "a folder": in_place(Path.mkdir),
    "a pipe": in_place(os.mkfifo),
    "a link to itself": in_place(lambda path: path.symlink_to(path)),
    "a link to an endless device": in_place(lambda path: path.symlink_to("/dev/zero")),
    "no file": in_place(lambda path: None),
}


def attacked(files: Callable[[Path], object], name: str, place: Place) -> Callable[[Path], None]:
    """Writes the files of a door, and what stands in the place of one."""

    def write(folder: Path) -> None:
        files(folder)
        place(folder / name)

    return write
