"""The cables' term, from the points with weights that their via points are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.cable import ROUTING, CableTerm
from softcal.mechanics.segments import MET, Segments

Weights = list[tuple[int, float]]


def build_cables(
    X: Floats,
    supports: dict[str, list[Weights]],
    pulled_last: np.ndarray,
    by_routing: Mapping[str, Mapping[str, list[Weights]]] | None = None,
    stated: tuple[str, ...] = (),
) -> CableTerm:
    """The term of cables given, by name and via point, as weighted points [(point, weight), ...].

    The rest length is the polyline's on the undeformed robot, X (n_points, 3) [m]. pulled_last (n_cables,): whether a
    cable is pulled at its last via point, or else at its first. by_routing, of cables that have a routing axis: their
    via points' derivatives by each of `ROUTING`, as points with weights whose sum is zero. stated: see `CableTerm`.
    """
    ptr, support, sigma, cable, order = [0], [], [], [], list[int]()
    rates: dict[str, list[float]] = {kind: [] for kind in ROUTING}
    for c, (name, via) in enumerate(supports.items()):
        first = len(cable)
        moves = (by_routing or {}).get(name, {})
        for k, ends in enumerate(pairwise(via)):
            weights = _difference(*ends)
            changes = {kind: _difference(*ways[k : k + 2]) for kind, ways in moves.items()}
            points = sorted(set(weights).union(*changes.values()))
            support.extend(points)
            sigma.extend(weights.get(p, 0.0) for p in points)
            for kind, rate in rates.items():
                rate.extend(changes.get(kind, {}).get(p, 0.0) for p in points)
            ptr.append(len(support))
            cable.append(c)
        own = range(first, len(cable))
        order.extend(reversed(own) if pulled_last[c] else own)
    segments = Segments(
        np.array(ptr, dtype=np.int64),
        np.array(support, dtype=np.int64),
        np.array(sigma, dtype=np.float64),
        {kind: np.array(rate, dtype=np.float64) for kind, rate in rates.items()},
        np.zeros(len(cable)),
    )
    segments = replace(segments, met=MET * np.linalg.norm(segments.vectors(X), axis=1))
    return CableTerm(
        tuple(supports),
        segments,
        np.array(cable, dtype=np.int64),
        np.array(order, dtype=np.int64),
        segments.shape(X).lengths,
        {kind: segments.lengths_by_routing(X, kind) for kind in ROUTING},
        stated,
    )


def _difference(start: Weights, end: Weights) -> dict[int, float]:
    """The weights of the vector from one weighted point to another."""
    weights: dict[int, float] = {}
    for sign, place in ((-1.0, start), (1.0, end)):
        for point, weight in place:
            weights[point] = weights.get(point, 0.0) + sign * weight
    return weights
