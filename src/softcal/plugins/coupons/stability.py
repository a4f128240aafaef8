"""Range of stability of a law that was fitted to coupons, by Drucker's criterion (`materials/drucker.py`).

Three modes are looked at: uniaxial compression is equibiaxial tension, and the other way round. The measured strains of
one mode are compared with those of another by their size, the root of the sum of the squared logarithmic strains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.materials.drucker import is_stable
from softcal.materials.law import compile_law
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import FreeConstants
from softcal.plugins.coupons.kind import KINDS

# Mode -> its principal logarithmic strains, where the first one is 1.
MODES = {"uniaxial": (1.0, -0.5, -0.5), "planar": (1.0, 0.0, -1.0), "equibiaxial": (1.0, 1.0, -2.0)}
_STATES = 400  # of a mode


@dataclass(frozen=True)
class Stability:
    """The range of stability of a law.

    Attributes
    ----------
    measured
        Mode -> the stretch [-] with the size of the largest measured strain.
    reach
        The largest stretch that was looked at [-].
    limits
        Mode -> the stretch [-] from which the law is unstable; None where it is stable up to `reach`.
    in_tests
        Whether it is stable in every measured state.
    """

    measured: Mapping[str, float]
    reach: float
    limits: Mapping[str, float | None]
    in_tests: bool

    @property
    def is_stable(self) -> bool:
        """Whether the law is stable in every measured state, and in every mode up to strains of their size."""
        limits = self.limits.items()
        return self.in_tests and all(limit is None or limit > self.measured[mode] for mode, limit in limits)


def stability(constants: FreeConstants, values: Floats, coupons: Sequence[Coupon], reach: float) -> Stability:
    """The range of stability of the law at the values of its fitted constants.

    Parameters
    ----------
    constants
        The fitted constants, and their law.
    values
        Their values (size,) [SI].
    coupons
        The tests.
    reach
        Stretch [-] up to which to look; the largest measured one where that is larger.
    """
    stretches: list[Floats] = [np.linalg.svd(c.states.points.F, compute_uv=False).astype(float) for c in coupons]
    size = max(float(np.linalg.norm(np.log(one), axis=1).max()) for one in stretches)
    measured = {mode: float(np.exp(size / np.linalg.norm(direction))) for mode, direction in MODES.items()}
    reach = max(reach, *measured.values())
    law, ordered = compile_law(constants.law), constants.ordered(values)
    limits: dict[str, float | None] = {}
    for mode in MODES:
        # The stretch of the size that was measured is one of the states.
        stretch = np.sort(np.append(np.linspace(1.0, reach, _STATES), measured[mode]))
        F = KINDS[mode].states(stretch[:, None]).points.F
        unstable = ~is_stable(law, ordered, F[:, 0, 0], F[:, 1, 1])
        limits[mode] = float(stretch[np.argmax(unstable)]) if unstable.any() else None
    in_tests = all(is_stable(law, ordered, one[:, 0], one[:, 1]).all() for one in stretches)
    return Stability(measured, reach, limits, in_tests)
