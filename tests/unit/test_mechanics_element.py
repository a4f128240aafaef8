"""Shape functions and quadrature of tetrahedra, and the solid's bookkeeping on them."""

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import body_theta, constants, elastic, held, irregular_box, placed, solid_system

from softcal.errors import MeshError
from softcal.geometry.primitives import box_mesh
from softcal.materials.catalogue import LAWS
from softcal.materials.law import compile_law
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.materials.stress_at import points, whole_energy
from softcal.mechanics.elements import ELEMENTS, P1
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.term import Given


@pytest.mark.parametrize("element", ELEMENTS)
def test_weights_sum_to_the_volume_and_gradients_are_exact_for_affine_maps(element):
    mesh = irregular_box((2.0, 3.0, 1.5), (2, 3, 2), element)
    dN, w = ELEMENTS[element].gradients(mesh.points, mesh.tets)
    assert w.sum() == pytest.approx(9.0)
    A = np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 2.0], [0.0, 1.0, 1.0]])
    F = np.einsum("eai,eqaj->eqij", (mesh.points @ A.T)[mesh.tets], dN)
    np.testing.assert_allclose(F, np.broadcast_to(A, F.shape), atol=1e-12)


def test_inverted_element_is_refused_by_number():
    mesh = box_mesh((1.0, 1.0, 1.0), (1, 1, 1))
    tets = mesh.tets.copy()
    tets[3] = tets[3][[1, 0, 2, 3]]
    with pytest.raises(MeshError, match=r"neck: 1 element\(s\) are inverted; got tets \[3\]"):
        P1.gradients(mesh.points, tets, where="neck")


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@pytest.mark.parametrize("nu", [-0.45, 0.3])
def test_a_law_that_gives_way_under_compression_is_reported(law, nu):
    """Where more compression of a cube on all sides takes less pressure, by differences of the energy."""
    if not all(one.quantity.allows(nu) for one in law.parameters if one.name == "poissons_ratio"):
        pytest.skip("it does not admit this ratio")
    compiled, values = compile_law(law), tuple(constants(law, 3.0, nu).values())
    mesh = box_mesh((1.0, 1.0, 1.0), (1, 1, 1))
    system = solid_system(mesh, "P1", law, np.array([0]))
    given_way = []
    for s in np.linspace(0.6, 1.3, 15):
        J, h = s**3, 1e-4
        directions = np.array([[[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]]])
        even = points(np.cbrt([J - h, J, J + h])[:, None, None] * np.eye(3), directions)
        psi = whole_energy(compiled, even, values)
        gives_way = psi[0] - 2 * psi[1] + psi[2] < 0.0 and J < 1.0
        told = system.remarks(placed(system, mesh.points * s), body_theta(constants(law, 3.0, nu)))
        assert bool(told) == gives_way
        assert not told or f"compressed to {J:.2g} of its volume, where its law {law.name} softens" in told
        given_way.append(gives_way)
    assert any(given_way) == ((law.name, nu) in {("neo-hooke", -0.45), ("stable-neo-hooke", 0.3)})


def test_the_volume_in_which_a_law_is_unstable_is_reported():
    """Half of a bar in equibiaxial tension; with C01 below zero, C10 and C01 are Ogden's terms 2 and -2."""
    a, b = 2e5, -2e4
    law, theta = LAWS["mooney-rivlin"], {"C10": a, "C01": b, "bulk_modulus": 1e7}
    mesh = box_mesh((2.0, 1.0, 1.0), (2, 1, 1))
    system = solid_system(mesh, "P1", law, np.array([0]))
    x = np.linspace(1.0, 6.0, 2001)
    limit = x[np.argmax((a * (x**2 + 2 * x**-4) + b * (x**-2 + 2 * x**4) < 0) | (a * x**2 + b * x**-2 < 0))]
    for stretch, expected in (
        (0.98 * limit, ""),
        (
            1.02 * limit,
            " In 50 % of the volume of body body its law mooney-rivlin is unstable: more strain takes less stress "
            "(Drucker).",
        ),
    ):
        # The other half is not shortened along x, and has a strain of a third apart from its change of volume.
        along = np.minimum(mesh.points[:, 0], 1.0) + np.maximum(mesh.points[:, 0] - 1.0, 0.0) / stretch**2
        moved = np.column_stack([along, stretch * mesh.points[:, 1:]])
        assert system.remarks(placed(system, moved), body_theta(theta)) == expected


@pytest.mark.parametrize("element", ELEMENTS)
def test_energy_of_a_homogeneous_stretch_is_psi_times_volume(element):
    mesh = irregular_box((2.0, 3.0, 1.5), (2, 2, 2), element)
    system = solid_system(mesh, element, NEO_HOOKE, np.array([0]))
    (solid,) = system.of(SolidTerm)
    stretch, theta = np.array([1.2, 0.9, 1.1]), elastic(3.0, 0.35)
    mu, kappa = NEO_HOOKE.shear_modulus(theta), NEO_HOOKE.bulk_modulus(theta)
    lmbda = 3.0 * 0.35 / ((1.0 + 0.35) * (1.0 - 2.0 * 0.35))  # paper A, Eq. (3)
    lnJ = np.log(np.prod(stretch))
    psi = mu / 2 * (np.sum(stretch**2) - 3) - mu * lnJ + lmbda / 2 * lnJ**2
    pressure = np.full(mesh.n_points, kappa * lnJ)
    state = replace(placed(system, mesh.points * stretch), pressure=pressure)
    got = solid.energy(Given(state, held(), body_theta(theta)))
    assert got == pytest.approx(9.0 * psi, rel=1e-12)
