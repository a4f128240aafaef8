"""Writing mesh files: .msh (Gmsh 2.2, which most tools read) and .vtu, with their sets."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from softcal.checks import Ints
from softcal.errors import Fault, MeshError, StorageError
from softcal.geometry.mesh import TetMesh

SUFFIXES = (".msh", ".vtu")


def write_mesh(mesh: TetMesh, path: str | Path) -> Path:
    """Write a mesh [m] in a form that `read_mesh` reads with its sets; returns the path.

    In a .msh file the sets are physical groups, in a .vtu file arrays of 0 and 1. A node set with the name of a face
    set must contain exactly its nodes, since one group represents both.

    Raises
    ------
    MeshError
        If the suffix is unknown, or the format cannot represent the sets.
    StorageError
        Where the file cannot be written.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise MeshError(
            Fault("a mesh cannot be written like this", where=str(path), got=f"'{suffix}'", allowed=", ".join(SUFFIXES))
        )
    if suffix == ".msh":
        raw = _to_msh(mesh, path)
    else:
        cells: list[tuple[str, Ints]] = [(mesh.cell.meshio, mesh.tets)]
        point_data = {f"node set {name}": _flags(mesh.n_points, nodes) for name, nodes in mesh.node_sets.items()}
        cell_data = {f"element set {name}": [_flags(mesh.n_tets, own)] for name, own in mesh.element_sets.items()}
        for name, faces in mesh.face_sets.items():
            for flags in cell_data.values():
                flags.append(np.zeros(len(faces), dtype=np.int8))
            before = [np.zeros(len(nodes), dtype=np.int8) for _, nodes in cells]
            cell_data[f"face set {name}"] = [*before, np.ones(len(faces), dtype=np.int8)]
            cells.append((mesh.cell.meshio_face, faces))
        meshio: Any = import_module("meshio")
        raw = meshio.Mesh(mesh.points, cells, point_data=point_data, cell_data=cell_data)
    unfinished = path.with_name(f".{path.stem}.unfinished{suffix}")
    try:
        if suffix == ".msh":
            raw.write(unfinished, file_format="gmsh22", binary=False)
        else:
            raw.write(unfinished, file_format="vtu")
        unfinished.replace(path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        raise StorageError(
            Fault("the mesh cannot be written", where=str(path), got=error.strerror or str(error))
        ) from error
    return path


def _to_msh(mesh: TetMesh, path: Path) -> Any:
    meshio: Any = import_module("meshio")
    cells: list[tuple[str, Ints]] = []
    tags: list[Ints] = []
    names: dict[str, Any] = {}

    def add(kind: str, nodes: Ints, numbers: Ints) -> None:
        cells.append((kind, nodes))
        tags.append(numbers)

    def number_of(name: str, dimension: int) -> int:
        if name in names:
            raise _clash(path, name)
        names[name] = np.array([len(names) + 1, dimension])
        return len(names)

    for name, faces in mesh.face_sets.items():
        add(mesh.cell.meshio_face, faces, np.full(len(faces), number_of(name, 2)))
    for name, nodes in mesh.node_sets.items():
        if name in mesh.face_sets:
            if not np.array_equal(np.unique(nodes), np.unique(mesh.face_sets[name])):
                raise _clash(path, name)
            continue
        add("vertex", nodes[:, None], np.full(len(nodes), number_of(name, 0)))
    number = np.zeros(mesh.n_tets, dtype=np.int64)
    for name, elements in mesh.element_sets.items():
        if number[elements].any():
            raise MeshError(
                Fault(
                    "a .msh file cannot hold element sets that overlap",
                    where=str(path),
                    got=f"'{name}'",
                    attempt=".vtu",
                )
            )
        number[elements] = number_of(name, 3)
    add(mesh.cell.meshio, mesh.tets, number)
    data = {"gmsh:physical": tags, "gmsh:geometrical": [np.ones_like(numbers) for numbers in tags]}
    return meshio.Mesh(mesh.points, cells, cell_data=data, field_data=names)


def _flags(n: int, chosen: Ints) -> np.ndarray[Any, np.dtype[np.int8]]:
    flags = np.zeros(n, dtype=np.int8)
    flags[chosen] = 1
    return flags


def _clash(path: Path, name: str) -> MeshError:
    return MeshError(
        Fault("two groups of a .msh file cannot share a name", where=str(path), got=f"'{name}'", attempt=".vtu")
    )
