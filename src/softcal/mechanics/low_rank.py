"""Products of low rank in the tangent, such as those of friction, by as few columns as they need.

Friction couples every segment of a cable with those before it: a column and a row for each. Of a thousand via points in
one mesh there need not be as many, but one for each unknown that the cable touches.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.motion import Motion
from softcal.mechanics.state import State
from softcal.mechanics.term import LowRank


def low_rank_product(motion: Motion, state: State, part: LowRank) -> tuple[Floats, Floats]:
    """Columns and rows (n_unknowns - n_actuators, k) of a product of low rank on the unknowns.

    Parameters
    ----------
    motion
        Map from the unknowns to the points.
    state
        The state.
    part
        The product on all entities.
    """
    columns = motion.reduce_columns(state, part.columns, int(part.ptr[-1]))
    spans = [_span(columns[:, a:b]) for a, b in pairwise(part.ptr.tolist())]
    ends = np.cumsum([0, *(basis.shape[1] for basis, _ in spans)])
    mixed = np.zeros((columns.shape[1], np.diff(ends).max()))
    for (_, weights), a, b in zip(spans, part.ptr[:-1], part.ptr[1:], strict=True):
        mixed[a:b, : weights.shape[1]] = weights
    rows = motion.reduce_columns(state, part.rows(mixed, ends), int(ends[-1]))
    return np.hstack([basis for basis, _ in spans]), rows


def _span(columns: Floats) -> tuple[Floats, Floats]:
    """A basis (n, r) of columns (n, m), and the weights (m, r) with columns = basis weights^T: the columns themselves,
    or the unknowns that they touch where these are fewer.
    """
    touched = np.flatnonzero(columns.any(axis=1))
    if len(touched) >= columns.shape[1]:
        return columns, np.eye(columns.shape[1])
    basis = np.zeros((len(columns), len(touched)))
    basis[touched, np.arange(len(touched))] = 1.0
    return basis, columns[touched].T
