"""A smooth surrogate for losses with kinks, far from the minimum: relative squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softcal.calibration.experiment import Experiment
from softcal.calibration.loss import Block, Loss
from softcal.checks import Floats
from softcal.errors import Fault


@dataclass(frozen=True)
class RelativeSquares(Loss):
    """sum of mean squares, each over the mean square of the measurement: smooth where the papers' loss has kinks.

    It judges no result and is not registered: a search minimises it until it is near the minimum.
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
