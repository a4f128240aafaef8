"""A record of a coupon test: strains and nominal stresses in SI, by specimen."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.coupons.kind import KINDS, CouponKind, CouponStates


@dataclass(frozen=True)
class Coupon:
    """One test of one specimen, in the order of its strains.

    Attributes
    ----------
    name
        The specimen, or the file where it names none.
    test
        The kind of test, of `KINDS`.
    strain
        Stretches along the measured axes, or the amount of shear, shape (n, k) [-].
    stress
        Nominal stresses (n, k) [Pa].
    """

    name: str
    test: str
    strain: Floats
    stress: Floats

    @property
    def kind(self) -> CouponKind:
        """Its kind of test."""
        return KINDS[self.test]

    @cached_property
    def states(self) -> CouponStates:
        """Its states."""
        return self.kind.states(self.strain)

    @cached_property
    def largest_stretch(self) -> float:
        """The largest principal stretch [-]."""
        return float(np.linalg.svd(self.states.points.F, compute_uv=False).max())

    def rows(self, kept: np.ndarray) -> Coupon:
        """Some of its rows."""
        return Coupon(self.name, self.test, self.strain[kept], self.stress[kept])
