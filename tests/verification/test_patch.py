"""Affine displacements of the boundary give affine ones inside; rigid motions give no stress."""

import numpy as np
import pytest
from mechanics_cases import (
    body_theta,
    constants,
    elastic,
    held,
    irregular_box,
    placed,
    solid_system,
)
from scipy.spatial.transform import Rotation

from softcal.geometry.surface import boundary_faces
from softcal.materials.catalogue import LAWS
from softcal.materials.neo_hooke import NEO_HOOKE
from softcal.mechanics.elements import ELEMENTS
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.statics import Statics

STRETCH = np.array([[1.25, 0.1, -0.05], [0.2, 0.9, 0.15], [-0.1, 0.05, 1.1]])


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@pytest.mark.parametrize("element", ELEMENTS)
def test_patch_is_homogeneous(element, law):
    mesh = irregular_box((1.0, 0.8, 1.2), (3, 3, 3), element)
    theta = body_theta(constants(law, 1.0, 0.4))
    boundary = np.unique(boundary_faces(mesh))
    system = solid_system(mesh, element, law, boundary)
    exact = mesh.points @ STRETCH.T + np.array([0.3, -0.2, 0.1])
    guess = exact.copy()
    inner = system.layout.free_points
    guess[inner] += np.random.default_rng(1).uniform(-0.01, 0.01, (len(inner), 3))

    found = Statics(system, theta).equilibrium(placed(system, guess), held())

    assert found.converged, found.status
    assert len(inner) >= 8
    np.testing.assert_allclose(found.state.x, exact, rtol=0, atol=1e-9)
    (solid,) = system.of(SolidTerm)
    F, *_ = solid.kinematics(found.state)
    np.testing.assert_allclose(F, np.broadcast_to(STRETCH, F.shape), rtol=0, atol=1e-8)
    if ELEMENTS[element].is_mixed:
        J = np.linalg.det(STRETCH)
        strain = {"log(J)": np.log(J), "J - 1": J - 1.0}[law.volumetric_strain]
        expected = law.bulk_modulus(constants(law, 1.0, 0.4)) * strain
        np.testing.assert_allclose(found.state.pressure, expected, rtol=1e-8)


@pytest.mark.parametrize("element", ELEMENTS)
def test_exact_patch_has_no_inner_residual(element):
    mesh = irregular_box((1.0, 0.8, 1.2), (3, 3, 3), element, seed=4)
    system = solid_system(mesh, element, NEO_HOOKE, np.unique(boundary_faces(mesh)))
    state = placed(system, mesh.points @ STRETCH.T)
    state.pressure[:] = NEO_HOOKE.bulk_modulus(elastic(1.0, 0.4)) * np.log(np.linalg.det(STRETCH))

    at = system.linearise(state, held(), body_theta(elastic(1.0, 0.4)), tangent=False)

    reactions = np.abs(at.full[: 3 * system.layout.n_points]).max()
    assert reactions > 1e-3
    assert np.abs(at.reduced).max() < 1e-13 * max(reactions, 1.0)


@pytest.mark.parametrize("law", LAWS.values(), ids=lambda law: law.name)
@pytest.mark.parametrize("element", ELEMENTS)
def test_rigid_motion_gives_no_stress(element, law):
    mesh = irregular_box((1.0, 0.8, 1.2), (2, 2, 2), element)
    system = solid_system(mesh, element, law, np.array([0]))
    R = Rotation.from_rotvec([0.7, -1.9, 0.4]).as_matrix()
    state = placed(system, mesh.points @ R.T + np.array([3.0, -1.0, 2.0]))

    at = system.linearise(state, held(), body_theta(constants(law, 1.0, 0.45)), tangent=False)

    assert np.abs(at.full).max() < 1e-13
