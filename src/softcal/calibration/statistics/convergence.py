"""Distance of a search from the minimum, in standard errors: the length of the next Gauss-Newton step."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np

from softcal.calibration.problem.loss import Loss, rms, total
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.statistics.estimator import estimator
from softcal.calibration.statistics.local_model import LocalModel, Point, jacobian_of
from softcal.checks import Floats

NEAR = 0.1
"""Standard errors: g' C g = 0.01 variances. A search that is as near has converged."""
# An attainable reduction of the loss by half a standard error counts as a step of a tenth.
_GAIN = 0.2
# Of a channel's root mean square: the interpolation error of the twin's curves between equilibria.
_TWIN_ROUNDING = 1e-5


def distance_to_minimum(space: SearchSpace, loss: Loss, here: Point, trusted: LocalModel) -> float:
    """Distance of a simulated point from the minimum within the bounds, in standard errors.

    The larger of two measures: the length of Gauss-Newton's step, and a fifth of the attainable reduction of the loss.
    The latter is sqrt((n - k) (S - S_min) / S), with the sum of squares S of n residuals and k parameters, and its
    minimum S_min by `trusted`, the search's own model there: towards a distant bound the loss may decrease by much, of
    which a linearisation at a large misfit shows little.

    Parameters
    ----------
    space, loss
        The search space, and the loss.
    here, trusted
        The simulated point, and the search's own model there.
    """
    plain = LocalModel(space, loss, here, plain=True)
    step = plain.minimise(np.zeros(space.size), np.ones(space.size)) - here.z
    lowest = trusted.loss(trusted.minimise(np.zeros(space.size), np.ones(space.size)))
    before, after = loss.squares(trusted.loss(here.z)), loss.squares(lowest)
    rounding = [replace(b, residual=np.full(len(b.residual), _TWIN_ROUNDING * rms(b.measured))) for b in here.blocks]
    left = before + loss.squares(total(loss, rounding))
    n = sum(len(block.residual) for block in here.blocks)
    gain = math.sqrt(max(before - after, 0.0) * max(n - space.size, 1) / left) if left > 0.0 else 0.0
    return max(in_standard_errors(space, loss, here, step), _GAIN * gain)


def share_of_errors(space: SearchSpace, loss: Loss, here: Point, step: Floats) -> float:
    """The largest share that a step in the unit box is of the standard error of a parameter, with the noise correlated
    along the records as in the intervals. Parameters that no residual feels do not count.

    Parameters
    ----------
    space, loss
        The search space, and the loss.
    here, step
        The simulated point, and the step (size,) in the unit box.
    """
    spread = np.linalg.norm(estimator(loss, here.z, space.jacobian(here.z), here.blocks).root, axis=0)
    felt = spread > 0.0
    return float((np.abs(step[felt]) / spread[felt]).max(initial=0.0))


def in_standard_errors(space: SearchSpace, loss: Loss, here: Point, step: Floats) -> float:
    """The length sqrt(p' C^-1 p) of a step p in the unit box, an upper bound for the step of each parameter in its
    standard errors.

    C is Gauss-Newton's covariance. For the step to the minimum, p = C g, the length is sqrt(g' C g), with the gradient
    g of half the loss. The noise of each group of channels is estimated from its own residuals: a channel with a large
    misfit does not hide how well another determines a parameter. No noise is below the twin's rounding error. A prior
    counts by its stated standard deviation, as in the estimator, whatever is left of it: one residual estimates none.

    Parameters
    ----------
    space, loss
        The search space, and the loss.
    here, step
        The simulated point, and the step (size,) in the unit box.
    """
    theta = step * space.jacobian(here.z)
    by_priors = 0.0
    groups: defaultdict[str, Floats] = defaultdict(lambda: np.zeros(3))  # moved, left, count
    for block in here.blocks:
        moved = jacobian_of(block) @ theta
        if not block.experiment:
            by_priors += float(np.sum((moved / block.sigma) ** 2))
            continue
        floor = _TWIN_ROUNDING * rms(block.measured)
        weights = loss.precisions(block, floor + 1e-300)
        left = weights @ (block.residual**2 + floor**2)
        groups[loss.noise_group(block)] += np.array([weights @ moved**2, left, len(moved)])
    n = sum(count for _, _, count in groups.values())
    free = max(n - space.size, 1) / n  # of each residual, once the parameters are fitted
    by_data = sum(moved * count * free / left for moved, left, count in groups.values() if left > 0.0)
    return math.sqrt(by_priors + by_data)
