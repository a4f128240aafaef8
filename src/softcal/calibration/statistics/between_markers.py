"""The estimator where markers differ by more than the noise of their positions explains.

The noise of single positions says nothing of a marker that is glued a little off: all its positions share the error.
The values that are found without each marker show it (`jackknife.py`). Where they scatter by more than the noise
explains, each parameter's standard error is the one by the markers, if that is the longer one; the correlations stay.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.estimator import Estimator
from softcal.calibration.statistics.jackknife import UNLIKELY, delete_one
from softcal.calibration.statistics.reweighted import reweighted
from softcal.checks import Floats

MARKERS = "markers"
"""The source of error that the scatter among the markers shows."""
MANY = 6
"""Markers: the intervals by fewer are several times too long."""


def n_markers(blocks: Iterable[Block]) -> int:
    """The number of markers, or plates, whose positions are compared."""
    return len({block.point for block in blocks if block.point})


def with_markers(
    loss: Loss,
    z: Floats,
    slopes: Floats,
    blocks: Sequence[Block],
    found: Estimator,
    uncertain: Sequence[UncertainParameter] = (),
) -> Estimator:
    """The estimator with the scatter among the markers, where six or more differ in any parameter; else as it is.

    Parameters
    ----------
    loss, z, slopes, blocks, uncertain
        See `estimator`.
    found
        The estimator that these made.
    """
    if found.spent or n_markers(blocks) < MANY:
        return found
    groups = [np.full(len(block.residual), block.point, dtype=object) for block in blocks]
    without = delete_one(reweighted(loss, z, slopes, blocks, groups, found, uncertain))
    longer = without.determined & (without.ratios(found) > 1.0)
    if not np.any(longer & (without.chances(found) < UNLIKELY)):
        return found
    quick = np.sum(list(found.variances.values()), axis=0)
    by_markers = np.sum(list(without.budget.variances.values()), axis=0)
    total = np.where(longer, np.maximum(by_markers, quick), quick)
    scale = np.sqrt(np.divide(total, quick, out=np.ones_like(quick), where=quick > 0.0))
    return replace(
        found,
        root=found.root * scale,
        dof=np.where(scale > 1.0, without.total_dof, found.dof),
        variances={**found.variances, MARKERS: total - quick},
        within_bounds=found.within_bounds * np.outer(scale, scale),
    )
