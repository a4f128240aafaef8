"""What every hyperelastic law must keep; a law joins by being in the catalogue."""

import json

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mechanics_cases import constants
from scipy.spatial.transform import Rotation

from scripts.law_sources import own_laws
from softcal.materials.catalogue import LAWS
from softcal.materials.components import PAIRS, full
from softcal.materials.law import INVARIANTS, LAW_SOURCES, compile_law, fingerprint, stacked
from softcal.materials.stress_at import (
    Deformation,
    Points,
    Volumetric,
    add_volumetric,
    points,
    whole_energy,
    whole_stress,
)

EVERY = list(LAWS.values())
every_law = pytest.mark.parametrize("law", EVERY, ids=lambda law: law.name)
stretches = st.lists(st.floats(0.6, 1.7), min_size=3, max_size=3).map(np.array)
ratios = st.floats(-0.45, 0.4999)
theta = st.tuples(st.floats(0.1, 50.0), ratios)


def values_of(law, E=2.0, nu=0.4):
    """The law's constants, in its order, where its moduli at small strain are these."""
    return tuple(constants(law, E, nu).values())


DIRECTIONS = np.array([[[0.48, 0.6, 0.64], [0.0, 0.6, -0.8]]])  # of laws that have one, or two


def at(*F) -> Points:
    return points(np.array(F, dtype=float), DIRECTIONS)


def energy(law, F, values):
    return float(whole_energy(compile_law(law), at(F), values)[0])


def stress(law, F, values):
    """dpsi/dF from the stress that the kernels use."""
    return F @ full(whole_stress(compile_law(law), at(F), values).S)[0]


def admits(law, nu):
    return all(one.quantity.allows(nu) for one in law.parameters if one.name == "poissons_ratio")


@every_law
def test_name_is_the_catalogues_key_and_has_a_reference(law):
    assert LAWS[law.name] is law
    assert law.reference


@every_law
@settings(deadline=None)
@given(theta)
def test_undeformed_has_neither_energy_nor_stress(law, theta):
    assume(admits(law, theta[1]))
    values = values_of(law, *theta)
    assert abs(energy(law, np.eye(3), values)) < 1e-12 * theta[0]
    assert np.abs(stress(law, np.eye(3), values)).max() < 1e-10 * theta[0] / (1 - 2 * theta[1])


@every_law
@settings(deadline=None)
@given(stretches, ratios)
def test_every_deformation_costs_energy(law, stretch, nu):
    assume(admits(law, nu))
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
    np.testing.assert_allclose(stress(law, Q.T @ R.T @ F, values), Q.T @ R.T @ P, atol=1e-9)
    if not law.is_directed:
        np.testing.assert_allclose(stress(law, np.diag(stretch), values), R.T @ P @ Q.T, atol=1e-9)
    np.testing.assert_allclose(P @ F.T, F @ P.T, atol=1e-9)  # moments balance


@every_law
@settings(deadline=None)
@given(theta)
def test_small_strain_moduli_are_those_of_E_and_nu(law, theta):
    """Uniaxial and shear stiffness at the undeformed state are E and E / 2(1 + nu); of a law with a direction, these of
    its isotropic part.
    """
    E, nu = theta
    assume(nu <= 0.49)
    values = values_of(law, E, nu)
    mu = E / (2 * (1 + nu))
    named = dict(zip(law.names, values, strict=True))
    assert law.shear_modulus(named) == pytest.approx(mu, rel=1e-12)
    assert law.youngs_modulus(named) == pytest.approx(E, rel=1e-9)
    if law.is_directed:
        return
    D = whole_stress(compile_law(law), at(np.eye(3)), values).D[0]
    compliance = np.linalg.inv(D)
    np.testing.assert_allclose(np.diag(compliance), [1 / E] * 3 + [1 / mu] * 3, rtol=1e-8)
    np.testing.assert_allclose(compliance[0, 1:3], -nu / E, rtol=1e-7, atol=1e-10 / E)


