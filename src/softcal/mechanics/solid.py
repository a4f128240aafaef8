"""Hyperelastic tetrahedra: linear, quadratic, and quadratic with continuous linear pressure (Taylor-Hood)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.law import CompiledLaw, Law, compile_law, stacked
from softcal.mechanics import solid_kernels
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.element import Element
from softcal.mechanics.layout import Layout
from softcal.mechanics.loads import Loads
from softcal.mechanics.mesh_motion import MeshMotion, cofactor, stress_rate
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.scales import Sizes
from softcal.mechanics.solid_kernels import Places
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Given, Sum, Term, Theta, part_theta
from softcal.mechanics.viscosity import ViscousTerm

Kinematics = tuple[Floats, Floats, Floats, Floats]


@dataclass(frozen=True)
class SolidPlaces:
    """Places of a solid's element blocks in the tangent's long array (see `Pattern`).

    Attributes
    ----------
    displacement
        Of pairs of points (n_tets, n_pairs, 3).
    coupling, pressure
        Of points with pressures (n_tets, n_a, n_b, 3), and of pairs of pressures (n_tets, n_pairs); empty without.
    """

    displacement: Places
    coupling: Places
    pressure: Places


UNPLANNED = SolidPlaces(*(np.zeros((0,) * n_dim, dtype=np.int32) for n_dim in (3, 4, 2)))


class _Volume(NamedTuple):
    """A mixed element at its quadrature points.

    Attributes
    ----------
    g
        g, g' and g'' (3, n) [-].
    p
        Pressure (n,) [Pa].
    compliance
        1/kappa [1/Pa].
    """

    g: Floats
    p: Floats
    compliance: float


@dataclass(frozen=True)
class SolidTerm(Term):
    """Pi = sum over quadrature points of w psi(F), or w (psi_d(F) + p g(J) - p^2/(2 kappa)) with pressures p.

    Attributes
    ----------
    name
        Of the material, before its parameters' names.
    law, compiled
        The law, and its derivatives to evaluate.
    conn
        Points of each tet (n_tets, n_a), ascending in each row.
    dN
        Gradients of their shape functions at the quadrature points (n_tets, n_q, n_a, 3) [1/m].
    w
        Weights of the quadrature points (n_tets, n_q) [m^3].
    pressure_conn
        Pressures of each tet (n_tets, n_b), ascending; (n_tets, 0) of a pure displacement element.
    N_p
        Their shape functions at the quadrature points (n_tets, n_q, n_b) [-].
    motion
        How a parameter moves the undeformed mesh, with dN and w on the moved one; None where none does.
    places
        Places of the blocks in the tangent.
    """

    name: str
    law: Law
    compiled: CompiledLaw
    conn: Ints
    dN: Floats
    w: Floats
    pressure_conn: Ints
    N_p: Floats
    motion: MeshMotion | None = None
    places: SolidPlaces = UNPLANNED

    @property
    def is_mixed(self) -> bool:
        return self.pressure_conn.shape[1] > 0

    @property
    def _is_constant(self) -> bool:
        """Whether each tet has one strain, in one quadrature point, and no pressure."""
        return self.dN.shape[1:3] == (1, 4) and not self.is_mixed

    @property
    def parameters(self) -> tuple[str, ...]:
        own = tuple(f"{self.name}.{name}" for name in self.compiled.parameters)
        return own if self.motion is None else (*own, self.motion.parameter)

    def connectivity(self, layout: Layout) -> Connectivity:
        """The points and pressures of each tet."""
        return Connectivity([np.concatenate([self.conn, layout.n_points + self.pressure_conn], axis=1)])

    def plan(self, layout: Layout, pattern: Pattern) -> SolidTerm:
        displacement = pattern.blocks(self.conn).astype(np.int32)
        if not self.is_mixed:
            return replace(self, places=replace(UNPLANNED, displacement=displacement))
        p = layout.n_points + self.pressure_conn
        coupling = pattern.pair(self.conn[:, :, None], p[:, None, :]).astype(np.int32)
        return replace(self, places=SolidPlaces(displacement, coupling, pattern.blocks(p)[..., 0].astype(np.int32)))

    def kinematics(self, state: State) -> Kinematics:
        """F (n_tets, n_q, 3, 3) and I1, I2, J (n_tets, n_q)."""
        n, n_q = self.w.shape
        F = np.empty((n, n_q, 3, 3))
        I1, I2, J = np.empty((n, n_q)), np.empty((n, n_q)), np.empty((n, n_q))
        x = state.x if self.motion is None else self.motion.moved(state.x)
        solid_kernels.kinematics(x, self.conn, self.dN, F, I1, I2, J)
        return F, I1, I2, J

    def why_not(self, known: Kinematics) -> str:
        J_min = float(known[3].min())
        return "" if J_min > 0.0 else f"it inverts an element (J = {J_min:.2g})"

    def add(self, into: Sum, given: Given) -> None:
        """J must be positive."""
        gradient, data, places, state = into.full, into.data, self.places, given.state
        (F, I1, _, J) = given.known
        coefficients, volume = self._coefficients(given)
        if volume is not None:
            error = volume.g[0] - volume.compliance * volume.p
            solid_kernels.add_volume_gradient(gradient, state.x.size, self.pressure_conn, self.N_p, self.w, error)
        if data is not None and self._is_constant and not self.compiled.has_cross_terms:
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

    def _coefficients(self, given: Given) -> tuple[Floats, _Volume | None]:
        """The derivatives of the energy by the invariants (9, n_tets * n_q), at given pressures; of a mixed element
        also what these are made of.
        """
        (_, I1, I2, J), values = given.known, self._theta(given.theta)
        invariants = (I1.ravel(), I2.ravel(), J.ravel())
        derivatives = self.compiled.distortional if self.is_mixed else self.compiled.full
        coefficients = stacked(derivatives(*invariants, *values), I1.size)
        if not self.is_mixed:
            return coefficients, None
        volume = self._volume(invariants[2], given.state.pressure, values)
        coefficients[2] += volume.p * volume.g[1]
        coefficients[8] += volume.p * volume.g[2]
        return coefficients, volume

    def _volume(self, J: Floats, pressure: Floats, values: tuple[float, ...]) -> _Volume:
        compliance, _ = self.compiled.compliance(*values)
        p = solid_kernels.interpolate(pressure, self.pressure_conn, self.N_p).ravel()
        return _Volume(stacked(self.compiled.strain(J), J.size), p, float(compliance))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if self.motion is not None and self.motion.parameter in into:
            self._add_by_motion(into[self.motion.parameter].full, given, self.motion)
        wanted = {name: one.full for name, one in part_theta(into, self.name).items()}
        if not wanted:
            return
        (F, I1, I2, J), values, state = given.known, self._theta(given.theta), given.state
        invariants = (I1.ravel(), I2.ravel(), J.ravel())
        derivatives = (self.compiled.distortional_by_parameter if self.is_mixed else self.compiled.full_by_parameter)(
            *invariants, *values
        )
        for i, name in enumerate(self.compiled.parameters):
            if name not in wanted:
                continue
            coefficients = stacked(derivatives[i], I1.size)
            solid_kernels.add_gradient(wanted[name], self.conn, self.dN, self.w, F, I1, J, coefficients)
            if self.is_mixed:
                _, by_parameter = self.compiled.compliance(*values)
                p = solid_kernels.interpolate(state.pressure, self.pressure_conn, self.N_p).ravel()
                solid_kernels.add_volume_gradient(
                    wanted[name], state.x.size, self.pressure_conn, self.N_p, self.w, -float(by_parameter[i]) * p
                )

    def _add_by_motion(self, gradient: Floats, given: Given, motion: MeshMotion) -> None:
        tets, G = motion.rate(self.conn, self.dN)
        (F, *invariants), (coefficients, volume) = given.known, self._coefficients(given)
        known = (F[tets], *(one[tets] for one in invariants))
        coefficients = coefficients.reshape(9, *self.w.shape)[:, tets]
        dF = G - known[0] @ G
        P, dP = stress_rate(known, dF, coefficients)
        of_size = np.trace(G, axis1=2, axis2=3)
        flow = of_size[..., None, None] * P + dP - P @ np.swapaxes(G, 2, 3)
        forces = np.einsum("eq,eqij,eqaj->eai", self.w[tets], flow, self.dN[tets])
        np.add.at(gradient, 3 * self.conn[tets][..., None] + np.arange(3), forces)
        if volume is None:
            return
        g, error = (
            row.reshape(self.w.shape)[tets] for row in (volume.g[1], volume.g[0] - volume.compliance * volume.p)
        )
        dJ = np.einsum("eqij,eqij->eq", cofactor(known[0], known[0]), dF)
        rates = np.einsum("eq,eqb->eb", self.w[tets] * (of_size * error + g * dJ), self.N_p[tets])
        np.add.at(gradient, given.state.x.size + self.pressure_conn[tets], rates)

    def energy(self, given: Given) -> float:
        """The stored energy [J] (for a mixed element, the value of its two-field potential)."""
        (_, I1, I2, J), values = self.kinematics(given.state), self._theta(given.theta)
        if not self.is_mixed:
            return float(np.sum(self.w * self.compiled.energy(I1, I2, J, *values)))
        p = solid_kernels.interpolate(given.state.pressure, self.pressure_conn, self.N_p)
        compliance, _ = self.compiled.compliance(*values)
        psi = self.compiled.energy_distortional(I1, I2, J, *values)
        return float(np.sum(self.w * (psi + p * self.compiled.strain(J)[0] - 0.5 * compliance * p**2)))

    def measure(self, sizes: Sizes, theta: Theta) -> None:
        sizes.shear_modulus = max(sizes.shear_modulus, self.law.shear_modulus(part_theta(theta, self.name)))
        volume = float(self.w.sum())
        sizes.volume += volume
        sizes.meshed += volume
        sizes.n_tets += len(self.conn)

    def remark(self, state: State, theta: Theta) -> str:
        ratio = self._softened(self.kinematics(state), theta)
        if ratio == 1.0:
            return ""
        return (
            f" Body {self.name} is compressed to {ratio:.2g} of its volume, where its law {self.law.name} softens: "
            "the pressure decreases with further compression."
        )

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """With damping of its strains, or of its forces: an energy 1 + r_s / h times as large, less a dead force."""
        if step.share == 0.0:
            return (self,)
        if step.damping.kind == "strain":
            lmbda, mu = (step.share * modulus for modulus in self.rest_moduli(before.theta))
            F = before.known[0]
            C_n = np.swapaxes(F, 2, 3) @ F
            viscous = ViscousTerm(self.conn, self.dN, self.w, lmbda, mu, C_n, self.motion, self.places.displacement)
            return self, viscous
        held = Sum(step.layout)
        self.add(held, before)
        return replace(self, w=(1.0 + step.share) * self.w), Loads(step.share * held.points, {})

    def rest_moduli(self, theta: Theta) -> tuple[float, float]:
        """Lamé's moduli [Pa] of the undeformed body; with pressures, those of psi_d alone."""
        values = self._theta(theta)
        derivatives = self.compiled.distortional if self.is_mixed else self.compiled.full
        rows = stacked(derivatives(np.full(1, 3.0), np.full(1, 3.0), np.ones(1), *values), 1)[:, 0]
        _, psi_2, psi_J, psi_11, psi_12, psi_1J, psi_22, psi_2J, psi_JJ = (float(row) for row in rows)
        # 4 d2psi/dC2 at C = I, where dI1 = I, dI2 = 2 I, dJ = I/2
        lmbda = 4.0 * (psi_11 + 4.0 * psi_12 + psi_1J + 4.0 * psi_22 + 2.0 * psi_2J + psi_2) + psi_JJ + psi_J
        return lmbda, -2.0 * psi_2 - psi_J

    def _softened(self, known: Kinematics, theta: Theta) -> float:
        """The least volume ratio J < 1 at a quadrature point whose law softens in compression, d2psi/dJ2 < 0 along F ->
        J^(1/3) F; 1 where there is none.
        """
        _, I1, I2, J = (values.ravel() for values in known)
        rows = stacked(self.compiled.full(I1, I2, J, *self._theta(theta)), J.size)
        first, second = rows[:3], rows[3:]
        rate = np.stack([2.0 * I1, 4.0 * I2, 3.0 * J])  # of the invariants as F -> s F, at s = 1
        by_s = np.einsum("in,in->n", first, rate)
        by_s_twice = np.einsum("in,in->n", first, np.stack([2.0 * I1, 12.0 * I2, 6.0 * J]))
        for (a, b), row in zip(combinations_with_replacement(range(3), 2), second, strict=True):
            by_s_twice += (1.0 if a == b else 2.0) * row * rate[a] * rate[b]
        gives_way = (by_s_twice < 2.0 * by_s) & (J < 1.0)
        return float(J[gives_way].min(initial=1.0))

    def _theta(self, theta: Theta) -> tuple[float, ...]:
        return tuple(theta[f"{self.name}.{name}"] for name in self.compiled.parameters)


def build_solid(
    name: str,
    law: Law,
    element: Element,
    points: Floats,
    tets: Ints,
    *,
    first_point: int,
    first_pressure: int = 0,
    motion: MeshMotion | None = None,
) -> tuple[SolidTerm, Ints]:
    """The term of some tets of a body, and the nodes that have its pressures, in the order of their numbers.

    Raises
    ------
    MeshError
        Where an element is inverted, or its motion inverts it.
    """
    if motion is not None:
        points = points + motion.value * motion.way
    dN, w = element.gradients(points, tets, where=name)
    order = np.argsort(tets, axis=1)
    conn = np.take_along_axis(tets, order, axis=1) + first_point
    dN = np.take_along_axis(dN, order[:, None, :, None], axis=2)
    own = element.pressure_nodes(tets)
    nodes, number = np.unique(own, return_inverse=True)
    number = number.reshape(own.shape)
    order = np.argsort(number, axis=1)
    term = SolidTerm(
        name,
        law,
        compile_law(law),
        conn,
        np.ascontiguousarray(dN),
        w,
        np.take_along_axis(number, order, axis=1) + first_pressure,
        np.ascontiguousarray(np.swapaxes(element.pressure_functions().T[order], 1, 2)),
        motion,
    )
    return term, nodes
