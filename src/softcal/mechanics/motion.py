"""How the points follow the unknowns: dx = P dz, and what that makes of forces and tangents."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern, triple_product
from softcal.mechanics.state import State


@dataclass(frozen=True)
class Motion:
    """Points that ride on a plate move as dx = dc + omega x r, r = x - c; all others move freely or not at all."""

    layout: Layout
    source: Ints
    weight_a: Ints
    weight_b: Ints
    target: Ints
    plate_diagonal: Ints  # (n_plates, 3, 3): places of the rotation block in `data` (upper triangle)

    def weights(self, state: State) -> Floats:
        """The nonzeros of P that change: one, then (r, -r) for every rigid point."""
        rigid = self.layout.rigid_points
        r = state.x[rigid] - state.position[self.layout.rider[rigid]]
        return np.concatenate([[1.0], np.concatenate([r, -r], axis=1).ravel()])

    def reduce_gradient(self, state: State, gradient: Floats) -> Floats:
        """P^T g for a gradient g on all entities (3 n_points + n_scalars,) -> (n_unknowns,)."""
        layout = self.layout
        n = 3 * layout.n_points
        f = gradient[:n].reshape(-1, 3)
        out = np.empty(layout.n_unknowns)
        out[: layout.first_plate_unknown] = f[layout.free_points].ravel()
        plates = np.zeros((layout.n_plates, 6))
        rigid = layout.rigid_points
        if len(rigid):
            k = layout.rider[rigid]
            r = state.x[rigid] - state.position[k]
            np.add.at(plates, k, np.concatenate([f[rigid], np.cross(r, f[rigid])], axis=1))
        out[layout.first_plate_unknown : layout.first_scalar_unknown] = plates.ravel()
        out[layout.first_scalar_unknown :] = gradient[n:]
        return out

    def reduce_tangent(self, state: State, gradient: Floats, data: Floats) -> None:
        """Fold the side blocks of `data` into the triangle, and add what the forces do as the plates turn."""
        _fold(data, self.source, self.weight_a, self.weight_b, self.target, self.weights(state))
        layout = self.layout
        rigid = layout.rigid_points
        if len(rigid) == 0:
            return
        k = layout.rider[rigid]
        f = gradient[: 3 * layout.n_points].reshape(-1, 3)[rigid]
        r = state.x[rigid] - state.position[k]
        # d2/domega2 of f . exp(omega) r at zero: (r f^T + f r^T)/2 - (f . r) I
        rf = np.einsum("ni,nj->nij", r, f)
        H = 0.5 * (rf + np.swapaxes(rf, 1, 2)) - np.einsum("ni,ni->n", r, f)[:, None, None] * np.eye(3)
        total = np.zeros((layout.n_plates, 3, 3))
        np.add.at(total, k, H)
        i, j = np.triu_indices(3)
        data[self.plate_diagonal[:, i, j]] += total[:, i, j]


def build_motion(layout: Layout, pattern: Pattern) -> Motion:
    """Plan the reduction for a layout and its pattern."""
    weight_of = np.zeros(layout.n_points, dtype=np.int64)
    rigid = layout.rigid_points
    weight_of[rigid] = 1 + 6 * np.arange(len(rigid))
    lists = triple_product(layout, pattern, weight_of)
    diagonal = np.zeros((layout.n_plates, 3, 3), dtype=np.int64)
    for p in range(layout.n_plates):
        omega = layout.first_plate_unknown + 6 * p + 3 + np.arange(3)
        for i in range(3):
            for j in range(i, 3):
                diagonal[p, i, j] = pattern.entry(omega[i], omega[j])
    return Motion(layout, *lists, diagonal)


@numba.njit(cache=True)
def _fold(data, source, weight_a, weight_b, target, w):  # type: ignore[no-untyped-def]
    for k in range(len(source)):
        data[target[k]] += data[source[k]] * w[weight_a[k]] * w[weight_b[k]]
