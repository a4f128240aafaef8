"""The mesh of a Gmsh file (.msh 2 and 4.1, as text), with all groups of all elements.

meshio's own reader stops at the stated number of elements, takes the last of two nodes of a number, the end of a row
that is too long, and node 0 for the last one, leaves out groups of a surface in several, and reads no elements in none.
"""

from __future__ import annotations

import shlex
import warnings
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.deck import DeckError, numbers_of, places_of

_TEXT = {b"2": "2", b"2.0": "2", b"2.1": "2", b"2.2": "2", b"4.1": "4.1"}  # version -> how it is read


def is_msh_text(path: Path) -> bool:
    """Whether a file of Gmsh is read here; other versions, and binary files, are left to meshio."""
    with path.open("rb") as file:
        words = file.read(100).split()
    return words[:1] == [b"$MeshFormat"] and len(words) > 2 and words[1] in _TEXT and words[2] == b"0"


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
    sections = _sections(path.read_text(encoding="utf-8"))
    if "PartitionedEntities" in sections:
        raise DeckError("partitions, which are not followed: save the mesh without them")
    for name in {"Nodes", "Elements"} - sections.keys():
        raise DeckError(f"no ${name}")
    names: dict[tuple[int, int], str] = {}
    for line in _counted("PhysicalNames", sections.get("PhysicalNames", ["0"])):
        dimension, tag, name = shlex.split(line)
        names[int(dimension), int(tag)] = name
    read = _read_2 if _TEXT[sections["MeshFormat"][0].split()[0].encode()] == "2" else _read_4
    numbers, points, rows = read(sections, common._gmsh_to_meshio_type, meshio._common.num_nodes_per_cell)  # noqa: SLF001
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


def _sections(text: str) -> dict[str, list[str]]:
    """Section -> its lines that are not blank."""
    sections: dict[str, list[str]] = {}
    name = ""
    for line in text.splitlines():
        if name and line.strip() == f"$End{name}":
            name = ""
        elif name:
            if line.strip():
                sections[name].append(line)
        elif line.startswith("$"):
            name = line[1:].strip()
            if name in sections and name in ("Nodes", "Elements", "Entities", "PhysicalNames"):
                raise DeckError(f"two sections ${name}")
            sections[name] = []
    if name:
        raise DeckError(f"${name} without an end")
    return sections


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
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring("\n".join(lines), dtype=kind, sep=" ").reshape(-1, width)
        except DeprecationWarning as error:
            raise ValueError(what) from error


def _read_2(
    sections: Mapping[str, list[str]], kinds: Mapping[int, str], sizes: Mapping[str, int]
) -> tuple[Ints, Floats, _Rows]:
    nodes = _table(_counted("Nodes", sections["Nodes"]), np.float64, 4, "a node")
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
    return numbers_of([nodes[:, 0].astype(np.int64)], "nodes"), nodes[:, 1:], rows


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
