"""A law fitted to coupon tests: its constants with 95 % intervals, its errors, and where it is stable."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.sensitivity import Statistics, local_estimator, local_statistics
from softcal.checks import Floats, ReadOnly
from softcal.display import displayed
from softcal.materials.law import Law
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.fitted_material import FittedMaterial, PredictedCoupon, fitted_material
from softcal.plugins.coupons.free_constants import FreeConstants
from softcal.plugins.coupons.history_search import best_values
from softcal.plugins.coupons.problem import CouponLoss, CouponProblem, coupon_loss
from softcal.plugins.coupons.stability import Stability, stability


@displayed
@dataclass(frozen=True)
class LawFit(ReadOnly):
    """A law with the constants that fit coupon tests best.

    Attributes
    ----------
    constants
        The law, and which of its constants are fitted.
    space
        The bounds of the fit.
    values
        The fitted constants (size,) [SI].
    theta
        All constants [SI] by name.
    predicted
        The nominal stresses [Pa] of each test, shape (n, k) each.
    errors
        Kind of test -> root-mean-square error over the root mean square of its nominal stresses [-].
    error
        The same over all kinds: the root of the mean square of their rows [-].
    aic
        Akaike's information criterion with the correction for few rows [-].
    statistics
        Standard errors, intervals and notes; see `local_statistics`.
    stability
        Where the law is stable.
    material
        What predicts further tests.
    """

    constants: FreeConstants
    space: SearchSpace
    values: Floats
    theta: Mapping[str, float]
    predicted: tuple[Floats, ...]
    errors: Mapping[str, float]
    error: float
    aic: float
    statistics: Statistics
    stability: Stability
    material: FittedMaterial

    @property
    def law(self) -> Law:
        """The law."""
        return self.constants.law

    def tests(self, coupons: Sequence[Coupon]) -> list[PredictedCoupon]:
        """The predictions of tests by the law, with bands."""
        return [self.material.predict(coupon) for coupon in coupons]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The fitted constants by name."""
        return self.statistics.estimates(self.space, self.theta)

    @property
    def small_strain(self) -> SmallStrain:
        """Its moduli at small strain."""
        return small_strain(self.material, self.estimates)

    @property
    def is_determined(self) -> bool:
        """Whether the tests determine every fitted constant: each has an interval, or all tests are fitted exactly, and
        none is at its bound.
        """
        found = self.estimates.values()
        return all((one.interval is not None or self.statistics.is_exact) and not one.at_bound for one in found)


def fit_law(constants: FreeConstants, coupons: Sequence[Coupon], reach: float) -> LawFit:
    """Fit a law to coupon tests.

    Parameters
    ----------
    constants
        The constants to fit, and their law.
    coupons
        The tests.
    reach
        Stretch [-] up to which the law's stability is looked at.

    Raises
    ------
    CalibrationError
        Where the law's energy does not exist at the measured strains.
    """
    problem = CouponProblem(constants, coupons, coupon_loss(coupons))
    values = best_values(problem)
    constants, coupons = problem.constants, problem.coupons
    residuals, predicted = problem.residuals(values), tuple(problem.stresses(values))
    theta = constants.theta(values)
    fitted = {name: theta[name] for name in constants.names}
    space = problem.space_near(values)
    blocks, z = problem.blocks(values), np.clip(space.to_search(fitted), 0.0, 1.0)
    found = local_estimator(space, problem.loss, z, blocks)
    statistics = local_statistics(space, problem.loss, fitted, blocks, found=found)
    has_intervals = all(ends is not None for ends in statistics.intervals.values())
    # Akaike's criterion of independent errors of one size: that size counts as a parameter. Infinite with too few rows.
    n, k, aic = len(residuals), len(values) + 1, math.inf
    if n - k - 1 > 0:
        aic = n * math.log(max(float(residuals @ residuals), 1e-300) / n) + 2 * k + 2 * k * (k + 1) / (n - k - 1)
    return LawFit(
        constants,
        space,
        values,
        theta,
        predicted,
        relative_errors(problem.loss, coupons, predicted),
        math.sqrt(float(residuals @ residuals) / len(residuals)),
        aic,
        statistics,
        stability(constants, values, coupons, reach),
        fitted_material(constants, values, found, space.jacobian(z), has_intervals=has_intervals),
    )


def relative_errors(loss: CouponLoss, coupons: Sequence[Coupon], predicted: Sequence[Floats]) -> dict[str, float]:
    """Kind of test -> root-mean-square error of its predicted stresses over its scale [-].

    Parameters
    ----------
    loss
        The loss of the fit, which has the scales of the stresses.
    coupons
        The tests.
    predicted
        Nominal stresses (n, k) [Pa] of each test by the law.
    """
    squares: dict[str, list[Floats]] = {}
    for coupon, stress in zip(coupons, predicted, strict=True):
        squares.setdefault(coupon.test, []).append(
            np.square((stress - coupon.stress) / loss.scales[coupon.test]).ravel()
        )
    return {test: math.sqrt(float(np.concatenate(parts).mean())) for test, parts in squares.items()}


STEP = 1e-6  # of a constant, for a central difference


@displayed
@dataclass(frozen=True)
class SmallStrain:
    """Moduli at small strain of a fitted law: what rods use, and what laws are compared by.

    Poisson's ratio is stated, so both moduli are one estimate, and their intervals have the same relative width.

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
