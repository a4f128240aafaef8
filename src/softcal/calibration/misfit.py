"""What would explain the residuals of a channel: each usual cause by its own shape along the record.

A cause of shape c explains the share (c . r)^2 / (c . c)(r . r) of the residuals r, both without what the fitted
parameters can do, by the jacobian. Shares compare causes; they do not sum to one, since shapes are alike.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from softcal.calibration.correlation import span
from softcal.calibration.loss import Block
from softcal.checks import Floats

OFFSET, DRIFT, GAIN = "an offset of the instrument", "its drift", "its gain"
SLACK, FRICTION = "a slack", "friction that reverses"
LAW = "a law that stiffens or softens"
_ABSORBED = 1e-3  # of its size: with less left, the parameters can do what a cause would
_BRANCH = 0.1  # of the samples: a branch of a cycle


def explained_by(block: Block) -> dict[str, float]:
    """Cause -> the share [-] of a block's residuals that it explains, the largest first; empty without a jacobian."""
    if block.jacobian is None:
        return {}
    sizes = np.linalg.norm(block.jacobian, axis=0)
    basis = span(block.jacobian / np.where(sizes > 0.0, sizes, 1.0))  # a modulus and a ratio have other units
    residual = _without(basis, block.residual)
    square = float(residual @ residual)
    found: dict[str, float] = {}
    for cause, shape in _shapes(block.residual + block.measured).items():
        left = _without(basis, shape)
        size = float(left @ left)
        if square > 0.0 and size > _ABSORBED**2 * float(shape @ shape):
            found[cause] = float(left @ residual) ** 2 / (size * square)
    return dict(sorted(found.items(), key=lambda one: -one[1]))


def _shapes(y: Floats) -> Mapping[str, Floats]:
    """The shapes (n,) of causes in a channel with these predictions (n,)."""
    slope, largest = np.gradient(y), max(float(np.abs(y).max()), 1e-300)
    shapes = {
        OFFSET: np.ones_like(y),
        DRIFT: np.linspace(0.0, 1.0, len(y)),
        GAIN: y,
        SLACK: slope,
        LAW: y * (y / largest) ** 2,
    }
    rises = float(np.mean(slope > 0.0))
    if _BRANCH < rises < 1.0 - _BRANCH:
        shapes[FRICTION] = np.sign(slope) * y
    return shapes


def _without(basis: Floats, x: Floats) -> Floats:
    return x - basis @ (basis.T @ x)
