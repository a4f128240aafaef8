"""The elements by name: softcal's own, and those that are registered from outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np

from softcal.catalogue import Catalogue
from softcal.declare import member_of
from softcal.errors import Fault
from softcal.geometry.cell import LINEAR, QUADRATIC
from softcal.mechanics.element import Element, Quadrature

ONE_POINT = Quadrature(np.full((1, 4), 0.25), np.array([1.0 / 6.0]), degree=1)
# Exact to degree two, as CalculiX has for its C3D10.
_A, _B = (5.0 + 3.0 * np.sqrt(5.0)) / 20.0, (5.0 - np.sqrt(5.0)) / 20.0
FOUR_POINTS = Quadrature(np.where(np.eye(4, dtype=bool), _A, _B), np.full(4, 1.0 / 24.0), degree=2)

P1 = Element("P1", "linear tets, which lock as Poisson's ratio nears 0.5; SOFA's", LINEAR, ONE_POINT, rank=0)
P2 = Element("P2", "quadratic tets", QUADRATIC, FOUR_POINTS, rank=1)
P2P1 = Element(
    "P2P1",
    "quadratic tets with continuous linear pressure (Taylor-Hood), which do not lock",
    QUADRATIC,
    FOUR_POINTS,
    rank=2,
    pressure=LINEAR,
)
DEFAULT = P2P1


def _faults(element: Element, known: Mapping[str, Element]) -> list[Fault]:
    """The faults of an element's name."""
    if not isinstance(element, Element):
        return [
            Fault(
                "this is not an element",
                where="element",
                got=repr(element)[:60],
                allowed="a softcal.mechanics.element.Element",
            )
        ]
    if element.name.isidentifier():
        return []
    return [Fault("this cannot be a name", where="element", got=f"'{element.name}'", allowed="letters, digits and _")]


ELEMENTS = Catalogue("element", "softcal.elements", _faults, own=(P1, P2, P2P1))
# The name of an element, as a project file gives it.
ElementName = Annotated[str, member_of(ELEMENTS)]


def higher_elements() -> tuple[str, ...]:
    """The names of the elements that bodies can be raised to: all but the lowest."""
    lowest = min(element.rank for element in ELEMENTS.values())
    return tuple(name for name, element in ELEMENTS.items() if element.rank > lowest)


register_element = ELEMENTS.registrar(
    "register_element", "Add an element: project files, checks, mesh studies and exports then accept its name."
)
