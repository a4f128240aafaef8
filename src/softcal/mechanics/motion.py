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
        """P^T g for a gradient g on all entities (3 n_points + n_pressures,) -> (n_unknowns - n_cables,)."""
        layout = self.layout
        n = 3 * layout.n_points
        out = np.empty(layout.first_tension_unknown)
        out[: layout.first_plate_unknown] = gradient[:n].reshape(-1, 3)[layout.free_points].ravel()
        out[layout.first_plate_unknown : layout.first_pressure_unknown] = 0.0
        _gather(out[layout.first_plate_unknown :], gradient, state.x, state.position, layout.rigid_points, layout.rider)
        out[layout.first_pressure_unknown :] = gradient[n:]
        return out

    def reduce_tangent(self, state: State, gradient: Floats, data: Floats) -> None:
        """Fold the side blocks of `data` into the triangle, and add what the forces do as the plates turn."""
        layout = self.layout
        if len(layout.rigid_points) == 0:
            return
        _fold(data, self.source, self.weight_a, self.weight_b, self.target, self.weights(state))
        _turn(data, gradient, state.x, state.position, layout.rigid_points, layout.rider, self.plate_diagonal)


def build_motion(layout: Layout, pattern: Pattern) -> Motion:
    """Plan the reduction for a layout and its pattern."""
    weight_of = np.zeros(layout.n_points, dtype=np.int64)
    rigid = layout.rigid_points
    weight_of[rigid] = 1 + 6 * np.arange(len(rigid))
    source, weight_a, weight_b, target = triple_product(layout, pattern, weight_of)
    diagonal = np.zeros((layout.n_plates, 3, 3), dtype=np.int64)
    for p in range(layout.n_plates):
        omega = layout.first_plate_unknown + 6 * p + 3 + np.arange(3)
        for i in range(3):
            for j in range(i, 3):
                diagonal[p, i, j] = pattern.entry(omega[i], omega[j])
    return Motion(layout, source, weight_a, weight_b, target, diagonal)


@numba.njit(cache=True, error_model="numpy")
def _fold(data: Floats, source: Ints, weight_a: Ints, weight_b: Ints, target: Ints, w: Floats) -> None:
    for k in range(len(source)):
        data[target[k]] += data[source[k]] * w[weight_a[k]] * w[weight_b[k]]


@numba.njit(cache=True, error_model="numpy")
def _gather(out: Floats, gradient: Floats, x: Floats, position: Floats, rigid: Ints, rider: Ints) -> None:
    """Forces and moments of the rigid points on their plates."""
    for p in rigid:
        k = rider[p]
        f0, f1, f2 = gradient[3 * p], gradient[3 * p + 1], gradient[3 * p + 2]
        r0, r1, r2 = x[p, 0] - position[k, 0], x[p, 1] - position[k, 1], x[p, 2] - position[k, 2]
        out[6 * k] += f0
        out[6 * k + 1] += f1
        out[6 * k + 2] += f2
        out[6 * k + 3] += r1 * f2 - r2 * f1
        out[6 * k + 4] += r2 * f0 - r0 * f2
        out[6 * k + 5] += r0 * f1 - r1 * f0


@numba.njit(cache=True, error_model="numpy")
def _turn(
    data: Floats, gradient: Floats, x: Floats, position: Floats, rigid: Ints, rider: Ints, diagonal: Ints
) -> None:
    """d2/domega2 of f . exp(omega) r at zero: (r f^T + f r^T)/2 - (f . r) I."""
    for p in rigid:
        k = rider[p]
        fr = 0.0
        for i in range(3):
            fr += gradient[3 * p + i] * (x[p, i] - position[k, i])
        for i in range(3):
            for j in range(i, 3):
                ri, rj = x[p, i] - position[k, i], x[p, j] - position[k, j]
                h = 0.5 * (ri * gradient[3 * p + j] + gradient[3 * p + i] * rj)
                data[diagonal[k, i, j]] += h - fr if i == j else h
