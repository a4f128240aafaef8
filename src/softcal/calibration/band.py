"""The 95 % band of a further experiment around the twin's predictions: the intervals carried into force and pitch.

It has the covariance of the estimates, the spread between the experiments where they differ, and the noise of the
measurements; all by the exact derivatives at the minimum.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.calibration.estimator import Estimator
from softcal.calibration.intervals import student
from softcal.calibration.loss import Block, Loss
from softcal.checks import Floats


def half_width(loss: Loss, block: Block, slopes: Floats, covariance: Floats, found: Estimator) -> Floats:
    """Half the width (n,) [SI] of the band of a block.

    Parameters
    ----------
    slopes
        Derivative (n, size) of the prediction by the point of the unit box.
    covariance
        Of the estimates that predict, shape (size, size).
    found
        The estimator of all experiments: their noise, and how they differ.
    """
    differing = [one for one in found.between if one.effects.differs and np.any(slopes[:, one.column])]
    variance = np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    for one in differing:
        variance = variance + (one.effects.spread * slopes[:, one.column]) ** 2
    noise = noise_of(loss, block, found)
    dof = min((float(one.effects.dof) for one in differing), default=np.inf)
    return float(student(np.array([dof]))[0]) * np.sqrt(variance + noise**2)


def noise_of(loss: Loss, block: Block, found: Estimator) -> Floats | float:
    """The standard deviation [SI] of the measurements of a block: of each (n,) where it is stated."""
    stated = loss.stated_noise(block)
    return found.noise[loss.noise_group(block)].size * (1.0 if stated is None else stated)


def bands(loss: Loss, slopes: Floats, blocks: Sequence[Block], found: Estimator) -> dict[str, dict[str, Floats]]:
    """Experiment -> compared channel -> half the width (n,) [SI] of the band at its measured samples.

    slopes: d theta / d z (size,).
    """
    widths: dict[str, dict[str, Floats]] = {}
    for block in blocks:
        if block.experiment and block.jacobian is not None:
            own = widths.setdefault(block.experiment, {})
            own[block.channel] = half_width(loss, block, block.jacobian * slopes, found.within_bounds, found)
    return widths