@every_law
@settings(deadline=None)
@given(ratios)
def test_a_change_of_volume_that_the_pressure_does_not_see_is_not_unstable(law, nu):
    """The part of the energy without pressure never decreases with a small dilation, by differences."""
    assume(admits(law, nu))
    h = 1e-3
    even = at(*((1.0 + change) * np.eye(3) for change in (-h, 0.0, h)))
    psi = Deformation(compile_law(law), even).energy(values_of(law, 2.0, nu))
    assert (psi[0] - 2.0 * psi[1] + psi[2]) / h**2 > -1e-4


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.5])
def test_a_layered_body_is_so_much_stiffer_along_its_direction(ratio):
    """Of an incompressible body 3 mu ratio along the direction."""
    law = LAWS["neo-hooke-layered"]
    values = (3.0, 0.4999999, ratio)
    compliance = np.linalg.inv(
        whole_stress(compile_law(law), points(np.eye(3)[None], np.array([[[0, 0, 1.0]]])), values).D[0]
    )
    assert 1 / compliance[2, 2] == pytest.approx(3.0 * ratio, rel=1e-6)
    assert compliance[0, 0] == pytest.approx(compliance[1, 1], rel=1e-9)
    assert np.sign(3.0 * compliance[0, 0] - 1.0) * (ratio < 1.0) >= 0.0
    assert ratio == 1.0 or abs(3.0 * compliance[0, 0] - 1.0) > 0.05


def strained(F, k, h):
    """F with the strain component k of `PAIRS` larger by h, the shears doubled."""
    i, j = PAIRS[k]
    dE = np.zeros((3, 3))
    dE[i, j] += 0.5 * h
    dE[j, i] += 0.5 * h
    return F + np.linalg.inv(F).T @ dE


@every_law
@settings(max_examples=30, deadline=None)
@given(
    stretches, st.sampled_from([0.0, 1e-9, 1e-7, 1e-5, 1e-3, 1.0]), st.lists(st.floats(-2, 2), min_size=6, max_size=6)
)
def test_the_tangent_is_that_of_the_stress(law, stretch, spread, turns):
    """Also where stretches are equal, or nearly."""
    R, Q = Rotation.from_rotvec([turns[:3], turns[3:]]).as_matrix()
    F = R @ np.diag(stretch[0] + spread * (stretch - stretch[0])) @ Q
    values, compiled = values_of(law), compile_law(law)
    found = whole_stress(compiled, at(F), values)
    h = 1e-5
    for k in range(6):
        ends = [whole_stress(compiled, at(strained(F, k, s * h)), values, tangent=False).S[0] for s in (1, -1)]
        np.testing.assert_allclose(found.D[0, :, k], (ends[0] - ends[1]) / (2 * h), rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(found.D[0], found.D[0].T, rtol=1e-9, atol=1e-9)


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches, st.floats(-0.45, 0.499))
def test_parts_add_up_to_the_whole(law, stretch, nu):
    """psi = psi_d + kappa/2 g^2; with the pressure p = kappa g both forms give one stress."""
    assume(admits(law, nu))
    compiled, values = compile_law(law), values_of(law, 2.0, nu)
    here = at(np.diag(stretch))
    g, dg, ddg = stacked(compiled.strain(here.J), 1)
    kappa = float(compiled.bulk(*values))
    apart = Deformation(compiled, here)
    assert whole_energy(compiled, here, values) == pytest.approx(
        apart.energy(values) + kappa / 2 * g**2, rel=1e-10, abs=1e-12
    )
    split = apart.stress(values)
    add_volumetric(split, here, Volumetric(kappa * g * dg, kappa * (g * ddg + dg**2)))
    for one, other in zip(split, whole_stress(compiled, here, values), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9 * kappa)
    assert float(compiled.compliance(*values)[0]) == pytest.approx(1.0 / kappa, rel=1e-12)


