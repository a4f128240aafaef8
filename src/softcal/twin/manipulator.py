"""The continuum manipulator of paper B: discs joined by helical springs, bent by cables that end at some of them.

The base's mounting face is the origin; the discs follow along z, downwards where the manipulator hangs. Azimuths count
about +z from +x. Parts: base, S1, S2, …; spring1, …; cable1, …, numbered end by end; marker1, … on the discs. Every
disc has a guide hole for every cable, h1, h2, …, in its middle plane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline, helix
from softcal.geometry.rod_shapes import ELEMENTS_PER_TURN
from softcal.geometry.section import circular
from softcal.limits import LIMITS
from softcal.twin.robot import Cable, Disc, Marker, Plate, Robot, Rod, ViaPoint

BASE = "base"


@dataclass(frozen=True)
class ManipulatorShape:
    """The lengths [m] and angles [rad] of a manipulator; the defaults are paper B's where it gives them.

    Attributes
    ----------
    total_length
        From the base's mounting face to the far face of the last disc [m]; the springs share the length without discs.
    n_sections
        Number of discs that move, and of springs.
    hanging
        Whether the manipulator hangs, along -z; else it points along +z.
    base_diameter, base_thickness, disc_diameter, disc_thickness
        Of the base and of the moving discs [m].
    hole_diameter
        Of the guide holes [m].
    coil_diameter, wire_diameter, turns, left_handed, spring_azimuth
        Of every spring: mean coil and wire diameter [m], turns [-], sense, and azimuth of the wire's start [rad].
    cable_radius
        Radius of the circle of guide holes [m].
    cable_ends, cables_per_end, first_azimuths
        Numbers of the discs at which cables end; number of cables at each, evenly spaced from the azimuth [rad] given
        for it.
    cable_exit
        Distance behind the base at which the cables are pulled [m].
    marker_radius, marker_azimuth
        Place of each disc's marker in its middle plane [m], [rad].
    """

    total_length: float = 0.425
    n_sections: int = 4
    hanging: bool = True
    base_diameter: float = 0.080
    base_thickness: float = 0.010
    disc_diameter: float = 0.060
    disc_thickness: float = 0.008
    hole_diameter: float = 0.003
    coil_diameter: float = 0.030
    wire_diameter: float = 0.009
    turns: float = 3.0
    left_handed: bool = False
    spring_azimuth: float = 0.0
    cable_radius: float = 0.025
    cable_ends: tuple[int, ...] = (2, 4)
    cables_per_end: int = 3
    first_azimuths: tuple[float, ...] = (0.0, math.pi / 3.0)
    cable_exit: float = 0.050
    marker_radius: float = 0.030
    marker_azimuth: float = math.radians(270.0)

    def __post_init__(self) -> None:
        faults = _range_faults(self)
        if faults:
            raise MeshError(faults)
        faults = _fit_faults(self)
        if faults:
            raise MeshError(faults)

    @property
    def discs(self) -> tuple[str, ...]:
        """Names of the discs that move: S1, S2, …"""
        return tuple(f"S{k + 1}" for k in range(self.n_sections))

    @property
    def springs(self) -> tuple[str, ...]:
        """Names of the springs; spring k is before disc k."""
        return tuple(f"spring{k + 1}" for k in range(self.n_sections))

    @property
    def cables(self) -> tuple[str, ...]:
        """Names of the cables."""
        return tuple(f"cable{k + 1}" for k in range(len(self.cable_azimuths)))

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers; marker k is on disc k."""
        return tuple(f"marker{k + 1}" for k in range(self.n_sections))

    @property
    def spring_length(self) -> float:
        """Height of a spring between the faces of its discs [m]."""
        thick = self.base_thickness + self.n_sections * self.disc_thickness
        return (self.total_length - thick) / self.n_sections

    @property
    def outwards(self) -> Floats:
        """Unit vector from the base to the tip."""
        return np.array([0.0, 0.0, -1.0 if self.hanging else 1.0])

    @property
    def cable_azimuths(self) -> tuple[float, ...]:
        """Azimuth of every cable, and so of every guide hole [rad]."""
        step = 2.0 * math.pi / self.cables_per_end
        return tuple(first + k * step for first in self.first_azimuths for k in range(self.cables_per_end))

    def disc_middle(self, number: int) -> float:
        """Distance from the origin to the middle plane of a disc [m]; 0 is the base, 1 the first that moves."""
        if number == 0:
            return 0.5 * self.base_thickness
        pitch = self.spring_length + self.disc_thickness
        return self.base_thickness + number * pitch - 0.5 * self.disc_thickness

    def spring_start(self, number: int) -> float:
        """Distance from the origin to where spring 1, 2, … leaves the disc before it [m]."""
        return self.base_thickness + (number - 1) * (self.spring_length + self.disc_thickness)

    def on_disc(self, number: int, radius: float, azimuth: float) -> Floats:
        """A point in the middle plane of a disc [m]."""
        return np.array([radius * math.cos(azimuth), radius * math.sin(azimuth), 0.0]) + self.outwards * (
            self.disc_middle(number)
        )

    @property
    def disc_volume(self) -> float:
        """Of a disc less its holes [m^3]."""
        holes = len(self.cable_azimuths) * self.hole_diameter**2
        return 0.25 * math.pi * (self.disc_diameter**2 - holes) * self.disc_thickness


