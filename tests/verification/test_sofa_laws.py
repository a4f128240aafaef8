"""softcal's laws of SOFA's names against the stresses that SOFA v25.12 documents for them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import fractional_matrix_power

from softcal.checks import Floats
from softcal.materials.catalogue import LAWS
from softcal.materials.components import full
from softcal.materials.law import compile_law
from softcal.materials.stress_at import points, whole_stress

MU, LMBDA, KAPPA = 4e5, 9e5, 2e6
E, NU = MU * (3 * LMBDA + 2 * MU) / (LMBDA + MU), LMBDA / (2 * (LMBDA + MU))
ONE: Floats = np.eye(3)


def isochoric(C: Floats) -> tuple[float, Floats, float]:
    """J, C^-1 and tr C."""
    return float(np.sqrt(np.linalg.det(C))), np.linalg.inv(C), float(np.trace(C))


def neo_hookean(C: Floats) -> Floats:
    J, inverse, _ = isochoric(C)
    return MU * ONE + (LMBDA * np.log(J) - MU) * inverse


def stable_neo_hookean(C: Floats) -> Floats:
    J, inverse, _ = isochoric(C)
    alpha = 1 + MU / (LMBDA + MU)
    return MU * ONE + (LMBDA + MU) * J * (J - alpha) * inverse


def st_venant_kirchhoff(C: Floats) -> Floats:
    return MU * (C - ONE) + 0.5 * LMBDA * (np.trace(C) - 3) * ONE


def mooney_rivlin(C: Floats) -> Floats:
    J, inverse, I1 = isochoric(C)
    I2 = 0.5 * (I1**2 - np.trace(C @ C))
    first = 2 * 3e5 * J ** (-2 / 3) * (ONE - I1 / 3 * inverse)
    return first + 2 * 5e4 * J ** (-4 / 3) * (I1 * ONE - C - 2 * I2 / 3 * inverse) + KAPPA * np.log(J) * inverse


def ogden(C: Floats) -> Floats:
    J, inverse, _ = isochoric(C)
    mu, alpha = 6e5 * 2.6, 2.6
    power = np.real(fractional_matrix_power(C, alpha / 2 - 1))
    of_trace = np.trace(np.real(fractional_matrix_power(C, alpha / 2)))
    return J ** (-alpha / 3) * mu / alpha * (power - of_trace / 3 * inverse) + KAPPA * np.log(J) * inverse


def arruda_boyce(C: Floats) -> Floats:
    J, inverse, I1 = isochoric(C)
    factors = (1 / 2, 1 / 160, 11 / (1050 * 8**2), 19 / (7000 * 8**3), 519 / (673750 * 8**4))
    S = KAPPA * np.log(J) * inverse
    for k, factor in enumerate(factors, start=1):
        S = S + 2 * MU * factor * J ** (-2 * k / 3) * k * (I1 ** (k - 1) * ONE - I1**k / 3 * inverse)
    return S


OWN = {"youngs_modulus": E, "poissons_ratio": NU}
CASES = [
    ("neo-hooke", OWN, neo_hookean),
    ("stable-neo-hooke", OWN, stable_neo_hookean),
    ("stvenant-kirchhoff", OWN, st_venant_kirchhoff),
    ("sofa-mooney-rivlin", {"C10": 3e5, "C01": 5e4, "bulk_modulus": KAPPA}, mooney_rivlin),
    ("sofa-ogden", {"mu1": 6e5, "alpha1": 2.6, "bulk_modulus": KAPPA}, ogden),
    ("sofa-arruda-boyce", {"chain_modulus": MU, "bulk_modulus": KAPPA}, arruda_boyce),
]


@pytest.mark.parametrize(("name", "theta", "theirs"), CASES, ids=[name for name, _, _ in CASES])
def test_the_stress_is_sofas(name: str, theta: dict[str, float], theirs: Callable[[Floats], Floats]) -> None:
    law, chance = LAWS[name], np.random.default_rng(7)
    F = ONE + 0.3 * chance.uniform(-1.0, 1.0, (20, 3, 3))
    F = F[np.linalg.det(F) > 0.2]
    assert len(F) > 10
    found = full(whole_stress(compile_law(law), points(F), tuple(theta[key] for key in law.names), tangent=False).S)
    for one, S in zip(F, found, strict=True):
        expected = theirs(one.T @ one)
        np.testing.assert_allclose(S, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