@every_law
@settings(max_examples=30, deadline=None)
@given(stretches, st.floats(0.5, 5.0), st.floats(-0.45, 0.49))
def test_derivatives_by_the_parameters(law, stretch, E, nu):
    assume(admits(law, nu))
    compiled, values = compile_law(law), np.array(values_of(law, E, nu))
    apart = Deformation(compiled, at(np.diag(stretch)))
    for i, got in enumerate(apart.stress_by_parameters(tuple(values))):
        h = 1e-5 * np.eye(len(values))[i]
        ends = [apart.stress(tuple(values + s * h), tangent=False).S for s in (1, -1)]
        np.testing.assert_allclose(got, (ends[0] - ends[1]) / 2e-5, rtol=1e-5, atol=1e-5)
        slope = (compiled.compliance(*(values + h))[0] - compiled.compliance(*(values - h))[0]) / 2e-5
        assert compiled.compliance(*values)[1][i] == pytest.approx(slope, rel=1e-5, abs=1e-8)


@every_law
def test_a_simple_law_has_no_other_derivatives(law):
    """`is_simple` promises that psi_2 and all second derivatives but psi_JJ are zero, everywhere."""
    compiled = compile_law(law)
    if compiled.variables != INVARIANTS:
        assert not compiled.is_simple
        return
    stretches = np.random.default_rng(0).uniform(0.6, 1.7, (20, 3))
    rows = Deformation(compiled, at(*(np.diag(s) for s in stretches))).rows(values_of(law))
    assert compiled.is_simple == (np.abs(rows[[1, 3, 4, 5, 6, 7]]).max() < 1e-12)


@every_law
def test_the_incompressible_limit_holds_no_large_number_in_the_mixed_form(law):
    compiled = compile_law(law)
    if not admits(law, 0.4999999):
        pytest.skip("it does not admit this ratio")
    values = values_of(law, 2.0, 0.4999999)
    assert np.abs(Deformation(compiled, at(np.diag([1.3, 0.8, 1.05]))).stress(values).D).max() < 50.0
    assert 0.0 < float(compiled.compliance(*values)[0]) < 1e-5


@every_law
@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 1.0))
def test_the_pressure_resists_at_every_ratio(law, part):
    """kappa > 0 and finite: a mixed element is then well posed, also where Lame's lambda is zero or less."""
    least = next((one.quantity.lower for one in law.parameters if one.name == "poissons_ratio"), -1.0)
    most = next((one.quantity.upper for one in law.parameters if one.name == "poissons_ratio"), 0.5)
    nu = (1.0 - part) * max(least, -0.99) + part * min(most, 0.4999)
    compiled, values = compile_law(law), values_of(law, 2.0, nu)
    assert 0.0 < float(compiled.bulk(*values)) < np.inf
    assert 0.0 < float(compiled.compliance(*values)[0]) < np.inf


@every_law
def test_a_law_compiles_once(law):
    assert compile_law(law) is compile_law(law)


OWN = own_laws()


@pytest.mark.parametrize("law", OWN, ids=lambda law: f"{law.name} {fingerprint(law)[:4]}")
def test_what_is_written_out_is_what_sympy_derives(law, monkeypatch):
    """Each function of softcal's own laws, which `python -m scripts.law_sources` writes, at random arguments."""
    assert fingerprint(law) in json.loads(LAW_SOURCES.read_text(encoding="utf-8"))
    written = compile_law.__wrapped__(law)
    monkeypatch.setattr("softcal.materials.law._written_out", lambda: {})
    derived = compile_law.__wrapped__(law)
    assert (written.is_simple, written.parameters, written.variables) == (
        (derived.is_simple, derived.parameters, derived.variables)
    )
    values = tuple(constants(law, 2.0, 0.4).values())
    random = np.random.default_rng(1)
    near = {"lambda1": 0.0, "lambda2": 0.0, "lambda3": 0.0, "J": 1.0}
    of = tuple(near.get(name, 3.0) + random.uniform(0.05, 0.2, 4) for name in law.variables)
    arguments = {name: values for name in ("shear", "bulk", "compressed", "compliance", "shifted")}
    arguments |= {name: (*of, *values) for name in ("energy", "energy_by_parameter", "rows", "first_by_parameter")}
    for name, each in {**arguments, "strain": (np.array([0.9, 1.1]),)}.items():
        for one, other in zip(flat(getattr(written, name)(*each)), flat(getattr(derived, name)(*each)), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-12)


def flat(parts):
    return [leaf for part in parts for leaf in flat(part)] if isinstance(parts, (list, tuple)) else [parts]
