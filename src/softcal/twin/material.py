"""Materials of parts: a body's or a rod's own, those of some of its elements, and the winding of their fibres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from softcal.arrays import Numbers
from softcal.checks import Floats, require_below
from softcal.declare import Declared, FixedMapping
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.materials.inelastic import History
from softcal.materials.parameter import Parameter, complete
from softcal.quantities import Angle, Density, Direction, Point
from softcal.twin.parameter_name import parameter_name
from softcal.twin.part import NamedPart

NEAR_AXIS = 1e-9  # of the largest coordinate: nearer points have no direction around an axis


@displayed
@dataclass(frozen=True)
class Material(NamedPart):
    """A material of some tets of a mesh, or of some elements of a rod.

    Attributes
    ----------
    name : First part of its parameters' names
    elements : Numbers of its tets, or of its elements along the rod (n,)
    parameters : Constants of the law [SI] by name
    density : [kg/m^3]
    """

    elements: Numbers
    parameters: Mapping[str, float]
    density: Density = 0.0

    @property
    def _own_name(self) -> str:
        return parameter_name(self.name).kind


@displayed
@dataclass(frozen=True)
class Winding(Declared):
    """Fibres wound around an axis as helices of both hands, such as a braid's, or as one of them.

    Attributes
    ----------
    angle : Angle of the fibres to the axis: 0 along it, 90 deg around it
    point : A point (3,) [m] of the axis, in the robot at rest
    direction : Its direction (3,), of any length but zero
    """

    angle: Angle
    point: Point = (0.0, 0.0, 0.0)
    direction: Direction = (0.0, 0.0, 1.0)

    def directions(self, at: Floats) -> Floats:
        """Unit vectors (n, 2, 3) along the fibres of both hands, first the right-handed ones, at points (n, 3) [m].

        Raises
        ------
        InputError
            Where a point is on the axis.
        """
        axis = np.asarray(self.direction) / np.linalg.norm(self.direction)
        around = np.cross(axis, at - np.asarray(self.point))
        distances = np.linalg.norm(around, axis=1, keepdims=True)
        if not distances.min(initial=np.inf) > NEAR_AXIS * np.abs(at).max(initial=0.0):
            got = f"point {int(distances.argmin()) + 1} of {len(at)}"
            raise InputError(Fault("material is on the axis of its winding", "winding", got, "an axis in a cavity"))
        around *= np.sin(self.angle) / distances
        return np.stack([np.cos(self.angle) * axis + hand * around for hand in (1.0, -1.0)], axis=1)


class Deformable(Protocol):
    """A part with a material of its own, and inclusions of others, with the same constants and history."""

    @property
    def name(self) -> str: ...
    @property
    def parameters(self) -> Mapping[str, float]: ...
    @property
    def density(self) -> float: ...
    @property
    def inclusions(self) -> tuple[Material, ...]: ...
    @property
    def past(self) -> History: ...
    @property
    def constants(self) -> tuple[Parameter, ...]: ...


def complete_materials(part: Deformable, n_elements: int, of: str) -> None:
    """Complete the constants of a part, which is being made, and those that each inclusion leaves out.

    Parameters
    ----------
    part
        The part.
    n_elements
        Number of its elements.
    of
        What its elements are called.

    Raises
    ------
    InputError
        For numbers of elements that do not exist, an element with two inclusions, inclusions that cover the whole
        part, and constants that do not fit each other.
    """
    constants, past = part.constants, part.past
    own = complete(part.parameters, constants, owner=part.name)
    object.__setattr__(part, "parameters", FixedMapping(own))
    inclusions = (
        replace(one, parameters=complete({**own, **one.parameters}, constants, owner=f"{part.name}.{one.name}"))
        for one in part.inclusions
    )
    object.__setattr__(part, "inclusions", tuple(inclusions))
    times = np.zeros(n_elements, dtype=np.int64)
    for one in part.inclusions:
        require_below(n_elements, one.elements, f"{part.name}.{one.name}")
        np.add.at(times, one.elements, 1)
    names = ", ".join(one.name for one in part.inclusions)
    if (times > 1).any():
        raise InputError(Fault(f"{int((times > 1).sum())} {of} are of two materials", part.name, got=names))
    if part.inclusions and times.all():
        what = f"the materials leave none of the {of} to its own material"
        raise InputError(Fault(what, part.name, names, attempt="one of them as its own"))
    for material in materials_of(part, n_elements):
        if wrong := next(filter(None, (one.faults(material.parameters) for one in past.parts)), ""):
            raise InputError(Fault(wrong, material.name))


def materials_of(part: Deformable, n_elements: int) -> tuple[Material, ...]:
    """Every material of a part, named as its parameters are: its own, by its name, then `part.inclusion`."""
    rest = np.ones(n_elements, dtype=bool)
    for one in part.inclusions:
        rest[one.elements] = False
    own = Material(part.name, np.flatnonzero(rest), part.parameters, part.density)
    return (own, *(replace(one, name=f"{part.name}.{one.name}") for one in part.inclusions))
