"""Drawn shapes over the inputs of a reduced model, as few modes.

The points of all shapes are one matrix, of which the singular value decomposition gives the modes that represent it
best. Their coefficients are polynomials of the inputs, as the outputs of the model are. Points have four bytes a
coordinate, modes two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from softcal.checks import Floats
from softcal.export.reduced import terms_at

CLOSE = 2e-4  # of the largest displacement: the error of the modes in the shapes
MOST_MODES = 40
LARGEST = 32767  # of a mode's integers


@dataclass(frozen=True)
class ShapeModes:
    """Points of shapes over inputs. data: `rest` (points, float32), `modes` (int16), `n_modes`, and the `powers` and
    `coefficients` of the modes.
    """

    data: Mapping[str, Any]

    def distance(self, directions: Floats, places: Floats, shapes: Floats) -> float:
        """The largest distance [m] of a point from its position in other shapes.

        Parameters
        ----------
        directions
            Directions of the model (n_inputs, n_inputs).
        places
            Inputs (n, n_inputs), each from -1 to 1 over its range.
        shapes
            Positions there (n, n_points, 3) [m].
        """
        terms = terms_at(places, directions, np.array(self.data["powers"]))
        modes = self.data["modes"].astype(np.float64)
        moved = terms @ np.array(self.data["coefficients"]) @ modes
        return _furthest(moved - (shapes - self.data["rest"]).reshape(len(shapes), -1))


def shape_modes(rest: Floats, shapes: Floats, fitted: Callable[[Floats], Mapping[str, Any]]) -> ShapeModes:
    """The modes of shapes.

    Parameters
    ----------
    rest
        Positions (n_points, 3) [m] from which displacements are counted.
    shapes
        Positions (n, n_points, 3) [m].
    fitted
        From values (n, k) in these shapes to the `powers` and `coefficients` of polynomials.
    """
    start = rest.astype("<f4")
    moved: Floats = np.asarray(shapes - start, dtype=np.float64).reshape(len(shapes), -1)
    _, _, basis = np.linalg.svd(moved, full_matrices=False)
    allowed = CLOSE * _furthest(moved)
    n = 1
    while True:
        modes = basis[:n]
        scale = np.abs(modes).max(axis=1, initial=0.0, keepdims=True) / LARGEST
        rounded = np.round(np.divide(modes, scale, out=np.zeros_like(modes), where=scale > 0.0)).astype("<i2")
        # Coefficients of the rounded modes, which are no longer orthogonal.
        found = np.asarray(np.linalg.lstsq(rounded.T.astype(np.float64), moved.T, rcond=None)[0].T, dtype=np.float64)
        if n == min(len(basis), MOST_MODES) or _furthest(found @ rounded - moved) <= allowed:
            break
        n += 1
    return ShapeModes({"n_modes": n, "rest": start, "modes": rounded, **fitted(found)})


def _furthest(difference: Floats) -> float:
    return float(np.linalg.norm(difference.reshape(-1, 3), axis=1).max(initial=0.0))
