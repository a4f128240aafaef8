"""Symmetric matrices by six components, in one order everywhere; and the direction of a law that has none."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
NO_DIRECTION: Floats = np.zeros(3)


def full(components: Floats) -> Floats:
    """Symmetric matrices (..., 3, 3) of their components (..., 6)."""
    out = np.empty((*components.shape[:-1], 3, 3))
    for m, (i, j) in enumerate(PAIRS):
        out[..., i, j] = out[..., j, i] = components[..., m]
    return out
