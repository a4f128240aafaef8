"""The budget of errors: shares of the sources, with the other parameters within their bounds."""

from __future__ import annotations

import numpy as np
import pytest

from softcal.calibration.statistics.budget import Budget
from softcal.calibration.statistics.correlation import ErrorRecord
from softcal.calibration.statistics.noise import Source


def source(kind: str, size: float, dof: float = np.inf) -> Source:
    return Source(kind, kind, (ErrorRecord(np.zeros(1), np.zeros((1, 2)), np.zeros((1, 2))),), size, dof)


def budget(**rows: tuple[float, float, float]) -> Budget:
    """Sources with one record each: the response of the two parameters, and the degrees of freedom."""
    sources = [source(kind, 1.0, dof) for kind, (*_, dof) in rows.items()]
    return Budget(sources, [[np.array([row[:2]])] for row in rows.values()], 2)


def test_well_determined_parameters_have_the_plain_shares() -> None:
    found = budget(noise=(1e-3, 0.0, 10.0), mesh=(2e-3, 1e-3, np.inf))
    np.testing.assert_allclose(found.variances["noise"], [1e-6, 0.0], rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(found.variances["mesh"], [4e-6, 1e-6], rtol=1e-4)
    assert found.variances["bounds"][0] < 1e-4 * 5e-6
    assert found.dof[0] == pytest.approx(10 * 25, rel=1e-3)


def test_a_parameter_that_the_data_leave_open_is_held_by_its_bounds() -> None:
    """The first moves with the second, which noise leaves open; the mesh moves the first alone."""
    found = budget(noise=(5.0, 10.0, 4.0), mesh=(0.05, 0.0, np.inf))
    # Within its bounds the second has a variance of a twelfth, and the first follows by a half of it.
    assert found.variances["bounds"][0] == pytest.approx(0.25 / 12, rel=1e-2)
    assert found.variances["noise"][0] < 1e-3
    assert found.variances["mesh"][0] == pytest.approx(0.0025, rel=1e-2)
    assert found.dof[0] > 1e3  # of the noise, little is left
    # The second's own bounds do not count for it; those of the first hold it, through the noise that moves both.
    assert sum(part[1] for part in found.variances.values()) == pytest.approx(4 * (1 / 12 + 0.0025), rel=0.02)
    exact = np.linalg.inv(np.linalg.inv(found.root.T @ found.root) + 12 * np.eye(2))
    np.testing.assert_allclose(found.within_bounds, exact, rtol=1e-6)


def test_the_parts_are_those_of_draws_within_the_bounds() -> None:
    """Against a normal prior of the same variance: the posterior's spread of the first parameter."""
    found = budget(noise=(0.2, 0.5, np.inf), mesh=(0.1, 0.05, np.inf))
    covariance = found.root.T @ found.root
    precision = np.linalg.inv(covariance) + np.diag([0.0, 12.0])
    total = sum(part[0] for part in found.variances.values())
    assert total == pytest.approx(np.linalg.inv(precision)[0, 0], rel=1e-9)
