"""Systematic errors of instruments that would move an estimate by its interval.

An error of a load cell or an IMU of one sign in all samples, an offset, a gain or a drift in proportion to time, is in
no residual, nor is most of what a machine yields under the tension. By how much it would move the minimum is known from
the derivatives: -A^-1 J^T W c for the change c of the residuals, as of an uncertain parameter
(`problem/uncertain.py`). A parameter at a bound stays there.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.statistics.estimator import curving, linearised, weighed
from softcal.checks import Floats


def instrument_errors(loss: Loss, slopes: Floats, blocks: Sequence[Block], half: Floats) -> list[dict[str, float]]:
    """Of each parameter: name of an instrument's error, on which nothing is stated -> its size [SI] that moves the
    estimate by half its interval. Of each instrument the one that is smallest over what it reads.

    Parameters
    ----------
    loss, blocks
        The loss, and its blocks with jacobians.
    slopes
        d theta / d z (size,), zero of parameters that stay where they are.
    half
        Half the intervals (size,) in the unit box.
    """
    seen = [weighed(loss, one) for one in blocks]
    parts, inverse, _ = linearised(loss, seen, slopes)
    pulls: dict[str, Floats] = {}
    reads: dict[str, float] = {}
    for one, part in zip(seen, parts, strict=True):
        unit = np.ones(len(one.weights)) if one.stated is None else one.stated
        for name, (shape, scale) in one.block.unstated.items():
            changed = curving(loss, one.block, one.weights, shape[:, None])[:, 0]
            pulls[name] = pulls.get(name, 0.0) + (changed / unit) @ part.pull
            reads[name] = max(reads.get(name, 0.0), scale)
    moved = {name: np.abs(pull @ inverse) for name, pull in pulls.items()}
    smallest: list[dict[str, float]] = []
    for j in range(len(slopes)):
        found: dict[str, tuple[float, str, float]] = {}
        for name, shift in moved.items():
            if shift[j] * reads[name] <= half[j]:
                continue  # not even an error as large as what is read
            size = float(half[j]) / float(shift[j])
            best, instrument = (size / reads[name], name, size), name.rpartition("_")[0] or name
            found[instrument] = min(found.get(instrument, best), best)
        smallest.append({name: size for _, name, size in sorted(found.values())})
    return smallest
