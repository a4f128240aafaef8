"""The strategies keep what they promise; many other tests rest on it."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from tests import strategies


@given(strategies.rotations())
def test_rotations_are_proper(turn):
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-13)
    assert abs(np.linalg.det(turn) - 1.0) < 1e-13


@given(strategies.rotations(largest=0.1))
def test_rotations_keep_to_their_angle(turn):
    assert np.trace(turn) >= 1.0 + 2.0 * np.cos(0.1) - 1e-12


@given(strategies.deformation_gradients(0.5, 2.0))
def test_deformation_gradients_keep_to_their_stretches(gradient):
    principal = np.linalg.svd(gradient, compute_uv=False)
    assert principal.min() >= 0.5 - 1e-12
    assert principal.max() <= 2.0 + 1e-12
    assert np.linalg.det(gradient) > 0.0


@given(strategies.isochoric_deformation_gradients())
def test_isochoric_gradients_keep_the_volume(gradient):
    assert abs(np.linalg.det(gradient) - 1.0) < 1e-12


@given(strategies.youngs_moduli())
def test_youngs_moduli_are_soft(modulus):
    assert 1e5 * (1 - 1e-12) <= modulus <= 4e7 * (1 + 1e-12)
