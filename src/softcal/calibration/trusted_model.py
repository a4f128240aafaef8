"""Which local model a search follows: the one that predicts best what it has already simulated."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softcal.calibration.local_model import LocalModel, Point
from softcal.calibration.loss import Loss
from softcal.calibration.parameters import SearchSpace

# Of the scaled models' error: Gauss-Newton's must be smaller to replace them, since they extrapolate better.
_CLEARLY = 0.5


def trusted_model(space: SearchSpace, loss: Loss, here: Point, others: Sequence[Point]) -> LocalModel:
    """The model around `here` with the smallest error at the other points, nearest first, bent to the nearest.

    The models scale forces with moduli, with Poisson's ratio as itself or as its reciprocal distance to the ceiling.
    Gauss-Newton's takes their place where it predicts clearly better, as in a valley of factors (modulus times
    friction), which is straight in their logarithms; and where they do not reproduce the twin at its own point.
    """
    scaled = [LocalModel(space, loss, here, reciprocal=reciprocal) for reciprocal in (True, False)]
    plain = LocalModel(space, loss, here, plain=True)
    *errors, of_plain = (sum(model.missed(point) for point in others) for model in (*scaled, plain))
    model = plain if of_plain < _CLEARLY * min(errors) else scaled[int(np.argmin(errors))]
    if others:
        model.bend(others[0])
    return model if model.reproduces() else LocalModel(space, loss, here, plain=True)
