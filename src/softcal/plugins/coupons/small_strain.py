"""The moduli at small strain of a law that coupon tests were fitted by: what rods use, and what laws are compared by.

Poisson's ratio is stated, so both moduli are one estimate, and their intervals have the same relative width.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from softcal.calibration.statistics.estimate import Estimate
from softcal.checks import Floats
from softcal.display import displayed
from softcal.plugins.coupons.fitted_material import FittedMaterial

STEP = 1e-6  # of a constant, for a central difference


@displayed
@dataclass(frozen=True)
class SmallStrain:
    """Moduli at small strain.

    Attributes
    ----------
    youngs_modulus
        [Pa]
    interval
        Its ends at 95 % [Pa]; None where a constant has no interval.
    poissons_ratio
        As stated [-].
    shear_modulus
        [Pa]
    formula
        The shear modulus by the constants of the law.
    """

    youngs_modulus: float
    interval: tuple[float, float] | None
    poissons_ratio: float
    shear_modulus: float
    formula: str


def small_strain(material: FittedMaterial, estimates: dict[str, Estimate]) -> SmallStrain:
    """The moduli of a fitted law; with a history, those after a long time."""
    constants, values = material.constants, material.values
    law, theta = constants.law, constants.theta(values)

    def modulus(at: Floats) -> float:
        return law.youngs_modulus(constants.theta(at))

    ends = [None if one.at_bound else one.interval for one in estimates.values()]
    half = [0.5 * (one[1] - one[0]) for one in ends if one is not None]
    E, interval = modulus(values), None
    if material.covariance is not None and len(half) == len(values):
        sd = np.sqrt(np.diag(material.covariance))
        steps = STEP * np.maximum(np.abs(values), sd)
        slopes = [(modulus(values + dx) - modulus(values - dx)) / (2.0 * dx.sum()) for dx in np.diag(steps)]
        # The intervals of the constants, correlated as these are: of one constant its own.
        sizes = np.array(slopes) * half / sd
        width = float(np.sqrt(sizes @ material.covariance @ sizes))
        # Even in the logarithm, as those of moduli are.
        share = float(np.arcsinh(width / E))
        interval = (E * math.exp(-share), E * math.exp(share))
    return SmallStrain(E, interval, law.poissons_ratio(theta), law.shear_modulus(theta), law.shear_formula)
