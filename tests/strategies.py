"""Hypothesis strategies of the field: rotations, deformation gradients, elastic constants.

    from tests.strategies import deformation_gradients

Values are drawn from bounded factors, so that every matrix is well away from singular and failures shrink towards
the identity.
"""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def numbers(lower: float, upper: float) -> st.SearchStrategy[float]:
    """Finite floats in [lower, upper], subnormal numbers left out."""
    return st.floats(lower, upper, allow_nan=False, allow_infinity=False, allow_subnormal=False)


@st.composite
def vectors(draw: st.DrawFn, size: float = 1.0) -> Floats:
    """Vectors of shape (3,) with components in [-size, size]."""
    return np.array([draw(numbers(-size, size)) for _ in range(3)])


@st.composite
def rotations(draw: st.DrawFn, largest: float = np.pi) -> Floats:
    """Rotation matrices of shape (3, 3) about any axis, by [-largest, largest] rad (Rodrigues' formula)."""
    azimuth, height = draw(numbers(0.0, 2.0 * np.pi)), draw(numbers(-1.0, 1.0))
    angle = draw(numbers(-largest, largest))
    flat = np.sqrt(1.0 - height**2)
    x, y, z = flat * np.cos(azimuth), flat * np.sin(azimuth), height
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


@st.composite
def stretches(draw: st.DrawFn, lower: float = 0.5, upper: float = 2.0) -> Floats:
    """Symmetric positive definite matrices of shape (3, 3) with principal stretches in [lower, upper]."""
    principal = np.diag([draw(numbers(lower, upper)) for _ in range(3)])
    turn = draw(rotations())
    stretch = turn @ principal @ turn.T
    return 0.5 * (stretch + stretch.T)


@st.composite
def deformation_gradients(draw: st.DrawFn, lower: float = 0.5, upper: float = 2.0) -> Floats:
    """F = R U of shape (3, 3) with principal stretches in [lower, upper], so J = det F > 0."""
    return draw(rotations()) @ draw(stretches(lower, upper))


@st.composite
def isochoric_deformation_gradients(draw: st.DrawFn, lower: float = 0.5, upper: float = 2.0) -> Floats:
    """Deformation gradients with J = 1 up to rounding."""
    gradient = draw(deformation_gradients(lower, upper))
    return gradient / np.cbrt(np.linalg.det(gradient))


def youngs_moduli() -> st.SearchStrategy[float]:
    """Young's moduli [Pa] of soft prints, 0.1 to 40 MPa, even in the logarithm."""
    return numbers(5.0, np.log10(4e7)).map(lambda exponent: 10.0**exponent)


def poissons_ratios(upper: float = 0.4999) -> st.SearchStrategy[float]:
    """Poisson's ratios [-] from 0 to `upper`."""
    return numbers(0.0, upper)