def manipulator(
    shape: ManipulatorShape,
    *,
    youngs_modulus: float | Mapping[str, float],
    poissons_ratio: float,
    density: float = Rod.density,
    disc_mass: float | None = None,
    friction_coefficient: float = Cable.friction_coefficient,
    gravity: Sequence[float] = (0.0, 0.0, -9.81),
    elements_per_turn: int = ELEMENTS_PER_TURN,
) -> Robot:
    """The manipulator with rods for its springs.

    Parameters
    ----------
    youngs_modulus, poissons_ratio, density
        Of the springs [Pa], [-], [kg/m^3]; the modulus of each by its name where they differ.
    disc_mass
        Of each disc that moves [kg]; by default its volume times the density.
    friction_coefficient
        Between cables and guide holes [-].

    Raises
    ------
    MeshError
        For a spring that is cut into too few elements.
    """
    moduli = youngs_modulus if isinstance(youngs_modulus, Mapping) else dict.fromkeys(shape.springs, youngs_modulus)
    mass = density * shape.disc_volume if disc_mass is None else disc_mass
    rods = tuple(
        Rod(
            name,
            centreline := spring_centreline(shape, k + 1, elements_per_turn),
            circular(shape.wire_diameter),
            {"youngs_modulus": moduli[name], "poissons_ratio": poissons_ratio},
            {before: np.array([0]), after: np.array([len(centreline.nodes) - 1])},
            density=density,
        )
        for k, (name, before, after) in enumerate(zip(shape.springs, (BASE, *shape.discs), shape.discs, strict=False))
    )
    plates = manipulator_plates(shape, mass)
    cables = manipulator_cables(shape, plates, friction_coefficient)
    return Robot(
        plates=plates, cables=cables, rods=rods, markers=manipulator_markers(shape), gravity=np.asarray(gravity)
    )


def manipulator_plates(shape: ManipulatorShape, disc_mass: float) -> tuple[Plate, ...]:
    """The base, which does not move, and the discs."""
    plates: list[Plate] = []
    for number, name in enumerate((BASE, *shape.discs)):
        diameter, thickness = (
            (shape.base_diameter, shape.base_thickness) if number == 0 else (shape.disc_diameter, shape.disc_thickness)
        )
        middle = shape.on_disc(number, 0.0, 0.0)
        holes = {
            f"h{k + 1}": shape.on_disc(number, shape.cable_radius, azimuth)
            for k, azimuth in enumerate(shape.cable_azimuths)
        }
        disc = Disc(middle, shape.outwards, diameter, thickness, shape.hole_diameter)
        mass = 0.0 if number == 0 else disc_mass
        plates.append(Plate(name, {}, middle, mass, fixed=number == 0, holes=holes, disc=disc))
    return tuple(plates)


def spring_centreline(shape: ManipulatorShape, number: int, elements_per_turn: int) -> Centreline:
    """The wire of spring 1, 2, …, from the face of the disc before it to the face of its own.

    Raises
    ------
    MeshError
        For fewer than four elements per turn.
    InputError
        For more elements than a rod may have.
    """
    if elements_per_turn < 4:
        raise MeshError(Fault("a turn of a spring needs four elements or more", got=str(elements_per_turn)))
    elements = max(1, math.ceil(shape.turns * elements_per_turn - 1e-9))
    LIMITS["elements of a rod"].check(elements)
    azimuth = shape.spring_azimuth
    return helix(
        tuple(shape.spring_start(number) * shape.outwards),
        tuple(shape.outwards),
        diameter=shape.coil_diameter,
        pitch=shape.spring_length / shape.turns,
        turns=shape.turns,
        at=elements,
        towards=(math.cos(azimuth), math.sin(azimuth), 0.0),
        left_handed=shape.left_handed,
    )


