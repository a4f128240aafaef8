"""Circles in space: rings of guide holes, points, and a direction normal to the axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from softcal.checks import Floats, frozen_floats
from softcal.declare import Declared
from softcal.errors import Fault, InputError, MeshError
from softcal.limits import LIMITS
from softcal.quantities import Angle, Direction, Point, Size


@dataclass(frozen=True)
class Ring(Declared):
    """Holes evenly spaced on a circle.

    Attributes
    ----------
    count, radius : Number of holes, and radius [m] of the circle
    first_angle : Angle [rad] of the first hole about `axis`, from `zero`
    names : Names of the holes; None: h1, h2, …
    centre : Centre of the circle (3,) [m]; None: the plate's reference
    axis, zero : Directions (3,) of the axis of rotation of the angles, and of angle zero
    """

    count: Annotated[int, LIMITS["holes on a ring"]]
    radius: Size
    first_angle: Angle = 0.0
    names: tuple[str, ...] | None = None
    centre: Point | None = None
    axis: Direction = (0.0, 0.0, 1.0)
    zero: Direction = (1.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.hole_names) != self.count or len(set(self.hole_names)) != self.count:
            got, allowed = ", ".join(self.hole_names) or "none", f"{self.count} names"
            raise InputError(Fault("the ring needs one name for each hole", got=got, allowed=allowed))

    @property
    def hole_names(self) -> tuple[str, ...]:
        """The names given, or h1, h2, …"""
        return tuple(f"h{k + 1}" for k in range(self.count)) if self.names is None else self.names

    def holes(self, reference: ArrayLike) -> dict[str, Floats]:
        """The point (3,) [m] of each hole by name, on a plate with a reference (3,) [m].

        Raises
        ------
        MeshError
            Where `zero` is along the axis.
        """
        centre = reference if self.centre is None else self.centre
        points = ring_points(centre, self.axis, self.zero, self.radius, self.count, self.first_angle)
        return dict(zip(self.hole_names, points, strict=True))


def across(axis: Floats) -> Floats:
    """A unit vector normal to a direction, reproducible."""
    side = np.asarray(np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))]), dtype=np.float64)
    return side / np.linalg.norm(side)


def ring_points(
    centre: ArrayLike, axis: ArrayLike, zero: ArrayLike, radius: float, count: int, first_angle: float = 0.0
) -> Floats:
    """Points (count, 3) [m] evenly spaced on a circle.

    Parameters
    ----------
    zero
        The direction of angle zero; only its part normal to `axis` is used.
    first_angle
        Angle of the first point about `axis` [rad].

    Raises
    ------
    MeshError
        If the axis has no direction, or `zero` is along it.
    """
    e3 = frozen_floats(axis, name="axis", shape=(3,))
    size = float(np.linalg.norm(e3))
    if not size > 0.0:
        raise MeshError(
            Fault("the axis of a ring has no direction", got=str(np.asarray(axis).tolist()), allowed="not zero")
        )
    e3 = e3 / size
    across = frozen_floats(zero, name="zero", shape=(3,))
    across = across - (across @ e3) * e3
    size = float(np.linalg.norm(across))
    if size < 1e-9:
        raise MeshError(
            Fault("the direction of angle zero is along the ring's axis", got=str(np.asarray(zero).tolist()))
        )
    e1 = across / size
    e2 = np.cross(e3, e1)
    angle = first_angle + 2.0 * math.pi * np.arange(count) / count
    return np.asarray(centre) + radius * (np.outer(np.cos(angle), e1) + np.outer(np.sin(angle), e2))
