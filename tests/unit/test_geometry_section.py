"""Sections of rods against integrals and tables."""

import math

import numpy as np
import pytest

from softcal.errors import InputError
from softcal.geometry.section import GivenSection, RectangularBar, RoundBar


def shear_coefficient(pair: tuple[float, float], nu: float) -> float:
    """k of E A / (k G A) = s0 + s1 (1 + nu)."""
    return 2.0 * (1.0 + nu) / (pair[0] + pair[1] * (1.0 + nu))


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_shear_coefficients_are_cowpers(nu):
    assert shear_coefficient(RoundBar(2.0).constants.shear1, nu) == pytest.approx(6 * (1 + nu) / (7 + 6 * nu))
    assert shear_coefficient(RectangularBar(2.0, 1.0).constants.shear2, nu) == pytest.approx(
        10 * (1 + nu) / (12 + 11 * nu)
    )
    thin = RoundBar(2.0, inner_diameter=2.0 - 1e-9)
    assert shear_coefficient(thin.constants.shear1, nu) == pytest.approx(2 * (1 + nu) / (4 + 3 * nu))
    assert shear_coefficient(
        GivenSection(1.0, 1.0, 1.0, 1.0, shear_coefficients=(0.7, 0.8)).constants.shear2, nu
    ) == pytest.approx(0.8)


def test_moments_of_a_circle_and_a_tube():
    rod, bore = RoundBar(2.0).constants, RoundBar(1.0).constants
    tube = RoundBar(2.0, inner_diameter=1.0).constants
    assert (rod.area, rod.I1, rod.J) == pytest.approx((math.pi, math.pi / 4, math.pi / 2))
    for name in ("area", "I1", "I2", "J"):
        assert getattr(tube, name) == pytest.approx(getattr(rod, name) - getattr(bore, name))


@pytest.mark.parametrize(
    ("ratio", "table"), [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (4.0, 0.2808), (10.0, 0.3123)]
)
def test_torsion_of_a_rectangle_is_the_tables(ratio, table):
    """Timoshenko and Goodier (1951), k_1 in J = k_1 a b^3; tables differ in the last digit."""
    assert RectangularBar(ratio, 1.0).constants.J / ratio == pytest.approx(table, abs=1.01e-4)
    assert RectangularBar(1.0, ratio).constants.J == RectangularBar(ratio, 1.0).constants.J


def test_a_rectangle_bends_about_its_axes():
    y, x = np.meshgrid((np.arange(400) + 0.5) / 400 - 0.5, (np.arange(400) + 0.5) / 400 - 0.5)
    section = RectangularBar(3.0, 2.0)
    assert section.constants.I1 == pytest.approx(np.mean((2.0 * y) ** 2) * 6.0, rel=1e-4)
    assert section.constants.I2 == pytest.approx(np.mean((3.0 * x) ** 2) * 6.0, rel=1e-4)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RoundBar(0.0), "^diameter: the size is out of range"),
        (lambda: RoundBar(math.nan), "^diameter: the size is out of range"),
        (lambda: RoundBar(1.0, inner_diameter=1.0), "does not fit"),
        (lambda: RectangularBar(-1.0, 0.0), "^width: the size is out of range"),
        (lambda: GivenSection(1.0, 1.0, 0.0, 1.0), "^I2: the second moment is out of range"),
        (
            lambda: GivenSection(1.0, 1.0, 1.0, 1.0, shear_coefficients=(0.0, 1.0)),
            "^shear_coefficients.*: the positive ratio is out of range",
        ),
    ],
)
def test_bad_sections_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_every_bad_side_is_told():
    with pytest.raises(InputError) as caught:
        RectangularBar(-1.0, 0.0)
    assert len(caught.value.faults) == 2