def manipulator_cables(
    shape: ManipulatorShape, plates: Sequence[Plate], friction_coefficient: float
) -> tuple[Cable, ...]:
    """The cables, each from where it is pulled through the base and every disc to the one at which it ends."""
    ends = np.repeat(shape.cable_ends, shape.cables_per_end)
    cables: list[Cable] = []
    for k, (name, end) in enumerate(zip(shape.cables, ends, strict=True)):
        hole = f"h{k + 1}"
        exit_point = plates[0].holes[hole] - (shape.cable_exit + 0.5 * shape.base_thickness) * shape.outwards
        via = (ViaPoint(exit_point), *(plate.via(hole) for plate in plates[: end + 1]))
        cables.append(Cable(name, via, friction_coefficient, "first"))
    return tuple(cables)


def manipulator_markers(shape: ManipulatorShape) -> tuple[Marker, ...]:
    """A marker on every disc that moves."""
    return tuple(
        Marker(name, disc, shape.on_disc(k + 1, shape.marker_radius, shape.marker_azimuth))
        for k, (name, disc) in enumerate(zip(shape.markers, shape.discs, strict=True))
    )


def _range_faults(shape: ManipulatorShape) -> list[Fault]:
    positive = ("total_length", "base_diameter", "base_thickness", "disc_diameter", "disc_thickness", "coil_diameter")
    positive += ("wire_diameter", "turns", "cable_radius")
    faults = [
        Fault("the value must be positive", key, f"{getattr(shape, key):.6g}", "> 0")
        for key in positive
        if not 0.0 < getattr(shape, key) < math.inf
    ]
    faults += [
        Fault("the value must not be negative", key, f"{getattr(shape, key):.6g}", ">= 0")
        for key in ("hole_diameter", "cable_exit", "marker_radius")
        if not 0.0 <= getattr(shape, key) < math.inf
    ]
    faults += [
        Fault("the number is too small", key, str(getattr(shape, key)), "1 or more")
        for key in ("n_sections", "cables_per_end")
        if getattr(shape, key) < 1
    ]
    if len(shape.cable_ends) != len(shape.first_azimuths):
        faults.append(
            Fault(
                "each end of cables needs a first azimuth",
                "first_azimuths",
                f"{len(shape.first_azimuths)} for {len(shape.cable_ends)} ends",
            )
        )
    beyond = [str(end) for end in shape.cable_ends if not 1 <= end <= shape.n_sections]
    if beyond:
        faults.append(
            Fault("cables end at a disc that is not there", "cable_ends", ", ".join(beyond), f"1 to {shape.n_sections}")
        )
    return faults


def _fit_faults(shape: ManipulatorShape) -> list[Fault]:
    """The faults of lengths that do not fit together, though each by itself is allowed."""
    faults: list[Fault] = []
    if shape.spring_length <= 0.0:
        thick = shape.total_length - shape.n_sections * shape.spring_length
        faults.append(
            Fault(
                "the discs leave no room for springs",
                "total_length",
                f"{1e3 * shape.total_length:.4g} mm",
                f"more than {1e3 * thick:.4g} mm, the thickness of base and discs",
            )
        )
        return faults
    pitch = shape.spring_length / shape.turns
    apart = pitch / math.hypot(1.0, pitch / (math.pi * shape.coil_diameter))
    if shape.turns > 1.0 and apart <= shape.wire_diameter:
        faults.append(
            Fault(
                "the springs' coils touch at rest",
                "turns",
                f"{shape.turns:g} turns of a wire of {1e3 * shape.wire_diameter:.4g} mm in "
                f"{1e3 * shape.spring_length:.4g} mm",
                f"coils further apart than the wire is thick; these are {1e3 * apart:.4g} mm apart",
                "fewer turns or a thinner wire",
            )
        )
    widest = max(shape.coil_diameter + shape.wire_diameter, 2.0 * shape.cable_radius + shape.hole_diameter)
    if shape.wire_diameter >= shape.coil_diameter:
        faults.append(
            Fault(
                "the wire fills the coil",
                "wire_diameter",
                f"{1e3 * shape.wire_diameter:.4g} mm",
                f"below the coil's diameter of {1e3 * shape.coil_diameter:.4g} mm",
            )
        )
    for key in ("disc_diameter", "base_diameter"):
        if getattr(shape, key) < widest:
            faults.append(
                Fault(
                    "springs and guide holes do not fit on the disc",
                    key,
                    f"{1e3 * getattr(shape, key):.4g} mm",
                    f"at least {1e3 * widest:.4g} mm",
                )
            )
    inner = shape.cable_radius - 0.5 * shape.hole_diameter
    if inner < 0.5 * (shape.coil_diameter + shape.wire_diameter):
        faults.append(
            Fault(
                "the cables run through the springs",
                "cable_radius",
                f"{1e3 * shape.cable_radius:.4g} mm",
                f"at least {500 * (shape.coil_diameter + shape.wire_diameter + shape.hole_diameter):.4g} mm",
            )
        )
    return faults
