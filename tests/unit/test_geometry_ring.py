"""Points on circles in space."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from softcal.geometry.ring import across, ring_points

AXES = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array).filter(lambda axis: np.linalg.norm(axis) > 1e-3)


@given(AXES)
def test_what_is_across_is_a_unit_vector_at_a_right_angle(axis: np.ndarray) -> None:
    side = across(axis)
    assert np.linalg.norm(side) == pytest.approx(1.0)
    assert side @ axis == pytest.approx(0.0, abs=1e-12)


@given(AXES, st.integers(1, 40))
def test_points_lie_evenly_on_the_circle(axis: np.ndarray, count: int) -> None:
    centre = np.array([0.01, -0.02, 0.03])
    offsets = ring_points(centre, axis, across(axis), 0.05, count) - centre
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 0.05)
    np.testing.assert_allclose(offsets @ axis, 0.0, atol=1e-12)
    steps = np.linalg.norm(np.roll(offsets, -1, axis=0) - offsets, axis=1)
    np.testing.assert_allclose(steps, 0.1 * np.sin(np.pi / count), atol=1e-12)
    right_handed = np.linalg.det([axis, offsets[0], np.roll(offsets, -1, axis=0)[0]])
    assert right_handed >= -1e-12
