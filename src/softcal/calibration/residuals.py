"""Residuals along a record: how much neighbouring samples say the same, and whether they are noise at all.

The lag-1 correlation r of n residuals tells how many independent ones they are worth, n (1 - r) / (1 + r); the number
of runs of one sign is a second measure, which a few large residuals do not decide (Wald and Wolfowitz 1940).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from softcal.checks import Floats

FEW = 1 / 3
"""Share of the samples: with fewer effective ones, neighbouring residuals are called alike."""
CURVE, OF_CURVE = 1 / 5, 10
"""Share of the samples, and number: with fewer effective ones than both, residuals are a curve that the model misses. A
long record of correlated noise is worth more."""
FEWEST_OF_CURVE = 20
"""Fewer residuals of white noise look like a curve too often."""
FEWEST = 8
"""Fewer residuals show no correlation."""


@dataclass(frozen=True)
class ResidualRecord:
    """The residuals of one channel of one experiment, in the order of its samples.

    Attributes
    ----------
    n
        Number of residuals.
    correlation
        Lag-1 correlation about zero [-].
    runs, expected_runs
        Runs of one sign, and how many independent residuals of these signs would have on average.
    size
        Their root mean square, in the unit of the channel; zero where it is not known.
    largest
        Where they are largest, averaged over a twentieth of the record: as a part of its samples [-].
    explained
        Usual cause -> the share of them that it explains [-], the largest first (`softcal.calibration.misfit`).
    """

    n: int
    correlation: float
    runs: int
    expected_runs: float
    size: float = 0.0
    largest: float = 0.0
    explained: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def effective(self) -> float:
        """Number of independent samples that would tell as much."""
        r = min(max(self.correlation, 0.0), 1.0 - 1.0 / self.n)
        return self.n * (1.0 - r) / (1.0 + r)

    @property
    def is_curve(self) -> bool:
        """Whether they are a curve that the model misses, and no noise of single samples."""
        return self.n >= FEWEST_OF_CURVE and self.effective < min(CURVE * self.n, OF_CURVE)

    @property
    def are_alike(self) -> bool:
        """Whether neighbouring residuals are so alike that the samples tell far less than their number."""
        return self.n >= FEWEST and self.effective < FEW * self.n


def residual_record(residual: Floats) -> ResidualRecord | None:
    """The record of residuals (n,); None where there are fewer than two, or all are zero."""
    n, square = len(residual), float(residual @ residual)
    if n < 2 or square == 0.0:
        return None
    positive = residual > 0
    up = int(positive.sum())
    runs = 1 + int(np.sum(positive[1:] != positive[:-1]))
    part = max(n // 20, 1)
    means = np.convolve(residual, np.full(part, 1.0 / part), "valid")
    largest = (int(np.abs(means).argmax()) + 0.5 * (part - 1)) / (n - 1)
    return ResidualRecord(
        n,
        float(residual[1:] @ residual[:-1]) / square,
        runs,
        1.0 + 2.0 * up * (n - up) / n,
        float(np.sqrt(square / n)),
        largest,
    )
