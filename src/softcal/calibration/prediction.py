"""Where the models around one simulated point see the minimum: what a search steps by, and what it is given up by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softcal.calibration.local_model import LocalModel, Point, ceiling_powers, layer_powers
from softcal.calibration.loss import Loss
from softcal.calibration.parameters import SearchSpace
from softcal.checks import Floats

_APART = 0.02  # of the search range: over less, the bend between two points is made of the twin's rounding


@dataclass(frozen=True)
class Prediction:
    """A minimum that has not been simulated: its place z in the unit box and its modelled loss."""

    z: Floats
    loss: float


def predict(
    space: SearchSpace, loss: Loss, here: Point, others: Sequence[Point], lower: Floats, upper: Floats
) -> Prediction:
    """The minimum of the model around `here` in a box of the search space.

    Each of the other points gives a model of its own, bent to meet it (see `LocalModel`). That one is believed whose
    minimum lies between its two points, or the least beyond them (see `LocalModel.beyond`).
    No bend leads through the edge of a layer.
    """
    found: list[tuple[float, Prediction]] = []
    layer = _layer(space, here)
    far = [
        other
        for other in others
        if float(np.abs(other.z - here.z).max()) > _APART and np.array_equal(_layer(space, other), layer)
    ]
    for other in far or [None]:
        powers = None if other is None else ceiling_powers(space, here, other)
        model = LocalModel(space, loss, here, other, powers)
        z = model.minimise(lower, upper)
        found.append((model.beyond(z), Prediction(z, model.loss(z))))
    return min(found, key=lambda pair: pair[0])[1]


def way_out(space: SearchSpace, loss: Loss, here: Point) -> Floats | None:
    """A point outside the thin layer under a ceiling in which `here` lies; None where it lies in none.

    In the layer in which linear tets lock, derivatives hold over a thousandth of the range; a search that begins there
    creeps. The point has the layer's parameters in the middle of their ranges, and the others as the slopes ask for.
    """
    inside = _layer(space, here) & (here.z > 0.5)
    if not inside.any():
        return None
    lower, upper = np.where(inside, 0.5, 0.0), np.where(inside, 0.5, 1.0)
    return LocalModel(space, loss, here, None, layer_powers(space, here)).minimise(lower, upper)


def _layer(space: SearchSpace, here: Point) -> NDArray[np.bool_]:
    """By which parameters a point lies in a layer."""
    return ~np.isnan(layer_powers(space, here))
