"""Schema of `rods` in a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag

from softcal.declare import Reading, require_one
from softcal.errors import Fault, InputError, nearest
from softcal.geometry.placement import Placement
from softcal.geometry.rod_shapes import Helix, Polyline, RodShape, Straight
from softcal.geometry.section import CrossSection, GivenSection, RectangularBar, RoundBar
from softcal.limits import LIMITS
from softcal.materials.elastic_constants import LINEAR_ELASTIC
from softcal.materials.histories import history_constants
from softcal.materials.parameter import Parameter
from softcal.project.constants import ConstantsSection, SmallStrainSection
from softcal.project.section import Section
from softcal.quantities import QUANTITIES, Density
from softcal.twin.robot import Rod

BARS: Mapping[str, type[CrossSection]] = {cls.__name__: cls for cls in (RoundBar, RectangularBar, GivenSection)}


def _kinds(data: Any) -> list[str]:
    """Kinds of section with at least one of the mapping's keys."""
    return [name for name, cls in BARS.items() if data.keys() & cls.__annotations__.keys()]


def _of_one_kind(data: Any) -> Any:
    if isinstance(data, dict) and len(_kinds(data)) != 1:
        got = ", ".join(sorted(map(str, data))) or "nothing"
        allowed = "diameter (and inner_diameter), width and height, or area, I1, I2 and J"
        meant = nearest(got, [key for cls in BARS.values() for key in cls.__annotations__])
        raise InputError(Fault("the section is not of one kind", "", got, allowed, meant))
    return data


Bar = Annotated[
    Annotated[RoundBar, Tag("RoundBar")]
    | Annotated[RectangularBar, Tag("RectangularBar")]
    | Annotated[GivenSection, Tag("GivenSection")],
    Discriminator(lambda data: _kinds(data)[0] if isinstance(data, dict) else "RoundBar"),
    Reading(_of_one_kind),
]


def _station(value: object) -> float | str:
    if value in ("start", "end"):
        return str(value)
    length = QUANTITIES["length"].read(value)
    if length < 0.0:
        raise InputError(Fault("the station is not on the rod", got=str(value), allowed="start, end, or an arc length"))
    return length


# A place on a rod: "start", "end", or an arc length from its start [m].
Station = Annotated[float | str, Reading(_station, "instead")]
Stations = Annotated[list[Station], BeforeValidator(lambda value: value if isinstance(value, list) else [value])]


class SectionAtStation(Section):
    """The cross-section at a station of a rod whose section varies."""

    at: Station
    section: Bar


class RodMaterialSection(ConstantsSection):
    """The material of a rod between two stations; what is omitted is the rod's."""

    between: Annotated[list[Station], Field(min_length=2, max_length=2)]
    density: Density | None = None

    @classmethod
    def _of_law(cls, given: Mapping[str, Any]) -> Mapping[str, Parameter]:
        return {**{one.name: one for one in LINEAR_ELASTIC}, **history_constants()}


class RodSection(SmallStrainSection):
    """A slender elastic part: its shape, section (one all along, or several at stations), materials, and supports."""

    straight: Straight | None = None
    helix: Helix | None = None
    polyline: Polyline | None = None
    elements: Annotated[int, LIMITS["elements of a rod"]] | None = None
    section: Bar | None = None
    sections: Annotated[list[SectionAtStation], LIMITS["points of a line"].entries] | None = None
    density: Density = Rod.density
    materials: Mapping[str, RodMaterialSection] = Field(default_factory=dict)
    clamped: Mapping[str, Stations] = Field(default_factory=dict)
    fixed: Stations = Field(default_factory=list)
    placement: Placement | None = None

    def _check(self) -> None:
        super()._check()
        shapes = ("straight", "helix", "polyline")
        require_one(self, shapes, "a rod has one shape", nothing="none", allowed="straight, helix or polyline")
        allowed = "section (the same all along), or sections at stations"
        require_one(self, ("section", "sections"), "a rod has one kind of section", nothing="none", allowed=allowed)

    @property
    def shape(self) -> tuple[str, RodShape]:
        """Key and shape of the rod."""
        shapes = (("straight", self.straight), ("helix", self.helix), ("polyline", self.polyline))
        return next((key, shape) for key, shape in shapes if shape is not None)
