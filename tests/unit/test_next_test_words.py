"""The sentence on which test to make next, and the digits of intervals that are short."""

from __future__ import annotations

import pytest

from softcal.analysis.candidate import Candidate
from softcal.analysis.next_test import NextTests, Outlook, verdict
from softcal.calibration.interval_studies.checked_interval import CheckedInterval
from softcal.calibration.results.digits import format_interval
from softcal.units import digits_that_tell


def ranking(*shares: float) -> NextTests:
    outlooks = tuple(
        Outlook(Candidate(name=f"test {k}", like="pull"), (2.0e6, 2.1e6), share) for k, share in enumerate(shares)
    )
    return NextTests("neck.youngs_modulus", "Pa", 2.05e6, (1.9e6, 2.2e6), outlooks)


def test_one_candidate_that_is_better_is_named() -> None:
    assert "'test 0' is expected to shorten it most, to 0.5 of its length" in verdict(ranking(0.5, 0.6, 0.7))


def test_candidates_that_are_alike_are_not_ranked_in_words() -> None:
    text = verdict(ranking(0.780, 0.781, 0.783, 0.9))
    assert "3 candidates are expected to shorten it alike, to 0.78 of its length" in text
    assert "most" not in text


@pytest.mark.parametrize(("low", "high", "digits"), [(1.0, 2.0, 4), (11.9959, 12.0, 6), (5.0, 5.0, 4), (-1e-9, 1.0, 4)])
def test_ends_have_as_many_digits_as_tell_them_apart(low: float, high: float, digits: int) -> None:
    assert digits_that_tell(low, high) == digits


def test_the_ends_of_short_intervals_differ_in_text() -> None:
    assert format_interval((11.9959e6, 12.0e6), "Pa") == "11.9959 to 12 MPa"
    one = CheckedInterval(12e6, "Pa", 1e6, 40e6, "log", (11.9959e6, 12.0001e6), None)
    assert one.text(one.quick) == "11.9959 MPa to 12.0001 MPa"
