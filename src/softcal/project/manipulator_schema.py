"""Schema of `robot.manipulator` in a project file; omitted values are as in `ManipulatorShape`."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from softcal.declare import Reading
from softcal.errors import Fault, InputError
from softcal.limits import LIMITS
from softcal.mechanics.elements import DEFAULT, ElementName
from softcal.project.section import Section
from softcal.quantities import QUANTITIES, Angle, Clearance, Density, Friction, Mass, PoissonsRatio, Size, Turns
from softcal.twin.cables import Cable
from softcal.twin.manipulator import BASE, ELEMENTS_PER_TURN, ManipulatorShape
from softcal.twin.robot import Rod

# The place of each field of the shape in the section.
KEYS: Mapping[str, tuple[str, ...]] = {
    "total_length": ("total_length",),
    "n_sections": ("sections",),
    "hanging": ("hanging",),
    "base_diameter": ("base", "diameter"),
    "base_thickness": ("base", "thickness"),
    "disc_diameter": ("discs", "diameter"),
    "disc_thickness": ("discs", "thickness"),
    "hole_diameter": ("discs", "hole_diameter"),
    "coil_diameter": ("springs", "coil_diameter"),
    "wire_diameter": ("springs", "wire_diameter"),
    "turns": ("springs", "turns"),
    "left_handed": ("springs", "left_handed"),
    "spring_azimuth": ("springs", "azimuth"),
    "cable_radius": ("cables", "radius"),
    "cable_ends": ("cables", "ends"),
    "cables_per_end": ("cables", "per_end"),
    "cable_exit": ("cables", "exit"),
    "marker_radius": ("markers", "radius"),
    "marker_azimuth": ("markers", "azimuth"),
}


class BaseSection(Section):
    """The disc that does not move."""

    diameter: Size | None = None
    thickness: Size | None = None


class DiscsSection(Section):
    """The discs that move, all alike; without a mass, it is their volume times the springs' density."""

    diameter: Size | None = None
    thickness: Size | None = None
    hole_diameter: Clearance | None = None
    mass: Mass | None = None


def _moduli(value: object) -> float | dict[str, float]:
    read = QUANTITIES["modulus"].read
    if not isinstance(value, dict):
        return read(value)
    given: dict[str, object] = value
    return {name: read(entry) for name, entry in given.items()}


class SpringsSection(Section):
    """The springs, all alike except for moduli given by name; rods, or solid.

    elements_per_turn: of rods; rings, layers_per_turn, element: of solid ones.
    """

    model: Literal["rod", "solid"] = "rod"
    wire_diameter: Size | None = None
    coil_diameter: Size | None = None
    turns: Turns | None = None
    left_handed: bool | None = None
    azimuth: Angle | None = None
    elements_per_turn: Annotated[int, LIMITS["elements in a turn"]] = ELEMENTS_PER_TURN
    rings: Annotated[int, LIMITS["rings of elements"]] = 1
    layers_per_turn: Annotated[int, LIMITS["elements in a turn"]] | None = None
    element: ElementName = DEFAULT.name
    youngs_modulus: Annotated[float | dict[str, float], Reading(_moduli, "instead")]
    poissons_ratio: PoissonsRatio
    density: Density = Rod.density


def _disc_number(name: object) -> int:
    match = re.fullmatch(r"S(\d+)", str(name))
    if match is None:
        raise InputError(Fault("cables end at a disc", got=f"'{name}'", allowed="S1, S2, …"))
    return int(match[1])


def _by_disc(value: object) -> object:
    if not isinstance(value, dict) or not value:
        raise InputError(
            Fault(
                "this is of the wrong kind",
                got=repr(value),
                allowed="discs with the azimuth of their first cable: {S2: 0 deg}",
            )
        )
    given: dict[object, object] = value
    return {_disc_number(name): azimuth for name, azimuth in given.items()}


class CablesSection(Section):
    """The cables: at which discs they end, with the azimuth of the first of each end's."""

    radius: Clearance | None = None
    per_end: Annotated[int, LIMITS["cables at an end"]] | None = None
    ends: Annotated[dict[int, Angle] | None, Reading(_by_disc)] = None
    exit: Clearance | None = None
    friction_coefficient: Friction = Cable.friction_coefficient


class MarkersSection(Section):
    """Where the marker of each disc is, in its middle plane."""

    radius: Clearance | None = None
    azimuth: Angle | None = None


class ManipulatorSection(Section):
    """Discs joined by helical springs, and cables that end at some of them (paper B)."""

    total_length: Size | None = None
    sections: Annotated[int, LIMITS["sections of a manipulator"]] | None = None
    hanging: bool | None = None
    base: BaseSection = BaseSection()
    discs: DiscsSection = DiscsSection()
    springs: SpringsSection
    cables: CablesSection = CablesSection()
    markers: MarkersSection = MarkersSection()

    def shape(self) -> ManipulatorShape:
        """Its lengths and angles.

        Raises
        ------
        MeshError
            Where they do not fit together.
        """
        given = {field: self._value(path) for field, path in KEYS.items() if self._value(path) is not None}
        if self.cables.ends is not None:
            given |= {"cable_ends": tuple(self.cables.ends), "first_azimuths": tuple(self.cables.ends.values())}
        return ManipulatorShape(**given)

    def _value(self, path: tuple[str, ...]) -> Any:
        value: Any = self
        for key in path:
            value = getattr(value, key)
        return None if isinstance(value, dict) else value

    def part_names(self, kind: str) -> list[str]:
        """The names of its parts of a kind such as "plates"; none where its numbers are wrong."""
        sections = self.sections or ManipulatorShape.n_sections
        ends = self.cables.ends or dict.fromkeys(ManipulatorShape.cable_ends, 0.0)
        n_cables = len(ends) * (self.cables.per_end or ManipulatorShape.cables_per_end)
        names = {
            "plates": [BASE, *(f"S{k + 1}" for k in range(sections))],
            "bodies" if self.springs.model == "solid" else "rods": [f"spring{k + 1}" for k in range(sections)],
            "cables": [f"cable{k + 1}" for k in range(n_cables)],
            "markers": [f"marker{k + 1}" for k in range(sections)],
        }
        return names.get(kind, [])
