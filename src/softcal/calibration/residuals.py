"""Residuals along a record: how much neighbouring samples say the same.

The lag-1 correlation r of n residuals tells how many independent ones they are worth, n (1 - r) / (1 + r); the number
of runs of one sign is a second measure, which a few large residuals do not decide (Wald and Wolfowitz 1940).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats

FEW = 1 / 3
"""Share of the samples: with fewer effective ones, neighbouring residuals are called alike."""
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
    """

    n: int
    correlation: float
    runs: int
    expected_runs: float

    @property
    def effective(self) -> float:
        """Number of independent samples that would tell as much."""
        r = min(max(self.correlation, 0.0), 1.0 - 1.0 / self.n)
        return self.n * (1.0 - r) / (1.0 + r)

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
    return ResidualRecord(n, float(residual[1:] @ residual[:-1]) / square, runs, 1.0 + 2.0 * up * (n - up) / n)
