"""Round numbers in an interval."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softcal.round_number import roundest

PLACES = st.floats(-1e3, 1e3, allow_subnormal=False)


@pytest.mark.parametrize(
    ("low", "high", "number"),
    [(0.86, 0.98, 0.875), (0.9, 1.01, 1.0), (0.49, 0.51, 0.5), (-0.1, 0.3, 0.0), (0.46, 0.55, 0.5), (0.3, 0.3, 0.3)],
)
def test_round_numbers(low: float, high: float, number: float):
    assert roundest(low, high) == number


@given(PLACES, st.floats(1e-6, 10.0))
def test_no_other_number_of_the_interval_has_fewer_binary_digits(low: float, width: float):
    high = low + width
    number = roundest(low, high)
    assert low <= number <= high
    digit = Fraction(number).denominator
    coarser = Fraction(2, digit)
    first = -(-Fraction(low) // coarser) * coarser
    assert number == 0.0 or digit == 1 or first > high
