"""Symmetric matrices by six components, in one order everywhere; and the directions of a law that has none."""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats

PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
# Of strains with doubled shears, products with stresses are sums over the components; of two stresses they need these.
TWICE: Floats = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
NO_DIRECTIONS: Floats = np.zeros((1, 0, 3))
_TRACE: Floats = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
# (1, 6, 6): twice the deviator of strains with doubled shears, the stress of a shear modulus of one alone.
ISOCHORIC: Floats = 2.0 * (np.diag(1.0 / TWICE) - np.outer(_TRACE, _TRACE) / 3.0)[None]


def full(components: Floats) -> Floats:
    """Symmetric matrices (..., 3, 3) of their components (..., 6)."""
    out = np.empty((*components.shape[:-1], 3, 3))
    for m, (i, j) in enumerate(PAIRS):
        out[..., i, j] = out[..., j, i] = components[..., m]
    return out


def doubled(strain: Floats) -> Floats:
    """The components (..., 6) of strains (..., 3, 3), with doubled shears."""
    return np.stack([strain[..., i, j] for i, j in PAIRS], axis=-1) * TWICE
