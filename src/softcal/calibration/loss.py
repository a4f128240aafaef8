"""How far the twin is from the bench, as one number, with exact gradients.

Every loss here is a sum over blocks, or the root of one, a block being one channel of one experiment, and each block's
share is a convex function of its residual. The least-squares optimiser uses just that: `square_weights` gives, for the
residuals at hand, the weighted squares that touch the sum from above.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.experiment import AXES, Experiment
from softcal.checks import Floats
from softcal.errors import DatasetError, Fault

# RMSE over the root mean square of the measurement up to which a channel counts as met exactly.
MET = 1e-6
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

    Samples that were not measured are left out. jacobian: d residual / d theta, shape (n, size of the search space),
    or None. sigma: the noise of all samples or of each (n,), 0 where unknown. point: the marker or plate whose position
    the channel is a part of, "" for any other channel. experiment is "" for a prior.
    """

    experiment: str
    channel: str
    measured: Floats
    residual: Floats
    sigma: float | Floats = 0.0
    jacobian: Floats | None = None
    point: str = ""

    @property
    def grows_with_moduli(self) -> bool:
        """Whether it is proportional to moduli, as forces are and the prior of a modulus; no place or angle is."""
        return not self.experiment or self.channel.rpartition(".")[2] == "tension"


class Loss(ABC):
    """A loss: a sum over blocks of a convex function of the block's residual; where `rooted`, the root of that sum.

    degree: the power of the residuals by which it grows, 2 for a sum of squares.
    """

    name: str
    uses_priors: bool
    rooted: bool = False
    degree: int = 2

    def squares(self, value: float) -> float:
        """What a value of the loss is as a sum of squares: the square of a root."""
        return value ** (2 / self.degree)

    @abstractmethod
    def block_value(self, block: Block, residual: Floats) -> float:
        """The term of one block."""

    @abstractmethod
    def square_weights(self, block: Block, residual: Floats) -> Floats:
        """w (n,) such that d block_value = 2 (w residual) . d residual, and sum w r^2 + const >= block_value."""

    @abstractmethod
    def share(self, blocks: Sequence[Block]) -> float:
        """The factor of every block in the sum, such as one over the number of experiments."""

    def straight_along(self, block: Block, residual: Floats) -> Floats | None:
        """The unit direction (n,) in which block_value grows in a straight line; None where it curves in all.

        Half the Hessian of block_value by the residual is sqrt(W) (I - u u^T) sqrt(W), u being this direction.
        """
        return None

    def stated_noise(self, block: Block) -> Floats | None:
        """The standard deviation (n,) that the loss takes the samples to have, None where it does not say."""
        return None

    def noise_group(self, block: Block) -> str:
        """What the noise of a block shares its size with: channels of one kind, such as every marker's x."""
        return block.channel.rpartition(".")[2]

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
    degree: int = 1

    def block_value(self, block: Block, residual: Floats) -> float:
        return self.weights[block.channel] * rms(residual)

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        # A block that is met exactly has no gradient; the floor keeps its weight finite and still very large.
        floor = 1e-12 * rms(block.measured) + 1e-300
        weight = self.weights[block.channel] / (2 * len(residual) * max(rms(residual), floor))
        return np.full(len(residual), weight)

    def straight_along(self, block: Block, residual: Floats) -> Floats | None:
        # An RMSE is a cone: along the residual itself it grows in a straight line.
        return None if rms(residual) <= MET * rms(block.measured) else residual / np.linalg.norm(residual)

    def noise_group(self, block: Block) -> str:
        return f"{block.channel} in {block.experiment}"

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0 / max(len({block.experiment for block in blocks}), 1)

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        return [
            Fault(
                f"the loss 'papers' has no weight for '{channel}'",
                experiment.name,
                allowed=", ".join(self.weights),
                attempt="the loss 'distance' or 'likelihood', or leave the channel out",
            )
            for experiment in experiments
            for channel in experiment.compared
            if channel not in self.weights
        ]


@dataclass(frozen=True)
class LikelihoodLoss(Loss):
    """sum (residual / sigma)^2 over all samples and experiments, plus ((theta - mean) / sd)^2 of the priors.

    sigma is each sample's own where the dataset has it. sigmas: noise [SI] by channel, in the place of what it says.
    """

    sigmas: Mapping[str, float] = field(default_factory=dict[str, float])
    name: str = "likelihood"
    uses_priors: bool = True

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual**2 @ self.square_weights(block, residual))

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return 1.0 / self.stated_noise(block) ** 2

    def stated_noise(self, block: Block) -> Floats:
        sigma = self.sigmas.get(block.channel, block.sigma) if block.experiment else block.sigma
        return np.broadcast_to(np.asarray(sigma, dtype=float), len(block.residual))

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        found: list[Fault] = []
        for experiment in experiments:
            for channel in experiment.compared:
                unit = experiment.dataset.channels[channel].unit
                own = experiment.sigma(channel)[experiment.seen(channel)]
                sigma = np.atleast_1d(np.asarray(self.sigmas.get(channel, own)))
                bad = sigma[~(np.isfinite(sigma) & (sigma > 0))]
                if len(bad):
                    found.append(
                        Fault(
                            f"the likelihood loss needs the noise of '{channel}'",
                            experiment.name,
                            got=f"sigma {bad[0]:g} {unit}",
                            allowed=f"a sigma above 0 {unit}",
                            attempt="state the channel's sigma, or take the loss 'papers' or 'distance'",
                        )
                    )
        return found


