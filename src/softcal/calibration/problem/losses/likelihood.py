"""The likelihood of independent, normally distributed noise of a known size, priors counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, SumOfSquares, register_loss
from softcal.checks import Floats
from softcal.errors import Fault


@register_loss
@dataclass(frozen=True)
class LikelihoodLoss(SumOfSquares):
    """sum (residual / sigma)^2 over all samples and experiments, plus ((theta - mean) / sd)^2 of the priors.

    sigma is each sample's own where the dataset has it. sigmas: noise [SI] by channel, in the place of the dataset's.
    """

    sigmas: Mapping[str, float] = field(default_factory=dict[str, float])
    name: str = "likelihood"
    uses_priors: bool = True

    def square_weights(self, block: Block, residual: Floats) -> Floats:
        return 1.0 / self.stated_noise(block) ** 2

    def stated_noise(self, block: Block) -> Floats:
        sigma = self.sigmas.get(block.channel, block.sigma) if block.experiment else block.sigma
        return np.broadcast_to(np.asarray(sigma, dtype=float), len(block.residual))

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
                            attempt="a value for the channel under `noise` of the experiment, or another loss",
                        )
                    )
        return found
