"""The level L(T) that friction multiplies along a cable: its tension, and a preload a whose friction is constant.

    ln L(T_k) - ln L(T_(k-1)) = mu phi_k sigma_k,    L(T) = T + a T / (T + e),    e = a / 10

Far above e, L = T + a: beside mu phi T a via point has the friction mu phi a, whatever the tension. Towards a slack
cable it ends, so that friction alone never makes a cable push. L increases with T, and is the same all along a cable:
so with stretch the tensions remain the minimum of a convex function.
"""

from __future__ import annotations

import numpy as np

from softcal.checks import Floats
from softcal.kernel import kernel

BUILT_UP = 0.1  # of the preload: the tension at which half of its friction acts


@kernel(error_model="numpy")
def level(T: float, a: float) -> float:
    """L."""
    return T + a * T / (T + BUILT_UP * a) if a > 0.0 and T > 0.0 else T


@kernel(error_model="numpy")
def level_slope(T: float, a: float) -> float:
    """dL / dT."""
    if a <= 0.0:
        return 1.0
    e = BUILT_UP * a
    return 1.0 + a * e / (max(T, 0.0) + e) ** 2


@kernel(error_model="numpy")
def tension_at(L: float, a: float) -> float:
    """The tension with a level."""
    if a <= 0.0 or L <= 0.0:
        return L
    e = BUILT_UP * a
    b = L - e - a
    root = np.sqrt(b * b + 4.0 * e * L)
    return 0.5 * (b + root) if b > 0.0 else 2.0 * e * L / (root - b)


@kernel(error_model="numpy")
def along(pull: Floats, preload: Floats, rho: Floats, T: Floats, by_pull: Floats, by_rho: Floats) -> None:
    """The tensions at rho = ln(L(T) / L(pull)), with their derivatives by the pull and by rho.

    Parameters
    ----------
    pull
        Tension at the pulled end (n,) [N].
    preload
        Preload a of the friction (n,) [N].
    rho
        rho (n,) [-].
    T
        Tensions (n,) [N], written.
    by_pull, by_rho
        Derivatives (n,) [-; N], written.
    """
    for k in range(len(rho)):
        a = preload[k]
        if a <= 0.0 or pull[k] <= 0.0:
            by_pull[k] = np.exp(rho[k])
            T[k] = by_rho[k] = pull[k] * by_pull[k]
            continue
        L = level(pull[k], a) * np.exp(rho[k])
        T[k] = tension_at(L, a)
        slope = level_slope(T[k], a)
        by_pull[k] = level_slope(pull[k], a) * np.exp(rho[k]) / slope
        by_rho[k] = L / slope


def by_preload(pull: Floats, preload: Floats, rho: Floats, T: Floats) -> Floats:
    """d T / d preload (n,) at fixed rho.

    Parameters
    ----------
    pull
        Tension at the pulled end (n,) [N].
    preload
        Preload a of the friction (n,) [N].
    rho
        rho (n,) [-].
    T
        Tensions (n,) [N].
    """
    e = BUILT_UP * preload

    def of_level(tension: Floats) -> Floats:
        return np.divide(tension, tension + e, out=np.zeros_like(tension), where=tension > 0.0) ** 2

    slope = 1.0 + np.divide(preload * e, (np.maximum(T, 0.0) + e) ** 2, out=np.zeros_like(T), where=preload > 0.0)
    return (of_level(pull) * np.exp(rho) - of_level(T)) / slope
