"""One reader for every file that softcal has stored: a record of a known format, or its faults.

A record is the JSON of a frozen dataclass, which is its schema both ways (pydantic): its own types and no others, no
NaN, no infinity; keys that it does not name are left alone, for readers. A table is CSV with the same number of cells
in every row. A record has the SHA-256 of its content and of the tables beside it, so that a number that somebody
changed in either is refused: a fit and its interval would be shown that nobody computed. That is no signature: it
protects from a slip, an editor and a script, and not from somebody who computes it anew.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from softcal.csv_text import plain
from softcal.declare import shown
from softcal.errors import Fault, StorageError
from softcal.regular_file import read_own

_LARGEST = 2**28  # bytes of a record; those of long searches have some hundred thousand
_N_NAMED = 5  # faults of one record that are reported
_DIGEST, _TABLES = "sha256", "tables"  # keys of a record

Count = Annotated[int, Field(ge=0, lt=2**53)]
Amount = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1.0 + 1e-9)]


class Record(BaseModel):
    """A record on disk: JSON types are not converted into each other, and numbers are finite."""

    model_config = ConfigDict(frozen=True, strict=True, allow_inf_nan=False)


class Schema:
    """Base of a frozen dataclass that is the schema of its record, those within it included; rules as of `Record`."""

    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(
        strict=True, allow_inf_nan=False, arbitrary_types_allowed=True
    )


IN_TABLE = Field(exclude=True, default=())
"""Annotates a field whose values are in a table beside the record, from which its reader fills it."""
PERHAPS_IN_TABLE = Field(exclude=True)
"""The same of a field with a default."""


class _Header(Record):
    format: Count


_DOCUMENT = TypeAdapter(dict[str, Any])
R = TypeVar("R", bound=Record | Schema)


@cache
def _adapter(kind: type[R]) -> TypeAdapter[R]:
    return TypeAdapter(kind)


def as_json(record: Schema) -> dict[str, Any]:
    """The JSON of a record, without what is in tables."""
    return _adapter(type(record)).dump_python(record, mode="json", warnings="error")


def read_record(kind: type[R], path: Path, what: str, form: int | None = None) -> R:
    """The record in a file, unchanged since it was written; arguments and errors as of `as_record`.

    Parameters
    ----------
    kind, what, form
        See `as_record`.
    path
        The file.
    """
    text = read_bytes(path, what)
    record = as_record(kind, text, path, what, form)
    require_unchanged(text, path, what)
    return record


def sealed(document: Mapping[str, Any], tables: Mapping[str, str] | None = None) -> str:
    """The text of a record with its digest.

    Parameters
    ----------
    document
        The record, as JSON.
    tables
        Name -> text of each table beside it.

    Raises
    ------
    ValueError
        Where it has a number that is not finite.
    """
    digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in (tables or {}).items()}
    held = {**document, **({_TABLES: digests} if digests else {})}
    return json.dumps({**held, _DIGEST: digest(held)}, indent=2, allow_nan=False) + "\n"


def digest(document: object) -> str:
    """SHA-256 of what a JSON document says, however it is laid out."""
    return hashlib.sha256(json.dumps(_plain(document), sort_keys=True).encode()).hexdigest()


def _plain(value: Any) -> Any:
    """A value of JSON in which 1 is 1.0, as other programs write it."""
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return float(value) if type(value) is int and value.bit_length() < 1024 else value


def require_unchanged(text: bytes, path: Path, what: str) -> None:
    """Raise unless a record and the tables beside it are as they were written; one without a digest is an earlier one.

    Parameters
    ----------
    text
        The JSON of the record.
    path, what
        Its file, and its name as in "the result".

    Raises
    ------
    StorageError
        With every file that is another one.
    """
    held = as_document(text, path, what)
    if (before := held.pop(_DIGEST, None)) is None:
        return
    changed = [] if digest(held) == before else [path]
    tables = held.get(_TABLES)
    beside = {one.name: one for one in path.parent.iterdir()}
    for name, of_table in tables.items() if not changed and isinstance(tables, dict) else ():
        table = beside.get(name)
        if table is None or hashlib.sha256(read_bytes(table, what)).hexdigest() != of_table:
            changed.append(path if table is None else table)
    attempt = "restore it, or compute it again"
    if changed:
        raise StorageError(
            [Fault(f"{what} was changed after it was written", str(one), attempt=attempt) for one in changed]
        )


def as_record(kind: type[R], text: bytes, path: Path, what: str, form: int | None = None) -> R:
    """A record from its JSON.

    Parameters
    ----------
    kind
        Its class.
    text
        The JSON.
    path, what
        Its file, and its name as in "the result" (for messages).
    form
        The number of its format, None where it has none.

    Raises
    ------
    StorageError
        Where it cannot be read, is of another format, or is damaged: every fault of it.
    """
    try:
        if form is not None:
            found = _Header.model_validate_json(text).format
            if found != form:
                raise StorageError(
                    Fault(
                        f"{what} is of another format", str(path), str(found), str(form), "another version of softcal"
                    )
                )
        return _adapter(kind).validate_json(text)
    except ValidationError as error:
        raise damaged(path, what, error) from error


def as_document(text: bytes, path: Path, what: str) -> dict[str, Any]:
    """The mapping of a record, before its schema is known; errors as of `as_record`.

    Parameters
    ----------
    text, path, what
        See `as_record`.
    """
    try:
        return _DOCUMENT.validate_json(text)
    except ValidationError as error:
        raise damaged(path, what, error) from error


def read_bytes(path: Path, what: str, most: int = _LARGEST) -> bytes:
    """The bytes of a stored file.

    Parameters
    ----------
    path, what
        The file, and its name as in "the result" (for messages).
    most
        Largest number of bytes.

    Raises
    ------
    StorageError
        Where it cannot be read, or is larger than any such file.
    """
    try:
        return read_own(path, most)
    except OSError as error:
        raise StorageError(Fault(f"{what} cannot be read", str(path), error.strerror or str(error))) from error


def damaged(path: Path, what: str, error: ValidationError) -> StorageError:
    """The faults of a stored file by a schema.

    Parameters
    ----------
    path, what
        The file, and its name as in "the result".
    error
        What the schema finds.
    """
    faults: list[Fault] = []
    for one in error.errors(include_url=False, include_context=False)[:_N_NAMED]:
        got = "" if one["type"] in ("json_invalid", "missing", "value_error") else shown(one["input"])
        place = ".".join(str(key)[:60] for key in one["loc"]) + ": " * bool(one["loc"])
        message = one["msg"].removeprefix("Value error, ")
        message = message[:1].lower() + message[1:]
        faults.append(Fault(f"{what} cannot be read: {place}{message}", str(path), got))
    return StorageError(faults)


def contradiction(path: Path, what: str, why: str) -> StorageError:
    """The error of a stored file whose parts contradict each other.

    Parameters
    ----------
    path, what
        The file, and its name as in "the result".
    why
        The contradiction, the end of a sentence.
    """
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
