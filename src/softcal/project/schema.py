"""What may stand in a project file: its sections, keys and units. Names are not resolved and files not read here."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import PurePath
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    Tag,
    field_validator,
    model_validator,
)

from softcal.project.section import (
    Acceleration,
    Angle,
    Density,
    Direction,
    Duration,
    Force,
    ForceVector,
    Given,
    Length,
    Mass,
    Point,
    Pressure,
    Ratio,
    Section,
    Traction,
    above,
    fault_error,
)

SECTIONS = ("softcal", "name", "robot", "rig", "experiments", "parameters", "calibration", "print")
FORMAT = 1
TO_FILL = (".stl", ".step", ".stp")
CARRIES_UNIT = (".step", ".stp")
ONE_TARGET = "one of size, the length of an edge, and tets, their number"
ONE_CLOCK = "one clock"

Positive = AfterValidator(above(0.0))
Element = Literal["P1", "P2", "P2P1"]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


# --- robot ------------------------------------------------------------------------------------------------------


class MeshFile(Section):
    """A file of tetrahedra, or a surface or solid (.stl, .step) to fill with them by Gmsh."""

    file: str
    unit: str | None = None
    size: Annotated[Length, Positive] | None = None
    tets: Annotated[int, Positive] | None = None
    order: Literal[1, 2] | None = None

    @model_validator(mode="after")
    def _complete(self) -> MeshFile:
        kind = PurePath(self.file).suffix.lower()
        if self.unit is None and kind not in CARRIES_UNIT:
            raise fault_error(
                "the unit of the mesh is missing", got="no key 'unit'", allowed="unit: mm, or m, cm, inch"
            )
        target = [key for key in ("size", "tets") if getattr(self, key) is not None]
        if kind in TO_FILL and len(target) != 1:
            raise fault_error(f"a {kind} file is filled with tets to a target", got=_and(target), allowed=ONE_TARGET)
        extra = [key for key in ("size", "tets", "order") if getattr(self, key) is not None]
        if kind not in TO_FILL and extra:
            raise fault_error(
                f"a {kind or 'mesh'} file is used as it is",
                got=_and(extra),
                allowed="file and unit, or an .stl or .step",
            )
        return self


class MeshNeck(Section):
    """The soft neck, made by Gmsh from its lengths; what is left out is as published, scaled to the outer diameter."""

    primitive: Literal["neck"]
    outer_diameter: Annotated[Length, Positive] = 0.038
    n_bells: Annotated[int, Positive] | None = None
    bottom_link_height: Annotated[Length, Positive] | None = None
    link_pitch: Annotated[Length, Positive] | None = None
    dome_height: Annotated[Length, Positive] | None = None
    waist_diameter: Annotated[Length, Positive] | None = None
    collar_diameter: Annotated[Length, Positive] | None = None
    collar_height: Annotated[Length, Positive] | None = None
    clamp_depth: Annotated[Length, Positive] | None = None
    size: Annotated[Length, Positive] | None = None
    tets: Annotated[int, Positive] | None = None
    order: Literal[1, 2] = 2
    waist_refinement: Annotated[Ratio, Positive] = 1.0
    sectors: Annotated[int, Positive] | None = None

    @model_validator(mode="after")
    def _one_target(self) -> MeshNeck:
        target = [key for key in ("size", "tets") if getattr(self, key) is not None]
        if len(target) != 1:
            raise fault_error("the mesh needs a target", got=_and(target), allowed=ONE_TARGET)
        return self


def _and(keys: list[str]) -> str:
    return " and ".join(keys) or "neither size nor tets"


def _mesh_kind(data: Any) -> str:
    if isinstance(data, dict):
        return "primitive" if "primitive" in data else "file"
    return "primitive" if isinstance(data, MeshNeck) else "file"


Mesh = Annotated[Annotated[MeshFile, Tag("file")] | Annotated[MeshNeck, Tag("primitive")], Discriminator(_mesh_kind)]


class PlaneRegion(Section):
    """What lies on a plane, or above or below it as seen along its normal."""

    point: Point
    normal: Direction
    side: Literal["on", "above", "below"] = "on"
    tolerance: Length = 0.0


class BoxRegion(Section):
    """What lies between two corners."""

    lower: Point
    upper: Point


class CylinderRegion(Section):
    """What lies in a solid cylinder between the centres of its ends."""

    start: Point
    end: Point
    radius: Annotated[Length, Positive]


class SphereRegion(Section):
    """What lies in a ball."""

    centre: Point
    radius: Annotated[Length, Positive]


class RegionSection(Section):
    """A part of a mesh: by a group of its file, or by a shape."""

    group: str | None = None
    plane: PlaneRegion | None = None
    box: BoxRegion | None = None
    cylinder: CylinderRegion | None = None
    sphere: SphereRegion | None = None

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


# --- bench ------------------------------------------------------------------------------------------------------


class PulleysSection(Section):
    """The pulleys between the testing machine and the neck (Euler-Eytelwein)."""

    count: Annotated[int, Positive] = 2
    wrap: Angle
    friction_coefficient: Ratio = 0.0


class RigSection(Section):
    """What stands between the robot and the instruments."""

    pulleys: PulleysSection | None = None


class ColumnSection(Section):
    """Where a channel stands in a file; the unit may be left out where the file names it."""

    name: str
    unit: str | None = None
    scale: float = 1.0


class FileSection(Section):
    """One bench file."""

    path: str
    columns: Annotated[Mapping[str, ColumnSection], Field(min_length=1)]
    where: Mapping[str, Given] = Field(default_factory=dict)
    delimiter: str | None = None
    decimal: Literal[".", ","] | None = None
    header_row: int | None = None
    units_row: int | None = None
    skip_rows: int = 0
    skip_footer: int = 0
    axes: tuple[Axis, Axis, Axis] = ("x", "y", "z")
    rest_samples: int = 10


def _step(value: object) -> object:
    if not isinstance(value, (str, dict)):
        raise fault_error("this is no preparation step", got=repr(value), allowed="a name, or a name with settings")
    return value


class SynchroniseSection(Section):
    """How records of two clocks are matched: by the motion that both saw."""

    max_lag: Duration | None = None
    reference: str = "shortening"
    signal: str = "pitch"
    estimate_rate: bool = True
    min_correlation: Ratio = 0.8

    def settings(self) -> dict[str, Any]:
        """As keyword arguments of `softcal.experiments.synchronise.synchronise`."""
        return dict(self)


def _clock_kind(data: Any) -> str:
    return "one" if isinstance(data, str) else "two"


Synchronise = Annotated[
    Annotated[Literal["one clock"], Tag("one")] | Annotated[SynchroniseSection, Tag("two")],
    Discriminator(_clock_kind),
]


class ExperimentSection(Section):
    """One bench test: which cable was pulled, what was written, and what is done to it before it is compared."""

    cable: str
    plate: str | None = None
    drive: Literal["shortening", "tension"] = "shortening"
    compare: Annotated[list[Literal["tension", "shortening", "pitch", "roll"]], Field(min_length=1)] | None = None
    files: Annotated[list[FileSection], Field(min_length=1)]
    synchronise: Synchronise | None = None
    prepare: list[Annotated[str | Mapping[str, Any], PlainValidator(_step)]] = Field(default_factory=list)
    noise: Mapping[str, Given] = Field(default_factory=dict)
    slack: Length = 0.0
    tension_offset: Force = 0.0
    pitch_offset: Angle = 0.0
    roll_offset: Angle = 0.0


# --- calibration ------------------------------------------------------------------------------------------------


class PriorSection(Section):
    """What is known of a parameter beforehand, counted by the likelihood loss."""

    mean: Given
    sd: Given


class ParameterSection(Section):
    """A free parameter: its bounds, and whether every experiment has its own."""

    bounds: tuple[Given, Given]
    scale: Literal["linear", "log"] = "linear"
    per: Literal["experiment"] | None = None
    start: Given | None = None
    prior: PriorSection | None = None


class CalibrationSection(Section):
    """How the free parameters are looked for."""

    loss: Literal["papers", "likelihood"] = "papers"
    alpha: Annotated[Ratio, Positive] = 0.3
    beta: Annotated[Ratio, Positive] = 1.0
    method: Literal["least-squares", "tpe", "grid"] = "least-squares"
    trials: Annotated[int, Positive] | None = None
    starts: Annotated[int, Positive] = 3
    seed: Annotated[int, Field(ge=0)] = 1
    fit: Literal["each", "joint", "both"] = "joint"


class PrintSection(Section):
    """What is known of the print, for the plausibility band E_bulk * infill**exponent."""

    bulk_youngs_modulus: tuple[Pressure, Pressure]
    infill: Ratio
    exponent: tuple[Ratio, Ratio]