@dataclass(frozen=True)
class DistanceLoss(Loss):
    """Paper B's Eq. (1), d = |r - s| / L_T 100 %: the root of its mean square over all markers, states and experiments.

    Not the plain mean: the root of the mean square is smooth where one marker is met exactly, and its minimiser is that
    of least squares, with their standard errors. length: L_T [m].
    """

    length: float
    name: str = "distance"
    uses_priors: bool = False
    rooted: bool = True
    degree: int = 1

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual @ residual) * (100.0 / self.length) ** 2

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return np.full(len(residual), (100.0 / self.length) ** 2)

    def share(self, blocks: Sequence[Block]) -> float:
        return 3.0 / max(sum(len(block.residual) for block in blocks), 1)

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        found: list[Fault] = []
        for experiment in experiments:
            other = [channel for channel in experiment.compared if not experiment.point_of(channel)]
            if other or not experiment.points:
                found.append(
                    Fault(
                        "the loss 'distance' judges positions alone",
                        experiment.name,
                        got=", ".join(experiment.compared),
                        allowed="positions such as m4.x, m4.y, m4.z",
                        attempt="compare: […] without the others, or the loss 'likelihood'",
                    )
                )
            for point in experiment.points:
                parts = [channel for channel in experiment.compared if experiment.point_of(channel) == point]
                if len(parts) < 3:
                    allowed = f"{point}.x, {point}.y and {point}.z"
                    found.append(Fault("a distance needs all three parts", experiment.name, ", ".join(parts), allowed))
        return found


@dataclass(frozen=True)
class RelativeSquares(Loss):
    """sum of mean squares, each over the mean square of what was measured: smooth where the papers' loss has kinks.

    No loss to judge a result by: `Descent` goes by it until it is near.
    """

    name: str = "relative squares"
    uses_priors: bool = False

    def block_value(self, block: Block, residual: Floats) -> float:
        return float(residual**2 @ self.square_weights(block, residual))

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return np.full(len(residual), 1.0 / max(float(block.measured @ block.measured), 1e-300))

    def share(self, blocks: Sequence[Block]) -> float:
        return 1.0

    def faults(self, experiments: Sequence[Experiment]) -> list[Fault]:
        return []


def total(loss: Loss, blocks: Sequence[Block]) -> float:
    """The joint loss."""
    summed = loss.share(blocks) * sum(loss.block_value(block, block.residual) for block in blocks)
    return math.sqrt(summed) if loss.rooted else summed


def gradient(loss: Loss, blocks: Sequence[Block]) -> Floats:
    """d total / d theta, shape (size of the search space,); every block must have its jacobian."""
    parts = [
        2 * (loss.square_weights(block, block.residual) * block.residual) @ block.jacobian
        for block in blocks
        if block.jacobian is not None
    ]
    summed = loss.share(blocks) * np.sum(parts, axis=0)
    # Where all is met exactly the root has no gradient, only a kink.
    return summed / (2 * max(total(loss, blocks), 1e-300)) if loss.rooted else summed


def by_experiment(loss: Loss, blocks: Sequence[Block]) -> dict[str, float]:
    """Each experiment's loss, taken alone."""
    own: dict[str, list[Block]] = {}
    for block in blocks:
        if block.experiment:
            own.setdefault(block.experiment, []).append(block)
    return {experiment: total(loss, held) for experiment, held in own.items()}


def errors_by_point(blocks: Sequence[Block]) -> dict[str, dict[str, float]]:
    """Experiment -> marker, plate or channel -> root mean square of the distance [m] or the error [SI].

    A position of which not all three coordinates are compared is told coordinate by coordinate.
    """
    found: dict[str, dict[str, list[Floats]]] = {}
    for block in blocks:
        if block.experiment:
            alone = sum(b.experiment == block.experiment and b.point == block.point for b in blocks) < len(AXES)
            name = block.channel if alone or not block.point else block.point
            found.setdefault(block.experiment, {}).setdefault(name, []).append(block.residual)
    return {
        experiment: {name: rms(np.sqrt(np.sum(np.square(parts), axis=0))) for name, parts in held.items()}
        for experiment, held in found.items()
    }


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
