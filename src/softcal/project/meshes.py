"""The mesh of a body from its section: a file read, a surface or solid filled, or a primitive built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from softcal.geometry.disc import DiscShape, disc_mesh
from softcal.geometry.generate import mesh_file
from softcal.geometry.mesh import TetMesh
from softcal.geometry.neck import NeckShape, neck_mesh
from softcal.geometry.read import read_mesh
from softcal.geometry.wire import SpringShape, rod_mesh, spring_mesh
from softcal.limits import LIMITS
from softcal.project.files import InputFiles, stored_mesh
from softcal.project.mesh_schema import TO_FILL, MeshDisc, MeshFile, MeshNeck, MeshRod, MeshSpring
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
        copy = files.copies.get(stored_mesh(name))
        if copy is not None:
            return read_mesh(files.folder / copy, unit="m")
        if isinstance(body.mesh, MeshFile):
            return _from_file(body.mesh, files)
        return _primitive(body.mesh)

    return make


def is_generated(body: BodySection) -> bool:
    """Whether Gmsh makes the mesh, so that a run must keep the mesh itself."""
    if isinstance(body.mesh, MeshFile):
        return body.mesh.file.lower().endswith(TO_FILL)
    return isinstance(body.mesh, MeshNeck | MeshDisc)


def neck_shape(section: MeshNeck) -> NeckShape:
    """The neck with the lengths given, the others as published and scaled to the outer diameter."""
    given = {key: getattr(section, key) for key in LENGTHS if getattr(section, key) is not None}
    return replace(NeckShape.of_diameter(section.outer_diameter), **given)


def _primitive(section: MeshNeck | MeshRod | MeshSpring | MeshDisc) -> TetMesh:
    if isinstance(section, MeshNeck):
        return _neck(section)
    if isinstance(section, MeshDisc):
        return disc_mesh(_disc_shape(section), size=section.size, count=section.tets, order=section.order)
    if isinstance(section, MeshRod):
        return rod_mesh(
            section.length, section.diameter, layers=section.layers, rings=section.rings, order=section.order
        )
    return spring_mesh(
        _spring_shape(section), layers_per_turn=section.layers_per_turn, rings=section.rings, order=section.order
    )


def _spring_shape(section: MeshSpring) -> SpringShape:
    pitch = section.pitch if section.pitch is not None else (section.height or 0.0) / section.turns
    return SpringShape(section.wire_diameter, section.coil_diameter, section.turns, pitch, section.left_handed)


def _disc_shape(section: MeshDisc) -> DiscShape:
    plain = DiscShape(section.diameter, section.thickness, section.centre_hole)
    ring = section.holes
    if ring is None:
        return plain
    return replace(
        plain, holes=ring.count, hole_diameter=ring.diameter, hole_radius=ring.radius, first_angle=ring.first_angle
    )


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
    path = files.find(section.file, "mesh file", LIMITS["bytes of a mesh file"])
    unit = section.unit or "mm"
    if path.suffix.lower() in TO_FILL:
        return mesh_file(
            path,
            size=section.size,
            count=section.tets,
            order=section.order or 1,
            unit=unit,
            edges_around=section.edges_around,
        )
    return read_mesh(path, unit=unit)
