"""Reading mesh files (.msh, .vtu, .inp, and .vtk by meshio), with their named groups."""

from __future__ import annotations

import contextlib
import io
import re
import threading
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from softcal.bounded_work import TimeUp, memory_limit, time_limit
from softcal.checks import Floats, Ints
from softcal.declare import checked_arguments
from softcal.errors import Fault, MeshError
from softcal.geometry.deck import DeckError, read_deck
from softcal.geometry.mesh import TetMesh
from softcal.geometry.msh import read_msh
from softcal.geometry.surface import matching_faces
from softcal.geometry.vtu import read_vtu, vtk_cells
from softcal.limits import LIMITS
from softcal.units import unit_factor

SUFFIXES = (".msh", ".vtk", ".vtu", ".inp")
# meshio's names of the supported cells, and their dimension.
DIMENSION = {
    "vertex": 0,
    "line": 1,
    "line3": 1,
    "triangle": 2,
    "triangle6": 2,
    "tetra": 3,
    "tetra4": 3,
    "tetra10": 3,
}
# Arrays of 0 and 1 that store the sets in a .vtu file, whose format has none.
NODE_SET = "node set "
CELL_SETS = {"face set ": 2, "element set ": 3}
# What meshio's readers found where they raise one of Python's own exceptions.
NO_FORMAT = "contents that do not follow the format, or end too early"
FOUND: tuple[tuple[type[BaseException], str], ...] = (
    (UnicodeDecodeError, "bytes that are no text"),
    (LookupError, "the number or name of something that the file does not have, or a line that is too short"),
    (OverflowError, "a number that is too large"),
    (ValueError, "a word in the place of a number, or another number of values than the file states"),
    (Exception, NO_FORMAT),
)
# Lines of its own that are no words: numbers, lists, code, warnings; and how the last ones begin, which name readers.
NO_WORDS = re.compile(r"[^A-Za-z]*|\[.*|.*(\w\(|[!=]=).*|Warning: .*")
SUMMARY = "Error: Couldn't read file"
# Time [s] and memory [B] to read a file, and more for each of its bytes: a mesh of a million tets takes half as much.
MOST_SECONDS, MOST_BYTES, SECONDS_EACH, BYTES_EACH = 5.0, 5e8, 1e-6, 20.0
_reading = threading.Lock()


@checked_arguments
def read_mesh(path: str | Path, *, unit: str = "m") -> TetMesh:
    """The tetrahedra of a mesh file with its named groups.

    Groups of points and lines become node sets; groups of triangles face sets (outwards) and node sets; groups of
    tets element sets. They are Gmsh's physical groups (by number if unnamed), Abaqus' NSET and ELSET, and the 0/1
    arrays that `write_mesh` stores in a .vtu file. Other faces are ignored, other solids refused.

    Parameters
    ----------
    path
        A .msh, .vtk, .vtu or .inp file with linear or quadratic tetrahedra.
    unit
        Unit of its coordinates.

    Returns
    -------
    TetMesh
        In metres.

    Raises
    ------
    MeshError
        If the file is missing, empty, of another format, damaged, or without tetrahedra.
    UnitError
        If the unit is not a length.
    """
    path = Path(path)
    factor = unit_factor(unit, "m", where=str(path))
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(
            Fault(
                "this is not a mesh file that can be read",
                where=str(path),
                got=f"'{path.suffix}'",
                allowed=", ".join(SUFFIXES),
                attempt="mesh_file for .stl and .step" if path.suffix.lower() in (".stl", ".step", ".stp") else "",
            )
        )
    if not path.is_file():
        raise MeshError(Fault("the file does not exist", where=str(path)))
    if (size := path.stat().st_size) == 0:
        raise MeshError(Fault("the file is empty", where=str(path)))
    if fault := LIMITS["bytes of a mesh file"].fault(size, str(path)):
        raise MeshError(fault)
    seconds, memory = MOST_SECONDS + SECONDS_EACH * size, MOST_BYTES + BYTES_EACH * size
    try:
        with time_limit(seconds), memory_limit(memory):
            return _read(path, factor)
    except TimeUp:
        got = f"more than {seconds:.0f} s"
    except MemoryError:
        got = f"more than {memory / 1e6:.0f} MB"
    what = "reading this takes more than a mesh in a file of this size does"
    raise MeshError(Fault(what, str(path), got, attempt="write it again, as .msh or .vtu"))


