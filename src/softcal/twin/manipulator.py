"""The continuum manipulator of paper B: discs joined by helical springs, bent by cables that end at some of them.

The base's mounting face is the origin; the discs follow along z, downwards where the manipulator hangs. Azimuths count
about +z from +x. Parts: base, S1, S2, …; spring1, …; cable1, …, numbered end by end; marker1, … on the discs. Every
disc has a guide hole for every cable, h1, h2, …, in its middle plane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np

from softcal.checks import Floats
from softcal.declare import ByShape, Declared, Reading, checked_arguments
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.geometry.coil import Coil
from softcal.geometry.rod_shapes import ELEMENTS_PER_TURN
from softcal.geometry.section import RoundBar
from softcal.geometry.wire import SolidSpring
from softcal.limits import LIMITS
from softcal.mechanics.elements import DEFAULT, ElementName
from softcal.quantities import Angle, Clearance, Density, Friction, Mass, Modulus, PoissonsRatio, Size, Turns
from softcal.twin.cables import CableLine
from softcal.twin.robot import Cable, Disc, Marker, Plate, Robot, Rod, ViaPoint
from softcal.twin.solid_rods import with_solid_rods

BASE = "base"


@dataclass(frozen=True)
class BaseDisc(Declared):
    """The disc that does not move.

    Attributes
    ----------
    diameter, thickness : [m]
    """

    diameter: Size = 0.080
    thickness: Size = 0.010


@dataclass(frozen=True)
class Discs(Declared):
    """The discs that move, all alike.

    Attributes
    ----------
    diameter, thickness, hole_diameter : The last one is that of the guide holes [m]
    mass : Mass of each [kg]; None: its volume times the springs' density
    """

    diameter: Size = 0.060
    thickness: Size = 0.008
    hole_diameter: Clearance = 0.003
    mass: Mass | None = None


MESHED_BY = {"rod": ("elements_per_turn",), "solid": ("rings", "layers_per_turn", "element")}
"""Which settings of springs determine their elements, by their model."""


@displayed
@dataclass(frozen=True, kw_only=True)
class Springs(Declared):
    """The springs of a manipulator, all alike except for moduli given by name.

    Attributes
    ----------
    youngs_modulus : Young's modulus of the wire [Pa], or that of each spring by its name
    poissons_ratio, density : [-], [kg/m^3]
    wire_diameter, coil_diameter : The latter from wire centre to wire centre [m]
    turns, left_handed : Number of turns [-], and sense
    azimuth : Azimuth of the wire's start, about +z from +x [rad]
    model : Rods or solid bodies; the latter are 40 to 70 times slower
    elements_per_turn : Elements per turn of rods; None: 12
    rings, layers_per_turn, element : Of solid springs, as of a `SolidSpring` and a `Body`; None: their defaults
    """

    youngs_modulus: Annotated[Modulus | Mapping[str, Modulus], ByShape()]
    poissons_ratio: PoissonsRatio
    density: Density = Rod.density
    wire_diameter: Size = 0.009
    coil_diameter: Size = 0.030
    turns: Turns = 3.0
    left_handed: bool = False
    azimuth: Angle = 0.0
    model: Literal["rod", "solid"] = "rod"
    elements_per_turn: Annotated[int, LIMITS["elements in a turn"]] | None = None
    rings: Annotated[int, LIMITS["rings of elements"]] | None = None
    layers_per_turn: Annotated[int, LIMITS["layers in a turn"]] | None = None
    element: ElementName | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        what = f"springs of the model '{self.model}' have no such setting"
        foreign = [
            Fault(what, name, allowed=", ".join(MESHED_BY[self.model]), attempt=f"model: {model}")
            for model, names in MESHED_BY.items()
            for name in names
            if model != self.model and getattr(self, name) is not None
        ]
        if foreign:
            raise InputError(foreign)


def _ends(value: object) -> object:
    if not isinstance(value, dict) or not value:
        allowed = "discs with the azimuth of their first cable: {S2: 0 deg}"
        raise InputError(Fault("this is of the wrong kind", got=repr(value), allowed=allowed))
    return value


@dataclass(frozen=True)
class Cables(Declared):
    """The cables, numbered end by end.

    Attributes
    ----------
    radius : Radius of the circle of guide holes [m]
    ends : Disc at which cables end -> azimuth [rad] of the first of them, about +z from +x
    per_end : Number of cables at each of these discs, evenly spaced
    exit : Distance behind the base at which they are pulled [m]
    friction_coefficient : Coefficient of friction between cables and guide holes [-]
    line : Stretch, pretension and friction of each
    """

    radius: Clearance = 0.025
    ends: Annotated[Mapping[str, Angle], Reading(_ends)] = field(
        default_factory=lambda: {"S2": 0.0, "S4": math.pi / 3.0}
    )
    per_end: Annotated[int, LIMITS["cables at an end"]] = 3
    exit: Clearance = 0.050
    friction_coefficient: Friction = Cable.friction_coefficient
    line: CableLine = field(default_factory=CableLine)


@dataclass(frozen=True)
class DiscMarkers(Declared):
    """Places of the markers of discs, in their middle planes.

    Attributes
    ----------
    radius, azimuth : [m], and about +z from +x [rad]
    """

    radius: Clearance = 0.030
    azimuth: Angle = 1.5 * math.pi


@displayed
@dataclass(frozen=True, kw_only=True)
class Manipulator(Declared):
    """Discs joined by helical springs, and cables that end at some of them; defaults are paper B's where it gives them.

    Attributes
    ----------
    springs, base, discs, cables, markers : The parts
    total_length
        From the base's mounting face to the far face of the last disc [m]; the springs share the length without discs.
    sections : Number of discs that move, and of springs
    hanging : Whether the manipulator hangs, along -z; else it points along +z
    """

    springs: Springs
    total_length: Size = 0.425
    sections: Annotated[int, LIMITS["sections of a manipulator"]] = 4
    hanging: bool = True
    base: BaseDisc = BaseDisc()
    discs: Discs = Discs()
    cables: Cables = Cables()
    markers: DiscMarkers = DiscMarkers()

    def __post_init__(self) -> None:
        super().__post_init__()
        key, moduli, names = "springs.youngs_modulus", self.springs.youngs_modulus, self.spring_names
        springs, cables, hole = self.springs, self.cables, self.discs.hole_diameter
        faults: list[Fault] = []
        if isinstance(moduli, Mapping):
            what = "there is no such spring"
            faults += [unknown(what, f"{key}.{name}", name, names) for name in moduli if name not in names]
            if missing := [name for name in names if name not in moduli]:
                allowed = "one for each, or one for all"
                faults.append(Fault("springs have no modulus", key, ", ".join(missing), allowed))
        if beyond := [f"'{end}'" for end in cables.ends if end not in self.disc_names]:
            allowed = f"S1 to S{self.sections}"
            faults.append(Fault("cables end at a disc that is not there", "cables.ends", ", ".join(beyond), allowed))
        # Lengths that do not fit together, though each by itself is allowed.
        if self.spring_length <= 0.0:
            thick = self.base.thickness + self.sections * self.discs.thickness
            allowed = f"more than {1e3 * thick:.4g} mm, the thickness of base and discs"
            got = f"{1e3 * self.total_length:.4g} mm"
            raise InputError([*faults, Fault("the discs leave no room for springs", "total_length", got, allowed)])
        faults += [replace(fault, where="springs") for fault in self.coil.wire_faults(springs.wire_diameter)]
        wide = springs.coil_diameter + springs.wire_diameter
        widest = max(wide, 2.0 * cables.radius + hole)
        for key, part in (("discs", self.discs), ("base", self.base)):
            if part.diameter < widest:
                got, allowed = f"{1e3 * part.diameter:.4g} mm", f"at least {1e3 * widest:.4g} mm"
                faults.append(Fault("springs and guide holes do not fit on the disc", f"{key}.diameter", got, allowed))
        if cables.radius - 0.5 * hole < 0.5 * wide:
            got, allowed = f"{1e3 * cables.radius:.4g} mm", f"at least {500 * (wide + hole):.4g} mm"
            faults.append(Fault("the cables run through the springs", "cables.radius", got, allowed))
        if faults:
            raise InputError(faults)

    @property
    def disc_names(self) -> tuple[str, ...]:
        """Names of the discs that move: S1, S2, …"""
        return tuple(f"S{k + 1}" for k in range(self.sections))

    @property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs; spring k is before disc k."""
        return tuple(f"spring{k + 1}" for k in range(self.sections))

    @property
    def cable_names(self) -> tuple[str, ...]:
        """Names of the cables."""
        return tuple(f"cable{k + 1}" for k in range(len(self.cable_azimuths)))

    @property
    def marker_names(self) -> tuple[str, ...]:
        """Names of the markers; marker k is on disc k."""
        return tuple(f"marker{k + 1}" for k in range(self.sections))

    def part_names(self, kind: str) -> tuple[str, ...]:
        """The names of its parts of a kind such as "plates"."""
        flexible = "bodies" if self.springs.model == "solid" else "rods"
        names = {"plates": (BASE, *self.disc_names), flexible: self.spring_names}
        return {**names, "cables": self.cable_names, "markers": self.marker_names}.get(kind, ())

    @property
    def spring_length(self) -> float:
        """Height of a spring between the faces of its discs [m]."""
        thick = self.base.thickness + self.sections * self.discs.thickness
        return (self.total_length - thick) / self.sections

    @property
    def outwards(self) -> Floats:
        """Unit vector from the base to the tip."""
        return np.array([0.0, 0.0, -1.0 if self.hanging else 1.0])

    @property
    def cable_azimuths(self) -> tuple[float, ...]:
        """Azimuth of every cable, and so of every guide hole [rad]."""
        step = 2.0 * math.pi / self.cables.per_end
        return tuple(first + k * step for first in self.cables.ends.values() for k in range(self.cables.per_end))

    def disc_middle(self, number: int) -> float:
        """Distance from the origin to the middle plane of a disc [m]; 0 is the base, 1 the first that moves."""
        if number == 0:
            return 0.5 * self.base.thickness
        pitch = self.spring_length + self.discs.thickness
        return self.base.thickness + number * pitch - 0.5 * self.discs.thickness

    def spring_start(self, number: int) -> float:
        """Distance from the origin to where spring 1, 2, … leaves the disc before it [m]."""
        return self.base.thickness + (number - 1) * (self.spring_length + self.discs.thickness)

    def on_disc(self, number: int, radius: float, azimuth: float) -> Floats:
        """A point in the middle plane of a disc (3,) [m].

        Parameters
        ----------
        number
            Of the disc: 0 is the base, 1 the first that moves.
        radius
            Distance from the axis [m].
        azimuth
            About +z from +x [rad].
        """
        return np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), 0.0]) + self.outwards * (
            self.disc_middle(number)
        )

    @property
    def disc_volume(self) -> float:
        """Volume of a disc less its holes [m^3]."""
        holes = len(self.cable_azimuths) * self.discs.hole_diameter**2
        return 0.25 * math.pi * (self.discs.diameter**2 - holes) * self.discs.thickness

    @property
    def coil(self) -> Coil:
        """The winding of every spring's wire."""
        springs = self.springs
        return Coil(
            coil_diameter=springs.coil_diameter,
            turns=springs.turns,
            height=self.spring_length,
            left_handed=springs.left_handed,
        )


