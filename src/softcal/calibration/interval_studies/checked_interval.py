"""Intervals found another way, beside the quick ones of the linearised estimator, and where the two differ."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from softcal.calibration.problem.parameters import Scale
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.jackknife import UNLIKELY
from softcal.display import displayed
from softcal.html_text import summary
from softcal.units import digits_that_tell, format_quantity, readable_unit

DIFFERS = 0.1
"""Share of the quick interval's half-length: where an end moves by more, the two intervals differ."""
LARGE = 1.0
"""Share of the quick interval's half-length: where an end moves by more, chance alone is no comfort."""


@displayed
@dataclass(frozen=True)
class CheckedInterval:
    """The 95 % interval of one parameter, found twice.

    Attributes
    ----------
    value
        The calibrated value [unit].
    unit
        Its SI unit.
    lower, upper
        The bounds of the search [unit].
    scale
        Scale on which the parameter was searched, on which the ends are compared.
    quick
        Ends of the quick interval [unit]; None where there is none.
    found
        Ends of the other one [unit], within the bounds; None where it could not be found.
    reason
        Why the two differ, the end of a sentence; "" where that is not known.
    chance
        The probability that two estimates of one scatter differ as much; None where the ends are compared instead.
    """

    value: float
    unit: str
    lower: float
    upper: float
    scale: Scale
    quick: tuple[float, float] | None
    found: tuple[float, float] | None
    reason: str = ""
    chance: float | None = None

    @property
    def difference(self) -> float | None:
        """Largest distance between corresponding ends over half the quick interval's length [-]; None without both."""
        if self.quick is None or self.found is None:
            return None
        scaled = (math.log(end) if self.scale == "log" else end for end in (*self.quick, *self.found))
        low, high, found_low, found_high = scaled
        apart = max(abs(found_low - low), abs(found_high - high))
        return 2 * apart / (high - low) if high > low else (math.inf if apart > 0 else 0.0)

    @property
    def differs(self) -> bool:
        """Whether an end is elsewhere by more than `DIFFERS`, or chance does not explain how the scatters differ."""
        if self.chance is not None:
            return self.chance < UNLIKELY
        return self.difference is not None and self.difference > DIFFERS

    @property
    def at_bounds(self) -> tuple[bool, bool]:
        """Whether each end is the bound of the search."""
        return (False, False) if self.found is None else (self.found[0] <= self.lower, self.found[1] >= self.upper)

    def text(self, ends: tuple[float, float] | None) -> str:
        """Both ends with their unit, to the digits that tell them apart; "-" where there is no interval."""
        if ends is None:
            return "-"
        unit = readable_unit(self.value, self.unit)
        return " to ".join(format_quantity(end, self.unit, unit, digits=digits_that_tell(*ends)) for end in ends)


@displayed
@dataclass(frozen=True)
class IntervalStudy:
    """Intervals of all parameters by one method.

    Attributes
    ----------
    by
        The method: "profile", "posterior", "jackknife" or "bootstrap".
    intervals
        Label -> interval beside the quick one.
    notes
        Remarks on how they were found, sentences.
    facts
        What was counted, by name: simulations, effective samples.
    wall_s
        Wall time [s].
    points
        Label -> values [SI] of the simulated points of a profile, of the draws of a posterior or a bootstrap, or those
        without each group of a jackknife; all equally long.
    excess
        Of each point: minus twice the log-likelihood (or log-posterior) less the least found; empty for a bootstrap
        or a jackknife.
    """

    by: str
    intervals: Mapping[str, CheckedInterval]
    notes: tuple[str, ...]
    facts: Mapping[str, float]
    wall_s: float
    points: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    excess: tuple[float, ...] = ()

    def _repr_html_(self) -> str:
        rows = [
            [label, format_quantity(one.value, one.unit), one.text(one.quick), one.text(one.found)]
            for label, one in self.intervals.items()
        ]
        header = ["parameter", "value", "quick", self.by]
        return summary("95 % intervals", header, rows, [*self.notes, *self.sentences])

    @property
    def sentences(self) -> tuple[str, ...]:
        """Sentence on the comparison with the quick intervals."""
        found = tuple(
            f"{label}: the interval by {self.by} is {one.text(one.found)}, the quick one {one.text(one.quick)}"
            f"{one.reason and f': {one.reason}'}."
            for label, one in self.intervals.items()
            if one.differs
        )
        missing = [label for label, one in self.intervals.items() if one.quick is None and one.found is not None]
        if missing:
            found = (*found, f"There is no quick interval of {', '.join(missing)}.")
        if not found and any(one.difference is not None for one in self.intervals.values()):
            if any(one.chance is not None for one in self.intervals.values()):
                text = f"No interval by {self.by} differs from the quick one by more than chance explains"
                large = [
                    f"{label} (p = {one.chance:.2g})"
                    for label, one in self.intervals.items()
                    if one.chance is not None and one.difference is not None and one.difference > LARGE
                ]
                if large:
                    text += (
                        f", but of so few groups chance explains much: {', '.join(large)} "
                        f"differ{'s' * (len(large) == 1)} by more than the quick half-length. Where a group is "
                        "suspect, look at the values without it"
                    )
                return (f"{text}.",)
            share = f"{100 * DIFFERS:.0f} %"
            return (f"No end differs from that of the quick interval by more than {share} of its half-length.",)
        return found


def checked(
    estimates: Mapping[str, Estimate], found: Mapping[str, tuple[float, float] | None], reason: str
) -> dict[str, CheckedInterval]:
    """The intervals by another method beside the quick ones of the estimates, by label.

    Parameters
    ----------
    estimates, found
        Label -> estimate with its quick interval; label -> ends [unit] by the other method, None where it has none.
    reason
        Why they may differ, the end of a sentence.
    """
    return {
        label: CheckedInterval(e.value, e.unit, e.lower, e.upper, e.scale, e.interval, found.get(label), reason)
        for label, e in estimates.items()
    }
