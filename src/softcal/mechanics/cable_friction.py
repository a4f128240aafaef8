"""Euler-Eytelwein friction of a cable that is pulled: at each inner via point its tension falls by the turning angle.

    T_k = T exp(-mu sum_j phi_j),  j the via points between the pulled end and segment k

The force is no gradient of a potential, so the tangent gains an unsymmetric part; it is of low rank, one column and
one row per inner via point, and borders the symmetric tangent as the tensions do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.cable import CableTerm

# The turning angle has a kink at zero; below this angle [rad] it is rounded off.
SMOOTH = 1e-4


@dataclass(frozen=True)
class Loss:
    """factor (n_segments,): T_k over T. by_mu (n_segments,): d factor / d mu of its cable. vias: per inner via point
    (segment towards the pulled end, the next one, the segments beyond); turn: d phi / d the two segments' vectors.
    """

    factor: Floats
    by_mu: Floats
    vias: tuple[tuple[int, int, Ints], ...]
    turn: tuple[tuple[Floats, Floats], ...]
    mu: Floats  # (n_vias,)


def friction_loss(term: CableTerm, x: Floats, mu: Floats, *, by_all: bool = False) -> Loss:
    """The losses at positions x (n_points, 3) with friction coefficients mu (n_cables,).

    by_all: `by_mu` of every cable, also where mu is zero; what has no friction is left out otherwise.
    """
    n = len(term.cable)
    factor, by_mu = np.ones(n), np.zeros(n)
    vias: list[tuple[int, int, Ints]] = []
    turn: list[tuple[Floats, Floats]] = []
    mu_of: list[float] = []
    rough = np.flatnonzero((mu > 0.0) | by_all)
    v = term.vectors(x) if len(rough) else np.zeros((0, 3))
    for c in rough:
        segments = np.flatnonzero(term.cable == c)
        if term.pulled_last[c]:
            segments = segments[::-1]
        angle = 0.0
        for i in range(1, len(segments)):
            near, far = int(segments[i - 1]), int(segments[i])
            phi, d_near, d_far = _turning_angle(v[near], v[far])
            angle += phi
            factor[far] = np.exp(-mu[c] * angle)
            by_mu[far] = -angle * factor[far]
            if mu[c] == 0.0:
                continue
            vias.append((near, far, segments[i:]))
            turn.append((d_near, d_far))
            mu_of.append(float(mu[c]))
    return Loss(factor, by_mu, tuple(vias), tuple(turn), np.array(mu_of))


def loss_border(term: CableTerm, x: Floats, loss: Loss, tension: Floats, size: int) -> tuple[Floats, Floats]:
    """Columns and rows, (size, n_vias) each on all entities, with K_unsymmetric = sum_j column_j row_j^T.

    tension (n_cables,) [N]: at the pulled ends.
    """
    columns, rows = np.zeros((size, len(loss.vias))), np.zeros((size, len(loss.vias)))
    for j, (near, far, beyond) in enumerate(loss.vias):
        weights = np.zeros(len(term.cable))
        weights[beyond] = -loss.mu[j] * loss.factor[beyond] * tension[term.cable[beyond]]
        columns[:, j] = term.segment_gradient(x, weights, size)
        for k, d in ((near, loss.turn[j][0]), (far, loss.turn[j][1])):
            for s in range(term.ptr[k], term.ptr[k + 1]):
                at = 3 * term.support[s]
                rows[at : at + 3, j] += term.sigma[s] * d
    return columns, rows


def _turning_angle(a: Floats, b: Floats) -> tuple[float, Floats, Floats]:
    """Angle between two vectors, rounded off at zero, and its derivatives by both."""
    la, lb = float(np.linalg.norm(a)), float(np.linalg.norm(b))
    u, w = a / la, b / lb
    cos = float(u @ w)
    sin = float(np.linalg.norm(np.cross(u, w)))
    phi = float(np.arctan2(sin, cos))
    smooth = float(np.hypot(phi, SMOOTH))
    scale = phi / smooth / max(sin, 1e-12)
    return smooth - SMOOTH, -scale * (w - cos * u) / la, -scale * (u - cos * w) / lb
