"""The system within one time step: what backward Euler makes of mass and damping is a potential like any other.

With x_n, v_n at the step's start, h its length, and Rayleigh's coefficients r_m [1/s] and r_s [s], a step solves

    M (v - v_n) / h + r_m M v + g(x) + d(x) = 0,    v = (x - x_n) / h

where g is the gradient of the total potential and d that of damping. So

- mass is a spring of stiffness k = (1 + h r_m) / h^2 to x_n + h v_n / (1 + h r_m), for rotation matrices too;
- damping of bodies acts on their strains (`viscosity.py`) or, as Rayleigh's r_s K v and SOFA's, on their forces:
  d = r_s (g_int(x) - g_int(x_n)) / h, which multiplies their energy by 1 + r_s / h, less a dead force;
- damping of rods acts on their strains, xi: their energy is stiffer by 1 + r_s / h about a strain at rest in between,
  (xi_0 + r_s / h xi_n) / (1 + r_s / h).

All terms keep their code, and the tangent is exact and symmetric.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np

from softcal.checks import Floats
from softcal.mechanics import rod_kernels
from softcal.mechanics.inertia import Inertia, Rates, axial
from softcal.mechanics.layout import Layout
from softcal.mechanics.rod import RodTerm
from softcal.mechanics.solid import SolidTerm
from softcal.mechanics.state import State
from softcal.mechanics.system import Controls, Linearisation, Loads, System, part_theta
from softcal.mechanics.viscosity import ViscousTerm, viscous_term

# Of bodies: on strains, which never gives energy; or with the tangent of their forces, as in SOFA.
DampingKind = Literal["strain", "tangent"]


@dataclass(frozen=True)
class Damping:
    """Rayleigh's coefficients: stiffness [s] and mass [1/s], C = stiffness K + mass M; kind: what K is for bodies."""

    stiffness: float = 0.0
    mass: float = 0.0
    kind: DampingKind = "strain"


@dataclass(frozen=True)
class Instant:
    """The robot at a time [s]: where it is and how it moves, velocities [m/s] and rotations' R' [1/s]."""

    time: float
    state: State
    velocities: Rates


@dataclass(frozen=True)
class InertialSystem(System):
    """A system in a step from `before` of length `step` [s]; `solids`, `rods` and `loads` are those with damping, and
    `viscosities` are of the bodies, in their order, or none.
    """

    inertia: Inertia
    viscosities: tuple[ViscousTerm, ...]
    before: Instant
    step: float
    damping: Damping

    def linearise(
        self, state: State, controls: Controls, theta: Mapping[str, float], *, tangent: bool = True
    ) -> Linearisation:
        """Gradient and, on demand, tangent, inertia included."""
        at = super().linearise(state, controls, theta, tangent=tangent)
        if not at.is_admissible:
            return at
        rate = (1.0 + self.step * self.damping.mass) / self.step**2
        accelerations = self._accelerations(state, rate)
        forces = self.inertia.forces(state.rotation, accelerations)
        data = rate * self.inertia.data if at.data is not None else None
        added = forces.full.copy()
        for viscous, known in zip(self.viscosities, at.kinematics, strict=False):
            viscous.assemble(known[0], added, data)
        reduced = at.reduced.copy()
        reduced[: self.layout.first_tension_unknown] += self.motion.reduce_gradient(state, added)
        self.inertia.blocks.add_gradient(reduced, forces.on_frames)
        inertial = float(forces.full @ forces.full) + float(np.square(forces.on_frames[:, :3]).sum())
        with_mass = replace(at, reduced=reduced, forces=float(np.hypot(at.forces, np.sqrt(inertial))))
        if at.data is None or data is None:
            return with_mass
        self.motion.reduce_tangent(state, added, data)
        self.inertia.blocks.add_tangent(data, self.inertia.tangent(state.rotation, accelerations, rate))
        return replace(with_mass, data=at.data + data[: self.pattern.nnz])

    def _accelerations(self, state: State, rate: float) -> Rates:
        """What makes r_m M v + M (v - v_n) / h."""
        old, moving = self.before.state, self.before.velocities
        return Rates(
            rate * (state.x - old.x) - moving.points / self.step,
            rate * (state.position - old.position) - moving.frames / self.step,
            rate * (state.rotation - old.rotation) - moving.turning / self.step,
        )


