"""Prediction of each experiment by the others, by the jacobians at the joint minimum.

Without experiment i the minimum of the linear model moves by dz. The shared parameters move with it; the experiment's
own ones (its slack, its offsets) are fitted to it, for no other experiment knows them. Where it is the set-ups that
differ, the whole set-up of i is left out. Its residuals are then

    r_i' = P (r_i + J_i dz),    P = I - J_o (J_o^T W J_o)^-1 J_o^T W

J_o being the derivatives by its own parameters. The band around the prediction (`band`) has the covariance of the
others' estimates. Nothing is simulated again; `hold_out` fits and simulates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.problem.loss import Block, Loss, rms
from softcal.calibration.statistics.band import half_width
from softcal.calibration.statistics.between_experiments import of_other_set_ups
from softcal.calibration.statistics.estimator import Estimator, Estimators, Minimum, unseen_parameters
from softcal.calibration.statistics.intervals import nearest_within
from softcal.checks import Floats

FEWEST = 3  # experiments: of two others it can be said how far they differ


@dataclass(frozen=True)
class LeftOut:
    """An experiment as the others predict it.

    Attributes
    ----------
    rmse
        Compared channel -> root-mean-square error [SI] of the prediction.
    within
        Compared channel -> share of its samples [-] within the 95 % band of a further experiment.
    half_width
        Compared channel -> root-mean-square half-width [SI] of that band.
    """

    rmse: Mapping[str, float]
    within: Mapping[str, float]
    half_width: Mapping[str, float]


def left_out(
    loss: Loss,
    z: Floats,
    slopes: Floats,
    blocks: Sequence[Block],
    serves: Mapping[str, np.ndarray],
    found: Estimator,
) -> dict[str, LeftOut]:
    """Each experiment as the others predict it; empty where there are fewer than three, without those that the others
    do not determine.

    Parameters
    ----------
    loss, z, slopes, blocks, serves
        See `estimator`.
    found
        The estimator that these made.
    """
    if len(serves) < FEWEST or found.spent:
        return {}
    predicted: dict[str, LeftOut] = {}
    estimators = Estimators(loss, z, slopes, blocks)
    for name, on in serves.items():
        left = {other: serves[other] for other in of_other_set_ups(name, serves, found.set_ups)}
        known = np.any(list(left.values()), axis=0)
        own = on & ~known
        rest = (
            k for k, b in enumerate(blocks) if (b.experiment in left or not b.experiment) and not _only_of(b, ~known)
        )
        without = estimators.of(rest, left)
        if without.spent or np.any(unseen_parameters(without.unseen)[on & known]):
            continue
        held = [b for b in blocks if b.experiment == name or (own.any() and _only_of(b, own))]
        predicted[name] = _Prediction(loss, held, slopes, on, own, known).by(without, z, found)
    return predicted


def _only_of(block: Block, columns: np.ndarray) -> bool:
    """Whether it is the prior of a parameter in these columns."""
    return not block.experiment and block.jacobian is not None and not np.any(block.jacobian[:, ~columns])


@dataclass(frozen=True)
class _Prediction:
    """One experiment, whose own parameters are fitted to it.

    blocks: its own, and the priors of its own parameters. serves: the parameters that have an effect on it; own: those
    that no other has; known: those of the others.
    """

    loss: Loss
    blocks: Sequence[Block]
    slopes: Floats
    serves: np.ndarray
    own: np.ndarray
    known: np.ndarray

    @property
    def shared(self) -> np.ndarray:
        """The parameters that have an effect on the experiment, and that others determine."""
        return self.serves & self.known

    def by(self, others: Minimum, z: Floats, found: Estimator) -> LeftOut:
        jacobians = [block.jacobian * self.slopes for block in self.blocks if block.jacobian is not None]
        step = np.zeros(len(z))
        step[self.known] = nearest_within(others.minimum[self.known], others.budget.root[:, self.known]) - z[self.known]
        step[~self.shared] = 0.0
        fitted = [np.column_stack([b.residual + J @ step, J]) for b, J in zip(self.blocks, jacobians, strict=True)]
        if self.own.any():  # P times these columns
            weights = [self.loss.square_weights(block, block.residual)[:, None] for block in self.blocks]
            parts = [J[:, self.own] for J in jacobians]
            normal = np.sum([J.T @ (w * J) for J, w in zip(parts, weights, strict=True)], axis=0)
            pulled = np.sum([J.T @ (w * c) for J, w, c in zip(parts, weights, fitted, strict=True)], axis=0)
            steps = np.linalg.pinv(normal, hermitian=True) @ pulled
            fitted = [c - J @ steps for J, c in zip(parts, fitted, strict=True)]
        rmse: dict[str, float] = {}
        within: dict[str, float] = {}
        widths: dict[str, float] = {}
        for block, both in zip(self.blocks, fitted, strict=True):
            if not block.experiment:
                continue
            residual, slopes = both[:, 0], np.where(self.shared, both[:, 1:], 0.0)
            band = half_width(self.loss, block, slopes, others.budget.within_bounds, found)
            rmse[block.channel], widths[block.channel] = rms(residual), rms(band)
            within[block.channel] = float(np.mean(np.abs(residual) <= band))
        return LeftOut(rmse, within, widths)
