"""Euler-Eytelwein friction of a cable that is pulled: at each inner via point its tension decreases by the turning
angle.

    T_k = T exp(-mu sum_j phi_j),  j the via points between the pulled end and segment k

The force is no gradient of a potential, so the tangent gains an unsymmetric part; it is of low rank, one column and one
row per inner via point that moves, and borders the symmetric tangent as the tensions do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats, Ints

if TYPE_CHECKING:
    from softcal.mechanics.cable import CableTerm

# The turning angle has a kink at zero, rounded off below this angle [rad], which the via points of a cable share: so a
# smooth way turns by as much whether it goes through ten points or a thousand.
SMOOTH = 1e-4


@dataclass(frozen=True)
class CapstanLoss:
    """The losses of the tensions, at inner via points of cables with friction, each cable's from the pulled end on.

    Attributes
    ----------
    factor
        T_k over T of each segment (n_segments,) [-].
    by_mu
        d factor / d mu of the own cable (n_segments,) [-].
    near, far
        Segment of each via point towards the pulled end, and the next one (n_vias,).
    by_near, by_far
        d phi / d vectors of these segments (n_vias, 3) [1/m].
    mu
        Friction coefficient at each via point (n_vias,) [-].
    """

    factor: Floats
    by_mu: Floats
    near: Ints
    far: Ints
    by_near: Floats
    by_far: Floats
    mu: Floats


def friction_loss(term: CableTerm, x: Floats, mu: Floats, *, by_all: bool = False) -> CapstanLoss:
    """The losses at positions x (n_points, 3) with friction coefficients mu (n_cables,).

    by_all: compute `by_mu` for every cable, also where mu is zero; otherwise cables without friction are omitted.
    """
    n = len(term.cable)
    factor, by_mu = np.ones(n), np.zeros(n)
    none = np.zeros(0, dtype=np.int64)
    near, far, of_vias = [none], [none], [np.zeros(0)]
    turns = [(np.zeros((0, 3)), np.zeros((0, 3)))]
    wanted = np.flatnonzero((mu > 0.0) | by_all)
    v = term.vectors(x) if len(wanted) else np.zeros((0, 3))
    for c in wanted:
        segments = np.flatnonzero(term.cable == c)
        if term.pulled_last[c]:
            segments = segments[::-1]
        before, after = segments[:-1], segments[1:]
        phi, by_near, by_far = _turning_angles(v[before], v[after])
        angle = np.cumsum(phi)
        factor[after] = np.exp(-mu[c] * angle)
        by_mu[after] = -angle * factor[after]
        if mu[c] > 0.0:
            near.append(before)
            far.append(after)
            turns.append((by_near, by_far))
            of_vias.append(np.full(len(after), mu[c]))
    by_near, by_far = (np.concatenate(parts) for parts in zip(*turns, strict=True))
    return CapstanLoss(
        factor, by_mu, np.concatenate(near), np.concatenate(far), by_near, by_far, np.concatenate(of_vias)
    )


def factor_rates(loss: CapstanLoss, v_rates: Floats) -> Floats:
    """Rates of the factors (n_segments,) for rates (n_segments, 3) of the segments' vectors."""
    out = np.zeros(len(loss.factor))
    turned = 0.0
    for j, (near, far) in enumerate(zip(loss.near, loss.far, strict=True)):
        if j == 0 or near != loss.far[j - 1]:  # the first one of its cable
            turned = 0.0
        turned += float(loss.by_near[j] @ v_rates[near] + loss.by_far[j] @ v_rates[far])
        out[far] = -loss.mu[j] * loss.factor[far] * turned
    return out


def loss_border(
    term: CableTerm, x: Floats, loss: CapstanLoss, tension: Floats, moves: np.ndarray, size: int
) -> tuple[Floats, Floats]:
    """Columns and rows, (size, k) each on all entities, with K_unsymmetric = sum_j column_j row_j^T.

    tension (n_cables,) [N]: at the pulled ends; moves (n_points,): whether a point can. A via point whose angle
    depends on no point that moves has no column.
    """
    columns: list[Floats] = []
    rows: list[Floats] = []
    beyond = np.zeros(size)  # the angle changes the tension of all segments beyond the via point
    for j in range(len(loss.far) - 1, -1, -1):
        near, far = int(loss.near[j]), int(loss.far[j])
        if j + 1 == len(loss.far) or loss.near[j + 1] != far:  # the last one of its cable
            beyond = np.zeros(size)
        weight = -loss.mu[j] * loss.factor[far] * tension[term.cable[far]]
        beyond = beyond + term.segment_gradient(x, weight * (np.arange(len(term.cable)) == far), size)
        supports = [slice(term.ptr[k], term.ptr[k + 1]) for k in (near, far)]
        if not any(moves[term.support[s]].any() for s in supports):
            continue
        row = np.zeros((size // 3 + 1, 3))
        for s, by in zip(supports, (loss.by_near[j], loss.by_far[j]), strict=True):
            row[term.support[s]] += term.sigma[s, None] * by
        columns.append(beyond)
        rows.append(row.ravel()[:size])
    none = np.zeros((size, 0))
    return np.column_stack([none, *columns]), np.column_stack([none, *rows])


def _turning_angles(a: Floats, b: Floats) -> tuple[Floats, Floats, Floats]:
    """Angles (n,) between vectors a and b (n, 3), rounded off at zero, and their derivatives by both (n, 3).

    phi^2 / sqrt(phi^2 + s^2) in the place of phi: far above s it is phi, without an offset.
    """
    la, lb = (np.linalg.norm(vector, axis=1)[:, None] for vector in (a, b))
    u, w = a / la, b / lb
    cos = (u * w).sum(axis=1)[:, None]
    sin = np.linalg.norm(np.cross(u, w), axis=1)[:, None]
    phi, s = np.arctan2(sin, cos), SMOOTH / max(len(a), 1)
    smooth = np.hypot(phi, s)
    scale = phi * (phi**2 + 2.0 * s**2) / smooth**3 / np.maximum(sin, 1e-15)
    return (phi**2 / smooth)[:, 0], -scale * (w - cos * u) / la, -scale * (u - cos * w) / lb
