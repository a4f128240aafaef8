"""Whether the markers of a calibration differ by more than the noise of their positions explains.

The quick intervals take the errors of a marker's positions as independent. A marker that is glued a little off has the
same error in all of them, which the values that are found without it show (`jackknife.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softcal.calibration.checked_interval import UNLIKELY
from softcal.calibration.estimator import Estimator
from softcal.calibration.intervals import box_intervals
from softcal.calibration.jackknife import delete_one
from softcal.calibration.loss import Block, Loss
from softcal.calibration.parameters import SearchSpace
from softcal.calibration.result import Note
from softcal.calibration.reweighted import reweighted
from softcal.calibration.uncertain import UncertainParameter
from softcal.units import format_quantity, readable_unit

MANY = 6
"""Markers: the intervals by fewer are several times too long."""


def markers_differ(
    space: SearchSpace,
    loss: Loss,
    theta: Mapping[str, float],
    blocks: Sequence[Block],
    found: Estimator,
    uncertain: Sequence[UncertainParameter] = (),
) -> tuple[Note, ...]:
    """A note with the interval by the markers where they differ, of the parameter in which that is clearest.

    found: the estimator of the blocks at theta [SI by label].
    """
    groups = [np.full(len(block.residual), block.point, dtype=object) for block in blocks]
    if len({block.point for block in blocks if block.point}) < MANY:
        return ()
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    parts = reweighted(loss, z, space.jacobian(z), blocks, groups, found, uncertain)
    without = delete_one(parts)
    longer = without.determined & (without.ratios(found) > 1.0)
    chances = np.where(longer, without.chances(found), 1.0)
    j = int(np.argmin(chances))
    if chances[j] >= UNLIKELY:
        return ()
    ends = np.tile(z, (2, 1))
    ends[:, j] = box_intervals(z, parts.minimum, without.root(found), without.total_dof)[0][j]
    one = space.parameters[j]
    unit = readable_unit(theta[one.label], one.unit)
    low, high = (format_quantity(space.to_model(end)[one.label], one.unit, unit, digits=4) for end in ends)
    text = (
        f"The {len(parts.names)} markers differ by more than the noise explains: with one left out at a time, the 95 % "
        f"interval of {one.label} is {low} to {high} (softcal intervals RUN --by jackknife --over markers)."
    )
    return (Note(text, "warning"),)
