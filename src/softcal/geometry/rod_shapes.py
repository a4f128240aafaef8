"""The shapes of rods that a project file can state, and their centrelines."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from softcal.declare import Declared
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline, curve_through, polyline, spaced, straight
from softcal.geometry.coil import Coil
from softcal.limits import LIMITS
from softcal.quantities import Direction, Point

ELEMENTS = 40  # of a straight rod by default
ELEMENTS_PER_TURN = 12  # of a helical spring by default


class RodShape(Declared, ABC):
    """The stress-free shape of a rod's axis."""

    @property
    @abstractmethod
    def length(self) -> float:
        """Arc length [m]."""

    @property
    @abstractmethod
    def elements(self) -> int:
        """Number of elements by default."""

    @abstractmethod
    def centreline(self, arcs: Sequence[float], elements: int) -> Centreline:
        """Centreline with nodes at arc lengths [m] from the start, and no element longer than the length over
        `elements`.
        """

    def wire_faults(self, wire_diameter: float) -> list[Fault]:
        """The faults of a section of an outer diameter [m] that is too thick for the shape."""
        return []

    def require_fitting(self, diameter: float) -> None:
        """Check the outer diameter [m] of a section.

        Raises
        ------
        MeshError
            Where the shape does not leave room for it.
        """
        if faults := self.wire_faults(diameter):
            raise MeshError(faults)


@dataclass(frozen=True)
class Straight(RodShape):
    """A straight rod.

    Attributes
    ----------
    start, end : Its ends (3,) [m]
    first : Direction (3,) whose part normal to the rod becomes axis 1 of the sections; None: any
    """

    start: Point
    end: Point
    first: Direction | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.length > 0.0:
            raise MeshError(Fault("a rod's ends coincide", got=str(list(self.start)), allowed="two points"))

    @property
    def length(self) -> float:
        return math.dist(self.start, self.end)

    @property
    def elements(self) -> int:
        return ELEMENTS

    def centreline(self, arcs: Sequence[float], elements: int) -> Centreline:
        at = spaced([arc / self.length for arc in arcs], 1.0 / elements)
        return straight(self.start, self.end, at, first=self.first)


@dataclass(frozen=True, kw_only=True)
class Helix(Coil, RodShape):
    """The wire of a helical spring.

    Attributes
    ----------
    base : Point (3,) [m] on the coil's axis at the level of the wire's first node
    axis : Direction (3,) in which the wire climbs
    towards : Direction (3,) from the axis to the first node; None: any
    """

    base: Point
    axis: Direction = (0.0, 0.0, 1.0)
    towards: Direction | None = None

    @property
    def length(self) -> float:
        return self.wire_length

    @property
    def elements(self) -> int:
        return math.ceil(ELEMENTS_PER_TURN * self.turns - 1e-9)

    def centreline(self, arcs: Sequence[float], elements: int) -> Centreline:
        at = spaced([arc / self.length for arc in arcs], 1.0 / elements)
        return self.wire(at, base=self.base, axis=self.axis, towards=self.towards)


@dataclass(frozen=True)
class Polyline(RodShape):
    """A smooth curve.

    Attributes
    ----------
    points : Points (n, 3) [m] on the curve, in order
    first : Direction (3,) whose part normal to the curve becomes axis 1 of the first section; None: any
    """

    points: Annotated[tuple[Point, ...], LIMITS["points of a line"].entries]
    first: Direction | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        polyline(self.points, first=self.first)

    @property
    def length(self) -> float:
        return float(polyline(self.points, first=self.first).stations[-1])

    @property
    def elements(self) -> int:
        return 1  # from end to end: it has nodes at its points anyway

    def centreline(self, arcs: Sequence[float], elements: int) -> Centreline:
        return curve_through(self.points, arcs, self.length / elements, first=self.first)
