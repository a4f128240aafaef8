"""Known constants are found again from noisy coupon tests, inside intervals that hold."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.materials.catalogue import LAWS
from softcal.plugins.coupons.coupon import Coupon
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.kind import KINDS, LawResponse
from softcal.plugins.coupons.law_fit import fit_law

# Law -> constants [SI], the bulk modulus last where the law has one.
TRUE = {
    "mooney-rivlin": (2e5, 5e4, 1e9),
    "yeoh": (2e5, -2e3, 60.0, 1e9),
    "gent": (3e5, 40.0, 1e9),
    "arruda-boyce": (3e5, 3.5, 1e9),
    "ogden-2": (4e5, 1.6, -2e4, -2.5, 1e9),
}
TESTS = {"uniaxial": 4.0, "planar": 3.0, "equibiaxial": 2.2}
STUDIES = 40


def measured(name: str, seed: int, noise: float) -> list[Coupon]:
    """A test of each kind, its stresses with noise relative to their root mean square."""
    rng = np.random.default_rng(seed)
    found: list[Coupon] = []
    for test, largest in TESTS.items():
        strain = np.linspace(1.03, largest, 30)[:, None]
        values = tuple(np.float64(value) for value in TRUE[name])
        stress = LawResponse(LAWS[name], KINDS[test].states(strain)).stress(values)
        size = noise * np.sqrt(np.mean(stress**2))
        found.append(Coupon(test, test, strain, stress + rng.normal(0.0, size, stress.shape) if noise else stress))
    return found


@pytest.mark.parametrize("name", TRUE)
def test_constants_are_found_again_without_noise(name: str):
    constants = free_constants(LAWS[name])
    fit = fit_law(constants, measured(name, 0, 0.0), 5.0)
    terms = sorted(np.reshape(fit.values, (-1, 2)).tolist()) if "ogden" in name else fit.values
    wanted = np.array(TRUE[name])[: len(fit.values)]
    wanted = sorted(np.reshape(wanted, (-1, 2)).tolist()) if "ogden" in name else wanted
    np.testing.assert_allclose(np.array(terms), np.array(wanted), rtol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mooney-rivlin", "yeoh"])
def test_intervals_contain_the_truth(name: str):
    """Of 40 studies 95 % by binomial chance: 34 or more but for one time in a hundred."""
    constants = free_constants(LAWS[name])
    inside = np.zeros(len(constants.names))
    for seed in range(STUDIES):
        fit = fit_law(constants, measured(name, seed, 0.02), 5.0)
        for k, (estimate, true) in enumerate(zip(fit.estimates.values(), TRUE[name], strict=False)):
            assert estimate.interval is not None
            inside[k] += estimate.interval[0] <= true <= estimate.interval[1]
    assert (inside >= 34).all(), inside
    assert (inside < STUDIES).any()  # they are not wider than need be
