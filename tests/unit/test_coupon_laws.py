"""Laws in coupon tests: closed forms, derivatives, constants that tests determine, and stability."""

from __future__ import annotations

import numpy as np
import pytest
from coupon_case import MOONEY_RIVLIN as BY_HAND
from coupon_case import OGDEN as OGDEN_BY_HAND
from coupon_case import mooney_coupon, strains_of

from softcal.errors import InputError
from softcal.materials.catalogue import LAWS
from softcal.materials.drucker import stiffness
from softcal.materials.law import Law, compile_law
from softcal.plugins.coupons.free_constants import free_constants
from softcal.plugins.coupons.kind import KINDS, LawResponse, principal_states
from softcal.plugins.coupons.stability import stability

C10, C01 = 2e5, 5e4
TERMS = ((6.2e5, 1.3), (-1e4, -2.0))
FITTABLE = [name for name in LAWS if name not in ("stvenant-kirchhoff", "neo-hooke-layered", "neo-hooke-fibres")]


def typical(law: Law) -> tuple[float, ...]:
    return tuple(np.float64(parameter.typical) for parameter in law.parameters)


@pytest.mark.parametrize("test", list(BY_HAND))
def test_mooney_and_rivlins_stresses_are_the_textbooks(test: str):
    strain = strains_of(test)
    law = LAWS["mooney-rivlin"]
    found = LawResponse(law, KINDS[test].states(strain)).stress((C10, C01, 1e9))
    np.testing.assert_allclose(found, BY_HAND[test](C10, C01, strain), rtol=1e-12)


@pytest.mark.parametrize("test", list(OGDEN_BY_HAND))
def test_ogdens_stresses_are_the_textbooks(test: str):
    strain = strains_of(test)
    values = tuple(np.float64(x) for term in TERMS for x in term)
    found = LawResponse(LAWS["ogden-2"], KINDS[test].states(strain)).stress((*values, 1e9))
    np.testing.assert_allclose(found, sum(OGDEN_BY_HAND[test](*term, strain) for term in TERMS), rtol=1e-9)


def test_biaxial_stresses_are_the_textbooks():
    first, second = np.array([1.2, 2.0, 3.0, 0.8]), np.array([0.9, 2.0, 0.7, 1.1])
    strain = np.column_stack([first, second])
    found = LawResponse(LAWS["mooney-rivlin"], KINDS["biaxial"].states(strain)).stress((C10, C01, 1e9))
    for k, (one, other) in enumerate(((first, second), (second, first))):
        np.testing.assert_allclose(found[:, k], 2 * (one - one**-3 * other**-2) * (C10 + C01 * other**2), rtol=1e-12)


@pytest.mark.parametrize("name", FITTABLE)
def test_derivatives_by_the_constants_are_exact(name: str):
    law = LAWS[name]
    response, values = LawResponse(law, KINDS["biaxial"].states(np.array([[1.2, 1.0], [1.6, 0.8]]))), typical(law)
    found = response.by_constants(values)
    for k, value in enumerate(values):
        step = 1e-5 * abs(value)
        near = [response.stress((*values[:k], value + s, *values[k + 1 :])) for s in (step, -step)]
        scale = np.abs(near[0]).max() / abs(value)
        np.testing.assert_allclose(found[..., k], (near[0] - near[1]) / (2 * step), atol=1e-7 * scale, rtol=1e-6)


def test_volumetric_constants_are_stated_and_not_fitted():
    free = free_constants(LAWS["ogden-2"], 0.49)
    assert free.names == ("mu1", "alpha1", "mu2", "alpha2")
    theta = free.theta([x for term in TERMS for x in term])
    shear = sum(mu * alpha for mu, alpha in TERMS) / 2
    assert theta["bulk_modulus"] == pytest.approx(2 * shear * 1.49 / (3 * 0.02))
    assert free_constants(LAWS["neo-hooke"], 0.4).theta([1e6]) == {"youngs_modulus": 1e6, "poissons_ratio": 0.4}


@pytest.mark.parametrize(
    ("name", "why"), [("stvenant-kirchhoff", "incompressible form"), ("neo-hooke-layered", "direction")]
)
def test_laws_without_an_incompressible_form_are_refused(name: str, why: str):
    with pytest.raises(InputError, match=why):
        free_constants(LAWS[name])


@pytest.mark.parametrize(("first", "second"), [(1.5, 1.5), (2.0, 0.7), (1.3, 1.0)])
def test_the_stiffness_is_that_of_ogdens_energy(first: float, second: float):
    """In logarithmic strains the energy is sum mu/alpha (e^(alpha e1) + e^(alpha e2) + e^(-alpha (e1 + e2)))."""
    law, values = compile_law(LAWS["ogden-2"]), (*(x for term in TERMS for x in term), 1e9)
    found = stiffness(law, values, np.array([first]), np.array([second]))[0]
    third = 1 / (first * second)
    wanted = sum(m * a * (np.diag([first**a, second**a]) + third**a * np.ones((2, 2))) for m, a in TERMS)
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_the_limit_of_stability_is_that_of_the_energy():
    """C01 < 0: in equibiaxial tension C10 and C01 are Ogden's terms 2 and -2, and the even mode gives way first."""
    a, b = 2e5, -2e4
    free = free_constants(LAWS["mooney-rivlin"])
    found = stability(free, np.array([a, b]), [mooney_coupon("one", "uniaxial", (a, b))], 6.0)
    x = np.linspace(1, 6, 200_001)
    even = 2 * a * 2 * (x**2 + 2 * x**-4) + 2 * b * 2 * (x**-2 + 2 * x**4)
    odd = 2 * a * 2 * x**2 + 2 * b * 2 * x**-2
    limit = x[np.argmax((even < 0) | (odd < 0))]
    assert found.limits["equibiaxial"] == pytest.approx(limit, abs=0.03)
    # 1.73 in equibiaxial tension has logarithmic strains of the size of 3 in uniaxial tension: below the limit.
    assert found.measured["equibiaxial"] == pytest.approx(3**0.5)
    assert found.is_stable
    further = mooney_coupon("one", "equibiaxial", (a, b))  # up to 3
    assert not stability(free, np.array([a, b]), [further], 6.0).is_stable
    assert stability(free, np.array([a, 2e4]), [further], 6.0).is_stable


def test_a_law_of_negative_shear_modulus_is_nowhere_stable():
    free = free_constants(LAWS["mooney-rivlin"])
    found = stability(free, np.array([1e5, -2e5]), [mooney_coupon("one", "uniaxial", (1e5, 1e5))], 4.0)
    assert set(found.limits.values()) == {1.0}
    assert not found.is_stable


def test_a_chain_at_its_limit_is_unstable_from_there():
    free = free_constants(LAWS["gent"])
    found = stability(free, np.array([4e5, 10.0]), [mooney_coupon("one", "uniaxial", (1e5, 1e5))], 5.0)
    # I1 = 13 at a stretch of 3.518.
    root = max(np.roots([1.0, 0.0, -13.0, 2.0]).real)
    assert found.limits["uniaxial"] == pytest.approx(root, abs=0.02)


def test_states_do_not_change_their_volume():
    at = principal_states(np.array([1.5, 0.7]), np.array([0.9, 1.2]), 2).points
    np.testing.assert_allclose(at.J, 1.0, rtol=1e-12)
