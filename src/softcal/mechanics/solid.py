"""Hyperelastic tetrahedra: linear, quadratic, and quadratic with continuous linear pressure (Taylor-Hood)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.materials.components import NO_DIRECTIONS
from softcal.materials.inelastic import ELASTIC, History
from softcal.materials.law import CompiledLaw, Law, stacked
from softcal.materials.stress_at import (
    NO_TANGENT,
    Deformation,
    Points,
    Stress,
    Volumetric,
    add_volumetric,
    points,
    volumetric,
    whole_stress,
)
from softcal.mechanics import solid_kernels
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.layout import Layout
from softcal.mechanics.loads import Loads
from softcal.mechanics.mesh_motion import MeshMotion, cofactor, stress_rate
from softcal.mechanics.passed import Passed
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.scales import Sizes
from softcal.mechanics.solid_kernels import Places
from softcal.mechanics.solid_law import SolidLaw
from softcal.mechanics.solid_remark import remark
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Failing, Given, Sum, Term, Theta, part_theta
from softcal.mechanics.viscosity import ViscousTerm

FAILS = 0.3  # of its volume: more compressed elements are about to fold, whatever their law

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
    """The volumetric part of the potential at the quadrature points, p g - p^2/(2 kappa) of a mixed element.

    Attributes
    ----------
    slopes
        Its derivatives by J, at fixed pressures of a mixed element, without what a history acts on (`Law.shifted`).
    dg
        g' (n,) [-]; of a mixed element only, as `error`.
    error
        g - p/kappa (n,) [-].
    compliance
        1/kappa [1/Pa].
    """

    slopes: Volumetric
    dg: Floats
    error: Floats
    compliance: float


@dataclass(frozen=True)
class SolidTerm(Term):
    """Pi = sum over quadrature points of w psi(F), or w (psi_d(F) + p g(J) - p^2/(2 kappa)) with pressures p.

    Attributes
    ----------
    name
        Name of the material, before its parameters' names.
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
    directions
        Directions of a law in I4 and I6, as `Points` has them, at the quadrature points.
    history
        What the material does beyond its law.
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
    directions: Floats = field(default_factory=lambda: NO_DIRECTIONS)
    history: History = ELASTIC
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
        names = (*self.compiled.parameters, *(one.name for one in self.history.parameters))
        own = tuple(f"{self.name}.{name}" for name in names)
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

    def failing(self, known: Kinematics, X: Floats) -> Failing | None:
        least = known[3].min(axis=1)
        tet = int(least.argmin())
        if not least[tet] < FAILS:
            return None
        corners = X[self.conn[tet]]
        return Failing(self.name, float(least[tet]), corners.mean(axis=0), float(np.ptp(corners, axis=0).max()))

    def add(self, into: Sum, given: Given) -> None:
        """J must be positive."""
        gradient, data, places, state = into.full, into.data, self.places, given.state
        F, _, _, J = given.known
        volume = self._volume(given)
        if self.is_mixed:
            solid_kernels.add_volume_gradient(
                gradient, state.x.size, self.pressure_conn, self.N_p, self.w, volume.error
            )
        if self.compiled.is_simple and not self.history.parts:
            self._add_simple(gradient, data, given, volume)
        else:
            stress = self._stress(given, volume, tangent=data is not None)
            solid_kernels.add_stress_gradient(gradient, self.conn, self.dN, self.w, F, stress.S)
            if data is not None:
                is_linear = self.dN.shape[1:3] == (1, 4)
                add = solid_kernels.add_stress_tangent_linear if is_linear else solid_kernels.add_stress_tangent
                add(data, places.displacement, self.dN, self.w, F, *stress)
        if data is not None and self.is_mixed:
            solid_kernels.add_coupling(
                data,
                places.coupling,
                places.pressure,
                self.dN,
                self.w,
                F,
                J,
                self.N_p,
                volume.dg,
                volume.compliance,
            )

    def _add_simple(self, gradient: Floats, data: Floats | None, given: Given, volume: _Volume) -> None:
        """The part of the displacements of a simple law, of which S and D need not be worked out."""
        F, I1, I2, J = given.known
        rows = self.compiled.rows(I1.ravel(), I2.ravel(), J.ravel(), *self._theta(given.theta))
        coefficients = np.empty((3, J.size))
        coefficients[0] = rows[0]
        np.add(rows[2], volume.slopes.by_J, out=coefficients[1])
        np.add(rows[-1], volume.slopes.by_JJ, out=coefficients[2])
        displacement = self.places.displacement
        if data is None:
            solid_kernels.add_gradient(gradient, self.conn, self.dN, self.w, F, coefficients)
        elif self._is_constant:
            solid_kernels.add_both_linear(gradient, data, self.conn, displacement, self.dN, self.w, F, J, coefficients)
        else:
            solid_kernels.add_gradient(gradient, self.conn, self.dN, self.w, F, coefficients)
            solid_kernels.add_tangent(data, displacement, self.dN, self.w, F, J, coefficients)

    def _at(self, known: Kinematics) -> Points:
        F, I1, I2, J = known
        return Points(F.reshape(-1, 3, 3), I1.ravel(), I2.ravel(), J.ravel(), self.directions)

    def _stress(self, given: Given, volume: _Volume, *, tangent: bool) -> Stress:
        """The stress of the displacements' part of the potential, at fixed pressures."""
        passed = self._passed(given)
        law = passed.law
        if not self.history.parts:
            return law.deformation.stress(law.values, volume.slopes, tangent=tangent)
        at = passed.respond(tangent=tangent).at
        stress = Stress(at.S, at.D)
        add_volumetric(stress, law.deformation.at, volume.slopes)
        return stress

    def _passed(self, given: Given) -> Passed[SolidLaw]:
        law = SolidLaw(Deformation(self.compiled, self._at(given.known)), self._theta(given.theta))
        constants = self.history.constants(part_theta(given.theta, self.name))
        return Passed(self.history, law, constants, given.memory, given.controls.elapsed)

    # Of a material with a history, its memory at the quadrature points.

    def first_memory(self) -> Floats:
        return np.zeros(self.w.size * self.history.size)

    def advance(self, given: Given) -> Floats:
        if not self.history.parts:
            return given.memory
        return self._passed(given).respond(tangent=False).memory.ravel()

    def add_by_memory(self, into: Sum, given: Given, rate: Floats) -> None:
        """Add d gradient / d memory times a rate of the memory; nothing without a history."""
        if self.history.parts:
            S, _ = self._passed(given).rates(memory=rate)
            solid_kernels.add_stress_gradient(into.full, self.conn, self.dN, self.w, given.known[0], S)

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        """The derivative by a parameter of the memory after the state, at the quadrature points."""
        if not self.history.parts:
            return memory_rate
        dF = np.empty_like(given.known[0])
        rest = (np.empty_like(self.w) for _ in range(3))
        solid_kernels.kinematics(rate.x, self.conn, self.dN, dF, *rest)
        if self.motion is not None and self.motion.parameter == parameter:
            tets, G = self.motion.rate(self.conn, self.dN)
            dF[tets] += G - given.known[0][tets] @ G
        passed, own = self._passed(given), parameter.removeprefix(f"{self.name}.")
        return passed.rates(passed.law.strain_rates(dF.reshape(-1, 3, 3)), memory_rate, own)[1]

    def _volume(self, given: Given) -> _Volume:
        values, J = self._theta(given.theta), given.known[3].ravel()
        compliance, shifted = self.compiled.compliance(*values)[0], self._shifted(values)[0]
        if not self.is_mixed:
            none = np.zeros(0)
            slopes = volumetric(self.compiled, J, float(self.compiled.bulk(*values)) - shifted)
            return _Volume(slopes, none, none, float(compliance))
        p = self._pressure(given.state).ravel()
        g, dg, ddg = stacked(self.compiled.strain(J), J.size)
        of_history = volumetric(self.compiled, J, shifted)
        slopes = Volumetric(p * dg - of_history.by_J, p * ddg - of_history.by_JJ)
        return _Volume(slopes, dg, g - compliance * p, float(compliance))

    def _shifted(self, values: tuple[float, ...]) -> tuple[float, Sequence[float]]:
        """The modulus of the volumetric part that a history acts on [Pa], and its derivatives by the constants."""
        return self.compiled.shifted(*values) if self.history.parts else (0.0, [0.0] * len(values))

    def _pressure(self, state: State) -> Floats:
        """Pressures at the quadrature points (n_tets, n_q) [Pa]."""
        return solid_kernels.interpolate(state.pressure, self.pressure_conn, self.N_p)

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        if self.motion is not None and self.motion.parameter in into:
            self._add_by_motion(into[self.motion.parameter].full, given, self.motion)
        wanted = {name: one.full for name, one in part_theta(into, self.name).items()}
        laws, others = self.compiled.parameters, [one.name for one in self.history.parameters]
        if wanted.keys().isdisjoint((*laws, *others)):
            return
        passed, F = self._passed(given), given.known[0]
        law = passed.law
        elastic = [] if self.history.parts else law.deformation.stress_by_parameters(law.values)
        for i, name in enumerate(laws):
            if name in wanted:
                stress = passed.rates(constant=name)[0] if self.history.parts else elastic[i]
                self._add_volumetric(wanted[name], given, law, i, stress)
                solid_kernels.add_stress_gradient(wanted[name], self.conn, self.dN, self.w, F, stress)
        for name in others:
            if name in wanted:
                stress, _ = passed.rates(constant=name)
                solid_kernels.add_stress_gradient(wanted[name], self.conn, self.dN, self.w, F, stress)

    def _add_volumetric(self, gradient: Floats, given: Given, law: SolidLaw, i: int, stress: Floats) -> None:
        """Add the derivative of the volumetric part by the law's constant i: to that of the stress, or of a mixed
        element to the gradient.
        """
        compliance, by_parameter = self.compiled.compliance(*law.values)
        at, change = law.deformation.at, -float(self._shifted(law.values)[1][i])
        if self.is_mixed:
            error = -float(by_parameter[i]) * self._pressure(given.state).ravel()
            solid_kernels.add_volume_gradient(gradient, given.state.x.size, self.pressure_conn, self.N_p, self.w, error)
        else:
            change -= float(by_parameter[i]) / float(compliance) ** 2  # d kappa
        if change != 0.0:
            add_volumetric(Stress(stress, NO_TANGENT), at, volumetric(self.compiled, at.J, change))

    def _add_by_motion(self, gradient: Floats, given: Given, motion: MeshMotion) -> None:
        tets, G = motion.rate(self.conn, self.dN)
        volume = self._volume(given)
        stress = self._stress(given, volume, tangent=True)
        n_q = self.w.shape[1]
        S, D = stress.S.reshape(-1, n_q, 6)[tets], stress.D.reshape(-1, n_q, 6, 6)[tets]
        F = given.known[0][tets]
        dF = G - F @ G
        P, dP = stress_rate(F, dF, S, D)
        of_size = np.trace(G, axis1=2, axis2=3)
        flow = of_size[..., None, None] * P + dP - P @ np.swapaxes(G, 2, 3)
        forces = np.einsum("eq,eqij,eqaj->eai", self.w[tets], flow, self.dN[tets])
        np.add.at(gradient, 3 * self.conn[tets][..., None] + np.arange(3), forces)
        if not self.is_mixed:
            return
        dg, error = (row.reshape(self.w.shape)[tets] for row in (volume.dg, volume.error))
        dJ = np.einsum("eqij,eqij->eq", cofactor(F, F), dF)
        rates = np.einsum("eq,eqb->eb", self.w[tets] * (of_size * error + dg * dJ), self.N_p[tets])
        np.add.at(gradient, given.state.x.size + self.pressure_conn[tets], rates)

    def energy(self, given: Given) -> float:
        """The stored energy [J] (for a mixed element, the value of its two-field potential)."""
        given = given._replace(known=self.kinematics(given.state))
        at, values = self._at(given.known), self._theta(given.theta)
        g = stacked(self.compiled.strain(at.J), at.J.size)[0]
        compliance, _ = self.compiled.compliance(*values)
        psi = (
            self._passed(given).respond(tangent=False).at.W - 0.5 * self._shifted(values)[0] * g**2
            if self.history.parts
            else Deformation(self.compiled, at).energy(values)
        )
        p = self._pressure(given.state).ravel() if self.is_mixed else g / compliance
        return float(self.w.ravel() @ (psi + p * g - 0.5 * compliance * p**2))

    def measure(self, sizes: Sizes, theta: Theta) -> None:
        sizes.shear_modulus = max(sizes.shear_modulus, self.law.shear_modulus(part_theta(theta, self.name)))
        volume = float(self.w.sum())
        sizes.volume += volume
        sizes.meshed += volume
        sizes.n_tets += len(self.conn)

    def remark(self, state: State, theta: Theta) -> str:
        at = self._at(self.kinematics(state))
        return remark(self.name, self.law, at, self._theta(theta), self.w.ravel())

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """With damping of its strains, or of its forces: an energy 1 + r_s / h times as large, less a dead force."""
        if step.share == 0.0:
            return (self,)
        if step.damping.kind == "strain":
            lmbda, mu = (step.share * modulus for modulus in self.rest_moduli(before.theta))
            F = before.known[0]
            C_n = np.swapaxes(F, 2, 3) @ F
            viscous = ViscousTerm(
                conn=self.conn,
                dN=self.dN,
                w=self.w,
                lmbda=lmbda,
                mu=mu,
                C_n=C_n,
                motion=self.motion,
                places=self.places.displacement,
            )
            return self, viscous
        at_start = Sum(step.layout)
        self.add(at_start, before)
        return replace(self, w=(1.0 + step.share) * self.w), Loads(step.share * at_start.points, {})

    def rest_moduli(self, theta: Theta) -> tuple[float, float]:
        """Lamé's moduli [Pa] of the undeformed body; with pressures, those of psi_d alone."""
        at, values = points(np.eye(3)[None], self.directions[:1]), self._theta(theta)
        D = (
            Deformation(self.compiled, at).stress(values) if self.is_mixed else whole_stress(self.compiled, at, values)
        ).D[0]
        return float(D[0, 1]), float(D[3, 3])

    def _theta(self, theta: Theta) -> tuple[float, ...]:
        return tuple(theta[f"{self.name}.{name}"] for name in self.compiled.parameters)
