"""95 % intervals: the values that the loss near its optimum does not exclude, among those that a parameter can have.

Gauss-Newton's model of the loss is a quadratic in theta, or in ln theta where the logarithm is searched. The interval
of a parameter is that of the profile likelihood in this model: the values at which the sum of squares, least over all
other parameters, is within t^2 variances of the optimum's, t being Student's. Every parameter stays within its physical
limits, so that no interval reaches past its own, and none farther than the others can follow. Away from all limits this
is the usual value -+ t standard errors; an end at a limit says that the data does not exclude the limit.

A variable that has the limits at infinity (a logit) would not do: the answer of elements that do not lock is smooth up
to nu = 0.5, and an interval in logit(nu) leaves out what lies next to it, however little the data tells.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from softcal.calibration.parameters import FreeParameter
from softcal.checks import Floats

CONFIDENCE = 0.95
_LARGEST_EXPONENT = 700.0
_STANDS = 1e-12  # standard errors


def intervals(
    parameters: Sequence[FreeParameter], theta: Mapping[str, float], errors: Floats, root: Floats, dof: int
) -> list[tuple[float, float]]:
    """The 95 % interval [SI] of each parameter.

    Parameters
    ----------
    theta, errors
        The optimum [SI by label], and the parameters' standard errors [SI].
    root
        `root.T @ root` is the correlation of the parameters.
    dof
        Degrees of freedom that the noise is known from; 0 where it is known beforehand.
    """
    from scipy.special import ndtri, stdtrit

    upper_tail = 0.5 * (1.0 + CONFIDENCE)
    t = float(stdtrit(dof, upper_tail) if dof > 0 else ndtri(upper_tail))
    values = np.array([theta[p.label] for p in parameters])
    # Steps are counted in standard errors, of the logarithm where that is searched.
    units = errors / [value if p.scale == "log" else 1.0 for p, value in zip(parameters, values, strict=True)]
    room = np.array([_room(p, v, u) for p, v, u in zip(parameters, values, units, strict=True)])
    # The sum of squares of rows @ steps is what the loss rises by, in variances of the noise.
    rows = np.linalg.inv(np.linalg.qr(root, mode="r")).T
    correlation = root.T @ root
    found: list[tuple[float, float]] = []
    for j, p in enumerate(parameters):
        low, high = (_end(rows, j, sign * t * correlation[j], room, t) for sign in (-1.0, 1.0))
        value, unit = float(values[j]), float(units[j])
        found.append((_value(p, value, low * unit), _value(p, value, high * unit)))
    return found


def _room(parameter: FreeParameter, value: float, unit: float) -> tuple[float, float]:
    """How far a parameter may go down and up, in steps of `unit`."""
    if unit == 0.0:  # the twin meets the data exactly
        return -math.inf, math.inf
    if parameter.scale == "log":
        low = math.log(parameter.floor / value) if parameter.floor > 0 else -math.inf
        high = math.log(parameter.ceiling / value) if math.isfinite(parameter.ceiling) else math.inf
    else:
        low, high = parameter.floor - value, parameter.ceiling - value
    # Where it stands at a limit a trace of room is left, which the bounded least squares need.
    return min(low / unit, -_STANDS), max(high / unit, _STANDS)


def _end(rows: Floats, j: int, away: Floats, room: Floats, t: float) -> float:
    """How far parameter j goes until the loss is t^2 up, whatever the others do within their limits.

    away: the steps of all where nothing has a limit.
    """
    from scipy.optimize import brentq, lsq_linear

    if np.all((room[:, 0] <= away) & (away <= room[:, 1])):
        return float(away[j])
    others = np.delete(np.arange(rows.shape[1]), j)

    def excess(step: float) -> float:
        push = rows[:, j] * step
        if len(others):
            follow = lsq_linear(rows[:, others], -push, (room[others, 0], room[others, 1]), method="bvls")
            push = push + rows[:, others] @ follow.x
        return float(push @ push) - t**2

    limit = float(np.clip(away[j], *room[j]))
    return limit if excess(limit) <= 0.0 else cast("float", brentq(excess, 0.0, limit))


def _value(parameter: FreeParameter, value: float, step: float) -> float:
    """The value [SI] a step away: a step in the logarithm where that is searched."""
    if parameter.scale == "log":
        return math.exp(max(min(math.log(value) + step, _LARGEST_EXPONENT), -_LARGEST_EXPONENT))
    return min(max(value + step, parameter.floor), parameter.ceiling)  # rounding alone may lead past a limit
