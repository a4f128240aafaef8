"""A file as plain data with line numbers, and the collection of its faults."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from typing import Any

from softcal.errors import Fault, InputError, ProjectFileError, nearest, unknown

# The path to a value: keys of mappings and numbers of list entries.
KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class Entry:
    """An entry that replaces one of the file; place: where it is written, such as a cell of a table."""

    value: object
    place: str = ""


@dataclass(frozen=True)
class Document:
    """A parsed YAML file: mappings, lists, text, numbers, and the line of each by key path.

    places: key path -> where an entry comes from that replaces one of the file, for messages.
    """

    name: str
    data: Mapping[str, Any]
    lines: Mapping[KeyPath, int]
    faults: tuple[Fault, ...] = ()
    places: Mapping[KeyPath, str] = field(default_factory=dict[KeyPath, str])

    def mapping(self, key: str) -> Mapping[str, Any]:
        """The mapping under a key of the file; empty if there is none."""
        data = self.data.get(key)
        return data if isinstance(data, dict) else {}

    def where(self, path: KeyPath) -> str:
        """File, line and dotted key, such as `project.yaml:12: robot.bodies.neck.law`."""
        for given, written in self.places.items():
            if path[: len(given)] == given:
                return written
        at = path
        while at not in self.lines and at:
            at = at[:-1]
        place = f"{self.name}:{self.lines.get(at, 1)}"
        return f"{place}: {dotted(path)}" if path else place

    @property
    def changes(self) -> dict[str, object]:
        """The entries that replace some of the file, by dotted key."""
        return {dotted(path): _entry(self.data, path) for path in self.places}

    def changed(self, changes: Mapping[str, Entry]) -> Document:
        """The document with some entries replaced, by dotted key.

        Raises
        ------
        ProjectFileError
            For keys that have no place in the file, all at once.
        """
        data, faults = deepcopy(dict(self.data)), list[Fault]()
        places: dict[KeyPath, str] = {}
        written = {dotted(path): path for path in self.lines if path}
        for key, change in changes.items():
            path = written.get(key, key_path(key))
            holder = _entry(data, path[:-1])
            if not _has_place(holder, path[-1]):
                allowed = f"a key of {self.name}"
                faults.append(Fault("there is no such key", change.place, f"'{key}'", allowed, nearest(key, written)))
                continue
            holder[path[-1]] = change.value
            places[path] = change.place or f"{self.name}: {key}"
        if faults:
            raise ProjectFileError(faults)
        return replace(self, data=data, places=places)


@dataclass
class Findings:
    """All faults and warnings of a document, collected so that they are reported at once."""

    document: Document
    faults: list[Fault] = field(default_factory=list[Fault])
    warnings: list[Fault] = field(default_factory=list[Fault])

    def __post_init__(self) -> None:
        self.faults.extend(self.document.faults)

    def add(self, path: KeyPath, what: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        """Record a fault at a key.

        Parameters
        ----------
        path
            Key path of the fault.
        what
            The fault.
        got
            The value in the file.
        allowed
            What is allowed there.
        attempt
            What to try.
        """
        self.faults.append(Fault(what, self.document.where(path), got, allowed, attempt))

    def warn(self, path: KeyPath, what: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        """Record a value that is allowed but looks wrong.

        Parameters
        ----------
        path
            Key path of the value.
        what
            The warning.
        got
            The value in the file.
        allowed
            What is usual there.
        attempt
            What to try.
        """
        self.warnings.append(Fault(what, self.document.where(path), got, allowed, attempt))

    def unknown(self, path: KeyPath, kind: str, got: str, known: Iterable[str]) -> None:
        """Record a name that does not exist, with the nearest that does.

        Parameters
        ----------
        path
            Key path of the name.
        kind
            Kind of object, such as "plate".
        got
            The name in the file.
        known
            The names that exist.
        """
        known = sorted(known)
        none = f"none is defined: this project has no {kind}"
        self.faults.append(unknown(f"there is no such {kind}", self.document.where(path), got, known, none=none))

    @contextmanager
    def at(self, path: KeyPath) -> Generator[None]:
        """Record the faults of an `InputError` raised inside, at `path`."""
        try:
            yield
        except InputError as error:
            self.take(path, error.faults)

    def take(self, path: KeyPath, faults: Iterable[Fault]) -> None:
        """Record faults at `path`, each with its key path below it."""
        place = self.document.where(path)
        for fault in faults:
            said = not fault.where or dotted(path).endswith(fault.where)
            self.faults.append(replace(fault, where=place if said else f"{place}: {fault.where}"))

    def raise_if_any(self) -> None:
        """Raise the recorded faults, each once and in the order of the lines.

        Raises
        ------
        ProjectFileError
            Where there are any.
        """
        if self.faults:
            raise ProjectFileError(sorted(dict.fromkeys(self.faults), key=_line))


def dotted(path: KeyPath) -> str:
    """`robot.cables.front.via[1].at` for ("robot", "cables", "front", "via", 1, "at")."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")


def key_path(key: str) -> KeyPath:
    """The path of a dotted key: ("robot", "cables", "front", "via", 1, "at") for `robot.cables.front.via[1].at`."""
    parts = re.findall(r"[^.\[\]]+|\[\d+\]", key)
    return tuple(int(part[1:-1]) if part.startswith("[") else part for part in parts)


def _entry(data: Any, path: KeyPath) -> Any:
    """The value at a path; None if there is none."""
    for part in path:
        is_there = part in data if isinstance(data, dict) else _has_place(data, part)
        if not is_there:
            return None
        data = data[part]
    return data


def _has_place(holder: Any, key: str | int) -> bool:
    """True if a value can stand at a key: any key of a mapping, an existing index of a list."""
    if isinstance(holder, dict):
        return isinstance(key, str)
    return isinstance(holder, list) and isinstance(key, int) and key < len(holder)


def _line(fault: Fault) -> int:
    number = re.match(r"[^:]*:(\d+)", fault.where)
    return int(number[1]) if number else 0
