"""The error of a law on tests that it was not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Ints
from softcal.errors import CalibrationError
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.history_response import response_of
from softcal.plugins.coupons.history_search import best_values
from softcal.plugins.coupons.law_fit import LawFit
from softcal.plugins.coupons.problem import CouponProblem, coupon_loss, stress_scales

BLOCKS = 5  # of a record, where there is one kind of test


@dataclass(frozen=True)
class Fold:
    """Tests that are held out together: name, remaining tests, and tests held out."""

    name: str
    kept: tuple[Coupon, ...]
    held_out: tuple[Coupon, ...]


def folds(coupons: Sequence[Coupon], *, has_history: bool = False) -> list[Fold]:
    """Each kind of test held out in turn; where there is one kind, neighbouring blocks of its rows.

    With a history each test is held out in turn, at its own rates; of one test the stresses of neighbouring rows, on
    the whole way.
    """
    if has_history:
        if len(coupons) > 1:
            return [
                Fold(f"{one.test} test of {one.name}", tuple(c for c in coupons if c is not one), (one,))
                for one in coupons
            ]
        (one,) = coupons
        inside = [_blocks(one) == k for k in range(BLOCKS)]
        return [
            Fold(f"block {k + 1} of {BLOCKS}", (one.measured_at(~own),), (one.measured_at(own),))
            for k, own in enumerate(inside)
        ]
    tests = list(dict.fromkeys(coupon.test for coupon in coupons))
    if len(tests) > 1:
        return [
            Fold(test, tuple(c for c in coupons if c.test != test), tuple(c for c in coupons if c.test == test))
            for test in tests
        ]
    found: list[Fold] = []
    for k in range(BLOCKS):
        inside = [_blocks(c) == k for c in coupons]
        pairs = list(zip(coupons, inside, strict=True))
        kept, held_out = tuple(c.rows(~own) for c, own in pairs), tuple(c.rows(own) for c, own in pairs if own.any())
        found.append(Fold(f"block {k + 1} of {BLOCKS}", kept, held_out))
    return found


def _blocks(coupon: Coupon) -> Ints:
    """The block of each row."""
    return np.arange(len(coupon.strain)) * BLOCKS // len(coupon.strain)


def held_out_errors(fit: LawFit, coupons: Sequence[Coupon]) -> dict[str, float]:
    """Fold -> root-mean-square error of the stresses held out, over the root mean square of all stresses of their kind
    [-]; infinite where the law's energy does not exist there.
    """
    scales = stress_scales(coupons)
    found: dict[str, float] = {}
    for fold in folds(coupons, has_history=bool(fit.constants.parts)):
        problem = CouponProblem(fit.constants, fold.kept, coupon_loss(fold.kept))
        try:
            values = best_values(problem, fit.values)
        except CalibrationError:
            found[fold.name] = math.inf
            continue
        missed = [
            (response_of(fit.constants, c).stress(values) - c.stress)[c.measured] / scales[c.test]
            for c in fold.held_out
        ]
        square = float(np.square(np.concatenate(missed)).mean())
        found[fold.name] = math.sqrt(square) if math.isfinite(square) else math.inf
    return found


def joint_error(errors: Sequence[float]) -> float:
    """Root mean square over the folds."""
    return math.sqrt(sum(error**2 for error in errors) / len(errors))
