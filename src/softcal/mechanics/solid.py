"""Hyperelastic tetrahedra: linear, quadratic, and quadratic with continuous linear pressure (Taylor-Hood)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.law import CompiledLaw, Law, compile_law, stacked
from softcal.mechanics import solid_kernels
from softcal.mechanics.element import quadrature, reference_gradients
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.solid_kernels import Places


@dataclass(frozen=True)
class SolidPlaces:
    """Where a solid's element blocks stand in the tangent's long array (see `Pattern`)."""

    displacement: Places  # (n_tets, pairs, 3)
    coupling: Places  # (n_tets, n_a, 4, 3) or empty
    pressure: Places  # (n_tets, 10) or empty


class _Volume(NamedTuple):
    """Of a mixed element at its quadrature points: g, g', g'' (3, n); p (n,) [Pa]; 1/kappa [1/Pa]."""

    g: Floats
    p: Floats
    compliance: float


@dataclass(frozen=True)
class SolidTerm:
    """Pi = sum over quadrature points of w psi(F), or w (psi_d(F) + p g(J) - p^2/(2 kappa)) with pressures p.

    conn: (n_tets, 4 or 10) point numbers, ascending in each row; dN (n_tets, n_q, n_a, 3) [1/m]; w (n_tets, n_q) [m^3].
    pressure_conn: (n_tets, 4) pressure numbers, ascending, or (n_tets, 0) for a pure displacement element;
    N_p: (n_tets, n_q, 4) their shape functions.
    """

    name: str
    law: Law
    compiled: CompiledLaw
    conn: Ints
    dN: Floats
    w: Floats
    pressure_conn: Ints
    N_p: Floats

    @property
    def is_mixed(self) -> bool:
        return self.pressure_conn.shape[1] > 0

    def connectivity(self, n_points: int) -> Ints:
        """Entities each tet connects, ascending."""
        return np.concatenate([self.conn, n_points + self.pressure_conn], axis=1)

    def places(self, pattern: Pattern, n_points: int) -> SolidPlaces:
        """Look up, once, where the element blocks go."""
        a, b = np.triu_indices(self.conn.shape[1])
        displacement = pattern.pair(self.conn[:, a], self.conn[:, b]).astype(np.int32)
        if not self.is_mixed:
            none = np.zeros((0, 0, 0, 0), dtype=np.int32), np.zeros((0, 0), dtype=np.int32)
            return SolidPlaces(displacement, *none)
        p = n_points + self.pressure_conn
        coupling = pattern.pair(self.conn[:, :, None], p[:, None, :]).astype(np.int32)
        c, d = np.triu_indices(4)
        pressure = pattern.pair(p[:, c], p[:, d])[..., 0].astype(np.int32)
        return SolidPlaces(displacement, coupling, pressure)

    def invariants(self, x: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """F (n_tets, n_q, 3, 3) and I1, I2, J (n_tets, n_q) at positions x (n_points, 3)."""
        n, n_q = self.w.shape
        F = np.empty((n, n_q, 3, 3))
        I1, I2, J = np.empty((n, n_q)), np.empty((n, n_q)), np.empty((n, n_q))
        solid_kernels.kinematics(x, self.conn, self.dN, F, I1, I2, J)
        return F, I1, I2, J

    def assemble(
        self,
        x: Floats,
        pressure: Floats,
        kinematics: tuple[Floats, Floats, Floats, Floats],
        theta: Mapping[str, float],
        gradient: Floats,
        data: Floats | None,
        places: SolidPlaces,
    ) -> None:
        """Add the gradient (3 n_points + n_scalars,) and, where `data` is given, the tangent. J must be positive."""
        F, I1, I2, J = kinematics
        values = self._theta(theta)
        invariants = (I1.ravel(), I2.ravel(), J.ravel())
        derivatives = self.compiled.distortional if self.is_mixed else self.compiled.full
        coefficients = stacked(derivatives(*invariants, *values), I1.size)
        volume = self._volume(invariants[2], pressure, values) if self.is_mixed else None
        if volume is not None:
            coefficients[2] += volume.p * volume.g[1]
            coefficients[8] += volume.p * volume.g[2]
            error = volume.g[0] - volume.compliance * volume.p
            solid_kernels.add_volume_gradient(gradient, 3 * len(x), self.pressure_conn, self.N_p, self.w, error)
        if data is not None and self.conn.shape[1] == 4 and not self.compiled.has_cross_terms:
            solid_kernels.add_both_linear(
                gradient, data, self.conn, places.displacement, self.dN, self.w, F, J, coefficients
            )
            return
        solid_kernels.add_gradient(gradient, self.conn, self.dN, self.w, F, I1, J, coefficients)
        if data is None:
            return
        if self.compiled.has_cross_terms:
            solid_kernels.add_tangent_general(data, places.displacement, self.dN, self.w, F, I1, J, coefficients)
        else:
            solid_kernels.add_tangent(data, places.displacement, self.dN, self.w, F, J, coefficients)
        if volume is not None:
            solid_kernels.add_coupling(
                data,
                places.coupling,
                places.pressure,
                self.dN,
                self.w,
                F,
                J,
                self.N_p,
                volume.g[1],
                volume.compliance,
            )

    def _volume(self, J: Floats, pressure: Floats, values: tuple[float, ...]) -> _Volume:
        compliance, _ = self.compiled.compliance(*values)
        p = solid_kernels.interpolate(pressure, self.pressure_conn, self.N_p).ravel()
        return _Volume(stacked(self.compiled.strain(J), J.size), p, float(compliance))

    def gradient_by_parameters(
        self,
        x: Floats,
        pressure: Floats,
        kinematics: tuple[Floats, Floats, Floats, Floats],
        theta: Mapping[str, float],
        gradients: Mapping[str, Floats],
    ) -> None:
        """Add d gradient / d parameter to gradients[parameter], for the law's parameters that are asked for."""
        F, I1, I2, J = kinematics
        values = self._theta(theta)
        invariants = (I1.ravel(), I2.ravel(), J.ravel())
        derivatives = (self.compiled.distortional_by_parameter if self.is_mixed else self.compiled.full_by_parameter)(
            *invariants, *values
        )
        for i, name in enumerate(self.compiled.parameters):
            if name not in gradients:
                continue
            coefficients = stacked(derivatives[i], I1.size)
            solid_kernels.add_gradient(gradients[name], self.conn, self.dN, self.w, F, I1, J, coefficients)
            if self.is_mixed:
                _, by_parameter = self.compiled.compliance(*values)
                p = solid_kernels.interpolate(pressure, self.pressure_conn, self.N_p).ravel()
                solid_kernels.add_volume_gradient(
                    gradients[name], 3 * len(x), self.pressure_conn, self.N_p, self.w, -float(by_parameter[i]) * p
                )

    def energy(
        self, pressure: Floats, kinematics: tuple[Floats, Floats, Floats, Floats], theta: Mapping[str, float]
    ) -> float:
        """The stored energy [J] (for a mixed element, the value of its two-field potential)."""
        _, I1, I2, J = kinematics
        values = self._theta(theta)
        if not self.is_mixed:
            return float(np.sum(self.w * self.compiled.energy(I1, I2, J, *values)))
        p = solid_kernels.interpolate(pressure, self.pressure_conn, self.N_p)
        compliance, _ = self.compiled.compliance(*values)
        psi = self.compiled.energy_distortional(I1, I2, J, *values)
        return float(np.sum(self.w * (psi + p * self.compiled.strain(J)[0] - 0.5 * compliance * p**2)))

    def softened(self, kinematics: tuple[Floats, Floats, Floats, Floats], theta: Mapping[str, float]) -> float:
        """The least volume ratio J < 1 at a quadrature point whose law takes less pressure for more compression there,
        d2psi/dJ2 < 0 along F -> J^(1/3) F; 1 where there is none.
        """
        _, I1, I2, J = (values.ravel() for values in kinematics)
        rows = stacked(self.compiled.full(I1, I2, J, *self._theta(theta)), J.size)
        first, second = rows[:3], rows[3:]
        rate = np.stack([2.0 * I1, 4.0 * I2, 3.0 * J])  # of the invariants as F -> s F, at s = 1
        by_s = np.einsum("in,in->n", first, rate)
        by_s_twice = np.einsum("in,in->n", first, np.stack([2.0 * I1, 12.0 * I2, 6.0 * J]))
        for (a, b), row in zip(combinations_with_replacement(range(3), 2), second, strict=True):
            by_s_twice += (1.0 if a == b else 2.0) * row * rate[a] * rate[b]
        gives_way = (by_s_twice < 2.0 * by_s) & (J < 1.0)
        return float(J[gives_way].min(initial=1.0))

    def _theta(self, theta: Mapping[str, float]) -> tuple[float, ...]:
        return tuple(theta[name] for name in self.compiled.parameters)


def build_solid(
    name: str, law: Law, points: Floats, tets: Ints, *, first_point: int, first_pressure: int | None
) -> tuple[SolidTerm, int]:
    """The term of some tets of a body and its number of pressures; no pressures with `first_pressure` None."""
    dN, w = reference_gradients(points, tets, where=name)
    order = np.argsort(tets, axis=1)
    conn = np.take_along_axis(tets, order, axis=1) + first_point
    dN = np.take_along_axis(dN, order[:, None, :, None], axis=2)
    barycentric, _ = quadrature(1 if tets.shape[1] == 4 else 2)
    n_tets, n_q = w.shape
    if first_pressure is None:
        pressure_conn = np.zeros((n_tets, 0), dtype=np.int64)
        N_p = np.zeros((n_tets, n_q, 0))
        n_pressures = 0
    else:
        corners, number = np.unique(tets[:, :4], return_inverse=True)
        number = number.reshape(-1, 4)
        order = np.argsort(number, axis=1)
        pressure_conn = np.take_along_axis(number, order, axis=1) + first_pressure
        N_p = np.swapaxes(barycentric.T[order], 1, 2)
        n_pressures = len(corners)
    term = SolidTerm(
        name,
        law,
        compile_law(law),
        conn,
        np.ascontiguousarray(dN),
        w,
        pressure_conn,
        np.ascontiguousarray(N_p),
    )
    return term, n_pressures
