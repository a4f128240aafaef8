"""Residuals along a record: how much neighbouring samples say the same, and whether they are noise at all.

The lag-1 correlation r of n residuals tells how many independent ones they are worth, n (1 - r) / (1 + r); the number
of runs of one sign is a second measure, which a few large residuals do not decide (Wald and Wolfowitz 1940).
"""

from __future__ import annotations

import math
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
"""Least number of residuals that can be called a curve: fewer of white noise look like one too often."""
FEWEST = 8
"""Least number of residuals that can show a correlation."""
SHOWN = 5.0
"""Standard errors from which a cause is in the residuals beyond chance: of 200 right models, in at most one in 20."""
_AROUND = 5  # samples in whose median a sample that is far off has no part
_OUTLYING = 6.0  # deviations from there, by the median of all; of white noise one record in 1000 has 5
_ABOUT = 41  # samples by whose median too: noise may grow along the record
_SINGLE = 0.05  # of the samples: more of them are no outliers
_ROUNDING = 1e-9  # of the largest reading: closer ones are the same
_OF_STEP = 0.01  # of a step of the readings


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
        Usual cause no larger than the record -> the share of their squares that it explains [-], the clearest first
        (`softcal.calibration.statistics.misfit`).
    significance
        How many standard errors the clearest shape of such causes, of any size, is worth [-].
    outliers
        The samples of the experiment, from 1, that are far off their neighbours.
    step
        The step of the instrument's readings where it is larger than the residuals, in the unit of the channel; else 0.
    """

    n: int
    correlation: float
    runs: int
    expected_runs: float
    size: float = 0.0
    largest: float = 0.0
    explained: Mapping[str, float] = field(default_factory=dict[str, float])
    significance: float = 0.0
    outliers: tuple[int, ...] = ()
    step: float = 0.0

    def __post_init__(self) -> None:
        parts = (abs(self.correlation), self.largest, *self.explained.values())
        amounts = (self.n - 1, self.runs, self.expected_runs, self.size, self.significance, self.step, *parts)
        if min(amounts) < 0.0 or max(parts) > 1.0 + 1e-9 or min(self.outliers, default=1) < 1:
            raise ValueError("no record of residuals has such numbers")

    @property
    def effective(self) -> float:
        """Number of independent samples that would tell as much."""
        r = min(max(self.correlation, 0.0), 1.0 - 1.0 / self.n)
        return self.n * (1.0 - r) / (1.0 + r)

    @property
    def is_curve(self) -> bool:
        """Whether the residuals are a curve that the model misses, not noise of single samples."""
        return self.n >= FEWEST_OF_CURVE and self.effective < min(CURVE * self.n, OF_CURVE)

    @property
    def is_misfit(self) -> bool:
        """Whether the residuals are more than noise: a curve, a usual cause beyond chance, outliers, or steps."""
        return self.is_curve or self.significance > SHOWN or bool(self.outliers) or self.step > 0.0

    @property
    def are_alike(self) -> bool:
        """Whether neighbouring residuals are so correlated that the samples are worth far fewer independent ones."""
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


def outliers(residual: Floats) -> np.ndarray:
    """Indices of single residuals (n,) that are far off the median of their neighbours, and off the parabola through
    these, so that the top of a curve is none.
    """
    from scipy.ndimage import convolve1d, median_filter

    n = len(residual)
    if n < FEWEST_OF_CURVE:
        return np.zeros(0, dtype=np.intp)
    off_median = residual - median_filter(residual, size=_AROUND, mode="mirror")
    off_parabola = np.abs(convolve1d(residual, np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0, mode="mirror"))
    for end in (slice(4), slice(-1, -5, -1)):  # where mirrored neighbours make any steep curve a peak
        off_parabola[end][:2] = np.minimum(off_parabola[end][:2], abs(np.diff(residual[end], 3)[0]) / 2.0)
    far = np.flatnonzero(_is_far(off_median) & _is_far(off_parabola))
    return far if len(far) <= _SINGLE * n else far[:0]


def _is_far(off: Floats) -> np.ndarray:
    from scipy.ndimage import median_filter

    size = np.abs(off)
    if not np.any(size > 0.0):
        return size > 0.0
    typical = np.maximum(np.median(size[size > 0.0]), median_filter(size, size=min(_ABOUT, len(size)), mode="mirror"))
    return size > _OUTLYING * 1.4826 * typical


def step_of_readings(measured: Floats, residual: Floats) -> float:
    """The step between measured values (n,) where all are whole steps apart and it is larger than the residuals (n,);
    else zero.
    """
    if len(measured) < FEWEST_OF_CURVE:
        return 0.0
    unit = _ROUNDING * float(np.abs(measured).max())
    gaps = np.diff(np.unique(np.round(measured / unit))) * unit if unit > 0.0 else np.zeros(0)
    step = float(gaps.min(initial=np.inf))
    if not math.isfinite(step) or step <= float(np.sqrt(np.mean(residual**2))):
        return 0.0
    return step if np.all(np.abs(gaps / step - np.round(gaps / step)) < _OF_STEP) else 0.0
