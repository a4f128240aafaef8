"""Schema of `rods` in a project file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import BeforeValidator, Field

from softcal.declare import Reading, require_one
from softcal.errors import Fault, InputError
from softcal.geometry.placement import Placement
from softcal.geometry.rod_shapes import Helix, Polyline, RodShape, Straight
from softcal.limits import LIMITS
from softcal.project.section import Section
from softcal.quantities import (
    QUANTITIES,
    Area,
    Density,
    Modulus,
    PoissonsRatio,
    PositiveRatio,
    SecondMoment,
    Size,
)
from softcal.twin.robot import Rod


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

    def _check(self) -> None:
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
            raise InputError(
                Fault(
                    "the section is not of one kind",
                    got=", ".join(sorted(given)) or "nothing",
                    allowed="diameter (and inner_diameter), width and height, or area, I1, I2 and J",
                )
            )


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


class RodSection(Section):
    """A slender elastic part: its shape, section, material, and supports."""

    straight: Straight | None = None
    helix: Helix | None = None
    polyline: Polyline | None = None
    elements: Annotated[int, LIMITS["elements of a rod"]] | None = None
    section: BarSection
    youngs_modulus: Modulus
    poissons_ratio: PoissonsRatio
    density: Density = Rod.density
    clamped: Mapping[str, Stations] = Field(default_factory=dict)
    fixed: Stations = Field(default_factory=list)
    placement: Placement | None = None

    def _check(self) -> None:
        shapes = ("straight", "helix", "polyline")
        require_one(self, shapes, "a rod has one shape", nothing="none", allowed="straight, helix or polyline")

    @property
    def shape(self) -> tuple[str, RodShape]:
        """The key and the shape that is given."""
        shapes = (("straight", self.straight), ("helix", self.helix), ("polyline", self.polyline))
        return next((key, shape) for key, shape in shapes if shape is not None)
