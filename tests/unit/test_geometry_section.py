"""Sections of rods against integrals and tables."""

import math

import numpy as np
import pytest

from softcal.errors import MeshError
from softcal.geometry.section import circular, given, rectangular


def shear_coefficient(pair: tuple[float, float], nu: float) -> float:
    """k of E A / (k G A) = s0 + s1 (1 + nu)."""
    return 2.0 * (1.0 + nu) / (pair[0] + pair[1] * (1.0 + nu))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_shear_coefficients_are_cowpers(nu):
    assert shear_coefficient(circular(2.0).shear1, nu) == pytest.approx(6 * (1 + nu) / (7 + 6 * nu))
    assert shear_coefficient(rectangular(2.0, 1.0).shear2, nu) == pytest.approx(10 * (1 + nu) / (12 + 11 * nu))
    thin = circular(2.0, inner_diameter=2.0 - 1e-9)
    assert shear_coefficient(thin.shear1, nu) == pytest.approx(2 * (1 + nu) / (4 + 3 * nu))
    assert shear_coefficient(given(1.0, 1.0, 1.0, 1.0, shear_coefficients=(0.7, 0.8)).shear2, nu) == pytest.approx(0.8)


def test_moments_of_a_circle_and_a_tube():
    rod, bore = circular(2.0), circular(1.0)
    tube = circular(2.0, inner_diameter=1.0)
    assert (rod.area, rod.I1, rod.J) == pytest.approx((math.pi, math.pi / 4, math.pi / 2))
    for name in ("area", "I1", "I2", "J"):
        assert getattr(tube, name) == pytest.approx(getattr(rod, name) - getattr(bore, name))


@pytest.mark.parametrize(
    ("ratio", "table"), [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (4.0, 0.2808), (10.0, 0.3123)]
)
def test_torsion_of_a_rectangle_is_the_tables(ratio, table):
    """Timoshenko and Goodier (1951), k_1 in J = k_1 a b^3; tables differ in the last digit."""
    assert rectangular(ratio, 1.0).J / ratio == pytest.approx(table, abs=1.01e-4)
    assert rectangular(1.0, ratio).J == rectangular(ratio, 1.0).J


def test_a_rectangle_bends_about_its_axes():
    y, x = np.meshgrid((np.arange(400) + 0.5) / 400 - 0.5, (np.arange(400) + 0.5) / 400 - 0.5)
    section = rectangular(3.0, 2.0)
    assert section.I1 == pytest.approx(np.mean((2.0 * y) ** 2) * 6.0, rel=1e-4)
    assert section.I2 == pytest.approx(np.mean((3.0 * x) ** 2) * 6.0, rel=1e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: circular(0.0), "diameter must be positive"),
        (lambda: circular(math.nan), "diameter must be positive"),
        (lambda: circular(1.0, inner_diameter=1.0), "does not fit"),
        (lambda: rectangular(-1.0, 0.0), "width must be positive"),
        (lambda: given(1.0, 1.0, 0.0, 1.0), "I2 must be positive"),
        (lambda: given(1.0, 1.0, 1.0, 1.0, shear_coefficients=(0.0, 1.0)), "shear coefficient 1"),
    ],
)
def test_bad_sections_are_refused(make, message):
    with pytest.raises(MeshError, match=message):
        make()


def test_every_bad_side_is_told():
    with pytest.raises(MeshError) as caught:
        rectangular(-1.0, 0.0)
    assert len(caught.value.faults) == 2
