"""The mesh of a body from its section: a file read, a surface or solid filled, or a primitive built."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Literal

from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitives import Filled, Primitive
from softcal.geometry.read import read_mesh
from softcal.limits import LIMITS
from softcal.project.files import InputFiles, sha256
from softcal.project.mesh_schema import TO_FILL, MeshFile
from softcal.project.robot_schema import BodySection

_KEPT = 8  # meshes of a process


def mesh_maker(files: InputFiles) -> Callable[[str, BodySection], TetMesh]:
    """A function that makes the mesh [m] of a body by its name and section."""

    def make(name: str, body: BodySection) -> TetMesh:
        copy = files.mesh(name)
        if copy is not None:
            return read_mesh(files.folder / copy, unit="m")
        section = body.mesh
        if not isinstance(section, MeshFile):
            return _built(section)
        path, unit = files.find(section.file, "mesh file", LIMITS["bytes of a mesh file"]), section.unit or "mm"
        if path.suffix.lower() not in TO_FILL:
            return read_mesh(path, unit=unit)
        return _filled(path, sha256(path), unit, section.size, section.tets, section.order or 1, section.edges_around)

    return make


@lru_cache(maxsize=_KEPT)
def _built(shape: Primitive) -> TetMesh:
    """A primitive's mesh, built once in a process: the projects of many specimens share it."""
    return shape.mesh()


@lru_cache(maxsize=_KEPT)
def _filled(
    path: Path,
    digest: str,
    unit: str,
    size: float | None,
    tets: int | None,
    order: Literal[1, 2],
    edges_around: int | None,
) -> TetMesh:
    """As `_built`, for the mesh of a surface or solid; `digest` of the file makes a changed file a new one."""
    return mesh_file(path, size=size, tets=tets, order=order, unit=unit, edges_around=edges_around)


def is_generated(body: BodySection) -> bool:
    """True if Gmsh makes the mesh, so that a run must keep the mesh itself."""
    if isinstance(body.mesh, MeshFile):
        return body.mesh.file.lower().endswith(TO_FILL)
    return isinstance(body.mesh, Filled)
