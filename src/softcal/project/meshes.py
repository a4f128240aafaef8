"""The mesh of a body from its section: a file read, a surface or solid filled, or a primitive built."""

from __future__ import annotations

from collections.abc import Callable

from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.primitive import Filled
from softcal.geometry.read import read_mesh
from softcal.limits import LIMITS
from softcal.project.files import InputFiles, stored_mesh
from softcal.project.mesh_schema import TO_FILL, MeshFile
from softcal.project.robot_schema import BodySection


def mesh_maker(files: InputFiles) -> Callable[[str, BodySection], TetMesh]:
    """A function that makes the mesh [m] of a body by its name and section."""

    def make(name: str, body: BodySection) -> TetMesh:
        copy = files.copies.get(stored_mesh(name))
        if copy is not None:
            return read_mesh(files.folder / copy, unit="m")
        if isinstance(body.mesh, MeshFile):
            return _from_file(body.mesh, files)
        return body.mesh.mesh()

    return make


def is_generated(body: BodySection) -> bool:
    """Whether Gmsh makes the mesh, so that a run must keep the mesh itself."""
    if isinstance(body.mesh, MeshFile):
        return body.mesh.file.lower().endswith(TO_FILL)
    return isinstance(body.mesh, Filled)


def _from_file(section: MeshFile, files: InputFiles) -> TetMesh:
    path = files.find(section.file, "mesh file", LIMITS["bytes of a mesh file"])
    unit = section.unit or "mm"
    if path.suffix.lower() in TO_FILL:
        return mesh_file(
            path,
            size=section.size,
            tets=section.tets,
            order=section.order or 1,
            unit=unit,
            edges_around=section.edges_around,
        )
    return read_mesh(path, unit=unit)
