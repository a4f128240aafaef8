"""Files of a folder that somebody else may be writing, or may have made up: missing, half-written, damaged."""

from __future__ import annotations

import json
import stat
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from softcal.regular_file import is_inside, read_own

MOST_BYTES = 64_000_000  # of one file; a larger one is none of softcal's
_LARGEST = 1e100  # in any unit: what is computed from such numbers is finite
T = TypeVar("T")


class Unreadable(Exception):
    """A file that cannot be shown; the message is a sentence with its name."""


def inside(folder: Path, place: str) -> Path | None:
    """The regular file at a place in a folder; None where there is none, or where it is outside, as a link may lead.

    Raises
    ------
    Unreadable
        Where the system refuses to look.
    """
    path = folder / place
    try:
        found = path.resolve(strict=True)
        return found if stat.S_ISREG(found.stat().st_mode) and is_inside(found, folder) else None
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, ValueError, RuntimeError) as error:
        raise Unreadable(f"{clean(place)} cannot be read: {_reason(error)}.") from error


def read_file(folder: Path, place: str) -> bytes | None:
    """The bytes of a file in a folder; None where there is no such file.

    Raises
    ------
    Unreadable
        Where the system refuses to read it, or it is larger than any of softcal's.
    """
    path = inside(folder, place)
    try:
        return None if path is None else read_own(path, MOST_BYTES)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise Unreadable(f"{clean(place)} cannot be read: {_reason(error)}.") from error


def read_record(folder: Path, place: str) -> dict[str, Any] | None:
    """A JSON object in a folder, with texts that can be shown; None where there is no such file.

    Raises
    ------
    Unreadable
        Where it is no JSON object, such as one that is half-written.
    """
    text = read_file(folder, place)
    if text is None:
        return None
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Unreadable(f"{clean(place)} cannot be read: {_reason(error)}.") from error
    if not isinstance(record, dict):
        raise Unreadable(f"{clean(place)} is no record of softcal's.")
    return {clean(key): value for key, value in record.items()}


def told(faults: list[str], read: Callable[[], T]) -> T | None:
    """The content, or None and a sentence on why it cannot be read."""
    try:
        return read()
    except Unreadable as error:
        faults.append(str(error))
        return None


def clean(value: object, most: int = 2000) -> str:
    """A value as text that can be encoded and shown, of `most` characters; "" for None."""
    text = "" if value is None else str(value)
    text = text.encode("utf-8", "replace").decode("utf-8")
    text = "".join(letter if letter.isprintable() or letter == "\n" else " " for letter in text)
    return text if len(text) <= most else f"{text[:most]}…"


def finite(value: object) -> float | None:
    """A value as a number; None where it is no number, not finite, or larger than softcal's numbers can be."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if abs(number) <= _LARGEST else None


def count(value: object) -> int | None:
    """A value as a number of things; None where it is none."""
    number = finite(value)
    return int(number) if number is not None and number >= 0 and number == int(number) else None


def numbers(value: object) -> dict[str, float]:
    """The finite numbers of a mapping, by name."""
    if not isinstance(value, Mapping):
        return {}
    found = {clean(name): finite(one) for name, one in value.items()}
    return {name: one for name, one in found.items() if one is not None}


def _reason(error: Exception) -> str:
    if isinstance(error, OSError):
        return (error.strerror or "the system refuses it").lower()
    return "it is not whole" if isinstance(error, json.JSONDecodeError) else "it is no text of softcal's"
