"""A law and coupon tests as a problem of least squares, with exact derivatives by the law's constants.

The loss is the sum of squares of the nominal stresses' errors, those of each kind of test over the root mean square of
its stresses, so that a kind with small stresses counts as much as one with large ones. The search for the constants is
in `search.py`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from softcal.calibration.problem.loss import Block, SumOfSquares, rms
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.checks import Floats
from softcal.materials.law import Law
from softcal.materials.neo_hooke import NEO_HOOKE_ISOCHORIC
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import FreeConstants
from softcal.plugins.coupons.history_response import response_of
from softcal.plugins.coupons.kind import LawResponse

_LARGE = 1e3


@dataclass(frozen=True)
class CouponLoss(SumOfSquares):
    """sum (residual / scale)^2; scales: kind of test -> root mean square of its nominal stresses [Pa]."""

    scales: Mapping[str, float] = field(default_factory=dict[str, float])
    name: str = "coupons"

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return np.full(len(residual), self.scales[self.noise_group(block)] ** -2)

    def noise_group(self, block: Block) -> str:
        return block.channel.split()[0]


def coupon_loss(coupons: Sequence[Coupon]) -> CouponLoss:
    """The loss of some coupons."""
    return CouponLoss(scales=stress_scales(coupons))


def stress_scales(coupons: Sequence[Coupon]) -> dict[str, float]:
    """Kind of test -> root mean square of its nominal stresses [Pa]."""
    tests = dict.fromkeys(coupon.test for coupon in coupons)
    return {test: rms(np.concatenate([c.stresses for c in coupons if c.test == test])) for test in tests}


def apparent_modulus(coupons: Sequence[Coupon]) -> float:
    """The shear modulus [Pa] of the neo-Hookean body that is nearest to the stresses."""
    theta = {"youngs_modulus": 3.0, "poissons_ratio": 0.5}
    values = tuple(np.float64(theta[name]) for name in NEO_HOOKE_ISOCHORIC.names)
    unit = np.concatenate([LawResponse(NEO_HOOKE_ISOCHORIC, c.states).stress(values)[c.measured] for c in coupons])
    measured = np.concatenate([coupon.stresses for coupon in coupons])
    return float(abs(unit @ measured) / (unit @ unit))


class CouponProblem:
    """A law's constants to be found from coupons."""

    def __init__(self, constants: FreeConstants, coupons: Sequence[Coupon], loss: CouponLoss) -> None:
        self.constants, self.coupons, self.loss = constants, tuple(coupons), loss
        self._responses = [response_of(constants, coupon) for coupon in coupons]
        self._weights = [1.0 / loss.scales[coupon.test] for coupon in coupons]

    @property
    def law(self) -> Law:
        """The law."""
        return self.constants.law

    @cached_property
    def space(self) -> SearchSpace:
        """The fitted constants and their bounds."""
        return self.constants.space(apparent_modulus(self.coupons))

    def space_near(self, values: Floats) -> SearchSpace:
        """The same near some values (size,), no wider than any test could leave a constant: within it a constant of
        either sign changes all stresses by `_LARGE` times their size. So the constants of terms that grow fast and
        those of slow ones have ranges of like effect.
        """
        size = np.linalg.norm(self.jacobian(values), axis=0) / math.sqrt(sum(c.stresses.size for c in self.coupons))
        near: list[FreeParameter] = []
        for p, value, effect in zip(self.space.parameters, values.tolist(), size.tolist(), strict=True):
            wide = _LARGE / max(effect, 1e-300)
            linear = replace(p, lower=max(p.lower, value - wide), upper=min(p.upper, value + wide))
            near.append(p if p.scale == "log" else linear)
        return SearchSpace(tuple(near))

    def residuals(self, values: Floats) -> Floats:
        """Errors of all stresses, over their scale (m,)."""
        parts = [
            (response.stress(values) - coupon.stress)[coupon.measured] * weight
            for response, coupon, weight in zip(self._responses, self.coupons, self._weights, strict=True)
        ]
        return np.concatenate(parts)

    def jacobian(self, values: Floats) -> Floats:
        """Their derivatives by the fitted constants (m, size)."""
        parts = [
            response.by_constants(values)[coupon.measured] * weight
            for response, coupon, weight in zip(self._responses, self.coupons, self._weights, strict=True)
        ]
        return np.concatenate(parts)

    def stresses(self, values: Floats) -> list[Floats]:
        """The nominal stresses (n, k) [Pa] of each coupon."""
        return [response.stress(values) for response in self._responses]

    def blocks(self, values: Floats) -> list[Block]:
        """A block for each stress of each coupon, with derivatives by the fitted constants."""
        found: list[Block] = []
        for response, coupon in zip(self._responses, self.coupons, strict=True):
            residual, slopes = response.stress(values) - coupon.stress, response.by_constants(values)
            for k, stress in enumerate(coupon.kind.components):
                channel = f"{coupon.test} {stress}"
                found.append(Block(coupon.name, channel, coupon.stress[:, k], residual[:, k], jacobian=slopes[:, k]))
        return found
