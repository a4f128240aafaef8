"""Synchronisation of two records with separate clocks, by cross-correlation of a common motion."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.declare import Declared
from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Dataset, Step
from softcal.experiments.merge import covered
from softcal.quantities import Duration, Share
from softcal.units import format_quantity

_MAX_SAMPLES = 200_000
# Ratio of a second correlation peak to the best one from which the lag is ambiguous.
_AMBIGUOUS = 0.98
# Largest relative rate of two quartz clocks: two cheap ones at different temperatures. An estimate beyond it tells of
# the records: in 30 s and three cycles the noise alone makes 300 ppm, a material that lags 2000 ppm.
QUARTZ = 200e-6


@dataclass(frozen=True)
class ClockFit:
    """Relation of the two clocks: t_imu = t_utm + lag + rate (t_utm - middle).

    Attributes
    ----------
    lag
        Lag at `middle` [s]; positive if the IMU's clock is ahead.
    rate
        Relative rate [-]; 1e-6 is one ppm.
    middle
        Reference time on the UTM's clock [s].
    correlation
        Correlation coefficient of the two signals over their overlap [-].
    """

    lag: float
    rate: float
    middle: float
    correlation: float

    def to_imu(self, time: Floats) -> Floats:
        """The IMU's time at a time of the UTM's clock [s]."""
        return time + self.lag + self.rate * (time - self.middle)


def _pace(rate: float) -> str:
    return f"runs {abs(rate) * 1e6:.0f} ppm {'faster' if rate > 0 else 'slower'}"


def clock_warning(dataset: Dataset) -> str:
    """A warning if two records were estimated to have a rate that is impossible for two clocks, or ""."""
    for step in dataset.provenance:
        rate = step.settings.get("estimate", 0.0) if step.name == "synchronise" else 0.0
        if _impossible(rate):
            return (
                f"the clock of {step.settings['with']} is taken to run as fast as the other, at a lag of "
                f"{step.settings['lag']:+.3f} s: the halves of the records say that it {_pace(rate)}, but quartz "
                f"clocks differ by {QUARTZ * 1e6:.0f} ppm at most. Look at its time column and sampling rate; "
                "'estimate_rate: false' for records too short for an estimate"
            )
    return ""


def _impossible(rate: float) -> bool:
    return abs(rate) > QUARTZ


@dataclass(frozen=True)
class CommonMotion(Declared):
    """The motion that two records of different clocks measured, and how the lag between them is searched.

    Attributes
    ----------
    max_lag
        Largest lag that is searched [s]; None: as long as half of the shorter record overlaps. For equal cycles, give
        less than the duration of a cycle.
    reference, signal
        Channels of the first and of the second record that follow the same motion, with equal or opposite sign.
    estimate_rate
        Estimate a rate of the second clock relative to the first, from the lags of the two halves of the
        records. An estimate beyond what quartz clocks differ by, 200 ppm, is not used: both then run as fast.
    min_correlation
        Smallest accepted correlation coefficient over the overlap [-].
    """

    max_lag: Duration | None = None
    reference: str = "shortening"
    signal: str = "pitch"
    estimate_rate: bool = True
    min_correlation: Share = 0.8


def synchronise(utm: Dataset, imu: Dataset, motion: CommonMotion | None = None) -> Dataset:
    """The testing machine's dataset with the IMU's channels interpolated at its times.

    Parameters
    ----------
    utm
        Dataset of the testing machine.
    imu
        Dataset of the IMU.
    motion
        Settings of the search for the motion common to both; default settings if None.

    Raises
    ------
    DatasetError
        If both have the same channel, or the correlation is weak, peaks at the largest lag, or has two equal peaks.
    """
    motion = motion or CommonMotion()
    shared = [key for key in imu.channels if key in utm.channels and key != "time"]
    if shared:
        raise DatasetError(
            Fault(
                "both records have the same channel",
                where=f"{utm.name} and {imu.name}",
                got=", ".join(shared),
                attempt="leave it out of the columns of one",
            )
        )
    faults = [
        Fault(
            f"the {place} of the two files has no {channel}",
            where=f"{utm.name} and {imu.name}",
            got=", ".join(data.channels),
            attempt=f"first the file with {motion.reference}, then the one with {motion.signal}, or {key}: another "
            "channel",
        )
        for place, data, key, channel in (
            ("first", utm, "reference", motion.reference),
            ("second", imu, "signal", motion.signal),
        )
        if channel not in data.channels
    ]
    if faults:
        raise DatasetError(faults)
    fit = fit_clock(utm, imu, motion)
    estimate = fit.rate
    if _impossible(estimate):
        fit = fit_clock(utm, imu, replace(motion, estimate_rate=False))
    at = fit.to_imu(utm.values("time"))
    imu_time = imu.values("time")
    inside = covered(at, imu_time)
    outcome = (
        f"the clock of {imu.name} shows {fit.lag:+.4f} s beside that of {utm.name} at "
        f"{format_quantity(fit.middle, 's')}, "
        f"{_pace(fit.rate) if motion.estimate_rate and not _impossible(estimate) else 'taken to run as fast'}"
        f"{f', since no quartz clock {_pace(estimate)}' if _impossible(estimate) else ''}; "
        f"correlation of {motion.reference} and {motion.signal} {fit.correlation:+.4f}; "
        f"{len(inside)} of {utm.n_samples} samples have both"
    )
    settings = {"with": imu.name, **asdict(motion), "lag": fit.lag, "rate": fit.rate, "estimate": estimate}
    step = Step("synchronise", settings, outcome)
    both = replace(utm, provenance=(*utm.provenance, *imu.provenance)).take(inside, step)
    added = {
        key: replace(channel, values=np.interp(at[inside], imu_time, channel.values))
        for key, channel in imu.channels.items()
        if key != "time"
    }
    return replace(both, channels={**both.channels, **added})


def fit_clock(utm: Dataset, imu: Dataset, motion: CommonMotion) -> ClockFit:
    """Lag and rate of the IMU's clock against the UTM's by cross-correlation.

    Parameters
    ----------
    utm
        Dataset of the testing machine.
    imu
        Dataset of the IMU.
    motion
        Settings of the search for the motion common to both.

    Raises
    ------
    DatasetError
        If the peak of the correlation is weak, ambiguous or at the limit of the search.
    """
    where = f"{utm.name} and {imu.name}"
    x_time, x_raw = _distinct(utm.values("time"), utm.values(motion.reference))
    y_time, y_raw = _distinct(imu.values("time"), imu.values(motion.signal))
    spans = float(np.ptp(x_time)), float(np.ptp(y_time))
    if min(spans) <= 0.0 or min(np.ptp(x_raw), np.ptp(y_raw)) <= 0.0:
        raise DatasetError(Fault("a constant signal cannot be synchronised", where=where))
    step = max(min(float(np.median(np.diff(t))) for t in (x_time, y_time)), max(spans) / _MAX_SAMPLES)
    x = _evenly(x_time, x_raw, step)
    y = _evenly(y_time, y_raw, step)
    apart = y_time[0] - x_time[0]  # offset of the clocks by their own times
    coarse, sign = _coarse_lag(x, y, step, apart, motion.max_lag, where)
    shift, correlation = _refine(x, y, coarse, sign)
    if abs(correlation) < motion.min_correlation:
        raise DatasetError(
            Fault(
                f"{motion.reference} and {motion.signal} are hardly correlated, so the clocks cannot be matched",
                where=where,
                got=f"correlation {correlation:+.3f} at a lag of {shift * step + apart:.3f} s",
                allowed=f"{motion.min_correlation:g} or more",
                attempt="check that both files are of the same test, or a larger max_lag",
            )
        )
    begin, end = _overlap(len(x), len(y), round(shift))
    lag, middle, rate = shift * step + apart, float(x_time[0] + 0.5 * (begin + end) * step), 0.0
    if motion.estimate_rate:
        # From the lags of the first and of the last half of the overlap, if the motion is in both.
        lags: list[float] = []
        for a, b in ((begin, (begin + end) // 2), ((begin + end) // 2, end)):
            first, last = max(0, a + round(shift) - (b - a) // 4), b + round(shift) + (b - a) // 4
            base = a + round(shift) - first
            if np.ptp(x[a:b]) > 0.0 and np.ptp(y[first:last]) > 0.0:
                fine, _ = _refine(x[a:b], y[first:last], base, sign)
                lags.append((fine - base + round(shift)) * step + apart)
        if len(lags) == 2:
            early, late = lags
            lag, rate = 0.5 * (early + late), (late - early) / (0.5 * (end - begin) * step)
    return ClockFit(float(lag), float(rate), middle, float(correlation))


def _distinct(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    known = np.isfinite(values)
    time, values = time[known], values[known]
    kept = np.concatenate([[True], np.diff(time) > 0])
    return time[kept], values[kept]


def _evenly(time: Floats, values: Floats, step: float) -> Floats:
    grid = np.arange(time[0], time[-1] + 0.5 * step, step)
    return np.interp(grid, time, values)


def _coarse_lag(
    x: Floats, y: Floats, step: float, apart: float, max_lag: float | None, where: str
) -> tuple[int, float]:
    """Lag of y behind x in whole samples (by index), and the sign of the correlation there."""
    from scipy.signal import correlate, correlation_lags

    a, b = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
    # Not divided by the overlap: favours the lag at which most cycles coincide over one a period away.
    correlation = correlate(b, a, mode="full") / min(len(x), len(y))
    lags = correlation_lags(len(b), len(a), mode="full")
    overlap = np.minimum(len(y), lags + len(x)) - np.maximum(lags, 0)
    allowed = overlap >= min(len(x), len(y)) / 2
    if max_lag is not None:
        allowed &= np.abs(lags * step + apart) <= max_lag
    if np.count_nonzero(allowed) < 3:
        raise DatasetError(
            Fault(
                "no lag is within reach",
                where=where,
                got=f"the clocks read {apart:+.3f} s apart at the beginning"
                + ("" if max_lag is None else f", max_lag {max_lag:g} s"),
                attempt="a larger max_lag",
            )
        )
    correlation, lags = correlation[allowed], lags[allowed]
    best = int(np.argmax(np.abs(correlation)))
    if best in (0, len(lags) - 1):
        raise DatasetError(
            Fault(
                "the correlation of the two records peaks at the largest searched lag",
                where=where,
                got=f"lag {lags[best] * step + apart:+.3f} s",
                attempt="a larger max_lag, or records that cover the same cycles",
            )
        )
    sign = float(np.sign(correlation[best]))
    rectified = sign * correlation
    # Another peak of equal height, beyond the first loss of correlation on either side, makes the lag ambiguous.
    left = np.flatnonzero(rectified[:best] < 0.5 * rectified[best])
    right = np.flatnonzero(rectified[best:] < 0.5 * rectified[best])
    others = np.concatenate(
        [rectified[: left[-1]] if left.size else [], rectified[best + right[0] :] if right.size else []]
    )
    if others.size and others.max() > _AMBIGUOUS * rectified[best]:
        raise DatasetError(
            Fault(
                "two lags match the records equally well",
                where=where,
                got=f"correlation {rectified[best]:.3f} and {others.max():.3f}",
                attempt="max_lag below half the duration of a cycle",
            )
        )
    return int(lags[best]), sign


def _refine(x: Floats, y: Floats, coarse: int, sign: float) -> tuple[float, float]:
    """Lag in fractional samples, by a parabola through the correlation coefficients near the peak; and the peak."""
    reach = 2
    peak = _coefficient(x, y, coarse)
    # Wide enough that the parabola's decrease exceeds the noise: a hundredth of the peak's height.
    while reach < min(len(x), len(y)) // 4 and sign * _coefficient(x, y, coarse + reach) > sign * peak - 0.01:
        reach = int(np.ceil(1.5 * reach))
    offsets = np.unique(np.linspace(-reach, reach, 41).round().astype(int))
    coefficients = np.array([sign * _coefficient(x, y, coarse + int(offset)) for offset in offsets])
    curvature, slope, level = np.polyfit(offsets / reach, coefficients, 2)
    vertex = -0.5 * slope / curvature if curvature < 0.0 else np.inf
    if abs(vertex) > 1.0:
        best = int(np.argmax(coefficients))
        return float(coarse + offsets[best]), float(sign * coefficients[best])
    top = max(level - 0.25 * slope**2 / curvature, sign * peak)
    return float(coarse + reach * vertex), float(sign * min(top, 1.0))


def _coefficient(x: Floats, y: Floats, shift: int) -> float:
    begin, end = _overlap(len(x), len(y), shift)
    if end - begin < 3:
        return 0.0
    a, b = x[begin:end], y[begin + shift : end + shift]
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0


def _overlap(n_x: int, n_y: int, shift: int) -> tuple[int, int]:
    """Range of samples of x for which y[i + shift] exists."""
    return max(0, -shift), min(n_x, n_y - shift)
