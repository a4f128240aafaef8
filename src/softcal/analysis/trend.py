"""Trend of values that differ between the experiments of a joint fit with the conditions of the experiments.

A value as a power of the amplitude is a straight line of logarithms, with one slope and no choice of a form after the
fact:

    ln value_i = a + b ln amplitude_i + e_i,    weights 1 / (v_i + tau^2)

The slope is tested by Student's t with k - 2 degrees of freedom, against the scatter about the line (Knapp and Hartung,
Statistics in Medicine 22, 2003), so that experiments which differ at random show a trend one time in twenty. An exact
order alone would not do: three values are in order by chance in one case of three. Where the experiments differ in both
their amplitude and their speed, the chance of each counts twice; where both vary together, neither is named as the
cause.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from softcal.calibration.results.result import ExperimentFit, SearchResult
from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.sensing.channel import channel_name

LIMIT = 0.05
"""Chance below which values follow a condition."""
_FEWEST = 3
_ALIKE = 1.2  # ratio of the largest amplitude to the smallest below which they are alike
_TOGETHER = 0.5  # correlation of two conditions above which either can be the cause

Condition = Literal["amplitude", "speed"]


ENOUGH = 5
"""Tests of which a trend's chance is said: of fewer, another assumed shape of it gives quite another chance."""


@dataclass(frozen=True)
class Trend:
    """A parameter that rises or falls with a condition of the experiments.

    Attributes
    ----------
    name
        Label of the parameter.
    condition
        "amplitude": the largest magnitude of the drive; "speed": its rate.
    power
        The value grows as the condition to this power [-]; of values that are not positive, its sign alone counts.
    chance
        Probability that experiments without a trend show as much in any of the tested conditions.
    tested
        Number of conditions in which the experiments differ.
    along
        Conditions that vary together with this one, which may be the cause as well.
    n_tests
        Number of experiments; of fewer than `ENOUGH` the chance depends on the shape that is assumed of the trend.
    """

    name: str
    condition: Condition
    power: float
    chance: float
    tested: int = 1
    along: tuple[Condition, ...] = ()
    n_tests: int = 0


def trends(result: SearchResult, records: Mapping[str, Dataset] | None = None) -> tuple[Trend, ...]:
    """The clearest trend of each parameter that differs between the experiments, if it has one.

    records: experiment -> its record with times, for the speeds.
    """
    drives = {name: _drives(fit) for name, fit in result.experiments.items()}
    kinds = [{channel_name(drive).kind.name for drive in held} for held in drives.values()]
    largest: dict[str, float] = {}  # none if different channels drove the experiments
    if all(kind == kinds[0] and len(kind) == 1 for kind in kinds):
        of = {name: fit.measured for name, fit in result.experiments.items()}
        largest = {name: max(float(np.nanmax(np.abs(of[name][d]))) for d in held) for name, held in drives.items()}
    known: dict[Condition, Mapping[str, float]] = {"amplitude": largest, "speed": _speeds(result, records or {})}
    found: list[Trend] = []
    for name, spread in result.spreads.items():
        if not spread.differs or len(spread.values) < _FEWEST:
            continue
        # Of a condition that is known for all experiments and differs, the logarithms.
        differ: dict[Condition, Floats] = {}
        for c, at in known.items():
            x = np.array([at.get(experiment, 0.0) for experiment in spread.values])
            if x.min() > 0.0 and x.max() >= _ALIKE * x.min():
                differ[c] = np.log(x)
        y = np.array(list(spread.values.values()))
        weights = np.array([spread.weights.get(experiment, 1.0) for experiment in spread.values])
        slopes: dict[Condition, tuple[float, float]] = {
            c: slope(x, np.log(y) if np.all(y > 0) else y, weights) for c, x in differ.items()
        }
        clearest = min(slopes, key=lambda c: slopes[c][1], default=None)
        if clearest is None or len(slopes) * slopes[clearest][1] >= LIMIT:
            continue
        power, chance = slopes[clearest]
        along: list[Condition] = []
        for c, x in differ.items():
            (xx, xy), (_, yy) = np.cov(x, differ[clearest], aweights=weights, ddof=0)
            if c != clearest and abs(float(xy / np.sqrt(xx * yy))) > _TOGETHER:
                along.append(c)
        found.append(
            Trend(
                name=name,
                condition=clearest,
                power=power,
                chance=len(slopes) * chance,
                tested=len(slopes),
                along=tuple(along),
                n_tests=len(y),
            )
        )
    return tuple(found)


def slope(x: Floats, y: Floats, weights: Floats) -> tuple[float, float]:
    """Slope of a weighted straight line, and the probability of a slope as steep without any trend.

    Parameters
    ----------
    x
        Abscissae (k,), k > 2.
    y
        Ordinates (k,).
    weights
        Weights (k,).
    """
    from scipy.special import stdtr

    away, off = x - np.average(x, weights=weights), y - np.average(y, weights=weights)
    square = float(weights @ away**2)
    steep = float(weights @ (away * off)) / square
    dof = len(x) - 2
    error = float(np.sqrt(weights @ (off - steep * away) ** 2 / dof / square))
    if error == 0.0:
        return steep, 0.0 if steep else 1.0
    return steep, float(2.0 * stdtr(dof, -abs(steep) / error))


def _speeds(result: SearchResult, records: Mapping[str, Dataset]) -> dict[str, float]:
    """Usual rate of each experiment's drive [SI]; experiments without times are left out."""
    found: dict[str, float] = {}
    for name, fit in result.experiments.items():
        channels = records[name].channels if name in records else {}
        drives = [drive for drive in _drives(fit) if drive in channels]
        if drives and "time" in channels:
            step = np.diff(records[name].values("time"))
            moving = step > 0.0
            speeds = [np.abs(np.diff(records[name].values(drive))[moving] / step[moving]) for drive in drives]
            found[name] = max(float(np.nanmedian(each)) if moving.any() else 0.0 for each in speeds)
    return found


def _drives(fit: ExperimentFit) -> tuple[str, ...]:
    """Measured channels that drove the twin: of a kind that can, and not compared."""
    return tuple(
        channel
        for channel in fit.measured
        if not (of := channel_name(channel)).is_deviation and of.kind.drives and channel not in fit.rmse
    )