def _read(path: Path, factor: float) -> TetMesh:
    if path.suffix.lower() == ".vtk":
        content = path.read_bytes()
        stated = re.findall(rb"^(POINTS|CELLS|CELL_TYPES)[ \t]+(\d+)", content, re.MULTILINE | re.IGNORECASE)
        counts = {name.decode().upper(): int(count) for name, count in stated}
        more = b"Version 5" in content[:40]  # whose count is that of the offsets
        # meshio keeps the last of several, and as many cells as there are types.
        if len(counts) < len(stated) or counts.get("CELLS", 0) - more != counts.get("CELL_TYPES", 0):
            got = ", ".join(f"{name.decode()} {count.decode()}" for name, count in stated)
            what, allowed = (
                "the file holds several meshes, or cells without a type",
                "one section of each, of one length",
            )
            raise MeshError(Fault(what, str(path), got, allowed))
    raw = _read_raw(path)
    # Rows of other kinds, such as polyhedra, may differ in length.
    blocks = [
        (block.type, _numbers(block.data if block.type in DIMENSION else [], f"{path}, {block.type} cells"))
        for block in raw.cells
    ]
    kinds = {kind for kind, _ in blocks if DIMENSION.get(kind) == 3}
    if not kinds or sum(len(cells) for kind, cells in blocks if kind in kinds) == 0:
        raise MeshError(
            Fault("the file holds no tetrahedra", where=str(path), got=_contents(raw), allowed="tetra or tetra10")
        )
    if any(block.dim == 3 and block.type not in DIMENSION and len(block.data) for block in raw.cells):
        what, attempt = "the file holds other solid elements beside tetrahedra", "mesh all of the body with tetrahedra"
        raise MeshError(Fault(what, str(path), _contents(raw), "tetrahedra alone", attempt))
    if len({4 if kind != "tetra10" else 10 for kind in kinds}) > 1:
        raise MeshError(
            Fault(
                "the file mixes linear and quadratic tetrahedra",
                where=str(path),
                got=_contents(raw),
                allowed="tetrahedra of one order",
            )
        )
    # Tet number of each row of each block, and the tets; Gmsh writes a tet once for each of its groups.
    of_tets = [i for i, (kind, cells) in enumerate(blocks) if DIMENSION.get(kind) == 3 and len(cells)]
    stacked = np.concatenate([blocks[i][1] for i in of_tets])
    _, first, same = np.unique(np.sort(stacked, axis=1), axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    numbers = np.split(rank[same], np.cumsum([len(blocks[i][1]) for i in of_tets])[:-1])
    numbered, tets = dict(zip(of_tets, numbers, strict=True)), stacked[np.sort(first)]
    if fault := LIMITS["tets"].fault(len(tets), str(path)):
        raise MeshError(fault)
    mesh = _checked(path, factor * np.asarray(raw.points, dtype=np.float64), tets)
    node_sets: dict[str, Ints] = {name: np.unique(nodes) for name, nodes in raw.point_sets.items()}
    node_sets |= {
        key.removeprefix(NODE_SET): _flagged(flags, f"{path}, '{key}'")
        for key, flags in raw.point_data.items()
        if key.startswith(NODE_SET)
    }
    face_sets: dict[str, Ints] = {}
    element_sets: dict[str, Ints] = {}
    for name, dimension, chosen in _groups(path, raw, blocks):
        if dimension == 3:
            element_sets[name] = np.unique(np.concatenate([numbered[i][rows] for i, rows in chosen]))
            continue
        nodes = [blocks[i][1][rows] for i, rows in chosen]
        if dimension == 2:
            corners = np.concatenate([rows[:, :3] for rows in nodes])
            face_sets[name] = matching_faces(mesh, corners, where=f"{path}, group '{name}'")
            node_sets.setdefault(name, np.unique(face_sets[name]))
        else:
            node_sets[name] = np.unique(np.concatenate([rows.ravel() for rows in nodes]))
    return TetMesh(mesh.points, mesh.tets, node_sets=node_sets, face_sets=face_sets, element_sets=element_sets)


def _read_raw(path: Path) -> Any:
    meshio: Any = import_module("meshio")
    said = io.StringIO()
    try:
        # meshio prints an error and exits.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            if path.suffix.lower() == ".inp":
                return read_deck(path)
            if path.suffix.lower() == ".msh":
                return read_msh(path)
            if path.suffix.lower() == ".vtu":
                return read_vtu(path)
            reader: Any = import_module("meshio.vtk._vtk_51")
            with _reading:
                original, reader.vtk_cells_from_data = reader.vtk_cells_from_data, vtk_cells
                try:
                    return meshio.read(path)
                finally:
                    reader.vtk_cells_from_data = original
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:  # its readers raise arbitrary exceptions for a damaged file
        if isinstance(error, DeckError):
            reason = str(error)
        elif isinstance(error, OSError) and error.strerror:
            reason = error.strerror
        elif not isinstance(error, SystemExit):
            reason = next(words for kind, words in FOUND if isinstance(error, kind))
        else:  # the last line that it printed
            lines = [line.strip().rstrip(".") for line in said.getvalue().partition(SUMMARY)[0].splitlines()]
            own = [line for line in lines if line.isprintable() and not NO_WORDS.fullmatch(line)]
            reason = own[-1] if own else NO_FORMAT
        raise MeshError(
            Fault(
                "the mesh file cannot be read",
                where=str(path),
                got=reason,
                allowed=f"a valid {path.suffix.lower()} file",
                attempt="write it again with the program that made it",
            )
        ) from error


def _checked(path: Path, points: Floats, tets: Ints) -> TetMesh:
    faults: list[Fault] = []
    if points.ndim != 2 or points.shape[1] != 3:
        faults.append(Fault("the points are not in space", where=str(path), got=str(points.shape), allowed="(n, 3)"))
    elif not np.isfinite(points).all():
        bad = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        faults.append(Fault("a node has no finite coordinates", where=str(path), got=f"node {bad}: {points[bad]}"))
    outside = (tets < 0) | (tets >= len(points))
    if outside.any():
        faults.append(
            Fault(
                "a tetrahedron has a node number that the file does not have",
                where=str(path),
                got=f"node {tets[outside][0]} in tet {int(np.flatnonzero(outside.any(axis=1))[0])}",
                allowed=f"0 to {len(points) - 1}",
            )
        )
    if tets.shape[1] not in (4, 10):
        faults.append(
            Fault(
                "a tetrahedron has another number of nodes",
                str(path),
                str(tets.shape[1]),
                "4, or 10 of a quadratic one",
            )
        )
    twice = (np.diff(np.sort(tets, axis=1), axis=1) == 0).any(axis=1)
    if twice.any():
        faults.append(
            Fault(
                f"{int(twice.sum())} tetrahedra have a node twice",
                where=str(path),
                got=f"nodes {tets[twice][0].tolist()} of tet {int(np.flatnonzero(twice)[0])}",
                attempt="look at how the file lists the nodes of its cells",
            )
        )
    if faults:
        raise MeshError(faults)
    return TetMesh(points, tets)


def _groups(path: Path, raw: Any, blocks: list[tuple[str, Ints]]) -> Iterator[tuple[str, int, list[tuple[int, Ints]]]]:
    """Each group as its name, dimension and (block, rows of it)."""
    found: dict[tuple[str, int], dict[int, set[int]]] = {}

    def add(name: str, i: int, rows: Ints) -> None:
        dimension = DIMENSION.get(blocks[i][0])
        if dimension is None or len(rows) == 0:
            return
        n = len(blocks[i][1])
        if rows.min() < 0 or rows.max() >= n:
            got = f"number {rows.min() if rows.min() < 0 else rows.max()} of the {blocks[i][0]} cells"
            what = "a group names a cell that the file does not have"
            raise MeshError(Fault(what, f"{path}, group '{name}'", got, f"0 to {n - 1}"))
        found.setdefault((name, dimension), {}).setdefault(i, set()).update(rows.tolist())

    for name, by_block in raw.cell_sets.items():
        for i, rows in enumerate(by_block):
            if rows is not None:
                add(name, i, _numbers(rows, f"{path}, group '{name}'").ravel())
    for i, tags in enumerate(raw.cell_data.get("gmsh:physical", ())):  # of a .vtu that meshio has made of a .msh
        for tag in np.unique(tags[np.asarray(tags) != 0]).tolist():
            add(str(int(tag)), i, np.flatnonzero(tags == tag))
    for key, by_block in raw.cell_data.items():
        prefix = next((prefix for prefix in CELL_SETS if key.startswith(prefix)), None)
        for i, flags in enumerate(by_block if prefix else ()):
            if prefix and DIMENSION.get(blocks[i][0]) == CELL_SETS[prefix]:
                add(key.removeprefix(prefix), i, _flagged(flags, f"{path}, '{key}'"))
    for (name, dimension), chosen in found.items():
        yield name, dimension, [(i, np.array(sorted(rows), dtype=np.int64)) for i, rows in chosen.items()]


def _flagged(flags: Any, where: str) -> Ints:
    """The numbers whose flag is 1."""
    if np.ndim(flags) != 1 or not np.isin(flags, (0, 1)).all():
        got = f"numbers from {np.min(flags):g} to {np.max(flags):g} in an array {np.shape(flags)}"
        raise MeshError(Fault("this is no set", where, got, "0 or 1 for each node or cell"))
    return np.flatnonzero(flags)


def _numbers(values: Any, where: str) -> Ints:
    try:
        numbers = np.asarray(values, dtype=np.int64)
        if (numbers != np.asarray(values)).any():
            raise ValueError
        return numbers
    except (ValueError, TypeError, OverflowError) as error:
        what, allowed = "there are no numbers of nodes or cells", "whole numbers, as many in each row"
        raise MeshError(Fault(what, where, allowed=allowed)) from error


def _contents(raw: Any) -> str:
    counts: dict[str, int] = {}
    for block in raw.cells:
        counts[block.type] = counts.get(block.type, 0) + len(block.data)
    cells = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "no cells"
    return f"{len(raw.points)} points, {cells}"
