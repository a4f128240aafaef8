"""YAML: plain data as text; a file as plain data, bounded in size and depth, with unique keys, numbers by YAML 1.2."""

from __future__ import annotations

import io
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError, ReusedAnchorWarning, YAMLError
from ruamel.yaml.events import CollectionEndEvent, CollectionStartEvent
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from softcal.errors import Fault, ProjectFileError, StorageError
from softcal.limits import LIMITS
from softcal.project.document import Document, KeyPath, dotted
from softcal.project.files import require_file

_TAG = "tag:yaml.org,2002:"
_MERGE = _TAG + "merge"
# What YAML itself says of a value; whatever else a tag names is not read.
_TAGS = {_TAG + kind for kind in ("str", "int", "float", "bool", "null", "map", "seq", "merge", "timestamp", "value")}
_NO_NUMBERS = (".nan", ".inf")
_LONGEST_KEY, _MOST_DIGITS = 200, 30
_ONE_LINE = 2**20  # characters, so that no line is wrapped


def read_document(
    path: Path,
    kind: str = "project file",
    keys: str = "keys such as softcal, name, robot, experiments, parameters",
    attempt: str = "softcal init neck DIR writes one to start from",
) -> Document:
    """Parse a YAML file; equal keys and the like are kept as faults of the document.

    Parameters
    ----------
    path
        The file.
    kind
        Kind of the file, such as "mesh file", for messages.
    keys
        Keys that such a file has, for messages.
    attempt
        How to obtain such a file, for messages.

    Raises
    ------
    StorageError
        Where the file cannot be read, or is too large.
    ProjectFileError
        Where it is not YAML, holds no mapping, too many values or levels, or a value that holds itself.
    """
    require_file(path, kind, LIMITS["bytes of a YAML file"])
    name = path.name
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = (
            f"a byte that is not UTF-8 at {error.start}" if isinstance(error, UnicodeDecodeError) else error.strerror
        )
        raise StorageError(
            Fault(f"the {kind} cannot be read", str(path), reason or str(error), "a YAML file in UTF-8")
        ) from error
    try:
        root = _compose(text, name)
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise ProjectFileError(
            Fault("this is not YAML", f"{name}:{line}", error.problem or str(error.context), "key: value")
        ) from error
    except (YAMLError, ValueError, OverflowError) as error:  # of escapes such as "\UFFFFFFFF", ruamel lets Python's out
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


def _compose(text: str, name: str) -> Node | None:
    """The file's nodes; values and levels are counted first, event by event, since nodes are made by recursion."""
    levels, values, depth = LIMITS["levels of a YAML file"], LIMITS["values in a YAML file"], 0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ReusedAnchorWarning)  # YAML 1.2 lets an anchor be set anew
        for count, event in enumerate(_yaml().parse(text)):  # pyright: ignore[reportUnknownMemberType]
            depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
            where = f"{name}:{event.start_mark.line + 1}"  # a key and its value are two events
            if fault := levels.fault(depth, where) or values.fault(count / 2, where):
                raise ProjectFileError(fault)
        return _yaml().compose(text)  # pyright: ignore[reportUnknownMemberType, reportReturnType]


def _yaml() -> YAML:
    return YAML(typ="safe", pure=True)


def yaml_text(data: Mapping[str, Any], levels: int = 1) -> str:
    """A mapping as YAML, with a line for each entry down to `levels`, and deeper entries in flow style."""

    def styled(value: Any, level: int) -> Any:
        if isinstance(value, Mapping):
            made = CommentedMap((key, styled(one, level + 1)) for key, one in value.items())
        elif isinstance(value, list | tuple):
            made = CommentedSeq(styled(one, level + 1) for one in value)
        else:
            return value
        if level >= levels:
            made.fa.set_flow_style()
        return made

    text, writer = io.StringIO(), YAML(pure=True)
    writer.width = _ONE_LINE
    writer.dump(styled(data, 0), text)  # pyright: ignore[reportUnknownMemberType]
    return text.getvalue()


