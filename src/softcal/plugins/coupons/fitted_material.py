"""A material as coupon tests found it, and what it predicts of further tests, with 95 % bands.

The band of a further specimen has the covariance of the constants, the differences between the specimens where they
show, and the noise of the tests of that kind that were fitted: as those of `softcal.calibration.statistics.band`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.calibration.statistics.estimator import Estimator
from softcal.calibration.statistics.intervals import student
from softcal.checks import Floats
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import FreeConstants
from softcal.plugins.coupons.history_response import response_of


@dataclass(frozen=True)
class PredictedCoupon:
    """The prediction of a material for a test.

    Attributes
    ----------
    coupon
        The test; its stresses are NaN where none were measured.
    stress
        Predicted nominal stresses (n, k) [Pa].
    half
        Half the width of the 95 % band (n, k) [Pa]; NaN where the constants have no intervals.
    """

    coupon: Coupon
    stress: Floats
    half: Floats

    @property
    def is_measured(self) -> bool:
        """Whether any stress was measured."""
        return bool(self.coupon.measured.any())

    @property
    def error(self) -> float:
        """Root-mean-square error over the root mean square of the measured stresses [-]."""
        predicted, measured = self._pairs
        return math.sqrt(_over(np.square(predicted - measured).sum(), np.square(measured).sum()))

    @property
    def nmad(self) -> float:
        """Mean of |predicted - measured|, over the larger one of mean |measured| and mean |predicted| [-]."""
        return _nmad(*self._pairs)

    @property
    def factor(self) -> float:
        """The factor of the predicted stresses that would fit best: of a specimen whose size or stiffness differs."""
        predicted, measured = self._pairs
        return _over(float(predicted @ measured), float(predicted @ predicted))

    @property
    def nmad_by_factor(self) -> float:
        """The same deviation with that factor [-]."""
        predicted, measured = self._pairs
        with np.errstate(invalid="ignore"):
            return _nmad(self.factor * predicted, measured)

    @property
    def inside(self) -> float:
        """Share of the measured stresses within the band [-]; NaN without a band."""
        missed, half = np.abs(self.stress - self.coupon.stress)[self.coupon.measured], self.half[self.coupon.measured]
        return float(np.mean(missed <= half)) if np.isfinite(half).all() else math.nan

    @property
    def _pairs(self) -> tuple[Floats, Floats]:
        return self.stress[self.coupon.measured], self.coupon.stresses


def _nmad(predicted: Floats, measured: Floats) -> float:
    size = max(float(np.abs(measured).mean()), float(np.abs(predicted).mean()))
    return _over(np.abs(predicted - measured).mean(), size)


def _over(part: float, whole: float) -> float:
    """A ratio, infinite where there is nothing to compare with."""
    return float(part) / float(whole) if whole else math.inf


@dataclass(frozen=True)
class FittedMaterial:
    """A law and a history with constants that tests found.

    Attributes
    ----------
    constants
        The law, its history, and which constants are fitted.
    values
        The fitted constants (size,) [SI].
    covariance
        Theirs (size, size) [SI]; None where they have no intervals.
    spread
        How far specimens differ in each constant (size,) [SI]; zero where that does not show.
    dof
        Degrees of freedom of that spread [-]; infinite where none shows.
    noise
        Kind of test that was fitted -> standard deviation of its stresses [Pa].
    """

    constants: FreeConstants
    values: Floats
    covariance: Floats | None
    spread: Floats
    dof: float
    noise: Mapping[str, float]

    def predict(self, coupon: Coupon) -> PredictedCoupon:
        """The stresses along the strains and times of a test."""
        response = response_of(self.constants, coupon)
        stress = response.stress(self.values)
        if self.covariance is None:
            return PredictedCoupon(coupon, stress, np.full_like(stress, np.nan))
        slopes = response.by_constants(self.values)
        variance = np.einsum("nki,ij,nkj->nk", slopes, self.covariance, slopes)
        variance += np.square(slopes * self.spread).sum(axis=-1) + self.noise.get(coupon.test, 0.0) ** 2
        return PredictedCoupon(coupon, stress, float(student(np.array([self.dof]))[0]) * np.sqrt(variance))


def fitted_material(
    constants: FreeConstants, values: Floats, found: Estimator, slopes: Floats, *, has_intervals: bool
) -> FittedMaterial:
    """The material of a fit.

    Parameters
    ----------
    constants
        The constants that were fitted, and their law.
    values
        Their values (size,) [SI].
    found
        Estimator of the fit in the unit box.
    slopes
        d constant / d z (size,) [SI] there.
    has_intervals
        Every fitted constant has an interval.
    """
    differing = [one for one in found.between if one.effects.differs]
    spread = np.zeros(len(values))
    for one in differing:
        spread[one.column] = one.effects.spread * abs(slopes[one.column])
    return FittedMaterial(
        constants,
        values,
        found.within_bounds * np.outer(slopes, slopes) if has_intervals else None,
        spread,
        min((float(one.effects.dof) for one in differing), default=math.inf),
        {test: noise.size for test, noise in found.noise.items()},
    )
