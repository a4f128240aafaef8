"""The mesh of a body from its section: a file read, a surface or solid filled, or the neck built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import NeckShape, neck_mesh
from softcal.geometry.read import read_mesh
from softcal.project.files import InputFiles
from softcal.project.mesh_schema import TO_FILL, MeshFile, MeshNeck
from softcal.project.robot_schema import BodySection

LENGTHS = (
    "n_bells",
    "bottom_link_height",
    "link_pitch",
    "dome_height",
    "waist_diameter",
    "collar_diameter",
    "collar_height",
    "clamp_depth",
)


def mesh_maker(files: InputFiles) -> Callable[[str, BodySection], TetMesh]:
    """A function that makes the mesh [m] of a body by its name and section."""

    def make(name: str, body: BodySection) -> TetMesh:
        copy = files.copies.get(stored_name(name))
        if copy is not None:
            return read_mesh(files.folder / copy, unit="m")
        if isinstance(body.mesh, MeshNeck):
            return _neck(body.mesh)
        return _from_file(body.mesh, files)

    return make


def is_generated(body: BodySection) -> bool:
    """Whether Gmsh makes the mesh, so that a run must keep the mesh itself."""
    return isinstance(body.mesh, MeshNeck) or body.mesh.file.lower().endswith(TO_FILL)


def stored_name(body: str) -> str:
    """The name under which a run keeps a generated mesh."""
    return f"mesh of {body}"


def neck_shape(section: MeshNeck) -> NeckShape:
    """The neck with the lengths given, the others as published and scaled to the outer diameter."""
    given = {key: getattr(section, key) for key in LENGTHS if getattr(section, key) is not None}
    return replace(NeckShape.of_diameter(section.outer_diameter), **given)


def _neck(section: MeshNeck) -> TetMesh:
    return neck_mesh(
        neck_shape(section),
        size=section.size,
        count=section.tets,
        order=section.order,
        waist_refinement=section.waist_refinement,
        sectors=section.sectors,
    )


def _from_file(section: MeshFile, files: InputFiles) -> TetMesh:
    path = files.find(section.file, "mesh file")
    unit = section.unit or "mm"
    if path.suffix.lower() in TO_FILL:
        return mesh_file(path, size=section.size, count=section.tets, order=section.order or 1, unit=unit)
    return read_mesh(path, unit=unit)
