"""A file as plain data with line numbers, and the collection of its faults."""

from __future__ import annotations

import re
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from softcal.errors import Fault, InputError, ProjectFileError, nearest

# The path to a value: keys of mappings and numbers of list entries.
KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class Document:
    """A parsed YAML file: mappings, lists, text, numbers, and the line of each by key path."""

    name: str
    data: Mapping[str, Any]
    lines: Mapping[KeyPath, int]
    faults: tuple[Fault, ...] = ()

    def mapping(self, key: str) -> Mapping[str, Any]:
        """The mapping under a key of the file; empty where that is none."""
        data = self.data.get(key)
        return data if isinstance(data, dict) else {}

    def where(self, path: KeyPath) -> str:
        """File, line and dotted key, such as `project.yaml:12: robot.bodies.neck.law`."""
        at = path
        while at not in self.lines and at:
            at = at[:-1]
        place = f"{self.name}:{self.lines.get(at, 1)}"
        return f"{place}: {dotted(path)}" if path else place


@dataclass
class Findings:
    """Everything that is wrong with a document, collected so that it is reported at once."""

    document: Document
    faults: list[Fault] = field(default_factory=list[Fault])
    warnings: list[Fault] = field(default_factory=list[Fault])

    def __post_init__(self) -> None:
        self.faults.extend(self.document.faults)

    def add(self, path: KeyPath, what: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        """Record a fault at a key."""
        self.faults.append(Fault(what, self.document.where(path), got, allowed, attempt))

    def warn(self, path: KeyPath, what: str, *, got: str = "", allowed: str = "", attempt: str = "") -> None:
        """Record what is allowed but looks wrong."""
        self.warnings.append(Fault(what, self.document.where(path), got, allowed, attempt))

    def unknown(self, path: KeyPath, kind: str, got: str, known: Iterable[str]) -> None:
        """Record a name that does not exist, with the nearest that does."""
        known = sorted(known)
        self.add(
            path,
            f"there is no such {kind}",
            got=f"'{got}'",
            allowed=", ".join(known) or f"none is defined: this project has no {kind}",
            attempt=nearest(got, known),
        )

    @contextmanager
    def at(self, path: KeyPath) -> Generator[None]:
        """Record the faults of an `InputError` raised inside, as found at `path`."""
        try:
            yield
        except InputError as error:
            self.take(path, error.faults)

    def take(self, path: KeyPath, faults: Iterable[Fault]) -> None:
        """Record faults as found at `path`, each with its own place below it."""
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


def _line(fault: Fault) -> int:
    number = re.match(r"[^:]*:(\d+)", fault.where)
    return int(number[1]) if number else 0
