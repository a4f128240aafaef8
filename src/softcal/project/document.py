"""A YAML file as plain data that remembers its lines, and the place where everything wrong with it is collected."""

from __future__ import annotations

import difflib
import re
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from softcal.errors import Fault, InputError, ProjectFileError, StorageError

# The way to a value: keys of mappings and numbers of list entries.
KeyPath = tuple[str | int, ...]


@dataclass(frozen=True)
class Document:
    """A parsed YAML file: mappings, lists, text, numbers, and the line of each by key path."""

    name: str
    data: Mapping[str, Any]
    lines: Mapping[KeyPath, int]
    faults: tuple[Fault, ...] = ()

    def where(self, path: KeyPath) -> str:
        """File, line and dotted key, such as `project.yaml:12: robot.bodies.neck.law`."""
        at = path
        while at not in self.lines and at:
            at = at[:-1]
        place = f"{self.name}:{self.lines.get(at, 1)}"
        return f"{place}: {dotted(path)}" if path else place


@dataclass
class Findings:
    """Everything that is wrong with a document, gathered so that it can be told at once."""

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
        """Record a name that stands for nothing, with the nearest that does."""
        known = sorted(known)
        self.add(
            path,
            f"there is no such {kind}",
            got=f"'{got}'",
            allowed=", ".join(known) or f"none is defined: this project has no {kind}",
            attempt=suggestion(got, known),
        )

    @contextmanager
    def at(self, path: KeyPath) -> Generator[None]:
        """Record what an `InputError` raised inside says, as found at `path`."""
        try:
            yield
        except InputError as error:
            place = self.document.where(path)
            for fault in error.faults:
                said = not fault.where or dotted(path).endswith(fault.where)
                self.faults.append(replace(fault, where=place if said else f"{place}: {fault.where}"))

    def raise_if_any(self) -> None:
        """Raise what was found, each fault once and in the order of the lines.

        Raises
        ------
        ProjectFileError
            Where anything was found.
        """
        if self.faults:
            raise ProjectFileError(sorted(dict.fromkeys(self.faults), key=_line))


def dotted(path: KeyPath) -> str:
    """`robot.cables.front.via[1].at` for ("robot", "cables", "front", "via", 1, "at")."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path).lstrip(".")


def _line(fault: Fault) -> int:
    number = re.match(r"[^:]*:(\d+)", fault.where)
    return int(number[1]) if number else 0


def suggestion(got: str, known: Iterable[str]) -> str:
    """The known word nearest to `got`, quoted; nothing where none is near."""
    nearest = difflib.get_close_matches(got, list(known), n=1, cutoff=0.5)
    return f"'{nearest[0]}'" if nearest else ""


def read_document(
    path: Path,
    kind: str = "project file",
    keys: str = "keys such as softcal, name, robot, experiments, parameters",
    attempt: str = "softcal init neck DIR writes one to start from",
) -> Document:
    """Parse a YAML file; equal keys and the like are kept as faults of the document.

    `kind`, `keys` and `attempt` tell in messages what the file is, what stands in it and where to get one.

    Raises
    ------
    StorageError
        Where the file cannot be read.
    ProjectFileError
        Where it is not YAML, or holds no mapping.
    """
    name = path.name
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StorageError(
            Fault(f"the {kind} cannot be read", str(path), _reason(error), "a YAML file in UTF-8")
        ) from error
    try:
        root: Node | None = YAML(typ="safe", pure=True).compose(text)  # pyright: ignore[reportUnknownMemberType]
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise ProjectFileError(
            Fault("this is not YAML", f"{name}:{line}", error.problem or str(error.context), "key: value")
        ) from error
    except YAMLError as error:
        raise ProjectFileError(Fault("this is not YAML", name, str(error).splitlines()[0])) from error
    if not isinstance(root, MappingNode):
        raise ProjectFileError(
            Fault(
                f"the {kind} holds no keys",
                name,
                "an empty file" if root is None else "a list or a bare value",
                keys,
                attempt,
            )
        )
    reader = _Reader(name)
    data = reader.mapping(root, ())
    return Document(name, data, reader.lines, tuple(reader.faults))


class _Reader:
    """Turns YAML nodes into plain data: lines kept, equal keys found, numbers read by YAML 1.2's rules."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self.faults: list[Fault] = []

    def value(self, node: Node, path: KeyPath) -> Any:
        self.lines.setdefault(path, node.start_mark.line + 1)
        if isinstance(node, MappingNode):
            return self.mapping(node, path)
        if isinstance(node, SequenceNode):
            return [self.value(entry, (*path, i)) for i, entry in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return _scalar(node)
        raise AssertionError(f"a YAML node of unknown kind {type(node)}")

    def mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        found: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        for key_node, value_node in node.value:
            line = key_node.start_mark.line + 1
            if key_node.tag == "tag:yaml.org,2002:merge" and isinstance(value_node, MappingNode):
                merged.update(self.mapping(value_node, path))
                continue
            key = str(key_node.value)
            here = (*path, key)
            if key in found:
                where = f"{self.name}:{line}: {dotted(here)}"
                self.faults.append(
                    Fault("the key stands twice", where, f"a first one on line {self.lines[here]}", "one of each key")
                )
                continue
            self.lines[here] = line
            found[key] = self.value(value_node, here)
        return {**merged, **found}


def _scalar(node: ScalarNode) -> str | int | float | bool | None:
    text = str(node.value)
    kind = str(node.tag).rsplit(":", 1)[-1]
    if kind == "null":
        return None
    if kind == "bool":
        return text.lower() == "true"
    if kind == "int":
        return int(text.replace("_", ""), 0) if text.lstrip("+-")[:2] in ("0o", "0x") else int(text.replace("_", ""))
    if kind == "float" and any(character.isdigit() for character in text):
        return float(text.replace("_", ""))
    return text


def _reason(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return f"a byte that is not UTF-8 at {error.start}"
    return getattr(error, "strerror", None) or str(error)
