"""A record of a coupon test: strains and nominal stresses in SI, by specimen, and the times where they are known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from softcal.arrays import Array, Series
from softcal.checks import Floats
from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError, unknown
from softcal.plugins.coupons.kind import KINDS, CouponKind, CouponStates


@displayed
@dataclass(frozen=True)
class Coupon(Checked):
    """One test of one specimen: with times a way in their order, else in the order of the file.

    Attributes
    ----------
    name
        The specimen, or the file where it names none.
    test
        The kind of test, of `KINDS`.
    strain
        Stretches along the measured axes, or the amount of shear, shape (n, k) [-].
    stress
        Nominal stresses (n, k) [Pa]; NaN where none was measured.
    time
        Times (n,) [s] since the specimen was at rest; None where they are not known.
    """

    name: str
    test: str
    strain: Annotated[Floats, Array((None, None))]
    stress: Annotated[Floats, Array((None, None), missing=True)]
    time: Series | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.test not in KINDS:
            raise InputError(unknown("there is no such kind of test", "test", self.test, KINDS))
        if len({len(one) for one in (self.strain, self.stress, self.time) if one is not None}) != 1:
            got = f"{len(self.strain)} strains, {len(self.stress)} stresses"
            got += "" if self.time is None else f", {len(self.time)} times"
            raise InputError(Fault("a coupon needs arrays of one length", self.name, got))
        if self.time is not None and not (np.diff(self.time, prepend=0.0) >= 0.0).all():
            allowed = "times from 0 on that do not go back"
            raise InputError(Fault("the times of a coupon are not in order", self.name, str(self.time), allowed))

    @property
    def kind(self) -> CouponKind:
        """The kind of test."""
        return KINDS[self.test]

    @cached_property
    def states(self) -> CouponStates:
        """States of the material at the measured strains."""
        return self.kind.states(self.strain)

    @cached_property
    def largest_stretch(self) -> float:
        """The largest principal stretch [-]."""
        return float(np.linalg.svd(self.states.points.F, compute_uv=False).max())

    @cached_property
    def measured(self) -> np.ndarray:
        """True where a stress was measured (n, k)."""
        return np.isfinite(self.stress)

    @property
    def stresses(self) -> Floats:
        """The measured stresses, one after the other [Pa]."""
        return self.stress[self.measured]

    def rows(self, kept: np.ndarray) -> Coupon:
        """The coupon with some of its rows, without times, since these rows are no path in time."""
        return Coupon(self.name, self.test, self.strain[kept], self.stress[kept])

    def along_strain(self) -> Coupon:
        """The coupon with its rows in ascending order of strain."""
        return self.rows(np.lexsort(self.strain.T[::-1]))

    def coarser(self, most: int) -> Coupon:
        """The coupon with at most so many rows at equal intervals, and the last row."""
        n = len(self.strain)
        kept = np.unique(np.append(np.arange(0, n, -(-n // most)), n - 1))
        time = None if self.time is None else self.time[kept]
        return replace(self, strain=self.strain[kept], stress=self.stress[kept], time=time)

    def measured_at(self, kept: np.ndarray) -> Coupon:
        """The coupon with all rows and times, but with the stresses of some rows only."""
        return replace(self, stress=np.where(kept[:, None], self.stress, np.nan))
