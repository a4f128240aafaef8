"""The loss over one parameter, least over all others, as the derivatives at the best point predict it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.statistics.local_model import LocalModel, Point

Curve = tuple[tuple[float, float], ...]
"""Pairs of a parameter's value [unit] and the least loss there, from the lowest value to the highest."""

_MOST = 6  # parameters
_POINTS = 8  # on each side of the best value
_BEYOND = 0.5  # of the interval's length, on both sides
_PASSES = 6  # of the minimum over the others, from that of the point before


def loss_profiles(
    space: SearchSpace,
    loss: Loss,
    theta: Mapping[str, float],
    blocks: Sequence[Block],
    intervals: Mapping[str, tuple[float, float] | None],
) -> dict[str, Curve]:
    """Label -> curve, over the interval [SI] and beyond it, of the parameters that all experiments share; of the first
    ones without such. The blocks must have jacobians: nothing is simulated.

    The residuals follow `LocalModel`, every parameter stays within its bounds.
    """
    z = np.clip(space.to_search(theta), 0.0, 1.0)
    model = LocalModel(space, loss, Point(z, blocks))
    if not model.reproduces():
        model = LocalModel(space, loss, Point(z, blocks), plain=True)
    known = [j for j, p in enumerate(space.parameters) if intervals.get(p.label) is not None]
    shared = [j for j in known if not space.parameters[j].experiment] or known
    found: dict[str, Curve] = {}
    for j in shared[:_MOST]:
        label = space.labels[j]
        low, high = (float(space.to_search({**theta, label: end})[j]) for end in intervals[label] or ())
        more = _BEYOND * (high - low)
        curve = {theta[label]: model.loss(z)}
        for end in (max(low - more, 0.0), min(high + more, 1.0)):
            x = z
            for value in np.linspace(z[j], end, _POINTS + 1)[1:]:
                lower, upper = np.zeros(space.size), np.ones(space.size)
                lower[j] = upper[j] = value
                x = model.minimise(lower, upper, begin=x, max_iterations=_PASSES)
                curve[space.to_model(x)[label]] = model.loss(x)
        found[label] = tuple(sorted(curve.items()))
    return found
