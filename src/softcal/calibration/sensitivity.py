"""What the jacobian at the optimum tells: standard errors, intervals, and which parameters the data feels.

The covariance is Gauss-Newton's: the inverse of J^T W J over all free parameters, the rig's nuisances included, times
the variance per degree of freedom that the residuals leave. W is one over the square of the stated noise (likelihood;
there the variance is not let below one), of the RMSE that each channel was met with (papers), or the same for all
(distance). Neighbouring samples of one test share most of their error (friction, hysteresis, the mesh), so these are
lower limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.intervals import intervals as intervals_of
from softcal.calibration.loss import Block, DistanceLoss, Loss, rms
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Floats

# Singular value over the largest, in units of the search range, below which a direction counts as not seen at all.
_BLIND = 1e-7
# A parameter whose share of an unseen direction is above this is not told from the others in it.
_MIXED = 0.01
# Residuals this many times what the stated noise explains are worth a sentence.
_TOO_LARGE = 1.5
NOISE_ALONE = (
    "The standard errors hold for independent noise alone; what the mesh, the law and the rig's model get wrong is not "
    "in them and is usually larger."
)


@dataclass(frozen=True)
class Statistics:
    """Standard errors and 95 % intervals [SI] by label (None where they make no sense), importances (sum 1), notes."""

    standard_errors: Mapping[str, float | None]
    importance: Mapping[str, float]
    notes: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float] | None] = field(default_factory=dict[str, tuple[float, float] | None])


def local_statistics(space: SearchSpace, loss: Loss, theta: Mapping[str, float], blocks: Sequence[Block]) -> Statistics:
    """Standard errors, intervals and importances at theta [SI by label]; the blocks must have jacobians.

    A parameter at a bound counts as fixed there. The importance of a parameter is the share of the squared, weighted
    change of all channels per range of the parameter: a local measure, unlike fANOVA.
    """
    slopes = space.jacobian(space.to_search(theta))
    weights = [_weights(loss, block) for block in blocks]
    weighted = np.concatenate([_jacobian(b) * slopes * w[:, None] for b, w in zip(blocks, weights, strict=True)])
    residuals = np.concatenate([b.residual * w for b, w in zip(blocks, weights, strict=True)])
    felt = (weighted**2).sum(axis=0)
    importance = dict(zip(space.labels, (felt / felt.sum()).tolist(), strict=True)) if felt.sum() > 0 else {}
    at_bound = space.at_bound(theta)
    free = [j for j, label in enumerate(space.labels) if not at_bound[label]]
    errors: dict[str, float | None] = dict.fromkeys(space.labels)
    intervals: dict[str, tuple[float, float] | None] = dict.fromkeys(space.labels)
    if not free:
        return Statistics(errors, importance, (), intervals)
    _, sizes, directions = np.linalg.svd(weighted[:, free], full_matrices=True)
    seen = np.zeros(len(free), dtype=bool)
    seen[: len(sizes)] = sizes > _BLIND * sizes[0]
    mixed = np.abs(directions[~seen]).max(axis=0, initial=0.0) > _MIXED
    notes: list[str] = []
    if mixed.any():
        notes.append(_blind_note([space.labels[j] for j, is_mixed in zip(free, mixed, strict=True) if is_mixed]))
    dof = len(residuals) - int(seen.sum())
    # With as many parameters as residuals nothing is left that could tell the noise.
    variance = float(residuals @ residuals) / dof if dof > 0 else math.inf
    if loss.uses_priors:
        if math.isfinite(variance) and variance > _TOO_LARGE**2:
            notes.append(_excess_note(math.sqrt(variance)))
        variance = max(1.0, variance) if dof > 0 else 1.0
    if not math.isfinite(variance):
        notes.append("There are as many parameters as measurements: the noise cannot be told, nor standard errors.")
        return Statistics(errors, importance, tuple(notes), intervals)
    root = directions[seen] / sizes[seen[: len(sizes)], None]  # root.T @ root: the covariance, but for the variance
    known = [j for j, is_mixed in zip(free, mixed, strict=True) if not is_mixed]
    if known:
        root = root[:, ~mixed]
        stated = math.sqrt(variance) * np.linalg.norm(root, axis=0) * np.abs(slopes[known])
        found = [space.parameters[j] for j in known]
        ends = intervals_of(found, theta, stated, root / np.linalg.norm(root, axis=0), dof)
        errors |= dict(zip([p.label for p in found], stated.tolist(), strict=True))
        intervals |= dict(zip([p.label for p in found], ends, strict=True))
        notes.append(NOISE_ALONE)
    return Statistics(errors, importance, tuple(notes), intervals)


def _jacobian(block: Block) -> Floats:
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    return block.jacobian


def _weights(loss: Loss, block: Block) -> Floats:
    """One over the noise of each sample, but for a factor that all have in common."""
    if loss.uses_priors or isinstance(loss, DistanceLoss):
        return np.sqrt(loss.square_weights(block, block.residual))
    return np.full(len(block.residual), 1.0 / max(rms(block.residual), 1e-12 * rms(block.measured) + 1e-300))


def _excess_note(factor: float) -> str:
    return (
        f"The residuals are {factor:.2g} times what the stated noise explains: the twin or the rig's model misses "
        "something, or the noise was stated too small. The standard errors are widened by that."
    )


def _blind_note(mixed: Sequence[str]) -> str:
    if len(mixed) == 1:
        return f"The data does not feel {mixed[0]}: its value is arbitrary and no standard error is given."
    return f"The data cannot tell {' and '.join(mixed)} apart: only a combination of them is found; fix one of them."
