"""The minimum of a loss as an estimator: its covariance under noise, for any loss (an M-estimator).

Near the minimum the residuals are linear in z, the point of the unit box: r = e + J (z - truth). The loss's own weights
W and Hessian A then give

    z - truth = -A^-1 sum J^T W e,    covariance = A^-1 (sum J^T W Var(e) W J) A^-1

(the sandwich: Huber 1967, White 1980). For a likelihood with the right noise it is the inverse of A; for a sum of
RMSEs, whose weights are not one over the variances, it is not. A includes the curvature of the root in each RMSE.

The noise is independent from sample to sample. Its size is the same within a group of channels (`Loss.noise_group`) and
is estimated from the group's residuals without bias:

    E |r_g|^2 = sum_h s_h^2 |M_gh|^2,    M = I - J A^-1 J^T W

Where the loss states the noise, the estimate is at least the stated one. A prior is a measurement of known noise:
misfit does not widen it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.loss import Block, Loss
from softcal.checks import Floats

# Singular value over the largest, in units of the search range, below which a direction counts as unidentifiable.
_BLIND = 1e-7
PRIOR = ""
"""The group of the priors."""
_ITERATIONS = 200
_SPENT = 0.5  # degrees of freedom below which a group's noise cannot be estimated
_ROUNDING = 1e-12  # of the search range: no standard error is smaller


@dataclass(frozen=True)
class Noise:
    """The noise of a group of channels.

    Attributes
    ----------
    size
        Its standard deviation: over the stated one [-] where that is known, else in the channels' unit [SI].
    dof
        Degrees of freedom of its estimate [-], infinite where the stated noise is used.
    stated
        Whether the noise of the group is stated.
    """

    size: float
    dof: float
    stated: bool


@dataclass(frozen=True)
class Estimator:
    """Linear response of the minimum to noise, in the unit box of the search [-].

    Attributes
    ----------
    root
        `root.T @ root` (size, size) is the covariance of z; zero in unidentifiable directions.
    minimum
        Of the unbounded quadratic model (size,).
    unseen
        Unidentifiable directions (k, size), to which no residual is sensitive.
    dof
        Degrees of freedom of each parameter's variance (size,), by Satterthwaite; infinite where all noise is known.
    noise
        Group of channels -> its noise.
    spent
        Groups whose noise cannot be estimated, since the parameters fit them exactly whatever it is.
    """

    root: Floats
    minimum: Floats
    unseen: Floats
    dof: Floats
    noise: Mapping[str, Noise]
    spent: tuple[str, ...]


@dataclass(frozen=True)
class _Part:
    """A block of n samples in units of its noise v.

    Attributes
    ----------
    group
        The group of channels that have this noise.
    stated
        Whether v is the stated noise; else it is one.
    answer
        J / v (n, size).
    pull
        W v J (n, size).
    residual
        Residual / v (n,).
    """

    group: str
    stated: bool
    answer: Floats
    pull: Floats
    residual: Floats


def estimator(loss: Loss, z: Floats, slopes: Floats, blocks: Sequence[Block]) -> Estimator:
    """Linearise the minimum near z, where d theta / d z is `slopes`; the blocks must have jacobians."""
    jacobians = [_jacobian(block) * slopes for block in blocks]
    weights = [loss.square_weights(block, block.residual) for block in blocks]
    pulled = [J.T @ (w * b.residual) for J, w, b in zip(jacobians, weights, blocks, strict=True)]
    gradient: Floats = np.sum(pulled, axis=0)
    inverse, unseen = _inverse_hessian(loss, blocks, jacobians, weights, gradient)
    parts: list[_Part] = []
    for block, J, w in zip(blocks, jacobians, weights, strict=True):
        stated = loss.stated_noise(block)
        unit = np.ones(len(w)) if stated is None else stated
        group = loss.noise_group(block) if block.experiment else PRIOR
        over = block.residual / unit
        parts.append(_Part(group, stated is not None, J / unit[:, None], (w * unit)[:, None] * J, over))
    noise, spent = _noise(parts, inverse)
    shares = {group: sum(part.pull.T @ part.pull for part in parts if part.group == group) for group in noise}
    variances = {group: held.size**2 * np.diag(inverse @ shares[group] @ inverse) for group, held in noise.items()}
    summed = np.sum(list(variances.values()), axis=0)
    uncertain = sum(variances[group] ** 2 / held.dof for group, held in noise.items())
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = np.where(uncertain > 0, summed**2 / uncertain, np.inf)
    stacked = [noise[part.group].size * part.pull @ inverse for part in parts]
    root: Floats = np.linalg.qr(np.concatenate([*stacked, _ROUNDING * np.eye(len(z))]))[1]
    return Estimator(root, z - inverse @ gradient, unseen, dof, noise, spent)


def _inverse_hessian(
    loss: Loss, blocks: Sequence[Block], jacobians: Sequence[Floats], weights: Sequence[Floats], gradient: Floats
) -> tuple[Floats, Floats]:
    """The inverse of half the loss's Hessian in the identifiable directions, and the unidentifiable ones."""
    rows = [np.sqrt(w)[:, None] * J for J, w in zip(jacobians, weights, strict=True)]
    size = len(gradient)
    left, sizes, directions = np.linalg.svd(np.concatenate([*rows, np.zeros((size, size))]), full_matrices=False)
    seen = sizes > _BLIND * max(float(sizes[0]), 1e-300)
    root = directions[seen] / sizes[seen, None]
    # The curvature of the roots is that at the minimum: of the residuals only the part that no step removes is left.
    step = root.T @ (root @ gradient)
    hessian = np.eye(int(seen.sum()))
    places = np.split(left[:, seen], np.cumsum([len(own) for own in rows]))
    for block, J, place in zip(blocks, jacobians, places, strict=False):
        along = loss.straight_along(block, block.residual - J @ step)
        if along is not None:
            flat = place.T @ along
            hessian -= np.outer(flat, flat)
    curvatures, axes = np.linalg.eigh(hessian)
    root = (axes / np.sqrt(np.maximum(curvatures, _BLIND))).T @ root
    return root.T @ root, directions[~seen]


