"""Primitives: bodies that are meshed from their measures, by Gmsh or without."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated, Literal

from softcal.declare import Declared
from softcal.geometry.generate import require_target
from softcal.geometry.mesh import TetMesh
from softcal.limits import LIMITS
from softcal.quantities import Size


class Primitive(Declared, ABC):
    """A body by its measures, in its own frame."""

    @abstractmethod
    def mesh(self) -> TetMesh:
        """Its mesh [m]."""


@dataclass(frozen=True, kw_only=True)
class Filled(Primitive):
    """A body that Gmsh fills with tets.

    Attributes
    ----------
    size, tets : Target edge length [m], and target number of tets, to within 5 %; one of the two
    order : 2 for quadratic tets, curved on curved faces; 1 for linear ones
    """

    size: Size | None = None
    tets: Annotated[int, LIMITS["tets"]] | None = None
    order: Literal[1, 2] = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        require_target(self.size, self.tets)
