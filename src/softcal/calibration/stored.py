"""One reader for every file that softcal has stored: a record of a known format, or its faults.

A record is JSON by a schema (pydantic): its own types and no others, no NaN, no infinity. A table is CSV with the same
number of cells in every row.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from softcal.csv_text import plain
from softcal.errors import Fault, StorageError
from softcal.regular_file import read_own

_LARGEST = 2**28  # bytes of a record; those of long searches have some hundred thousand
_N_NAMED = 5  # faults of one record that are reported

Count = Annotated[int, Field(ge=0, lt=2**53)]
Amount = Annotated[float, Field(ge=0)]


class Record(BaseModel):
    """A record on disk: JSON types are not converted into each other, and numbers are finite."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


class _Header(Record):
    format: Count


R = TypeVar("R", bound=Record)


def read_record(model: type[R], path: Path, what: str, form: int | None = None) -> R:
    """The record in a file. what: its name, as in "the result"; form: the number of its format, None where it has none.

    Raises
    ------
    StorageError
        Where it cannot be read, is of another format, or is damaged: every fault that was found.
    """
    text = read_bytes(path, what)
    try:
        if form is not None:
            found = _Header.model_validate_json(text).format
            if found != form:
                raise StorageError(
                    Fault(
                        f"{what} is of another format", str(path), str(found), str(form), "another version of softcal"
                    )
                )
        return model.model_validate_json(text)
    except ValidationError as error:
        raise damaged(path, what, error) from error


def read_bytes(path: Path, what: str) -> bytes:
    """The bytes of a stored file.

    Raises
    ------
    StorageError
        Where it cannot be read, or is larger than any such file.
    """
    try:
        return read_own(path, _LARGEST)
    except OSError as error:
        raise StorageError(Fault(f"{what} cannot be read", str(path), error.strerror or str(error))) from error


def damaged(path: Path, what: str, error: ValidationError) -> StorageError:
    """What a schema finds wrong in a stored file, as faults."""
    faults: list[Fault] = []
    for one in error.errors(include_url=False, include_context=False)[:_N_NAMED]:
        got = "" if one["type"] in ("json_invalid", "missing") else _shown(one["input"])
        faults.append(Fault(f"{what} cannot be read: {_place(one['loc'])}{_sentence(one['msg'])}", str(path), got))
    return StorageError(faults)


def contradiction(path: Path, what: str, why: str) -> StorageError:
    """The error of a stored file whose parts contradict each other."""
    return StorageError(Fault(f"{what} cannot be read: {why}", str(path)))


def read_rows(path: Path, what: str) -> tuple[list[str], list[list[str]]]:
    """Header and rows of a stored table; every row as long as the header, whose names all differ.

    Raises
    ------
    StorageError
        Where it cannot be read, or is damaged.
    """
    try:
        text = read_bytes(path, what).decode("utf-8")
        lines = [[plain(cell) for cell in row] for row in csv.reader(io.StringIO(text), strict=True)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise contradiction(path, what, str(error)) from error
    if "\0" in text:
        raise contradiction(path, what, "it holds NUL")
    if not lines:
        raise contradiction(path, what, "it is empty")
    header, rows = lines[0], lines[1:]
    if len(set(header)) != len(header):
        raise contradiction(path, what, "two columns have one name")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise contradiction(path, what, f"row {number} has {len(row)} cells, and the header {len(header)}")
    return header, rows


def _place(location: tuple[str | int, ...]) -> str:
    return ".".join(map(str, location)) + ": " if location else ""


def _sentence(message: str) -> str:
    return message[:1].lower() + message[1:]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