def _noise(parts: Sequence[_Part], inverse: Floats) -> tuple[dict[str, Noise], tuple[str, ...]]:
    """The noise of every group, and the groups whose noise cannot be estimated."""
    groups = list(dict.fromkeys(part.group for part in parts if part.group != PRIOR))
    held = {group: [part for part in parts if part.group == group] for group in groups}
    answers = {g: sum(part.answer.T @ part.answer for part in held[g]) for g in groups}
    pulls = {g: sum(part.pull.T @ part.pull for part in held[g]) for g in groups}
    counts = np.array([sum(len(part.residual) for part in held[g]) for g in groups], dtype=float)
    used = np.array([np.trace(inverse @ sum(part.pull.T @ part.answer for part in held[g])) for g in groups])
    squares = np.array([sum(float(part.residual @ part.residual) for part in held[g]) for g in groups])
    mixing = np.array([[np.trace(inverse @ pulls[h] @ inverse @ answers[g]) for h in groups] for g in groups])
    mixing += np.diag(counts - 2 * used)
    by_priors = sum((part.pull.T @ part.pull for part in parts if part.group == PRIOR), np.zeros_like(inverse))
    priors = np.array([np.trace(inverse @ by_priors @ inverse @ answers[g]) for g in groups])
    dof = counts - used
    free = dof > _SPENT
    stated = np.array([held[g][0].stated for g in groups], dtype=bool)
    sizes = np.where(free, squares / np.where(free, dof, 1.0), stated.astype(float))
    for _ in range(_ITERATIONS):
        expected = mixing @ sizes + priors
        factor = np.where(free & (expected > 0), squares / np.where(expected > 0, expected, 1.0), 1.0)
        sizes = sizes * factor
        if np.all(np.abs(factor - 1.0) < 1e-9):
            break
    at_statement = stated & ~(sizes > 1.0)
    sizes = np.where(at_statement, 1.0, sizes)
    dof = np.where(at_statement | ~free, np.inf, dof)
    noise = {
        g: Noise(float(np.sqrt(size)), float(n), bool(known))
        for g, size, n, known in zip(groups, sizes, dof, stated, strict=True)
    }
    spent = tuple(g for g, known, has in zip(groups, stated, free, strict=True) if not (known or has))
    if any(part.group == PRIOR for part in parts):
        noise[PRIOR] = Noise(1.0, np.inf, stated=True)
    return noise, spent


def _jacobian(block: Block) -> Floats:
    if block.jacobian is None:
        raise ValueError(f"the block '{block.channel}' has no jacobian")
    return block.jacobian
