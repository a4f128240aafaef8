"""Sentences on the test to make next."""

from __future__ import annotations

from softcal.analysis.next_test import NextTests
from softcal.calibration.results.digits import format_interval
from softcal.units import plain

_ALIKE = 1.02  # of the shortest expected length: longer ones are worth a difference
_LITTLE = 0.95  # of the present length: a shorter interval is worth a sentence


def verdict(found: NextTests) -> str:
    """The best candidate and its expected interval, as a sentence."""
    best = found.best
    if best is None:
        return f"No candidate would give {found.parameter} an interval."
    expected = format_interval(best.interval, found.unit) if best.interval else ""
    if found.interval is None:
        return (
            f"{found.parameter} has no interval: the data do not determine it. With '{best.candidate.name}' one of "
            f"{expected} is expected."
        )
    now = f"The 95 % interval of {found.parameter} is {format_interval(found.interval, found.unit)}."
    if best.share is None or best.share > _LITTLE:
        return f"{now} No candidate would shorten it by more than {100 * (1 - _LITTLE):.0f} %."
    alike = [one for one in found.outlooks if one.share is not None and one.share < _ALIKE * best.share]
    if len(alike) > 2:
        most = max(one.share for one in alike if one.share is not None)
        shares = " to ".join(dict.fromkeys(plain(share, 2) for share in (best.share, most)))
        return (
            f"{now} {len(alike)} candidates are expected to shorten it alike, to {shares} of its length: "
            f"{expected} with '{best.candidate.name}'."
        )
    return (
        f"{now} '{best.candidate.name}' is expected to shorten it most, to {plain(best.share, 2)} of its length: "
        f"{expected}."
    )
