"""What may stand in the `robot` section of a project file. Names are not resolved and files not read here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from softcal.project.mesh_schema import Mesh, RegionSection
from softcal.project.section import (
    Acceleration,
    Density,
    ForceVector,
    Mass,
    Point,
    Positive,
    Pressure,
    Ratio,
    Section,
    Traction,
    fault_error,
)

Element = Literal["P1", "P2", "P2P1"]


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


class BodySection(Section):
    """A deformable body: its mesh, material and fixed region."""

    mesh: Mesh
    element: Element = "P2P1"
    law: str = "neo-hooke"
    youngs_modulus: Annotated[Pressure, Positive]
    poissons_ratio: Ratio
    density: Density = 0.0
    regions: Mapping[str, RegionSection] = Field(default_factory=dict)
    fixed: Annotated[list[str], BeforeValidator(_listed)] = Field(default_factory=list)

    @field_validator("poissons_ratio")
    @classmethod
    def _compressible(cls, value: float) -> float:
        return checked_poissons_ratio(value)


def checked_poissons_ratio(value: float) -> float:
    """The ratio, where it is that of a material that can be computed with."""
    if not -1.0 < value < 0.5:
        raise fault_error(
            "Poisson's ratio is out of range",
            got=f"{value:g}",
            allowed="-1 < ratio < 0.5",
            attempt="0.4999, with element P2P1" if value >= 0.5 else "",
        )
    return value


class PlateSection(Section):
    """A rigid plate tied to a region of a body."""

    body: str
    region: str
    reference: Point
    mass: Mass = 0.0
    centre_of_mass: Point | None = None


class ViaSection(Section):
    """A point that a cable runs through: on a plate or body, or fixed in space."""

    at: Point
    on: str = ""


class CableSection(Section):
    """A cable through two or more points; it is pulled at its last one unless said otherwise."""

    via: Annotated[list[ViaSection], Field(min_length=2)]
    friction_coefficient: Ratio = 0.0
    pulled_end: Literal["first", "last"] = "last"


class LoadSection(Section):
    """A dead force at a point, or a traction on a region of a body's surface."""

    on: str
    at: Point | None = None
    force: ForceVector | None = None
    region: str | None = None
    traction: Traction | None = None

    @model_validator(mode="after")
    def _point_or_surface(self) -> LoadSection:
        given = {key for key in ("at", "force", "region", "traction") if getattr(self, key) is not None}
        if given not in ({"at", "force"}, {"region", "traction"}):
            raise fault_error(
                "a load is a force at a point or a traction on a region",
                got=", ".join(sorted(given)) or "neither",
                allowed="at and force, or region and traction",
            )
        return self


class RobotSection(Section):
    """Bodies, plates, cables, loads and gravity."""

    bodies: Annotated[Mapping[str, BodySection], Field(min_length=1)]
    plates: Mapping[str, PlateSection] = Field(default_factory=dict)
    cables: Mapping[str, CableSection] = Field(default_factory=dict)
    loads: Mapping[str, LoadSection] = Field(default_factory=dict)
    gravity: tuple[Acceleration, Acceleration, Acceleration] = (0.0, 0.0, 0.0)
