"""Young's modulus E and Poisson's ratio nu, and the other elastic constants by them, as texts for the laws."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

YOUNGS_MODULUS = Parameter("youngs_modulus", "E", "E", QUANTITIES["modulus"], typical=1e6)
POISSONS_RATIO = Parameter("poissons_ratio", "nu", "ν", QUANTITIES["Poisson's ratio"], typical=0.45)


def poissons_ratio(lower: float, **others: Any) -> Parameter:
    """Poisson's ratio of a law that needs it above a value, where `neo-hooke-isochoric` does not; others: of its
    `Quantity`.
    """
    quantity = replace(POISSONS_RATIO.quantity, lower=lower, attempt_below="law neo-hooke-isochoric", **others)
    return replace(POISSONS_RATIO, quantity=quantity)


# Paper A, Eqs. (2) and (3).
SHEAR_MODULUS = "E/(2*(1 + nu))"
LAME_MODULUS = "E*nu/((1 + nu)*(1 - 2*nu))"
BULK_MODULUS = "E/(3*(1 - 2*nu))"

# The constants of linearly elastic parts, such as rods.
LINEAR_ELASTIC = (YOUNGS_MODULUS, POISSONS_RATIO)
