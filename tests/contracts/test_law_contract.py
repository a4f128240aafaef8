"""What every hyperelastic law must keep; a law joins by being in the catalogue."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mechanics_cases import constants
from scipy.spatial.transform import Rotation

from softcal.materials.catalogue import LAWS
from softcal.materials.law import FIRST, SECOND, compile_law, stacked

EVERY = list(LAWS.values())
every_law = pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
stretches = st.lists(st.floats(0.6, 1.7), min_size=3, max_size=3).map(np.array)
ratios = st.floats(-0.45, 0.4999)
theta = st.tuples(st.floats(0.1, 50.0), ratios)


def values_of(law, E=2.0, nu=0.4):
    """The law's constants, in its order, where its moduli at small strain are these."""
    return tuple(constants(law, E, nu).values())


def invariants(F):
    C = F.T @ F
    I1 = np.trace(C)
    return I1, 0.5 * (I1**2 - np.trace(C @ C)), np.linalg.det(F)


def energy(law, F, values):
    return float(compile_law(law).energy(*invariants(F), *values))


def stress(law, F, values):
    """dpsi/dF from the coefficients that the kernels use."""
    I1, I2, J = invariants(F)
    psi_1, psi_2, psi_J = stacked(compile_law(law).full(I1, I2, J, *values), 1)[:3, 0]
    return 2 * psi_1 * F + 2 * psi_2 * (I1 * F - F @ F.T @ F) + psi_J * J * np.linalg.inv(F).T


@every_law
def test_name_is_the_catalogues_key_and_has_a_reference(law):
    assert LAWS[law.name] is law
    assert law.reference


@every_law
@settings(deadline=None)
@given(theta)
def test_undeformed_has_neither_energy_nor_stress(law, theta):
    values = values_of(law, *theta)
    assert abs(energy(law, np.eye(3), values)) < 1e-12 * theta[0]
    assert np.abs(stress(law, np.eye(3), values)).max() < 1e-10 * theta[0] / (1 - 2 * theta[1])


@every_law
@settings(deadline=None)
@given(stretches, ratios)
def test_every_deformation_costs_energy(law, stretch, nu):
    F = np.diag(stretch)
    if np.abs(stretch - 1.0).max() > 1e-3:
        assert energy(law, F, values_of(law, 2.0, nu)) > 0.0


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches, st.lists(st.floats(-2, 2), min_size=6, max_size=6))
def test_stress_is_the_slope_of_the_energy_and_turns_with_the_frame(law, stretch, turns):
    R, Q = Rotation.from_rotvec([turns[:3], turns[3:]]).as_matrix()
    F = R @ np.diag(stretch) @ Q
    values = values_of(law)
    P = stress(law, F, values)
    h = 1e-5
    for i, j in np.ndindex(3, 3):
        d = np.zeros((3, 3))
        d[i, j] = h
        slope = (energy(law, F + d, values) - energy(law, F - d, values)) / (2 * h)
        assert P[i, j] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    np.testing.assert_allclose(stress(law, np.diag(stretch), values), R.T @ P @ Q.T, atol=1e-9)
    np.testing.assert_allclose(P @ F.T, F @ P.T, atol=1e-9)  # moments balance


