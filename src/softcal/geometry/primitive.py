"""Primitives: bodies that are meshed from their measures, by Gmsh or without."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Literal, Self

from softcal.declare import Declared
from softcal.geometry.mesh import TetMesh
from softcal.limits import LIMITS
from softcal.quantities import Size


@dataclass(frozen=True)
class Primitive(Declared, ABC):
    """A body by its measures, in its own frame.

    lengths: names of the fields that can be parameters of a body of this shape (see `PrimitiveShape`).
    """

    lengths: ClassVar[tuple[str, ...]] = ()

    @abstractmethod
    def mesh(self) -> TetMesh:
        """The mesh [m]."""

    @property
    def knots(self) -> tuple[Sequence[float], Sequence[float]]:
        """Ascending radii about z and heights [m], from zero to the outermost. Where a length changes, the points
        between two of them stay between them, at the same share of the way. Empty where no length is a parameter.
        """
        return (), ()

    def with_lengths(self, values: Mapping[str, float]) -> Self:
        """The same body with other lengths [m].

        Raises
        ------
        InputError
            Where no body has them.
        """
        return replace(self, **values)


@dataclass(frozen=True, kw_only=True)
class Filled(Primitive):
    """A body that Gmsh fills with tets.

    Attributes
    ----------
    size, tets : Target edge length [m], and target number of tets, to within 5 %; one of the two for a mesh
    order : 2 for quadratic tets, curved on curved faces; 1 for linear ones
    """

    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] = 2
