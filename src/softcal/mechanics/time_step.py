"""One time step: backward Euler turns mass and damping into terms of a potential.

With x_n, v_n at the step's start, h its length, and Rayleigh's coefficients r_m [1/s] and r_s [s], a step solves

    M (v - v_n) / h + r_m M v + g(x) + d(x) = 0,    v = (x - x_n) / h

where g is the gradient of the total potential and d that of damping. So

- mass is a spring of stiffness k = (1 + h r_m) / h^2 to x_n + h v_n / (1 + h r_m), for rotation matrices too;
- damping of bodies acts on their strains (`viscosity.py`) or, as Rayleigh's r_s K v and SOFA's, on their forces: d =
  r_s (g_int(x) - g_int(x_n)) / h, which multiplies their energy by 1 + r_s / h, less a dead force;
- damping of rods acts on their strains, xi: their energy is stiffer by 1 + r_s / h about a rest strain in between,
  (xi_0 + r_s / h xi_n) / (1 + r_s / h).

Every term has its form within a step (`Term.in_step`), mass is one more term, and the tangent is exact and symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.damping import Damping, TimeStep
from softcal.mechanics.inertia import Inertia, Rates, axial
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.state import State
from softcal.mechanics.system import System
from softcal.mechanics.term import Connectivity, Controls, Given, Sum, Term, Theta


@dataclass(frozen=True)
class Instant:
    """The robot at a time.

    Attributes
    ----------
    time
        Time [s].
    state
        The state, with the memory that the step to it left.
    velocities
        Velocities [m/s], and R' of the frames [1/s].
    effort_rates
        Rates of the actuators' efforts (n_actuators,) [1/s], of a pulley those of its angle.
    """

    time: float
    state: State
    velocities: Rates
    effort_rates: Floats = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class InertialTerm(Term):
    """Mass, and its damping, in a step.

    Attributes
    ----------
    inertia
        The mass.
    before
        The instant at the step's start.
    step
        The step.
    """

    inertia: Inertia
    before: Instant
    step: TimeStep

    def connectivity(self, layout: Layout) -> Connectivity:
        """The pairs of points that share an element's mass; frames have entries in the tangent without them."""
        pairs = self.inertia.pairs
        return Connectivity([np.stack([pairs.row, pairs.col], axis=1).astype(np.int64)])

    def plan(self, layout: Layout, pattern: Pattern) -> InertialTerm:
        return replace(self, inertia=self.inertia.planned(pattern))

    def add(self, into: Sum, given: Given) -> None:
        rotation, accelerations = given.state.rotation, self._accelerations(given.state)
        forces = self.inertia.forces(rotation, accelerations)
        into.in_motion.append(forces.full)
        self.inertia.blocks.add_gradient(into.own, forces.on_frames)
        into.squares += float(forces.full @ forces.full) + float(np.square(forces.on_frames[:, :3]).sum())
        if into.data is not None:
            into.data += self.step.mass_rate * self.inertia.data
            self.inertia.blocks.add_tangent(
                into.data, self.inertia.tangent(rotation, accelerations, self.step.mass_rate)
            )

    def energy(self, given: Given) -> float:
        """The kinetic energy at velocities equal to its accelerations, over their rate."""
        return self.inertia.momentum(given.state, self._accelerations(given.state)).kinetic_energy / self.step.mass_rate

    def _accelerations(self, state: State) -> Rates:
        """The accelerations with M a = r_m M v + M (v - v_n) / h."""
        old, moving = self.before.state, self.before.velocities
        return Rates(
            self.step.mass_rate * (state.x - old.x) - moving.points / self.step.length,
            self.step.mass_rate * (state.position - old.position) - moving.frames / self.step.length,
            self.step.mass_rate * (state.rotation - old.rotation) - moving.turning / self.step.length,
        )


def in_step(system: System, inertia: Inertia, damping: Damping, step: float, before: Instant, theta: Theta) -> System:
    """The system in a time step: planned as it is at rest, which must connect all that has mass.

    Parameters
    ----------
    system
        The discretised robot.
    inertia
        The masses.
    damping
        The damping.
    step
        Length of the step [s].
    before
        The instant at its start.
    theta
        Parameter values by dotted name [SI].
    """
    state, n = before.state, system.layout.n_actuators
    held = Controls(np.ones(n, dtype=bool), state.effort, np.zeros(n), elapsed=0.0)
    of_step = TimeStep(system.layout, step, damping, before.effort_rates)
    begun = zip(system.terms, system.given(state, held, theta), strict=True)
    terms = [part for term, given in begun for part in term.in_step(given, of_step)]
    return replace(system, terms=(*terms, InertialTerm(inertia, before, of_step)))


def at_rest(state: State, time: float = 0.0) -> Instant:
    """A state with zero velocities."""
    still = Rates(np.zeros_like(state.x), np.zeros_like(state.position), np.zeros_like(state.rotation))
    return Instant(time, state, still, np.zeros_like(state.effort))


def after(before: Instant, state: State, step: float) -> Instant:
    """The instant at a step's end: velocities are differences.

    Parameters
    ----------
    before
        The instant at the step's start.
    state
        The state at its end.
    step
        Its length [s].
    """
    old = before.state
    return Instant(
        before.time + step,
        state,
        Rates((state.x - old.x) / step, (state.position - old.position) / step, (state.rotation - old.rotation) / step),
        (state.effort - old.effort) / step,
    )


def coasting(layout: Layout, now: Instant, step: float) -> Floats:
    """The step of the unknowns (n_unknowns,) at constant velocities: a guess.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    now
        The instant at the step's start.
    step
        Its length [s].
    """
    n = layout.n_moving_frames
    dz = np.zeros(layout.n_unknowns)
    dz[: layout.first_frame_unknown] = now.velocities.points[layout.free_points].ravel()
    frames = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
    frames[:, :3] = now.velocities.frames[:n]
    spin = now.velocities.turning[:n] @ np.swapaxes(now.state.rotation[:n], 1, 2)
    frames[:, 3:] = -0.5 * axial(spin)
    return step * dz
