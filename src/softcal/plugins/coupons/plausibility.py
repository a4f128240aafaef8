"""Coupon tests that are not likely to be what their columns say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softcal.errors import DatasetError, Fault
from softcal.materials.neo_hooke import NEO_HOOKE_ISOCHORIC
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.kind import LawResponse

_MODERATE = 2.5  # largest stretch up to which rubber-like bodies are nearly neo-Hookean
_APART = 1.3  # stretch that a test must reach for true and nominal stresses to differ enough to be told apart
_FEWEST = 5  # rows
_NEVER_AT_REST = 1.9  # stretch of a body at rest that is read as a strain, with some room
_FITS, _BETTER = 0.08, 3.0  # error of what the other measure would be, and the stated one's error over it


def require_signs(coupons: Sequence[Coupon], path: Path) -> None:
    """Check that stresses have the sign of the strains: the work in extension, and that in compression, is above zero.

    path: of the file that they are from.

    Raises
    ------
    DatasetError
        With every test in which it is not.
    """
    faults: list[Fault] = []
    for coupon in coupons:
        rest = coupon.kind.at_rest
        work = ((coupon.strain - rest) * np.nan_to_num(coupon.stress)).sum(axis=1)
        for side, what in ((1.0, "extension"), (-1.0, "compression")):
            own = side * (coupon.strain[:, 0] - rest) > 0.0
            if own.any() and work[own].sum() < 0.0:
                faults.append(
                    Fault(
                        f"the stresses in {what} have the wrong sign",
                        f"{path}, specimen '{coupon.name}'",
                        allowed="stresses above zero in extension, below zero in compression",
                    )
                )
    if faults:
        raise DatasetError(faults)


def implausible(coupons: Sequence[Coupon]) -> list[str]:
    """A sentence for every test whose nominal and true stresses, or stretches and strains, seem to be mixed up.

    Up to a moderate stretch elastomers are nearly neo-Hookean. A test that is so only if its stresses are taken for the
    other measure is suspicious.
    """
    found: list[str] = []
    for coupon in coupons:
        if coupon.test != "shear" and (least := float(coupon.strain.min(initial=math.inf))) >= _NEVER_AT_REST:
            found.append(
                f"{coupon.name}: the least stretch is {least:.3g}: are these stretches, or per cent, that were read as "
                "strains?"
            )
        small = (coupon.strain < _MODERATE) & (coupon.strain > 1 / _MODERATE) & coupon.measured
        moderate = np.all(small, axis=1)
        if coupon.test == "shear" or moderate.sum() < _FEWEST or coupon.strain[moderate].max() < _APART:
            continue
        near = coupon.rows(np.asarray(moderate))
        error = _misfit(near, near.stress)
        as_true, as_nominal = _misfit(near, near.stress / near.strain), _misfit(near, near.stress * near.strain)
        for other, was, might in ((as_true, "nominal", "true"), (as_nominal, "true", "nominal")):
            if other < _FITS and error > _BETTER * other:
                found.append(
                    f"{coupon.name}: taken for {might} stresses where they were read as {was} ones, these numbers "
                    f"would be those of a neo-Hookean body within {100 * other:.1f} % up to a stretch of "
                    f"{near.strain.max():.2g}; as they are, within {100 * error:.0f} %. Check which stress was "
                    "measured."
                )
    return found


def _misfit(coupon: Coupon, stress: np.ndarray) -> float:
    """Error of a neo-Hookean body, over the root mean square of the stresses [-]."""
    theta = {"youngs_modulus": 1.0, "poissons_ratio": 0.5}
    law = NEO_HOOKE_ISOCHORIC
    unit = LawResponse(law, coupon.states).stress(tuple(np.float64(theta[name]) for name in law.names))
    factor = float((unit * stress).sum() / (unit * unit).sum())
    return math.sqrt(float(np.square(factor * unit - stress).sum() / np.square(stress).sum()))