@dataclass(frozen=True)
class Stepper:
    """What all steps of one length share; solids: with the damping that is in their energy."""

    system: System
    inertia: Inertia
    damping: Damping
    step: float
    solids: tuple[SolidTerm, ...]

    def begin(self, before: Instant, theta: Mapping[str, float]) -> InertialSystem:
        """The system of the step from an instant on."""
        system, share = self.system, self.damping.stiffness / self.step
        loads = system.loads
        viscosities: list[ViscousTerm] = []
        if share > 0.0 and self.damping.kind == "tangent":
            held = share * elastic_forces(system, before.state, theta)
            loads = Loads(loads.constant + held, loads.per_unit)
        elif share > 0.0:
            for solid, places in zip(system.solids, system.solid_places, strict=True):
                viscosities.append(viscous_term(solid, places.displacement, theta, share, before.state))
        given = {field.name: getattr(system, field.name) for field in fields(System)}
        given["solids"], given["loads"] = self.solids, loads
        given["rods"] = tuple(_viscous(rod, before.state, share) for rod in system.rods)
        given["contacts"] = tuple(contact.from_here(before.state.x, self.step) for contact in system.contacts)
        return InertialSystem(
            **given,
            inertia=self.inertia,
            viscosities=tuple(viscosities),
            before=before,
            step=self.step,
            damping=self.damping,
        )


def stepper(system: System, inertia: Inertia, damping: Damping, step: float) -> Stepper:
    """Prepare steps of one length [s]."""
    factor = 1.0 + damping.stiffness / step if damping.kind == "tangent" else 1.0
    solids = tuple(replace(solid, w=factor * solid.w) for solid in system.solids)
    return Stepper(system, inertia, damping, step, solids)


def at_rest(state: State, time: float = 0.0) -> Instant:
    """A state that does not move."""
    still = Rates(np.zeros_like(state.x), np.zeros_like(state.position), np.zeros_like(state.rotation))
    return Instant(time, state, still)


def after(before: Instant, state: State, step: float) -> Instant:
    """The instant at a step's end: velocities are differences."""
    old = before.state
    return Instant(
        before.time + step,
        state,
        Rates((state.x - old.x) / step, (state.position - old.position) / step, (state.rotation - old.rotation) / step),
    )


def coasting(layout: Layout, now: Instant, step: float) -> Floats:
    """The step of the unknowns (n_unknowns,) with velocities as they are: a guess."""
    n = layout.n_moving_frames
    dz = np.zeros(layout.n_unknowns)
    dz[: layout.first_frame_unknown] = now.velocities.points[layout.free_points].ravel()
    frames = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
    frames[:, :3] = now.velocities.frames[:n]
    spin = now.velocities.turning[:n] @ np.swapaxes(now.state.rotation[:n], 1, 2)
    frames[:, 3:] = -0.5 * axial(spin)
    return step * dz


def elastic_forces(system: System, state: State, theta: Mapping[str, float]) -> Floats:
    """Gradient of the bodies' elastic energy by the points (n_points, 3) [N]."""
    n = system.layout.n_points
    full = np.zeros(3 * n + system.layout.n_pressures)
    for solid, places in zip(system.solids, system.solid_places, strict=True):
        known = solid.invariants(state.x)
        solid.assemble(state.x, state.pressure, known, part_theta(theta, solid.name), full, None, places)
    return full[: 3 * n].reshape(-1, 3)


def _viscous(rod: RodTerm, state: State, share: float) -> RodTerm:
    if share == 0.0:
        return rod
    xi, turn = np.empty_like(rod.xi_rest), np.empty(len(rod.frames))
    rod_kernels.coordinates(state.position, state.rotation, rod.frames, rod.arm, rod.triad, xi, turn)
    return replace(
        rod,
        xi_rest=(rod.xi_rest + share * xi) / (1.0 + share),
        by_bending=rod.by_bending / (1.0 + share),
        by_shear=rod.by_shear / (1.0 + share),
    )
