"""The flexibility of a rod's elements: of all between their ends, straight or curved at rest, of any section.

    S^-1 = Z int_0^L B(s)^T diag(1/kGA, 1/kGA, 1/EA, 1/EI1, 1/EI2, 1/GJ) B(s) ds Z^T

with B(s) what equilibrium makes of a wrench at the middle on the way along the rod at rest (MacNeal's residual bending
flexibility, and its counterpart for curved rods), and Z the step from the middle's twist to the coordinates (rho,
theta) of `rod.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from softcal.checks import Floats
from softcal.geometry.section import CrossSection, SectionConstants

# Gauss points for an element's flexibility and terms of the exponential: enough for the last digits while an element
# turns by less than pi.
N_GAUSS = 8
N_SERIES = 28


def flexibility(section: CrossSection, shares: Floats, xi: Floats, length: Floats) -> tuple[Floats, Floats, Floats]:
    """E times the elements' flexibility (n, 6, 6): what does not depend on Poisson's ratio, and what goes with 1 + nu;
    and the elements' mean areas (n,) [m^2].

    Parameters
    ----------
    section
        The rod's section.
    shares
        Shares of the rod's arc length, at both ends of each element (n, 2) [-].
    xi
        Coordinates (rho, theta) of the elements at rest (n, 6) [m; rad].
    length
        Their lengths (n,) [m].
    """
    X = _bracket(xi)
    parts, area = np.zeros((2, len(xi), 6, 6)), np.zeros(len(xi))
    for point, weight in zip(*np.polynomial.legendre.leggauss(N_GAUSS), strict=True):
        here = shares @ [0.5 - 0.5 * point, 0.5 + 0.5 * point]
        constants = [section.at(float(share)) for share in (here[:1] if section.is_uniform else here)]
        bending, shear = (np.array(both) for both in zip(*map(_compliances, constants), strict=True))
        area += 0.5 * weight * np.array([one.area for one in constants])
        B = np.swapaxes(_series(0.5 * point * X, [1.0 / math.factorial(k) for k in range(N_SERIES)]), 1, 2)
        for part, compliance in zip(parts, (bending, shear), strict=True):
            part += 0.5 * weight * np.swapaxes(B, 1, 2) @ (compliance[:, :, None] * B)
    # d xi = Z (twist of b against a, seen from the middle's frame): the inverse of the mean of exp(t ad xi) over t from
    # -1/2 to 1/2.
    Z = np.linalg.inv(_series(X @ X, [0.25**k / math.factorial(2 * k + 1) for k in range(N_SERIES // 2)]))
    parts = length[:, None, None] * (Z @ parts @ np.swapaxes(Z, 1, 2))
    return parts[0], parts[1], area


def _compliances(section: SectionConstants) -> tuple[Floats, Floats]:
    """E times the section's compliances (6,): what does not depend on Poisson's ratio, and what goes with 1 + nu."""
    (a1, b1), (a2, b2), A = section.shear1, section.shear2, section.area
    bending = np.array([a1 / A, a2 / A, 1.0 / A, 1.0 / section.I1, 1.0 / section.I2, 0.0])
    return bending, np.array([b1 / A, b2 / A, 0.0, 0.0, 0.0, 2.0 / section.J])


def _bracket(xi: Floats) -> Floats:
    """ad xi (n, 6, 6) on twists (velocity, spin): (v, w) -> (theta x v + rho x w, theta x w)."""
    spin = np.cross(np.eye(3), xi.reshape(-1, 2, 1, 3))  # (n, 2, 3, 3): rows e_i x rho, that is [rho], and [theta]
    out = np.zeros((len(xi), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = spin[:, 1]
    out[:, :3, 3:] = spin[:, 0]
    return out


def _series(X: Floats, coefficients: Sequence[float]) -> Floats:
    """Sum of c_k X^k."""
    out = np.zeros_like(X)
    for c in reversed(coefficients):
        out = out @ X + c * np.eye(6)
    return out
