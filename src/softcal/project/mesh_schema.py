"""Schema of `mesh` and `regions` of a body in a project file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Tag, model_validator

from softcal.geometry.disc import DiscShape
from softcal.geometry.neck import NeckShape
from softcal.geometry.regions import Box, Cylinder, Named, Plane, Region, Sphere
from softcal.limits import LIMITS
from softcal.project.rod_schema import require_climb
from softcal.project.section import Section, fault_error, require_one
from softcal.quantities import Angle, Clearance, Refinement, Size, Turns

TO_FILL = (".stl", ".step", ".stp")
CARRIES_UNIT = (".step", ".stp")
ONE_TARGET = "one of size, the length of an edge, and tets, their number"


class MeshFile(Section):
    """A file of tetrahedra, or a surface or solid (.stl, .step) to fill with them by Gmsh."""

    file: str
    unit: str | None = None
    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] | None = None
    edges_around: Annotated[int, LIMITS["edges around a bore"]] | None = None

    @model_validator(mode="after")
    def _complete(self) -> MeshFile:
        kind = PurePath(self.file).suffix.lower()
        if self.unit is None and kind not in CARRIES_UNIT:
            raise fault_error(
                "the unit of the mesh is missing", got="no key 'unit'", allowed="unit: mm, or m, cm, inch"
            )
        if kind in TO_FILL:
            _require_target(self, f"a {kind} file is filled with tets to a target")
        extra = [key for key in ("size", "tets", "order", "edges_around") if getattr(self, key) is not None]
        if kind not in TO_FILL and extra:
            raise fault_error(
                f"a {kind or 'mesh'} file is used as it is",
                got=" and ".join(extra),
                allowed="file and unit, or an .stl or .step",
            )
        return self


class MeshNeck(Section):
    """The soft neck, made by Gmsh from its lengths; omitted ones are as published, scaled to the outer diameter."""

    primitive: Literal["neck"]
    outer_diameter: Size = NeckShape.outer_diameter
    n_bells: Annotated[int, LIMITS["bells"]] | None = None
    bottom_link_height: Size | None = None
    link_pitch: Size | None = None
    dome_height: Size | None = None
    waist_diameter: Size | None = None
    collar_diameter: Size | None = None
    collar_height: Size | None = None
    clamp_depth: Size | None = None
    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] = 2
    waist_refinement: Refinement = 1.0
    sectors: Annotated[int, LIMITS["sectors"]] | None = None

    @model_validator(mode="after")
    def _one_target(self) -> MeshNeck:
        _require_target(self, "the mesh needs a target")
        return self


class MeshRod(Section):
    """A straight round rod from the body's origin along its z."""

    primitive: Literal["rod"]
    length: Size
    diameter: Size
    layers: Annotated[int, LIMITS["layers of elements"]] | None = None
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    order: Literal[1, 2] = 2


class MeshSpring(Section):
    """The wire of a helical spring about the body's z; its ends are as they are cut."""

    primitive: Literal["spring"]
    wire_diameter: Size
    coil_diameter: Size
    turns: Turns
    pitch: Size | None = None
    height: Size | None = None
    left_handed: bool = False
    layers_per_turn: Annotated[int, LIMITS["elements in a turn"]] | None = None
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    order: Literal[1, 2] = 2

    @model_validator(mode="after")
    def _one_climb(self) -> MeshSpring:
        require_climb(self, "it is not said how far the spring climbs")
        return self


class DiscHolesSection(Section):
    """The guide holes of a disc, evenly spaced on a circle of `radius`; angles count about +z from +x."""

    count: Annotated[int, LIMITS["holes on a ring"]]
    diameter: Size
    radius: Size
    first_angle: Angle = DiscShape.first_angle


class MeshDisc(Section):
    """A disc with holes from the body's origin upwards, made by Gmsh."""

    primitive: Literal["disc"]
    diameter: Size
    thickness: Size
    centre_hole: Clearance = DiscShape.centre_hole
    holes: DiscHolesSection | None = None
    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] = 2

    @model_validator(mode="after")
    def _one_target(self) -> MeshDisc:
        _require_target(self, "the mesh needs a target")
        return self


def _require_target(section: Section, what: str) -> None:
    require_one(section, ("size", "tets"), what, nothing="neither size nor tets", allowed=ONE_TARGET)


PRIMITIVES: Mapping[str, type[Section]] = {"neck": MeshNeck, "rod": MeshRod, "spring": MeshSpring, "disc": MeshDisc}
FROM_FILE = "file"


def _known_primitive(data: Any) -> Any:
    name: object = data.get("primitive", "neck") if isinstance(data, dict) else "neck"
    if not isinstance(name, str) or name not in PRIMITIVES:
        raise fault_error("there is no such primitive", got=repr(name)[:60], allowed=", ".join(PRIMITIVES))
    return data


def _mesh_kind(data: Any) -> str:
    if isinstance(data, dict):
        return str(data.get("primitive", FROM_FILE))
    return next((name for name, kind in PRIMITIVES.items() if isinstance(data, kind)), FROM_FILE)


Mesh = Annotated[
    Annotated[MeshFile, Tag(FROM_FILE)]
    | Annotated[MeshNeck, Tag("neck")]
    | Annotated[MeshRod, Tag("rod")]
    | Annotated[MeshSpring, Tag("spring")]
    | Annotated[MeshDisc, Tag("disc")],
    Discriminator(_mesh_kind),
    BeforeValidator(_known_primitive),
]


class RegionSection(Section):
    """A part of a mesh: by a group of its file, or by a shape."""

    group: str | None = None
    plane: Plane | None = None
    box: Box | None = None
    cylinder: Cylinder | None = None
    sphere: Sphere | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> RegionSection:
        kinds = sorted(self.model_fields_set)
        if len(kinds) != 1:
            raise fault_error(
                "a region is one shape or one group",
                got=", ".join(kinds) or "nothing",
                allowed="one of group, plane, box, cylinder, sphere",
            )
        return self

    @property
    def region(self) -> Region:
        """The one of them that is given."""
        return self.plane or self.box or self.cylinder or self.sphere or Named(self.group or "")
