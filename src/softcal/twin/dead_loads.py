"""Dead loads: forces at points, moments, and tractions, which keep their direction in space."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softcal.arrays import ForceVector, MomentVector, Position, Traction, Triangles, UnitVector
from softcal.checks import Floats, frozen_floats
from softcal.display import displayed
from softcal.twin.part import NamedPart

CHOSEN: Any = None  # a load's direction, where it is omitted: that of its vector


@displayed
@dataclass(frozen=True)
class PointLoad(NamedPart):
    """A dead force at a point of a body, plate or rod.

    Attributes
    ----------
    name, on : Names of the load and of the body, plate or rod
    at : Point (3,) [m] in the rest frame
    force : (3,) [N]
    direction : Unit vector (3,) of the force; needed where its magnitude is zero now and another value later
    """

    on: str
    at: Position
    force: ForceVector
    direction: UnitVector = CHOSEN

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is CHOSEN:
            object.__setattr__(self, "direction", _direction(self.force))


def _direction(vector: Floats) -> Floats:
    """The unit vector along one that may be zero."""
    size = float(np.linalg.norm(vector))
    return frozen_floats(vector / size if size > 0.0 else vector, name="direction")


@displayed
@dataclass(frozen=True)
class Moment(NamedPart):
    """A dead moment on a plate, or on a rod: its direction stays the same as the part turns.

    Attributes
    ----------
    name, on : Names of the moment and of the plate or rod
    moment : (3,) [N m]
    at : Point (3,) [m] in the rest frame, which determines the section of a rod; not needed on a plate
    direction : Unit vector (3,) of the moment; needed where its magnitude is zero now and another value later
    """

    on: str
    moment: MomentVector
    at: Position = field(default_factory=lambda: np.zeros(3))
    direction: UnitVector = CHOSEN

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is CHOSEN:
            object.__setattr__(self, "direction", _direction(self.moment))


@displayed
@dataclass(frozen=True)
class SurfaceLoad(NamedPart):
    """A dead traction on a part of a body's surface.

    Attributes
    ----------
    name, on : Names of the load and of the body
    faces : Node numbers of triangles (k, 3 or 6) of the body's mesh
    traction : Force per undeformed area (3,) [Pa]
    """

    on: str
    faces: Triangles
    traction: Traction
