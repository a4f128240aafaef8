"""What the jacobian at the optimum tells: standard errors, and which parameters the data feels.

The standard errors are Laplace's: the covariance is the inverse of J^T W J, each channel weighted by its stated noise
(likelihood) or by the RMSE that it was met with (papers). Neighbouring samples of one test share most of their error
(friction, hysteresis, the mesh), so these are lower limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.loss import Block, Loss, rms
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Floats

# Singular value over the largest, in units of the search range, below which a direction counts as not seen at all.
_BLIND = 1e-7
NOISE_ALONE = (
    "The standard errors hold for independent noise alone; what the mesh, the law and the rig's model get wrong is not "
    "in them and is usually larger."
)


@dataclass(frozen=True)
class Statistics:
    """Standard errors [SI] by label (None where they make no sense), importances (sum 1), and notes as sentences."""

    standard_errors: Mapping[str, float | None]
    importance: Mapping[str, float]
    notes: tuple[str, ...]


def local_statistics(space: SearchSpace, loss: Loss, theta: Mapping[str, float], blocks: Sequence[Block]) -> Statistics:
    """Standard errors and importances at theta [SI by label]; the blocks must have jacobians.

    A parameter at a bound counts as fixed there. The importance of a parameter is the share of the squared, weighted
    change of all channels per range of the parameter: a local measure, unlike fANOVA.
    """
    slopes = space.jacobian(space.to_search(theta))
    weighted = np.concatenate([_weighted(loss, block, slopes) for block in blocks])
    felt = (weighted**2).sum(axis=0)
    importance = dict(zip(space.labels, (felt / felt.sum()).tolist(), strict=True)) if felt.sum() > 0 else {}
    at_bound = space.at_bound(theta)
    free = [j for j, label in enumerate(space.labels) if not at_bound[label]]
    errors: dict[str, float | None] = dict.fromkeys(space.labels)
    if not free:
        return Statistics(errors, importance, ())
    _, sizes, directions = np.linalg.svd(weighted[:, free], full_matrices=False)
    if len(sizes) < len(free) or sizes[-1] <= _BLIND * sizes[0]:
        return Statistics(errors, importance, (_blind_note(space, free, sizes, directions),))
    variances = ((directions / sizes[:, None]) ** 2).sum(axis=0)
    for j, variance in zip(free, variances, strict=True):
        errors[space.labels[j]] = math.sqrt(float(variance)) * abs(float(slopes[j]))
    return Statistics(errors, importance, (NOISE_ALONE,))


def _weighted(loss: Loss, block: Block, slopes: Floats) -> Floats:
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    if loss.uses_priors:
        return block.jacobian * slopes * math.sqrt(loss.square_weight(block, block.residual))
    sigma = max(rms(block.residual), 1e-12 * rms(block.measured) + 1e-300)
    return block.jacobian * slopes / sigma


def _blind_note(space: SearchSpace, free: Sequence[int], sizes: Floats, directions: Floats) -> str:
    unseen = directions[-1] if len(sizes) == len(free) else np.ones(len(free))
    mixed = [space.labels[j] for j, part in zip(free, unseen, strict=True) if abs(part) > 0.01]
    if len(mixed) == 1:
        return f"The data does not feel {mixed[0]}: its value is arbitrary and no standard errors are given."
    return f"The data cannot tell {' and '.join(mixed)} apart: only a combination of them is found; fix one of them."
