"""Play: what follows a driver within a clearance, as a drive with backlash or the slip of sticking friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softcal.checks import Floats


class Play(NamedTuple):
    """What follows, sample by sample (n,), its derivatives by half of the clearance, and by a shift of all samples."""

    values: Floats
    by_half: Floats
    by_shift: Floats


def play(driver: Floats, half: float) -> Play:
    """What follows a driver (n,) and is pushed along by it at a distance of `half` to either side, from zero on."""
    values, by_half, by_shift = (np.zeros(len(driver)) for _ in range(3))
    at, at_half, at_shift = 0.0, 0.0, 0.0
    for i, d in enumerate(driver.tolist()):
        if abs(d - at) >= half:
            sign = 1.0 if d >= at else -1.0
            at, at_half, at_shift = d - half * sign, -sign, 1.0
        values[i], by_half[i], by_shift[i] = at, at_half, at_shift
    return Play(values, by_half, by_shift)
