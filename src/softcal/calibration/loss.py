"""How far the twin is from the bench, as one number, with exact gradients.

Every loss here is a sum over blocks, a block being one channel of one experiment, and each block's share is a convex
function of its residual. The least-squares optimiser uses just that: `square_weights` gives, for the residuals at hand,
the weighted squares that touch the loss from above.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.experiment import Experiment
from softcal.checks import Floats
from softcal.errors import DatasetError, Fault

PAPER_WEIGHTS: Mapping[str, float] = {
    "tension": 0.3,  # alpha [1/N]
    "shortening": 300.0,  # [1/m]: alpha per millimetre, for an experiment driven by tension
    "pitch": 1.0,  # beta [1/rad]
    "roll": 1.0,
    "yaw": 1.0,
}


@dataclass(frozen=True)
class Block:
    """One channel of one experiment: measured and residual = predicted - measured [SI], shape (n,).

    jacobian: d residual / d theta, shape (n, size of the search space), or None. sigma: the channel's noise, 0 unknown.
    experiment is "" for a prior.
    """

    experiment: str
    channel: str
    measured: Floats
    residual: Floats
    sigma: float = 0.0
    jacobian: Floats | None = None


class Loss(ABC):
    """A loss: a sum over blocks of a convex function of the block's residual."""

    name: str
    uses_priors: bool

    @abstractmethod
    def block_value(self, block: Block, residual: Floats) -> float:
        """The loss of one block, its experiment taken alone."""

    @abstractmethod
    def square_weight(self, block: Block, residual: Floats) -> float:
        """w such that d block_value = 2 w residual . d residual, and w |r|^2 + const >= block_value for every r."""

    @abstractmethod
    def share(self, blocks: Sequence[Block]) -> float:
        """The factor of every block in the joint loss: 1, or one over the number of experiments."""

    @abstractmethod
    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        """What keeps these experiments from being judged by this loss."""


@dataclass(frozen=True)
class PapersLoss(Loss):
    """Paper A's cost, Eq. (4): alpha RMSE(tension) [N] + beta RMSE(pitch) [rad], the mean over the experiments.

    weights: per SI unit, by channel. An experiment driven by tension compares shortening; its weight is the same 0.3,
    per millimetre (300 per metre), which is near 0.3 per newton on a neck of some 0.4 N/mm.
    """

    weights: Mapping[str, float] = field(default_factory=lambda: dict(PAPER_WEIGHTS))
    name: str = "papers"
    uses_priors: bool = False

    def block_value(self, block: Block, residual: Floats) -> float:
        return self.weights[block.channel] * rms(residual)

    def square_weight(self, block: Block, residual: Floats) -> float:
        # A block that is met exactly has no gradient; the floor keeps its weight finite and still very large.
        floor = 1e-12 * rms(block.measured) + 1e-300
        return self.weights[block.channel] / (2 * len(residual) * max(rms(residual), floor))

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0 / max(len({block.experiment for block in blocks}), 1)

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        return [
            Fault(
                f"the papers' loss has no weight for '{channel}'",
                experiment.name,
                allowed=", ".join(self.weights),
                attempt="give it a weight, or leave the channel out",
            )
            for experiment in experiments
            for channel in experiment.compared
            if channel not in self.weights
        ]


@dataclass(frozen=True)
class LikelihoodLoss(Loss):
    """sum (residual / sigma)^2 over all samples and experiments, plus ((theta - mean) / sd)^2 of the priors.

    sigmas: noise [SI] by channel, in the place of what the datasets say.
    """

    sigmas: Mapping[str, float] = field(default_factory=dict[str, float])
    name: str = "likelihood"
    uses_priors: bool = True

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual @ residual) * self.square_weight(block, residual)

    def square_weight(self, block: Block, residual: Floats) -> float:
        sigma = self.sigmas.get(block.channel, block.sigma) if block.experiment else block.sigma
        return 1.0 / sigma**2

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        found: list[Fault] = []
        for experiment in experiments:
            for channel in experiment.compared:
                held = experiment.dataset.channels[channel]
                sigma = self.sigmas.get(channel, held.sigma)
                if not (math.isfinite(sigma) and sigma > 0):
                    found.append(
                        Fault(
                            f"the likelihood loss needs the noise of '{channel}'",
                            experiment.name,
                            got=f"sigma {sigma:g} {held.unit}",
                            allowed=f"a sigma above 0 {held.unit}",
                            attempt="state the channel's sigma, or take the loss 'papers'",
                        )
                    )
        return found


@dataclass(frozen=True)
class RelativeSquares(Loss):
    """sum of mean squares, each over the mean square of what was measured: smooth where the papers' loss has kinks.

    No loss to judge a result by: `Descent` goes by it until it is near.
    """

    name: str = "relative squares"
    uses_priors: bool = False

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual @ residual) * self.square_weight(block, residual)

    def square_weight(self, block: Block, residual: Floats) -> float:
        return 1.0 / max(float(block.measured @ block.measured), 1e-300)

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        return []


LOSSES: Mapping[str, type[Loss]] = {"papers": PapersLoss, "likelihood": LikelihoodLoss}


def total(loss: Loss, blocks: Sequence[Block]) -> float:
    """The joint loss."""
    return loss.share(blocks) * sum(loss.block_value(block, block.residual) for block in blocks)


def gradient(loss: Loss, blocks: Sequence[Block]) -> Floats:
    """d total / d theta, shape (size of the search space,); every block must have its jacobian."""
    parts = [
        2 * loss.square_weight(block, block.residual) * (block.residual @ block.jacobian)
        for block in blocks
        if block.jacobian is not None
    ]
    return loss.share(blocks) * np.sum(parts, axis=0)


def by_experiment(loss: Loss, blocks: Sequence[Block]) -> dict[str, float]:
    """Each experiment's loss, taken alone."""
    losses: dict[str, float] = {}
    for block in blocks:
        if block.experiment:
            losses[block.experiment] = losses.get(block.experiment, 0.0) + loss.block_value(block, block.residual)
    return losses


def require(loss: Loss, experiments: Sequence[Experiment]) -> None:
    """Check that the experiments can be judged.

    Raises
    ------
    DatasetError
        For a channel without a weight or a noise; all faults at once.
    """
    faults = loss.faults(experiments)
    if faults:
        raise DatasetError(faults)


def rms(values: Floats) -> float:
    """Root mean square."""
    return math.sqrt(float(values @ values) / len(values))


def rms_detrended(values: Floats) -> float:
    """Root mean square of what the best straight line over the samples leaves."""
    position = np.linspace(-1.0, 1.0, len(values)) if len(values) > 1 else np.zeros(1)
    centred = values - values.mean()
    span = float(position @ position)
    return rms(centred - position * (float(position @ centred) / span if span > 0 else 0.0))
