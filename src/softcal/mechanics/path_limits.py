"""Limits of the work on a load path, which end it as a state with a sentence."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Annotated

from softcal.declare import Declared
from softcal.display import displayed
from softcal.limits import LIMITS
from softcal.quantities import Duration
from softcal.units import format_quantity

GAIN = 0.01  # of a path's length so far: a smaller gain counts as none

Count = Annotated[int, LIMITS["factorisations"]]


@displayed
@dataclass(frozen=True)
class PathLimits(Declared):
    """Limits of the work on each load path, in factorisations of the tangent, which depend on no machine.

    Attributes
    ----------
    factorisations
        Largest number on one path.
    creeping
        Largest number by which a path gains less than 1 % of its length so far.
    failing
        The same where an element fails: it is compressed to less than 0.3 of its volume.
    cpu_time
        Processor time of a simulation [s]; None: no limit. Where it ends a path depends on the machine.
    """

    factorisations: Count = 5000
    creeping: Count = 1000
    failing: Count = 15
    cpu_time: Duration | None = None

    def why_late(self, begun: float) -> str:
        """Part of a sentence, if a simulation begun at this processor time [s] has used up its time; else ""."""
        if self.cpu_time is None or time.process_time() - begun < self.cpu_time:
            return ""
        return f"the simulation took {format_quantity(self.cpu_time, 's')} (limits.cpu_time)"

    def why_over(self, n: int, begun: float) -> str:
        """The limit that n factorisations of a path, or the time since `begun`, exceed, as of `why_late`; else ""."""
        if n >= self.factorisations:
            return f"it took {n} factorisations (limits.factorisations)"
        return self.why_late(begun)


@dataclass
class PathWork:
    """The gains by the work on a path so far: its length and the number of factorisations at each node."""

    limits: PathLimits
    gains: list[tuple[float, int]] = field(default_factory=list[tuple[float, int]])

    def gain(self, length: float, n: int) -> None:
        """Record the path's length after n factorisations."""
        self.gains.append((length, n))

    def why_vain(self, n: int, *, fails: bool) -> str:
        """The limit that n factorisations with too small a gain exceed, as part of a sentence; else "". fails: whether
        elements fail in the step that is attempted.
        """
        limits, length = self.limits, self.gains[-1][0]
        spent = n - next(at for reached, at in self.gains if reached >= (1.0 - GAIN) * length)
        name = "failing" if fails else "creeping"
        if spent >= getattr(limits, name):
            return f"the last {spent} factorisations gained less than {100 * GAIN:.0f} % of it (limits.{name})"
        return ""
