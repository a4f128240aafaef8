"""Drucker's stability of a law in an incompressible body.

With the third side free of stress, the Kirchhoff stresses tau_i = lambda_i^2 S_i - lambda3^2 S_3 change with the
logarithmic strains of the other two sides by a symmetric matrix (2, 2). The law is stable where that matrix is positive
definite: more strain in any direction then takes more stress. For an isotropic law this is the convexity of its energy
in the logarithmic strain (Hill, Proc. R. Soc. Lond. A 314, 1970), so that no shear need be looked at by itself.

Three modes are looked at: uniaxial compression is equibiaxial tension, and the other way round. The measured strains of
one mode are compared with those of another by their size, the root of the sum of the squared logarithmic strains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.coupons.coupon import Coupon
from softcal.coupons.free_constants import FreeConstants
from softcal.coupons.kind import KINDS, principal_states
from softcal.materials.law import compile_law
from softcal.materials.stress_at import Deformation

# Mode -> its principal logarithmic strains, where the first one is 1.
MODES = {"uniaxial": (1.0, -0.5, -0.5), "planar": (1.0, 0.0, -1.0), "equibiaxial": (1.0, 1.0, -2.0)}
_STATES = 400  # of a mode
_ROUNDING = 1e-12  # of the largest stiffness


@dataclass(frozen=True)
class Stability:
    """Where a law is stable.

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
    """Where the law is stable at the values of its fitted constants; reach: the stretch up to which to look, or the
    largest measured one where that is larger.
    """
    stretches: list[Floats] = [np.linalg.svd(c.states.points.F, compute_uv=False).astype(float) for c in coupons]
    size = max(float(np.linalg.norm(np.log(one), axis=1).max()) for one in stretches)
    measured = {mode: float(np.exp(size / np.linalg.norm(direction))) for mode, direction in MODES.items()}
    reach = max(reach, *measured.values())
    limits: dict[str, float | None] = {}
    for mode in MODES:
        # The stretch of the size that was measured is one of the states.
        stretch = np.sort(np.append(np.linspace(1.0, reach, _STATES), measured[mode]))
        F = KINDS[mode].states(stretch[:, None]).points.F
        unstable = ~is_stable(constants, values, F[:, 0, 0], F[:, 1, 1])
        limits[mode] = float(stretch[np.argmax(unstable)]) if unstable.any() else None
    in_tests = all(is_stable(constants, values, one[:, 0], one[:, 1]).all() for one in stretches)
    return Stability(measured, reach, limits, in_tests)


def is_stable(constants: FreeConstants, values: Floats, first: Floats, second: Floats) -> np.ndarray:
    """Whether the law is stable at stretches (n,) along two axes; not where its energy does not exist."""
    with np.errstate(all="ignore"):
        sizes = np.linalg.eigvalsh(np.nan_to_num(stiffness(constants, values, first, second), nan=-1.0))
    return sizes[:, 0] > -_ROUNDING * np.abs(sizes).max(axis=1)


def stiffness(constants: FreeConstants, values: Floats, first: Floats, second: Floats) -> Floats:
    """Change of the Kirchhoff stresses along two axes by the logarithmic strains along them (n, 2, 2) [Pa]."""
    at = principal_states(first, second, 2).points
    squares = np.einsum("nii->ni", at.F) ** 2
    stress = Deformation(compile_law(constants.law), at).stress(constants.ordered(values))
    # d(lambda_i^2 S_i) by each ln lambda_j, of all three sides; the third follows the other two.
    whole = squares[:, :, None] * stress.D[:, :3, :3] * squares[:, None, :]
    whole += 2.0 * (squares * stress.S[:, :3])[:, :, None] * np.eye(3)
    apart = whole[:, :2] - whole[:, 2:]
    return apart[:, :, :2] - apart[:, :, 2:]
