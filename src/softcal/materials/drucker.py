"""Drucker's stability of a law at constant volume: more strain, in any direction, takes more stress.

With the third side free of stress, the Kirchhoff stresses tau_i = lambda_i^2 S_i - lambda3^2 S_3 change with the
logarithmic strains of the other two sides by a symmetric matrix (2, 2). The law is stable where that matrix is positive
definite. For an isotropic law this is the convexity of its energy in the logarithmic strain (Hill, Proc. R. Soc. Lond.
A 314, 1970), so that no shear need be looked at by itself.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.materials.law import CompiledLaw
from softcal.materials.stress_at import Deformation, points

_ROUNDING = 1e-12  # of the largest stiffness


def is_stable(law: CompiledLaw, values: tuple[float, ...], first: Floats, second: Floats) -> np.ndarray:
    """Whether the law is stable at stretches along two axes (n,); not where its energy does not exist.

    Parameters
    ----------
    law
        The law.
    values
        Values of its constants, in their order [SI].
    first, second
        Stretches along two axes (n,) [-].
    """
    with np.errstate(all="ignore"):
        sizes = np.linalg.eigvalsh(np.nan_to_num(stiffness(law, values, first, second), nan=-1.0))
    return sizes[:, 0] > -_ROUNDING * np.abs(sizes).max(axis=1)


def stiffness(law: CompiledLaw, values: tuple[float, ...], first: Floats, second: Floats) -> Floats:
    """Change of the Kirchhoff stresses along two axes by the logarithmic strains along them (n, 2, 2) [Pa].

    Parameters
    ----------
    law
        The law.
    values
        Values of its constants, in their order [SI].
    first, second
        Stretches along two axes (n,) [-].
    """
    stretches = np.stack([first, second, 1.0 / (first * second)], axis=1)
    squares = stretches**2
    stress = Deformation(law, points(stretches[:, :, None] * np.eye(3))).stress(values)
    # d(lambda_i^2 S_i) by each ln lambda_j, of all three sides; the third follows the other two.
    whole = squares[:, :, None] * stress.D[:, :3, :3] * squares[:, None, :]
    whole += 2.0 * (squares * stress.S[:, :3])[:, :, None] * np.eye(3)
    apart = whole[:, :2] - whole[:, 2:]
    return apart[:, :, :2] - apart[:, :, 2:]
