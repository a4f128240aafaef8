"""Paper A's cost: a weighted sum of the channels' root mean square errors, and what is smooth in its place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import MET, Block, Loss, SumOfSquares, register_loss, rms
from softcal.calibration.problem.option import Option
from softcal.checks import Floats
from softcal.errors import Fault
from softcal.quantities import quantity
from softcal.sensing.channel import kinds
from softcal.sensing.sensors.actuators import TENSION
from softcal.sensing.sensors.pose import PITCH


def paper_weights() -> dict[str, float]:
    """The weights [1/SI unit] of the channels that have one."""
    ordered = sorted(kinds().values(), key=lambda kind: kind.compared or math.inf)
    return {kind.name: kind.paper_weight for kind in ordered if kind.paper_weight is not None}


@dataclass(frozen=True)
class RelativeSquares(SumOfSquares):
    """sum of mean squares, each over the mean square of the measurement: smooth where the papers' loss has kinks.

    It judges no result and is not registered: a search minimises it until it is near the minimum.
    """

    name: str = "relative squares"
    uses_priors: bool = False

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return np.full(len(residual), 1.0 / max(float(block.measured @ block.measured), 1e-300))


@register_loss
@dataclass(frozen=True)
class PapersLoss(Loss):
    """Paper A's cost, Eq. (4): alpha RMSE(tension) [N] + beta RMSE(pitch) [rad], the mean over the experiments.

    weights: per SI unit, by channel. An experiment driven by tension compares shortening; its weight is the same 0.3,
    per millimetre (300 per metre), which is near 0.3 per newton on a neck of some 0.4 N/mm.
    """

    weights: Mapping[str, float] = field(default_factory=paper_weights)
    name: str = "papers"
    uses_priors: bool = False
    degree: int = 1
    options: ClassVar[tuple[Option, ...]] = (
        Option("alpha", quantity("positive ratio"), TENSION.paper_weight or 0.0),
        Option("beta", quantity("positive ratio"), PITCH.paper_weight or 0.0),
    )

    @classmethod
    def made(cls, options: Mapping[str, float], length: float | None) -> PapersLoss:
        alpha, beta = (options[option.name] / option.default for option in cls.options)
        factors = {kind.name: alpha if kind.drives else beta for kind in kinds().values()}
        return cls({channel: factors[channel] * weight for channel, weight in paper_weights().items()})

    @property
    def surrogate(self) -> RelativeSquares:
        # A sum of RMSEs has a kink where one channel is fitted almost exactly; near it only short steps lower the sum.
        return RelativeSquares()

    def block_value(self, block: Block, residual: Floats) -> float:
        return self.weights[block.channel] * rms(residual)

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        # A block that is fitted exactly has no gradient; the floor keeps its weight finite and still very large.
        floor = 1e-12 * rms(block.measured) + 1e-300
        weight = self.weights[block.channel] / (2 * len(residual) * max(rms(residual), floor))
        return np.full(len(residual), weight)

    def straight_along(self, block: Block, residual: Floats) -> Floats | None:
        # An RMSE is a cone: along the residual itself it is linear.
        return None if rms(residual) <= MET * rms(block.measured) else residual / np.linalg.norm(residual)

    def precisions(self, block: Block, rounding: float) -> Floats:
        return np.full(len(block.residual), 1.0 / max(rms(block.residual), rounding) ** 2)

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
