"""The frame of a rig: pose of the frame of a camera or motion capture relative to the robot's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args, get_type_hints

import numpy as np

from softcal.checks import Floats
from softcal.declare import Declared
from softcal.quantities import Angle, Length, Quantity

# Below this angle [rad] the coefficients are computed by their series, which is then more accurate than the quotients.
_SMALL = 1e-2


@dataclass(frozen=True)
class Frame(Declared):
    """The frame that positions were measured in, relative to the robot's.

    Attributes
    ----------
    x, y, z : Translation [m]
    rx, ry, rz : Rotation vector [rad]
    """

    x: Length = 0.0
    y: Length = 0.0
    z: Length = 0.0
    rx: Angle = 0.0
    ry: Angle = 0.0
    rz: Angle = 0.0


# The parameters of a frame by their dotted names.
FRAME: Mapping[str, Quantity] = {
    f"frame.{axis}": get_args(hint)[1] for axis, hint in get_type_hints(Frame, include_extras=True).items()
}


def rotation(r: Floats) -> Floats:
    """R = exp([r]x) for a rotation vector r [rad], shape (3, 3)."""
    a, b, _ = _coefficients(float(np.linalg.norm(r)))
    K = _cross(r)
    return np.eye(3) + a * K + b * K @ K


def rotation_rates(r: Floats) -> Floats:
    """dR/dr_k, shape (3, 3, 3) with k first: [J e_k]x R with J the left Jacobian of the rotation vector."""
    _, b, c = _coefficients(float(np.linalg.norm(r)))
    K = _cross(r)
    J = np.eye(3) + b * K + c * K @ K
    return np.array([_cross(J[:, k]) for k in range(3)]) @ rotation(r)


def _coefficients(angle: float) -> tuple[float, float, float]:
    """sin(t)/t, (1 - cos t)/t^2 and (t - sin t)/t^3."""
    q = angle**2
    if angle < _SMALL:
        return (
            1 - q / 6 + q**2 / 120 - q**3 / 5040,
            1 / 2 - q / 24 + q**2 / 720 - q**3 / 40320,
            1 / 6 - q / 120 + q**2 / 5040 - q**3 / 362880,
        )
    return np.sin(angle) / angle, (1 - np.cos(angle)) / q, (angle - np.sin(angle)) / angle**3


def _cross(r: Floats) -> Floats:
    return np.array([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