class _Reader:
    """Turns YAML nodes into plain data: lines kept, equal keys found, anchors written out up to a limit."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.lines: dict[KeyPath, int] = {}
        self.faults: list[Fault] = []
        self.count = 0
        self.inside: list[Node] = []

    def value(self, node: Node, path: KeyPath) -> Any:
        self.lines.setdefault(path, _line(node))
        self.count += 1
        if fault := LIMITS["values in a YAML file"].fault(self.count, self.where(path, node)):
            raise ProjectFileError(fault)
        if any(node is outer for outer in self.inside):
            raise ProjectFileError(Fault("the value holds itself", self.where(path, node)))
        if node.tag not in _TAGS:
            self.add(path, node, "the tag is not known", f"'{node.tag}'", "a plain value")
        self.inside.append(node)
        try:
            if isinstance(node, MappingNode):
                return self.mapping(node, path)
            if isinstance(node, SequenceNode):
                return [self.value(entry, (*path, i)) for i, entry in enumerate(node.value)]
            return self.scalar(node, path)
        finally:
            self.inside.pop()

    def mapping(self, node: MappingNode, path: KeyPath) -> dict[str, Any]:
        found: dict[str, Any] = {}
        merged: dict[str, Any] | None = None
        for key_node, value_node in node.value:
            if key_node.tag == _MERGE:
                if merged is not None:
                    self.add(path, key_node, "the key appears twice", "a second <<", "<<: [*a, *b]")
                merged = {**self.merged(value_node, path), **(merged or {})}
                continue
            key = str(key_node.value)
            if (
                not isinstance(key_node, ScalarNode)
                or not key.strip()
                or len(key) > _LONGEST_KEY
                or not key.isprintable()
            ):
                allowed = f"text of 1 to {_LONGEST_KEY} characters that can be seen"
                self.add(path, key_node, "this cannot be a key", repr(key)[:40], allowed)
                continue
            here = (*path, key)
            if key in found:
                before = f"a first one on line {self.lines[here]}"
                self.add(here, key_node, "the key appears twice", before, "one of each key")
                continue
            self.lines[here] = _line(key_node)
            found[key] = self.value(value_node, here)
        return {**(merged or {}), **found}

    def merged(self, node: Node, path: KeyPath) -> dict[str, Any]:
        """The entries that `<<` adds: of a mapping, or of several, of which the first has precedence."""
        many: list[Node] = node.value if isinstance(node, SequenceNode) else [node]
        found: dict[str, Any] = {}
        for one in many:
            if isinstance(one, MappingNode):
                found = {**self.value(one, path), **found}
            else:
                self.add(path, one, "this cannot be merged", "a list or a bare value", "<<: *NAME, of a mapping")
        return found

    def scalar(self, node: Node, path: KeyPath) -> str | int | float | bool | None:
        text, kind = str(node.value), str(node.tag).removeprefix(_TAG)
        plain = text.replace("_", "")
        try:
            if kind == "null":
                return None
            if kind == "bool":
                return {"true": True, "false": False}[text.lower()]
            if kind == "int" and len(plain) <= _MOST_DIGITS:
                return int(plain, 0) if plain.lstrip("+-")[:2] in ("0o", "0x") else int(plain)
            if kind == "float" and math.isfinite(number := float(plain)):
                return number
        except (ValueError, KeyError):
            if kind == "float" and plain.lower().lstrip("+-") in _NO_NUMBERS:
                return text  # the reader of the value reports the expected type
            self.add(path, node, "the value does not match its tag", f"'{text[:40]}', {kind}", "a plain value")
        return text

    def add(self, path: KeyPath, node: Node, what: str, got: str, allowed: str) -> None:
        self.faults.append(Fault(what, self.where(path, node), got, allowed))

    def where(self, path: KeyPath, node: Node) -> str:
        return f"{self.name}:{_line(node)}" + (f": {dotted(path)}" if path else "")


def _line(node: Node) -> int:
    return node.start_mark.line + 1
