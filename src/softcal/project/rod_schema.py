"""Schema of `rods` in a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from softcal.declare import Reading
from softcal.geometry.placement import Placement
from softcal.limits import LIMITS
from softcal.project.section import Section, fault_error, require_one
from softcal.quantities import (
    QUANTITIES,
    Area,
    Density,
    Direction,
    Modulus,
    Point,
    PoissonsRatio,
    PositiveRatio,
    SecondMoment,
    Size,
    Turns,
)
from softcal.twin.robot import Rod


class StraightSection(Section):
    """A straight rod between two points."""

    start: Point
    end: Point
    first: Direction | None = None


class HelixSection(Section):
    """The wire of a helical spring; it climbs along `axis` from the level of `base`."""

    base: Point
    axis: Direction = (0.0, 0.0, 1.0)
    coil_diameter: Size
    turns: Turns
    pitch: Size | None = None
    height: Size | None = None
    towards: Direction | None = None
    left_handed: bool = False

    @model_validator(mode="after")
    def _one_climb(self) -> HelixSection:
        require_climb(self, "it is not said how far the helix climbs")
        return self


def require_climb(section: Section, what: str) -> None:
    """Check that a helix's climb is given per turn or in all."""
    require_one(section, ("pitch", "height"), what, allowed="one of pitch, per turn, and height, in all")


class PolylineSection(Section):
    """A smooth curve through points."""

    points: Annotated[list[Point], Field(min_length=2), LIMITS["points of a line"]]
    first: Direction | None = None


class BarSection(Section):
    """A rod's section: a round bar or tube, a rectangular bar, or given constants."""

    diameter: Size | None = None
    inner_diameter: Size | None = None
    width: Size | None = None
    height: Size | None = None
    area: Area | None = None
    I1: SecondMoment | None = None
    I2: SecondMoment | None = None
    J: SecondMoment | None = None
    shear_coefficients: tuple[PositiveRatio, PositiveRatio] | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> BarSection:
        given = {key for key in type(self).model_fields if getattr(self, key) is not None}
        constants = {"area", "I1", "I2", "J"}
        kinds = (
            {"diameter"},
            {"diameter", "inner_diameter"},
            {"width", "height"},
            constants,
            constants | {"shear_coefficients"},
        )
        if given not in kinds:
            raise fault_error(
                "the section is not of one kind",
                got=", ".join(sorted(given)) or "nothing",
                allowed="diameter (and inner_diameter), width and height, or area, I1, I2 and J",
            )
        return self


def _station(value: object) -> float | str:
    if value in ("start", "end"):
        return str(value)
    length = QUANTITIES["length"].read(value)
    if length < 0.0:
        raise fault_error("the station lies off the rod", got=str(value), allowed="start, end, or an arc length")
    return length


# A place on a rod: "start", "end", or an arc length from its start [m].
Station = Annotated[float | str, Reading(_station, "instead")]
Stations = Annotated[list[Station], BeforeValidator(lambda value: value if isinstance(value, list) else [value])]


class RodSection(Section):
    """A slender elastic part: its shape, section, material, and supports."""

    straight: StraightSection | None = None
    helix: HelixSection | None = None
    polyline: PolylineSection | None = None
    elements: Annotated[int, LIMITS["elements of a rod"]] | None = None
    section: BarSection
    youngs_modulus: Modulus
    poissons_ratio: PoissonsRatio
    density: Density = Rod.density
    clamped: Mapping[str, Stations] = Field(default_factory=dict)
    fixed: Stations = Field(default_factory=list)
    placement: Placement | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> RodSection:
        shapes = ("straight", "helix", "polyline")
        require_one(self, shapes, "a rod has one shape", nothing="none", allowed="straight, helix or polyline")
        return self
