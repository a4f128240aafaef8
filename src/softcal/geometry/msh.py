"""The mesh of a Gmsh file (.msh 2 and 4.1, as text or binary), with all groups of all elements.

meshio's own reader stops at the stated number of elements, takes the last of two nodes of a number, the end of a row
that is too long, and node 0 for the last one, leaves out groups of a surface in several, and reads no elements in none.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.deck import DeckError, numbers_in, numbers_of, places_of

_SECTIONS = ("PhysicalNames", "Entities", "Nodes", "Elements")  # that are read
_BEGIN = re.compile(rb"^\$(\S+)[ \t\r]*\n", re.MULTILINE)
_CONVERSION = "2 and 4.1 are read, which Gmsh writes by: gmsh OLD.msh -save -format msh41 -o NEW.msh"


def read_msh(path: Path) -> Any:
    """A mesh of meshio, whose sets of cells are its groups, by name, or by number.

    Raises
    ------
    DeckError
        For what is wrong, or not followed.
    ValueError, LookupError
        For rows that are no numbers, or too short.
    """
    meshio: Any = import_module("meshio")
    common: Any = import_module("meshio.gmsh.common")
    kinds, sizes = common._gmsh_to_meshio_type, meshio._common.num_nodes_per_cell  # noqa: SLF001
    raw = path.read_bytes()
    parts = _parts(raw) if b"$MeshFormat" in raw else {}  # which version 1 does not have
    if "PartitionedEntities" in parts:
        raise DeckError("partitions, which are not followed: save the mesh without them")
    for name in ("MeshFormat", "Nodes", "Elements"):
        if name not in parts:
            raise DeckError(f"no ${name}; {_CONVERSION}")
    header, _, one = parts["MeshFormat"].partition(b"\n")
    version, form, size = header.decode().split()
    if version not in ("2", "2.0", "2.1", "2.2", "4.1"):
        raise DeckError(f"version {version[:20]} of the format; {_CONVERSION}")
    is_packed, is_4 = form != "0", version == "4.1"
    if is_packed and (form, size, one.strip()) != ("1", "8", b"\1\0\0\0"):
        raise DeckError(f"binary numbers of another kind or order of bytes; {_CONVERSION}")
    sections = {
        name: _unpacked(name, parts[name], kinds, sizes, is_4=is_4)
        if is_packed and name != _SECTIONS[0]
        else [line for line in parts[name].decode().splitlines() if line.strip()]
        for name in parts.keys() & {*_SECTIONS}
    }
    names: dict[tuple[int, int], str] = {}
    for line in _counted("PhysicalNames", sections.get("PhysicalNames", ["0"])):
        dimension, tag, name = shlex.split(line)
        if names.setdefault((int(dimension), int(tag)), name) != name:
            raise DeckError(f"two names of group {tag} of dimension {dimension}")
    numbers, points, rows = (_read_4 if is_4 else _read_2)(sections, kinds, sizes)
    cells = [
        (kind, common._gmsh_to_meshio_order(kind, places_of(numbers, nodes, f"{kind} cells, which no node has")))  # noqa: SLF001
        for kind, nodes, _ in rows
    ]
    groups: dict[str, list[Ints]] = {}
    for i, (kind, _, tagged) in enumerate(rows):
        for tag, members in tagged.items():
            name = names.get((meshio._mesh.topological_dimension[kind], abs(tag)), str(tag))  # noqa: SLF001
            groups.setdefault(name, [np.zeros(0, dtype=np.int64)] * len(rows))[i] = members
    return meshio.Mesh(points, cells, cell_sets=groups)


# Of each block of cells of one kind: the kind, the numbers of their nodes, and group -> rows.
_Rows = list[tuple[str, Ints, Mapping[int, Ints]]]


def _parts(raw: bytes) -> dict[str, bytes]:
    """Section -> its content."""
    parts: dict[str, bytes] = {}
    at = 0
    while begin := _BEGIN.search(raw, at):
        end = re.compile(rb"^[ \t]*\$End%s[ \t\r]*$" % re.escape(begin[1]), re.MULTILINE).search(raw, begin.end())
        name = begin[1].decode()
        if not end:
            raise DeckError(f"${name} without an end")
        if name in parts and name in _SECTIONS:
            raise DeckError(f"two sections ${name}")
        parts[name] = raw[begin.end() : end.start()]
        at = end.end()
    return parts


def _unpacked(name: str, raw: bytes, kinds: Mapping[int, str], sizes: Mapping[str, int], *, is_4: bool) -> list[str]:
    """The lines of a binary section, as a file of text has them."""
    raw, at = raw[:-1], 0  # without the line break before the end

    def take(kind: str, count: int = 1, width: int = 1) -> list[list[Any]]:
        """The next rows of numbers."""
        nonlocal at
        begin, at = at, at + count * width * np.dtype(kind).itemsize
        if min(count, width) < 0 or at > len(raw):
            raise DeckError(f"${name} that ends too early")
        return np.frombuffer(raw, kind, count * width, begin).reshape(count, width).tolist()

    def counted(kind: str) -> list[Any]:
        """A count and as many numbers."""
        [[count]] = take("<u8")
        return [count, *take(kind, 1, count)[0]]

    rows: list[list[Any]] = []
    if name == "Entities":
        rows = take("<u8", 1, 4)
        for dimension, count in enumerate(rows[0]):
            for _ in range(count):
                [[tag]], [box] = take("<i4"), take("<f8", 1, 6 if dimension else 3)
                rows.append([tag, *box, *counted("<i4"), *(counted("<i4") if dimension else ())])
    elif is_4:
        rows = take("<u8", 1, 4)
        while at < len(raw):
            [head], [[count]] = take("<i4", 1, 3), take("<u8")
            rows.append([*head, count])
            if name == "Nodes":
                rows += take("<u8", count) + take("<f8", count, 3 + (head[0] if head[2] else 0))
            else:
                rows += take("<u8", count, 1 + sizes[_kind(kinds, head[2])])
    else:
        at = raw.find(b"\n") + 1
        rows.append([raw[:at].decode()])
        if name == "Nodes":
            rows += [list(row) for [row] in take("<i4,<f8,<f8,<f8", (len(raw) - at) // 28)]
        while name == "Elements" and at < len(raw):
            [[kind, count, n_tags]] = take("<i4", 1, 3)
            table = take("<i4", count, 1 + n_tags + sizes[_kind(kinds, kind)])
            rows += [[number, kind, n_tags, *rest] for number, *rest in table]
    if at < len(raw):
        raise DeckError(f"{len(raw) - at} bytes too many in ${name}")
    return [" ".join(map(str, row)) for row in rows]


def _counted(name: str, lines: Sequence[str]) -> Sequence[str]:
    """The lines of a section below the one that counts them."""
    count, rows = int(lines[0]), lines[1:]
    if count != len(rows):
        raise DeckError(f"{len(rows)} lines in ${name}, which states {count}")
    return rows


def _table(lines: Sequence[str], kind: Any, width: int, what: str) -> Any:
    """Lines of so many numbers each."""
    for line in lines:
        if len(line.split()) != width:
            raise DeckError(f"'{line[:60].strip()}', in the place of the {width} numbers of {what}")
    return numbers_in("\n".join(lines), kind).reshape(-1, width)


def _read_2(
    sections: Mapping[str, list[str]], kinds: Mapping[int, str], sizes: Mapping[str, int]
) -> tuple[Ints, Floats, _Rows]:
    lines = _counted("Nodes", sections["Nodes"])
    nodes = _table(lines, np.float64, 4, "a node")
    numbers = _table([line.split(maxsplit=1)[0] for line in lines], np.int64, 1, "a node's number")[:, 0]
    alike: dict[tuple[int, int], list[str]] = {}
    for line in _counted("Elements", sections["Elements"]):
        kind, n_tags = map(int, line.split(maxsplit=3)[1:3])
        alike.setdefault((kind, n_tags), []).append(line)
    rows: _Rows = []
    for (kind, n_tags), lines in alike.items():
        name = _kind(kinds, kind)
        table = _table(lines, np.int64, 3 + n_tags + sizes[name], f"a {name} with {n_tags} tags")
        tags = table[:, 3] if n_tags else np.zeros(len(table), dtype=np.int64)
        groups = {int(tag): np.flatnonzero(tags == tag) for tag in np.unique(tags) if tag}
        rows.append((name, table[:, 3 + n_tags :], groups))
    return numbers_of([numbers], "nodes"), nodes[:, 1:], rows


def _read_4(
    sections: Mapping[str, list[str]], kinds: Mapping[int, str], sizes: Mapping[str, int]
) -> tuple[Ints, Floats, _Rows]:
    groups: dict[tuple[int, int], list[int]] = {}
    entities = iter(sections.get("Entities", ["0 0 0 0"]))
    for dimension, count in enumerate(next(entities).split()):
        for _, line in zip(range(int(count)), entities, strict=False):
            words = line.split()
            first = 4 if dimension == 0 else 7  # behind the number and the box
            groups[dimension, int(words[0])] = [int(word) for word in words[first + 1 : first + 1 + int(words[first])]]
    numbers: list[Ints] = []
    points: list[Floats] = []
    for (dimension, _, parametric, _), lines in _blocks("Nodes", sections["Nodes"], 2):
        half = len(lines) // 2
        numbers.append(_table(lines[:half], np.int64, 1, "the number of a node")[:, 0])
        width = 3 + (dimension if parametric else 0)
        points.append(_table(lines[half:], np.float64, width, "the place of a node")[:, :3])
    rows: _Rows = []
    for (dimension, entity, kind, count), lines in _blocks("Elements", sections["Elements"], 1):
        name = _kind(kinds, kind)
        table = _table(lines, np.int64, 1 + sizes[name], f"a {name}")
        if import_module("meshio._mesh").topological_dimension[name] != dimension:
            raise DeckError(f"{name} cells of an entity of dimension {dimension}")
        if groups and (dimension, entity) not in groups:
            raise DeckError(f"elements of an entity {entity} of dimension {dimension} that $Entities does not list")
        rows.append((name, table[:, 1:], dict.fromkeys(groups.get((dimension, entity), ()), np.arange(count))))
    return numbers_of(numbers, "nodes"), np.concatenate([np.zeros((0, 3)), *points]), rows


def _blocks(name: str, lines: Sequence[str], lines_each: int) -> list[tuple[tuple[int, int, int, int], Sequence[str]]]:
    """The blocks of a section of format 4.1: the four numbers above each, and its lines."""
    n_blocks, total = map(int, lines[0].split()[:2])
    blocks: list[tuple[tuple[int, int, int, int], Sequence[str]]] = []
    at = 1
    while at < len(lines):
        first, second, third, count = map(int, lines[at].split())
        if count < 0:
            raise DeckError(f"{count} entries of ${name}")
        blocks.append(((first, second, third, count), lines[at + 1 : at + 1 + lines_each * count]))
        at += 1 + lines_each * count
    if at != len(lines) or len(blocks) != n_blocks or sum(head[3] for head, _ in blocks) != total:
        raise DeckError(f"other numbers of lines in ${name} than it states")
    return blocks


def _kind(kinds: Mapping[int, str], number: int) -> str:
    if number not in kinds:
        raise DeckError(f"elements of type {number}")
    return kinds[number]
