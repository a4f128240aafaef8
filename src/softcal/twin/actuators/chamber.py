"""A pressure chamber: a cavity that gas or liquid fills, commanded by its pressure or by its pump's volume."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

import numpy as np

from softcal.arrays import Triangles
from softcal.checks import Ints
from softcal.declare import Reading, shown
from softcal.display import displayed
from softcal.errors import Fault, InputError, MeshError
from softcal.geometry.surface import border
from softcal.quantities import QUANTITIES, Quantity
from softcal.sensing.kind import ChannelKind
from softcal.sensing.sensors.actuators import PRESSURE, VOLUME
from softcal.twin.actuated import Actuator, Numbering, register_actuator
from softcal.units import format_quantity

LEAST_VOLUME = 1e-9  # of the cube of a chamber's extent: a smaller one encloses nothing

if TYPE_CHECKING:
    from softcal.mechanics.chamber import ChamberTerm


def _region_name(value: object) -> str:
    if not isinstance(value, str):
        raise InputError(
            Fault("this is of the wrong kind", got=shown(value), allowed="the name of a region of the body")
        )
    return value


@displayed
@register_actuator
@dataclass(frozen=True)
class Chamber(Actuator):
    """A cavity of one or more bodies; flat caps close its openings, as a plug or a plate does.

    Attributes
    ----------
    walls : Body -> the part of its surface that the cavity has: a region's name, or triangles (n, 3 or 6) of its mesh
    medium : "gas", which the pump compresses, or "liquid", which it does not
    dead_volume : Dead volume of gas in hoses, fittings and pump at no pressure [m^3]; with a gas alone
    hose_compliance : Volume of the hoses per pressure [m^3/Pa]; None: they are stiff
    polytropic_exponent : 1 for a gas that stays as warm as it is, 1.4 for air that is compressed at once; None: 1
    """

    walls: Mapping[str, Annotated[str | Triangles, Reading(_region_name, "instead")]]
    medium: Literal["gas", "liquid"] = "gas"
    dead_volume: Annotated[float, QUANTITIES["dead volume"]] | None = None
    hose_compliance: Annotated[float, QUANTITIES["compliance of a hose"]] | None = None
    polytropic_exponent: Annotated[float, QUANTITIES["polytropic exponent"]] | None = None

    name: ClassVar[str] = "chamber"
    region_key: ClassVar[tuple[str, ...]] = ("walls",)
    channels: ClassVar[tuple[ChannelKind, ChannelKind]] = (VOLUME, PRESSURE)
    ranges: ClassVar[tuple[Quantity, Quantity]] = (QUANTITIES["pumped volume"], QUANTITIES["gauge pressure"])
    quantities: ClassVar[Mapping[str, Quantity]] = {
        "dead_volume": QUANTITIES["dead volume"],
        "hose_compliance": QUANTITIES["compliance of a hose"],
        "polytropic_exponent": QUANTITIES["polytropic exponent"],
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.walls:
            raise InputError(Fault("the chamber has no wall", "walls", allowed="body: region, for one body or more"))
        for key in ("dead_volume", "polytropic_exponent"):
            if self.medium == "liquid" and getattr(self, key) is not None:
                allowed = "medium: gas, or hose_compliance"
                raise InputError(Fault("a liquid is not compressed", key, f"{getattr(self, key):.6g}", allowed))

    @property
    def surfaces(self) -> Mapping[str, Ints | str]:
        return self.walls

    def on_surfaces(self, surfaces: Mapping[str, Ints | str]) -> Self:
        return replace(self, walls=surfaces)

    def term(self, name: str, places: Numbering) -> ChamberTerm:
        """Its term; the volume at rest is that of the undeformed mesh.

        Raises
        ------
        MeshError
            Where its walls enclose no volume, or are no surface of their bodies.
        """
        from softcal.mechanics.chamber import ChamberTerm, ChamberWall

        walls: list[ChamberWall] = []
        for body, given in self.walls.items():
            faces = places.faces(body, given, f"{name}.walls.{body}", is_wall=True)
            walls.append(ChamberWall(faces, tuple(border(faces))))
        term = ChamberTerm(
            name=name,
            walls=tuple(walls),
            rest_volume=0.0,
            stated=tuple(key for key in self.quantities if getattr(self, key) is not None),
            is_gas=self.medium == "gas",
        )
        volume = term.volume(places.X)
        points = places.X[np.unique(np.concatenate([wall.faces.ravel() for wall in walls]))]
        if not volume > LEAST_VOLUME * float(np.ptp(points, axis=0).max()) ** 3:
            raise MeshError(
                Fault(
                    "the walls of the chamber enclose no volume",
                    f"{name}.walls",
                    got=format_quantity(volume, "m^3"),
                    allowed="the inner surface of a cavity, seen from which the material is outside",
                )
            )
        return replace(term, rest_volume=volume)
