"""The rotation of a rig's frame and its exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from softcal.calibration.problem.frame import Frame, rotation, rotation_rates
from softcal.errors import InputError

VECTORS = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@given(VECTORS)
def test_the_rotation_is_that_of_the_rotation_vector(r: np.ndarray) -> None:
    np.testing.assert_allclose(rotation(r), Rotation.from_rotvec(r).as_matrix(), atol=1e-14)


@given(VECTORS)
def test_its_rates_are_those_of_central_differences(r: np.ndarray) -> None:
    h = 1e-5
    for k, rate in enumerate(rotation_rates(r)):
        e = np.eye(3)[k] * h
        np.testing.assert_allclose(rate, (rotation(r + e) - rotation(r - e)) / (2 * h), atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.00999, 0.01001, 3.1])
def test_small_angles_lose_no_digits(angle: float) -> None:
    r = angle * np.array([0.6, -0.48, 0.64])
    np.testing.assert_allclose(rotation(r), Rotation.from_rotvec(r).as_matrix(), atol=1e-15)
    below, above = rotation_rates(r * (1 - 1e-7)), rotation_rates(r * (1 + 1e-7))
    np.testing.assert_allclose(below, above, atol=1e-6)


def test_a_frame_out_of_range_is_refused_in_python_as_in_a_file() -> None:
    with pytest.raises(InputError) as caught:
        Frame(x=1000.0, rz=float("nan"))
    assert [fault.where for fault in caught.value.faults] == ["x", "rz"]
