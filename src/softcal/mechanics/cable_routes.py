"""The cables' term, from the points with weights that their via points are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.cable import CableTerm
from softcal.mechanics.segments import MET, EndMotion, Segments

Weights = list[tuple[int, float]]


def build_cables(
    X: Floats,
    supports: dict[str, list[Weights]],
    pulled_last: np.ndarray,
    placed: Mapping[str, dict[str, list[Weights]]] | None = None,
    stated: tuple[str, ...] = (),
    slowness: Floats | None = None,
) -> CableTerm:
    """The cables' term. The rest length of a cable is that of its polyline on the undeformed robot.

    Parameters
    ----------
    X
        Points of the undeformed robot (n_points, 3) [m].
    supports
        Cable -> its via points, each as weighted points [(point, weight), ...].
    pulled_last
        Whether a cable is pulled at its last via point, else at its first (n_cables,).
    placed
        Cable -> parameter -> derivatives of its via points by the parameter, as weighted points whose weights sum to 0.
    stated, slowness
        See `CableTerm`.
    """
    ptr, support, sigma, cable, order = [0], [], [], [], list[int]()
    for c, via in enumerate(supports.values()):
        first = len(cable)
        for start, end in pairwise(via):
            weights = _difference(start, end)
            support.extend(sorted(weights))
            sigma.extend(weights[p] for p in sorted(weights))
            ptr.append(len(support))
            cable.append(c)
        own = range(first, len(cable))
        order.extend(reversed(own) if pulled_last[c] else own)
    segments = Segments(
        np.array(ptr, dtype=np.int64),
        np.array(support, dtype=np.int64),
        np.array(sigma, dtype=np.float64),
        np.zeros(len(cable)),
    )
    segments = replace(segments, met=MET * np.linalg.norm(segments.vectors(X), axis=1))
    of_cable = np.array(cable, dtype=np.int64)
    end_motions = {
        parameter: _end_motion(c, int(np.searchsorted(of_cable, c)), ways, segments, X)
        for c, name in enumerate(supports)
        for parameter, ways in (placed or {}).get(name, {}).items()
    }
    return CableTerm(
        names=tuple(supports),
        segments=segments,
        cable=of_cable,
        order=np.array(order, dtype=np.int64),
        rest=segments.shape(X).lengths,
        stated=stated,
        end_motions=end_motions,
        slowness=slowness,
    )


def _end_motion(cable: int, first: int, ways: list[Weights], segments: Segments, X: Floats) -> EndMotion:
    """The motion of a cable from the number of its first segment and its via points' derivatives."""
    changes = [
        (first + k, point, rate) for k, ends in enumerate(pairwise(ways)) for point, rate in _difference(*ends).items()
    ]
    segment, support, rate = zip(*changes, strict=True) if changes else ((), (), ())
    motion = EndMotion(
        cable,
        np.array(segment, dtype=np.int64),
        np.array(support, dtype=np.int64),
        np.array(rate, dtype=np.float64),
        np.zeros(len(segments)),
    )
    return replace(motion, rest=segments.lengths_by(motion, X, segments.shape(X)))


def _difference(start: Weights, end: Weights) -> dict[int, float]:
    """The weights of the vector from one weighted point to another."""
    weights: dict[int, float] = {}
    for sign, place in ((-1.0, start), (1.0, end)):
        for point, weight in place:
            weights[point] = weights.get(point, 0.0) + sign * weight
    return weights
