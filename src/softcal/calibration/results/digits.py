"""An estimate as text: nothing is shown to more digits than its 95 % interval allows, two of the half-width.

A bound of the search is shown as it was written. On a logarithmic scale an interval is a ratio, so that a number keeps
one significant digit however wide the interval is.
"""

from __future__ import annotations

import math

from softcal.calibration.statistics.estimate import Estimate
from softcal.units import (
    AS_WRITTEN,
    digits_that_tell,
    format_quantity,
    format_range,
    plain,
    readable_unit,
    rounded,
    unit_factor,
)

NORMAL_95 = 1.959964  # half-width of a 95 % interval in standard errors
_WHOLE = 0.9  # share of the allowed range with which an interval leaves the parameter anywhere in it
ESTIMATE = ("value", "95 % interval", "bounds")
"""The heads of `estimate_cells`."""


def half_width(estimate: Estimate) -> float | None:
    """Half the length of the 95 % interval [unit]; None without an interval."""
    error = estimate.standard_error
    if estimate.interval is not None:
        return 0.5 * (estimate.interval[1] - estimate.interval[0])
    return NORMAL_95 * error if error and math.isfinite(error) else None


def interval_share(estimate: Estimate) -> float | None:
    """Ratio of the 95 % interval to the allowed range, both on the scale of the search; None if unknown."""
    error, half = estimate.standard_error, half_width(estimate)
    if estimate.upper <= estimate.lower:
        return None
    if error is not None and not math.isfinite(error):
        return math.inf
    if half is None and error is None:
        return None
    low, high = estimate.interval or (estimate.value - (half or 0.0), estimate.value + (half or 0.0))
    if estimate.scale == "log" and low > 0:
        return math.log(high / low) / math.log(estimate.upper / estimate.lower)
    return (high - low) / (estimate.upper - estimate.lower)


def is_determined(estimate: Estimate) -> bool:
    """Whether the 95 % interval excludes more than a tenth of the allowed range; True without a range."""
    share = interval_share(estimate)
    return share is None or share < _WHOLE


def shown(estimate: Estimate, value: float, unit: str = "") -> str:
    """A value of the parameter [unit], such as an end of its interval, as a plain number in a display unit.

    Parameters
    ----------
    estimate
        The parameter's.
    value
        Number [SI].
    unit
        Display unit; by default that of the estimate.
    """
    factor = unit_factor(unit or display_unit(estimate), estimate.unit)
    for bound in (estimate.lower, estimate.upper):
        if math.isclose(value, bound, rel_tol=1e-9):
            return plain(value / factor, AS_WRITTEN)
    return difference(estimate, value, unit)


def difference(estimate: Estimate, value: float, unit: str = "") -> str:
    """An error of the parameter, or a difference of its values, as a plain number in a display unit; bounds do not
    concern it.

    Parameters
    ----------
    estimate, value, unit
        See `shown`.
    """
    factor, half = unit_factor(unit or display_unit(estimate), estimate.unit), half_width(estimate)
    return rounded(value / factor, half and half / factor, least=int(estimate.scale == "log"))


def display_unit(estimate: Estimate) -> str:
    """The unit in which an estimate is shown: "MPa"; "1" without one."""
    return readable_unit(estimate.value, estimate.unit)


def value_text(estimate: Estimate) -> str:
    """The value with its unit: "1.983 MPa"."""
    return with_unit(estimate, shown(estimate, estimate.value))


def value_and_error(estimate: Estimate) -> str:
    """The value with its standard error, if it has one and the data determine it: "1.983 ± 0.021"."""
    text, error = shown(estimate, estimate.value), estimate.standard_error
    if not error or not math.isfinite(error) or not is_determined(estimate):
        return text
    return f"{text} ± {difference(estimate, error)}"


def estimate_text(estimate: Estimate) -> str:
    """The value with its standard error, if it has one, and its unit: "1.983 ± 0.021 MPa"."""
    return with_unit(estimate, value_and_error(estimate))


def ends_text(estimate: Estimate) -> str:
    """The ends of the 95 % interval, "1.94 to 2.02"; "" without an interval."""
    return " to ".join(shown(estimate, end) for end in estimate.interval or ())


def interval_text(estimate: Estimate) -> str:
    """The 95 % interval with its unit, "1.94 to 2.02 MPa"; "" without an interval."""
    if estimate.interval is None:
        return ""
    return with_unit(estimate, ends_text(estimate))


def format_interval(ends: tuple[float, float], unit: str) -> str:
    """Ends [unit], to four digits or as many as tell them apart: "1.94 to 2.02 MPa", "950 kPa to 1.02 MPa"."""
    return format_range(*ends, unit, digits=digits_that_tell(*ends))


def with_unit(estimate: Estimate, text: str) -> str:
    """A number or two in the estimate's display unit, with that unit."""
    unit = display_unit(estimate)
    return text if unit == "1" else f"{text} {unit}"


def estimate_cells(estimate: Estimate) -> list[str]:
    """The cells of an estimate in a table of any, below `ESTIMATE`."""
    ends = estimate.interval
    return [
        format_quantity(estimate.value, estimate.unit) + (" (at a bound)" if estimate.at_bound else ""),
        "–" if ends is None else format_interval(ends, estimate.unit),
        format_range(estimate.lower, estimate.upper, estimate.unit),
    ]
