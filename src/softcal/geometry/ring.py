"""Circles in space: points on them, such as guide holes, and a direction normal to their axis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from softcal.checks import Floats, frozen_floats
from softcal.errors import Fault, MeshError


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