@checked_arguments
def manipulator(of: Manipulator, *, gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Robot:
    """The robot of a manipulator.

    Parameters
    ----------
    gravity
        Acceleration (3,) [m/s^2].

    Raises
    ------
    InputError
        For more elements than a rod may have.
    MeshError
        For solid springs whose wire is too thick for its curvature.
    """
    springs, is_solid = of.springs, of.springs.model == "solid"
    moduli = springs.youngs_modulus
    rings = springs.rings or 1
    if is_solid:
        solid = SolidSpring(
            **vars(of.coil),
            wire_diameter=springs.wire_diameter,
            rings=rings,
            layers_per_turn=springs.layers_per_turn,
        )
        per_turn = 2 * solid.layers
    else:
        per_turn = springs.elements_per_turn or ELEMENTS_PER_TURN
    elements = max(1, math.ceil(springs.turns * per_turn - 1e-9))
    LIMITS["elements of a rod"].check(elements)
    towards = (math.cos(springs.azimuth), math.sin(springs.azimuth), 0.0)
    rods: list[Rod] = []
    for k, (name, before, after) in enumerate(
        zip(of.spring_names, (BASE, *of.disc_names), of.disc_names, strict=False)
    ):
        start = of.spring_start(k + 1) * of.outwards
        line = of.coil.wire(elements, base=start.tolist(), axis=of.outwards.tolist(), towards=towards)
        modulus = moduli[name] if isinstance(moduli, Mapping) else moduli
        parameters = {"youngs_modulus": modulus, "poissons_ratio": springs.poissons_ratio}
        clamped = {before: np.array([0]), after: np.array([elements])}
        rods.append(Rod(name, line, RoundBar(springs.wire_diameter), parameters, clamped, density=springs.density))
    mass = of.springs.density * of.disc_volume if of.discs.mass is None else of.discs.mass
    plates: list[Plate] = []
    for number, name in enumerate((BASE, *of.disc_names)):
        is_base = number == 0
        shape, middle = of.base if is_base else of.discs, of.on_disc(number, 0.0, 0.0)
        holes = {
            f"h{k + 1}": of.on_disc(number, of.cables.radius, azimuth) for k, azimuth in enumerate(of.cable_azimuths)
        }
        disc = Disc(shape.diameter, shape.thickness, of.outwards, hole_diameter=of.discs.hole_diameter)
        plates.append(Plate(name, {}, middle, 0.0 if is_base else mass, fixed=is_base, holes=holes, disc=disc))
    markers = [
        Marker(name, disc, of.on_disc(k + 1, of.markers.radius, of.markers.azimuth))
        for k, (name, disc) in enumerate(zip(of.marker_names, of.disc_names, strict=True))
    ]
    ends = [1 + of.disc_names.index(end) for end in of.cables.ends for _ in range(of.cables.per_end)]
    cables: list[Cable] = []
    for k, (name, end) in enumerate(zip(of.cable_names, ends, strict=True)):
        hole = f"h{k + 1}"
        exit_point = plates[0].holes[hole] - (of.cables.exit + 0.5 * of.base.thickness) * of.outwards
        via = (ViaPoint(exit_point), *(plate.via(hole) for plate in plates[: end + 1]))
        cables.append(Cable(name, via, of.cables.friction_coefficient, "first", line=of.cables.line))
    robot = Robot(
        plates=tuple(plates),
        cables=tuple(cables),
        rods=tuple(rods),
        markers=tuple(markers),
        gravity=np.asarray(gravity),
    )
    return with_solid_rods(robot, rings=rings, element=springs.element or DEFAULT.name) if is_solid else robot
