"""Drawn shapes over a grid of tensions, as few modes.

The points of all shapes at the nodes are one matrix, of which the singular value decomposition gives the modes that
represent it best. Their coefficients are interpolated over the grid as the channels of the grid's model are, with the
slopes of splines through them. Points have four bytes a coordinate, modes two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from softcal.checks import Floats
from softcal.export.tension_grid import with_mixed
from softcal.export.tension_grid_model import GridModel

CLOSE = 2e-4  # of the largest displacement: the error of the modes at the nodes
MOST_MODES = 40
LARGEST = 32767  # of a mode's integers


@dataclass(frozen=True)
class ShapeModes:
    """Points of shapes over tensions.

    Attributes
    ----------
    data
        For the page: `rest` (points at the first node, float32), `modes` (int16), `n_modes`, and `nodes`, the
        coefficients as the model's `nodes` are.
    error
        The largest distance [m] of a point from the twin's at the nodes and at the held-out tensions.
    """

    data: Mapping[str, Any]
    error: float


def shape_modes(model: Mapping[str, Any], nodes: Floats, points: Floats, between: Floats) -> ShapeModes:
    """The modes of shapes.

    Parameters
    ----------
    model
        Of the same grid.
    nodes
        Positions [m] at its nodes (n_nodes, n_points, 3), the last cable's changing first.
    points
        Held-out tensions (n, n_cables) [N].
    between
        Positions there (n, n_points, 3).
    """
    rest = nodes[0].astype("<f4")
    moved = (nodes - rest).reshape(len(nodes), -1)
    _, _, basis = np.linalg.svd(moved, full_matrices=False)
    allowed = CLOSE * float(np.linalg.norm(moved.reshape(*nodes.shape), axis=2).max(initial=0.0))
    n = 1
    while True:
        modes = basis[:n]
        scale = np.abs(modes).max(axis=1, initial=0.0, keepdims=True) / LARGEST
        rounded = np.round(np.divide(modes, scale, out=np.zeros_like(modes), where=scale > 0.0)).astype("<i2")
        # Coefficients of the rounded modes, which are no longer orthogonal.
        found = np.linalg.lstsq(rounded.T.astype(np.float64), moved.T, rcond=None)[0].T
        if n == min(len(basis), MOST_MODES) or _furthest(found @ rounded - moved) <= allowed:
            break
        n += 1
    data = {"n_modes": n, "rest": rest, "modes": rounded, "nodes": hermite(model, found)}
    read = GridModel({**model, "nodes": data["nodes"]})
    at = np.array([read.channels([*map(float, tensions)], read.model["nodes"]) for tensions in points])
    errors = (found @ rounded - moved, np.reshape(at, (-1, n)) @ rounded - (between - rest).reshape(-1, rest.size))
    return ShapeModes(data, max(map(_furthest, errors)))


def hermite(model: Mapping[str, Any], values: Floats, *, monotonic: bool = False) -> list[Any]:
    """Values (n_nodes, n) with their slopes and mixed derivatives, as the model's `nodes` are.

    Parameters
    ----------
    model
        Of the same grid.
    values
        At its nodes, the last cable's changing first.
    monotonic
        Whether the slopes are those of monotonic pieces, which do not leave the range of the values, or of a spline.
    """
    axes: Sequence[Floats] = [np.array(axis) for axis in model["axes"]]
    table = values.reshape(*map(len, axes), -1)
    through = PchipInterpolator if monotonic else CubicSpline
    slopes = [through(axis, table, axis=k).derivative()(axis) for k, axis in enumerate(axes)]
    return with_mixed(np.stack([table, *slopes], axis=-2), axes).tolist()


def _furthest(difference: Floats) -> float:
    return float(np.linalg.norm(difference.reshape(-1, 3), axis=1).max(initial=0.0))
