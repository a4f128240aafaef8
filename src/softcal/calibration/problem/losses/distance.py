"""Paper B's loss: distances of simulated from measured markers, in per cent of the robot's length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, Loss, register_loss
from softcal.checks import Floats
from softcal.errors import Fault


@register_loss
@dataclass(frozen=True)
class DistanceLoss(Loss):
    """Paper B's Eq. (1), d = |r - s| / L_T 100 %: the root of its mean square over all markers, states and experiments.

    Not the plain mean: the root of the mean square is smooth where one marker is fitted exactly, and its minimiser is
    that of least squares, with their standard errors. length: L_T [m].
    """

    length: float
    name: str = "distance"
    uses_priors: bool = False
    rooted: bool = True
    degree: int = 1
    unit: ClassVar[str] = "%"
    needs_length: ClassVar[bool] = True

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
                        "the loss 'distance' needs positions only",
                        experiment.name,
                        got=", ".join(experiment.compared),
                        allowed="positions such as m4.x, m4.y, m4.z",
                        attempt="compare: […] without the others, or the loss 'likelihood'",
                    )
                )
            for point in experiment.points:
                parts = experiment.parts_of(point)
                if len(parts) < 3:
                    allowed = f"{point}.x, {point}.y and {point}.z"
                    found.append(Fault("a distance needs all three parts", experiment.name, ", ".join(parts), allowed))
        return found
