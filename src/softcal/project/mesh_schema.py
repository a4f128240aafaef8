"""Schema of `mesh` and `regions` of a body in a project file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import TypeAdapter

from softcal.declare import Reading, shown
from softcal.errors import Fault, InputError, unknown
from softcal.geometry.bellows import Bellows
from softcal.geometry.disc import SolidDisc
from softcal.geometry.generate import require_target
from softcal.geometry.neck import Neck
from softcal.geometry.primitives import Filled, Primitive
from softcal.geometry.regions import Box, Cavity, Cylinder, Named, Plane, Region, Sphere
from softcal.geometry.shape import DrawnShape
from softcal.geometry.wire import SolidRod, SolidSpring
from softcal.limits import LIMITS
from softcal.project.section import Section
from softcal.quantities import Size

TO_FILL = (".stl", ".step", ".stp")
CARRIES_UNIT = (".step", ".stp")


class MeshFile(Section):
    """A file of tetrahedra, or a surface or solid (.stl, .step) to fill with them by Gmsh."""

    file: str
    unit: str | None = None
    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] | None = None
    edges_around: Annotated[int, LIMITS["edges around a bore"]] | None = None

    def _check(self) -> None:
        kind = PurePath(self.file).suffix.lower()
        if self.unit is None and kind not in CARRIES_UNIT:
            raise InputError(
                Fault("the unit of the mesh is missing", got="no key 'unit'", allowed="unit: mm, or m, cm, inch")
            )
        if kind in TO_FILL:
            require_target(self.size, self.tets)
        extra = [key for key in ("size", "tets", "order", "edges_around") if getattr(self, key) is not None]
        if kind not in TO_FILL and extra:
            raise InputError(
                Fault(
                    f"a {kind or 'mesh'} file is used as it is",
                    got=" and ".join(extra),
                    allowed="file and unit, or an .stl or .step",
                )
            )


PRIMITIVES: Mapping[str, type[Primitive]] = {
    "neck": Neck,
    "rod": SolidRod,
    "spring": SolidSpring,
    "disc": SolidDisc,
    "bellows": Bellows,
}
KEY = "primitive"
DRAWN = "drawn"


def _read(value: Any) -> MeshFile | Primitive:
    if not isinstance(value, dict) or KEY not in value:
        return MeshFile.model_validate(value)
    found = _primitive(value)
    if isinstance(found, Filled):
        require_target(found.size, found.tets)
    return found


def _read_shape(value: Any) -> DrawnShape | Primitive:
    if value == DRAWN:
        return DrawnShape()
    found = _primitive(value) if isinstance(value, dict) and KEY in value else None
    if found is None or not found.lengths:
        with_lengths = ", ".join(name for name, one in PRIMITIVES.items() if one.lengths)
        raise InputError(
            Fault(
                "there is no such shape" if found is None else "no length of this primitive can be a parameter",
                got=shown(value),
                allowed=f"'{DRAWN}', or a primitive with the lengths of the mesh: {with_lengths}",
            )
        )
    return found


def _primitive(value: dict[str, Any]) -> Primitive:
    name = value[KEY]
    if not isinstance(name, str) or name not in PRIMITIVES:
        raise InputError(unknown("there is no such primitive", "", str(name), PRIMITIVES, got=shown(name)))
    return TypeAdapter(PRIMITIVES[name]).validate_python({key: given for key, given in value.items() if key != KEY})


# `file: PATH`, or `primitive: NAME` and the measures of its class.
Mesh = Annotated[MeshFile | Primitive, Reading(_read, "instead")]
# `drawn`, or `primitive: NAME` and the measures of its class, which need no target of a mesh.
MeshShape = Annotated[DrawnShape | Primitive, Reading(_read_shape, "instead")]


class RegionSection(Section):
    """A part of a mesh: by a group of its file, or by a shape."""

    group: str | None = None
    plane: Plane | None = None
    box: Box | None = None
    cylinder: Cylinder | None = None
    sphere: Sphere | None = None
    cavity: Cavity | None = None

    def _check(self) -> None:
        kinds = sorted(self.model_fields_set)
        if len(kinds) != 1:
            raise InputError(
                Fault(
                    "a region is one shape or one group",
                    got=", ".join(kinds) or "nothing",
                    allowed="one of group, plane, box, cylinder, sphere, cavity",
                )
            )

    @property
    def region(self) -> Region:
        """The region: the one key that is present."""
        return self.plane or self.box or self.cylinder or self.sphere or self.cavity or Named(self.group or "")
