"""Elastic constants by Young's modulus E and Poisson's ratio nu, as texts for the laws and as numbers."""

from __future__ import annotations

# Paper A, Eqs. (2) and (3).
SHEAR_MODULUS = "E/(2*(1 + nu))"
LAME_LAMBDA = "E*nu/((1 + nu)*(1 - 2*nu))"


def shear_modulus(youngs_modulus: float, poissons_ratio: float) -> float:
    """mu = E / (2 (1 + nu)) [Pa] (paper A, Eq. 2)."""
    return youngs_modulus / (2.0 * (1.0 + poissons_ratio))


def lame_lambda(youngs_modulus: float, poissons_ratio: float) -> float:
    """Lamé lambda = E nu / ((1 + nu)(1 - 2 nu)) [Pa] (paper A, Eq. 3)."""
    return youngs_modulus * poissons_ratio / ((1.0 + poissons_ratio) * (1.0 - 2.0 * poissons_ratio))
