"""How far a search is from the minimum, in standard errors: the step that Gauss-Newton would still take."""

from __future__ import annotations

import math

import numpy as np

from softcal.calibration.local_model import LocalModel, Point, jacobian_of
from softcal.calibration.loss import Block, Loss, PapersLoss, rms
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Floats

NEAR = 0.1
"""Standard errors: g' C g = 0.01 variances. A search that is as near has converged."""
# Of a channel's root mean square: the twin reads its curves between equilibria no better than that.
_TWIN_ROUNDING = 1e-5


def distance_to_minimum(space: SearchSpace, loss: Loss, here: Point) -> float:
    """The length of Gauss-Newton's step from a simulated point to the minimum within the bounds, in standard errors."""
    end = LocalModel(space, loss, here, plain=True).minimise(np.zeros(space.size), np.ones(space.size))
    return in_standard_errors(space, loss, here, end - here.z)


def in_standard_errors(space: SearchSpace, loss: Loss, here: Point, step: Floats) -> float:
    """The length sqrt(p' C^-1 p) of a step p in the unit box; no parameter moves by more of its standard errors.

    C is Gauss-Newton's covariance. For the step to the minimum, p = C g, the length is sqrt(g' C g), with the gradient
    g of half the loss. The noise is what was stated, times what the residuals are of it; where a loss knows no noise,
    the residuals are the noise. Nothing is known better than the twin rounds.
    """
    moved = left = 0.0
    n = 0
    theta = step * space.jacobian(here.z)
    for block in here.blocks:
        weights = _weights(loss, block)
        floor = _TWIN_ROUNDING * rms(block.measured)
        moved += float(weights @ (jacobian_of(block) @ theta) ** 2)
        left += float(weights @ (block.residual**2 + floor**2))
        n += len(block.residual)
    return math.sqrt(moved * max(n - space.size, 1) / left) if left > 0 else 0.0


def _weights(loss: Loss, block: Block) -> Floats:
    """One over the variance of each sample, but for a factor that all have in common."""
    if isinstance(loss, PapersLoss):
        floor = _TWIN_ROUNDING * rms(block.measured) + 1e-300
        return np.full(len(block.residual), 1.0 / max(rms(block.residual), floor) ** 2)
    return loss.square_weights(block, block.residual)
