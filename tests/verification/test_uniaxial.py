"""Stretching an incompressible bar: the textbooks' nominal stress, by each law."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.materials.components import full
from softcal.materials.isochoric import MOONEY_RIVLIN, YEOH
from softcal.materials.law import Law, compile_law
from softcal.materials.neo_hooke import NEO_HOOKE_ISOCHORIC
from softcal.materials.stress_at import points, whole_stress

STRETCHES = np.array([0.6, 0.9, 1.0, 1.3, 2.0, 3.5])


def nominal_stress(law: Law, theta: dict[str, float], stretch: float) -> float:
    """P11 with free sides, whatever the pressure is that keeps the volume."""
    F = np.diag([stretch, stretch**-0.5, stretch**-0.5])
    values = tuple(theta[name] for name in law.names)
    P = F @ full(whole_stress(compile_law(law), points(F[None]), values, tangent=False).S)[0]
    return float(P[0, 0] - P[1, 1] * F[1, 1] / F[0, 0])


@pytest.mark.parametrize("stretch", STRETCHES)
def test_uniaxial_stress(stretch: float) -> None:
    rise, excess = stretch - stretch**-2, stretch**2 + 2.0 / stretch - 3.0
    yeoh = {"C10": 0.2e6, "C20": -3e3, "C30": 150.0, "bulk_modulus": 1e8}
    expected = 2.0 * rise * (0.2e6 - 2.0 * 3e3 * excess + 3.0 * 150.0 * excess**2)
    assert nominal_stress(YEOH, yeoh, stretch) == pytest.approx(expected, rel=1e-12, abs=1e-6)
    rivlin = {"C10": 0.15e6, "C01": 0.04e6, "bulk_modulus": 1e8}
    expected = 2.0 * rise * (0.15e6 + 0.04e6 / stretch)
    assert nominal_stress(MOONEY_RIVLIN, rivlin, stretch) == pytest.approx(expected, rel=1e-12, abs=1e-6)
    neo_hooke = {"youngs_modulus": 1.2e6, "poissons_ratio": 0.4999}
    expected = 0.5 * 1.2e6 / 1.4999 * rise
    assert nominal_stress(NEO_HOOKE_ISOCHORIC, neo_hooke, stretch) == pytest.approx(expected, rel=1e-12, abs=1e-6)
