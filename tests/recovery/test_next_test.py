"""Does a further test shorten the interval as `next-test` expects? Studies with the test drawn and calibrated too."""

from __future__ import annotations

import pytest

from benchmarks import next_test

CASES = {case.name: case for case in next_test.CASES}
STUDIES = 8
WITHIN = 0.2  # of the length that calibrations with the test find


@pytest.mark.long  # some 50 calibrations each
@pytest.mark.parametrize(
    "name", ["likelihood", *(pytest.param(name, marks=pytest.mark.long) for name in ("papers", "likelihood-differ"))]
)
def test_the_interval_is_the_expected_one(name: str) -> None:
    found = next_test.shrinkages(CASES[name], STUDIES)
    assert len(found) == len(next_test.CANDIDATES) > 5
    ratios = {one.candidate: one.ratio for one in found}
    assert all(abs(ratio - 1) <= WITHIN for ratio in ratios.values()), ratios
    # They are right because they differ, not because all are alike.
    lengths = [one.found / one.present for one in found]
    assert max(lengths) > 1.4 * min(lengths)
