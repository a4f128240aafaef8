"""A curve between solved nodes: interpolation, its estimated error, and the passage a machine sees."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from softcal.twin.curve import Curve


def curve_of(f, df, c, by=None, by_slope=None):
    c = np.asarray(c, dtype=float)
    values, slopes = np.asarray(f(c))[:, None], np.asarray(df(c))[:, None]
    by_parameter = np.zeros((len(c), 1, 0)) if by is None else np.asarray(by(c))[:, None, None]
    by_slopes = np.zeros_like(by_parameter) if by_slope is None else np.asarray(by_slope(c))[:, None, None]
    return Curve(c, values, slopes, by_parameter, by_slopes, np.zeros(len(c) - 1, dtype=bool))


@settings(deadline=None)
@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4))
def test_cubics_are_met_exactly(coefficients):
    p = np.polynomial.Polynomial(coefficients)
    curve = curve_of(p, p.deriv(), [0.0, 0.3, 1.0, 1.1], by=p, by_slope=p.deriv())
    at = np.linspace(0.0, 1.1, 23)
    values, slopes, by_parameter = curve.at(at)
    np.testing.assert_allclose(values[:, 0], p(at), atol=1e-12)
    np.testing.assert_allclose(slopes[:, 0], p.deriv()(at), atol=1e-11)
    np.testing.assert_allclose(by_parameter[:, 0, 0], p(at), atol=1e-11)
    assert curve.error().max() < 1e-10
    assert curve.error_by_parameter().max() < 1e-10


@pytest.mark.parametrize("n", [5, 9, 17])
def test_estimated_error_is_of_the_size_of_the_true_one(n):
    curve = curve_of(np.sin, np.cos, np.linspace(0.2, 2.8, n))
    at = np.linspace(0.2, 2.8, 2001)
    true = np.abs(curve.at(at)[0][:, 0] - np.sin(at)).max()
    assert true < curve.error().max() * 1.2
    assert curve.error().max() < 3.0 * true
    derivative = curve_of(np.cos, np.cos, np.linspace(0.2, 2.8, n), by=np.sin, by_slope=np.cos)
    np.testing.assert_allclose(derivative.error_by_parameter()[:, :, 0], curve.error())


@pytest.mark.parametrize("power", [4, 5])
@pytest.mark.parametrize("c", [[-1.0, 0.0, 1.0], [-1.0, 0.0, 0.5], [0.0, 1.0, 2.0]])
def test_three_nodes_estimate_the_error_of_odd_and_even_parts(power, c):
    """Of x^5 around its middle node the third derivatives of both pieces are the same."""
    p = np.polynomial.Polynomial.basis(power)
    curve = curve_of(p, p.deriv(), c)
    at = np.linspace(c[0], c[-1], 2001)
    true = np.abs(curve.at(at)[0][:, 0] - p(at)).max()
    assert 0.9 * true < curve.error().max() < 6.0 * true


def test_error_of_one_interval_is_not_known():
    assert np.all(np.isinf(curve_of(np.sin, np.cos, [0.0, 1.0]).error()))


def test_one_node_is_a_constant():
    values, _, _ = curve_of(np.sin, np.cos, [0.5]).at(np.array([0.5, 0.7]))
    np.testing.assert_allclose(values[:, 0], np.sin(0.5))


def test_passage_inverts_a_rising_channel():
    curve = curve_of(np.exp, np.exp, np.linspace(0.0, 2.0, 9))
    targets = np.array([3.0, 1.0, 1.5, 7.0])
    values = curve.at(curve.first_passage(0, targets))[0][:, 0]
    np.testing.assert_allclose(values, targets, rtol=1e-12)


def test_passage_snaps_past_a_maximum():
    """Rise to 1 at c = pi/2, fall, rise again: what is above 1 is first met on the second branch."""

    def f(c):
        return np.where(c < 5.0, np.sin(c), np.sin(5.0) + np.cos(5.0) * (c - 5.0) + (c - 5.0) ** 2)

    def df(c):
        return np.where(c < 5.0, np.cos(c), np.cos(5.0) + 2.0 * (c - 5.0))

    curve = curve_of(f, df, np.linspace(0.0, 8.0, 81))
    below, above, never = curve.first_passage(0, np.array([0.9, 1.1, 20.0]))
    assert below == pytest.approx(np.arcsin(0.9), abs=1e-6)
    assert above > 5.0
    assert f(np.array(above)) == pytest.approx(1.1, abs=1e-6)
    assert np.isnan(never)


def test_what_is_passed_first_lies_in_intervals_that_are_known() -> None:
    """sin passes 0.9 in its second interval at first, and comes that high again on the way down, which is not read."""
    curve = curve_of(np.sin, np.cos, np.linspace(0.0, 3.0, 4))
    np.testing.assert_array_equal(curve.may_pass(0, np.array([0.9])), [False, True, False])
    np.testing.assert_array_equal(curve.may_pass(0, np.array([0.2, 0.9])), [True, True, False])
    np.testing.assert_array_equal(curve.may_pass(0, np.array([2.0])), [False, False, False])
    # One that its error may hide counts: the first piece errs by some 0.002.
    just_above = np.array([np.sin(1.0) + 1e-4])
    np.testing.assert_array_equal(curve.may_pass(0, just_above), [True, True, False])
    assert curve_of(np.sin, np.cos, [0.0, 1.0]).may_pass(0, np.array([5.0])).all()  # nothing is known of its error


def test_what_is_passed_at_the_start_is_the_start():
    curve = curve_of(np.exp, np.exp, np.linspace(0.0, 2.0, 5))
    np.testing.assert_array_equal(curve.first_passage(0, np.array([0.5, 1.0])), [0.0, 0.0])


def test_nothing_goes_on_across_a_fall():
    """A cubic before, another one after, a straight line between; errors are told from each side alone."""
    before, after = (np.polynomial.Polynomial(p) for p in ([0.0, 1.0, -2.0, 0.5], [5.0, -1.0, 0.3, 2.0]))
    c = np.array([0.0, 0.3, 0.7, 1.0, 1.1, 1.5, 2.0, 2.4])
    is_before = c <= 1.0
    values, slopes, by, by_slopes = (
        np.where(is_before, f(c), g(c))
        for f, g in (
            (before, after),
            (before.deriv(), after.deriv()),
            (before.deriv(2), after.deriv(3)),
            (before.deriv(3), after.deriv(4)),
        )
    )
    is_jump = np.diff(is_before.astype(int)) != 0
    curve = Curve(c, values[:, None], slopes[:, None], by[:, None, None], by_slopes[:, None, None], is_jump)
    assert curve.error().max() < 1e-10
    at = np.array([0.5, 1.0, 1.1, 1.9])
    of = [before, before, after, after]
    found = curve.at(at)
    np.testing.assert_allclose(found[0][:, 0], [f(x) for f, x in zip(of, at, strict=True)], atol=1e-12)
    np.testing.assert_allclose(found[1][:, 0], [f.deriv()(x) for f, x in zip(of, at, strict=True)], atol=1e-11)
    expected = [before.deriv(2)(0.5), before.deriv(2)(1.0), after.deriv(3)(1.1), after.deriv(3)(1.9)]
    np.testing.assert_allclose(found[2][:, 0, 0], expected, atol=1e-11)
    across = curve.at(np.array([1.05]))
    assert across[0][0, 0] == pytest.approx(0.5 * (before(1.0) + after(1.1)))
    assert across[1][0, 0] == pytest.approx((after(1.1) - before(1.0)) / 0.1)
