"""The 95 % bands of further measurements around the twin's predictions: the intervals carried into force and pitch.

A further experiment, on a new set-up, errs by the covariance of the estimates, by the spread between the experiments
where they differ, and by the noise of the measurements. A further sample of the same experiment has the same specimen
and the same errors of instruments, mesh and rig, which the fit has followed: what is left of them is in the residuals.
It errs by these, or by the noise where that is larger, and by what the noise of the fitted samples makes of the
estimates. All by the exact derivatives at the minimum.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.statistics.between_experiments import Between
from softcal.calibration.statistics.estimator import Estimator
from softcal.calibration.statistics.intervals import student
from softcal.checks import Floats

_AROUND, _PART = 5, 10  # samples around one whose residuals are alike, or such a part of the record


def half_width(loss: Loss, block: Block, slopes: Floats, covariance: Floats, found: Estimator) -> Floats:
    """Half the width (n,) [SI] of the band of a block.

    Parameters
    ----------
    slopes
        Derivative (n, size) of the prediction by the point of the unit box.
    covariance
        Covariance of the estimates that predict, shape (size, size).
    found
        The estimator of all experiments: their noise, and how they differ.
    """
    return width_of(slopes, covariance, found, noise_of(loss, block, found))


def width_of(slopes: Floats, covariance: Floats, found: Estimator, noise: Floats | float = 0.0) -> Floats:
    """Half the width (n,) [SI] of the 95 % band of a further experiment around predictions.

    Parameters
    ----------
    slopes, covariance, found
        See `half_width`.
    noise
        Standard deviation [SI] of a measurement; 0 for the band of the robot itself.
    """
    mean = np.einsum("ni,ij,nj->n", slopes, covariance, slopes)
    variance, scatter = mean + noise**2, np.zeros(len(slopes))
    for one in found.between:
        if one.effects.differs:
            further, uncertain = further_variance(one, found, slopes[:, one.column] ** 2, mean)
            variance, scatter = variance + further, scatter + uncertain
    dof = np.divide(variance**2, scatter, out=np.full(len(slopes), np.inf), where=scatter > 0)
    return student(dof) * np.sqrt(variance)


def further_variance(one: Between, found: Estimator, square: Floats, mean: Floats) -> tuple[Floats, Floats]:
    """The variance (n,) of a further experiment around the mean of all, and S (n,), by which the sum V of both
    variances has V**2 / S degrees of freedom (Satterthwaite).

    Parameters
    ----------
    one, found
        How the experiments differ in a parameter, and the estimator of all.
    square
        Square (n,) of the derivative of a prediction by that parameter; 1 for its own value.
    mean
        The variance (n,) of the prediction at the mean.
    """
    j = one.column
    further = square * one.effects.spread**2
    # The share of the differences in the variance of the mean is as uncertain as they are.
    of_mean = square * found.variances[one.kind][j] if one.kind in found.variances else 0.0
    return further, ((of_mean + further) ** 2 - of_mean**2) / one.effects.dof + mean**2 / found.dof[j]


def noise_of(loss: Loss, block: Block, found: Estimator) -> Floats | float:
    """The standard deviation [SI] of the measurements of a block: one for each (n,) where the noise is stated.

    Parameters
    ----------
    loss, block
        The loss, and a block of residuals.
    found
        The estimator of all blocks.
    """
    stated = loss.stated_noise(block)
    return found.noise[loss.noise_group(block)].size * (1.0 if stated is None else stated)


def bands(loss: Loss, slopes: Floats, blocks: Sequence[Block], found: Estimator) -> dict[str, dict[str, Floats]]:
    """Experiment -> compared channel -> half the width (n,) [SI] of the band of a further experiment at its measured
    samples.

    Parameters
    ----------
    loss, blocks
        The loss, and its blocks with jacobians.
    slopes
        d theta / d z (size,).
    found
        The estimator of these blocks.
    """
    return _by_channel(blocks, lambda block, J: half_width(loss, block, J * slopes, found.within_bounds, found))


def repeat_bands(loss: Loss, slopes: Floats, blocks: Sequence[Block], found: Estimator) -> dict[str, dict[str, Floats]]:
    """Experiment -> compared channel -> half the width (n,) [SI] of the band of a further sample of the same experiment
    at its measured samples.

    Parameters
    ----------
    loss, slopes, blocks, found
        See `bands`.
    """
    from scipy.ndimage import uniform_filter1d

    def width(block: Block, jacobian: Floats) -> Floats:
        J, n = jacobian * slopes, len(block.residual)
        around = uniform_filter1d(block.residual**2, size=min(n, max(_AROUND, n // _PART)), mode="nearest")
        off = np.maximum(noise_of(loss, block, found) ** 2, np.asarray(around, dtype=np.float64))
        return float(student(np.array([np.inf]))[0]) * np.sqrt(np.einsum("ni,ij,nj->n", J, found.by_noise, J) + off)

    return _by_channel(blocks, width)


def _by_channel(blocks: Sequence[Block], width: Callable[[Block, Floats], Floats]) -> dict[str, dict[str, Floats]]:
    widths: dict[str, dict[str, Floats]] = {}
    for block in blocks:
        if block.experiment and block.jacobian is not None:
            widths.setdefault(block.experiment, {})[block.channel] = width(block, block.jacobian)
    return widths