@every_law
@settings(deadline=None)
@given(theta)
def test_small_strain_moduli_are_those_of_E_and_nu(law, theta):
    """Uniaxial and shear stiffness at the undeformed state are E and E / 2(1 + nu)."""
    E, nu = theta
    if nu > 0.49:
        return
    values = values_of(law, E, nu)
    h = 1e-5
    shear = np.eye(3)
    shear[0, 1] = h
    mu = E / (2 * (1 + nu))
    assert stress(law, shear, values)[0, 1] / h == pytest.approx(mu, rel=1e-3)
    assert law.shear_modulus(dict(zip(law.names, values, strict=True))) == pytest.approx(mu, rel=1e-12)
    P = stress(law, np.diag([1 + h, 1 - nu * h, 1 - nu * h]), values)
    assert P[0, 0] / h == pytest.approx(E, rel=1e-3)
    assert abs(P[1, 1]) < 1e-3 * E * h


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches)
def test_coefficients_are_the_derivatives_by_the_invariants(law, stretch):
    """First and second derivatives by I1, I2, J, each taken as independent."""
    compiled, values = compile_law(law), values_of(law)
    at = np.array(invariants(np.diag(stretch)))
    got = stacked(compiled.full(*at, *values), 1)[:, 0]
    h = 1e-4 * at
    for k in range(3):
        d = h * np.eye(3)[k]
        slope = (compiled.energy(*(at + d), *values) - compiled.energy(*(at - d), *values)) / (2 * h[k])
        assert got[k] == pytest.approx(slope, rel=1e-5, abs=1e-6)
    firsts = {}
    for name, k in zip(FIRST, range(3), strict=True):
        d = h * np.eye(3)[k]
        ends = [stacked(compiled.full(*(at + s * d), *values), 1)[:3, 0] for s in (1, -1)]
        firsts[name] = dict(zip(FIRST, (ends[0] - ends[1]) / (2 * h[k]), strict=True))
    for m, (a, b) in enumerate(SECOND):
        assert got[3 + m] == pytest.approx(firsts[a][b], rel=1e-5, abs=1e-5)


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches, st.floats(-0.45, 0.499))
def test_parts_add_up_to_the_whole(law, stretch, nu):
    """psi = psi_d + kappa/2 g^2; with the pressure p = kappa g both forms give one stress."""
    compiled, values = compile_law(law), values_of(law, 2.0, nu)
    at = invariants(np.diag(stretch))
    g, dg, ddg = stacked(compiled.strain(at[2]), 1)[:, 0]
    kappa = float(compiled.bulk(*values))
    assert compiled.energy(*at, *values) == pytest.approx(
        compiled.energy_distortional(*at, *values) + kappa / 2 * g**2, rel=1e-10, abs=1e-12
    )
    full = stacked(compiled.full(*at, *values), 1)[:, 0]
    split = stacked(compiled.distortional(*at, *values), 1)[:, 0]
    split[2] += kappa * g * dg
    split[8] += kappa * (g * ddg + dg**2)
    np.testing.assert_allclose(split, full, rtol=1e-9, atol=1e-9 * kappa)
    assert float(compiled.compliance(*values)[0]) == pytest.approx(1.0 / kappa, rel=1e-12)


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches, st.floats(0.5, 5.0), st.floats(-0.45, 0.49))
def test_derivatives_by_the_parameters(law, stretch, E, nu):
    compiled, values = compile_law(law), np.array(values_of(law, E, nu))
    at = invariants(np.diag(stretch))
    for i in range(len(values)):
        h = 1e-5 * np.eye(len(values))[i]
        for by, of in (("full_by_parameter", "full"), ("distortional_by_parameter", "distortional")):
            got = stacked(getattr(compiled, by)(*at, *values)[i], 1)[:, 0]
            ends = [stacked(getattr(compiled, of)(*at, *(values + s * h)), 1)[:3, 0] for s in (1, -1)]
            np.testing.assert_allclose(got, (ends[0] - ends[1]) / 2e-5, rtol=1e-5, atol=1e-5)
        slope = (compiled.compliance(*(values + h))[0] - compiled.compliance(*(values - h))[0]) / 2e-5
        assert compiled.compliance(*values)[1][i] == pytest.approx(slope, rel=1e-5, abs=1e-8)


@every_law
def test_short_tangent_is_used_only_where_it_is_the_whole(law):
    """`has_cross_terms` False promises that psi_2 and all second derivatives but psi_JJ are zero, everywhere."""
    compiled = compile_law(law)
    rows = [1, 3, 4, 5, 6, 7]
    largest = max(
        np.abs(stacked(compiled.full(*invariants(np.diag(s)), *values_of(law)), 1)[rows, 0]).max()
        for s in np.random.default_rng(0).uniform(0.6, 1.7, (20, 3))
    )
    assert compiled.has_cross_terms == (largest > 1e-12)


@every_law
def test_the_incompressible_limit_holds_no_large_number_in_the_mixed_form(law):
    compiled = compile_law(law)
    at = invariants(np.diag([1.3, 0.8, 1.05]))
    values = values_of(law, 2.0, 0.4999999)
    assert np.abs(stacked(compiled.distortional(*at, *values), 1)).max() < 20.0
    assert 0.0 < float(compiled.compliance(*values)[0]) < 1e-5


@every_law
@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 1.0))
def test_the_pressure_resists_at_every_ratio(law, part):
    """kappa > 0 and finite: a mixed element is then well posed, also where Lame's lambda is zero or less."""
    least = next((one.quantity.lower for one in law.parameters if one.name == "poissons_ratio"), -1.0)
    nu = (1.0 - part) * max(least, -0.99) + part * 0.4999
    compiled, values = compile_law(law), values_of(law, 2.0, nu)
    assert 0.0 < float(compiled.bulk(*values)) < np.inf
    assert 0.0 < float(compiled.compliance(*values)[0]) < np.inf


@every_law
def test_a_law_compiles_once(law):
    assert compile_law(law) is compile_law(law)
