"""Equilibrium at given controls: Newton's method that keeps a factorisation as long as it serves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.linear_solve import Factorisation, factorisation
from softcal.mechanics.state import State, moved
from softcal.mechanics.system import Controls, Linearisation, System, solid_theta

TOLERANCE = 1e-9  # residual over its scale
MAX_ITERATIONS = 25
REUSE_BELOW = 0.1  # a factorisation is kept while each step shrinks the residual at least tenfold
MAX_CUTS = 8  # halvings of a step that would invert an element


@dataclass(frozen=True)
class Equilibrium:
    """A state and whether it is one of equilibrium. status: a sentence where it is not."""

    state: State
    converged: bool
    n_iterations: int
    residual: float
    status: str = ""


class Statics:
    """A system at parameters theta, and the factorisation of its tangent that goes from solve to solve."""

    def __init__(self, system: System, theta: Mapping[str, float]) -> None:
        self.system = system
        self.theta = dict(theta)
        self.n_factorisations = 0
        self._factors: Factorisation = factorisation(system.pattern.indptr, system.pattern.indices)
        layout = system.layout
        shear = max(s.law.shear_modulus(solid_theta(theta, s.name)) for s in system.solids)
        self._force_floor = 1e-4 * shear * system.stiffness_length**2
        self._length = float(np.linalg.norm(np.ptp(layout.X, axis=0)))
        volume = sum(float(s.w.sum()) for s in system.solids)
        self._volume = volume / max(layout.n_pressures, 1)
        self._unit = _units(system, shear, self._length)
        rows = np.repeat(np.arange(layout.n_unknowns), np.diff(system.pattern.indptr))
        self._unit_entries = self._unit[rows] * self._unit[system.pattern.indices]

    def norm(self, at: Linearisation) -> float:
        """The residual over its scale: forces over the reactions, volumes over a node's, lengths over the robot's."""
        layout = self.system.layout
        n_plate, n_scalar = layout.first_plate_unknown, layout.first_scalar_unknown
        force = max(float(np.linalg.norm(at.full[: 3 * layout.n_points])), self._force_floor)
        plates = at.reduced[n_plate:n_scalar].reshape(-1, 6)
        scalars = at.reduced[n_scalar:]
        parts = (
            np.linalg.norm(at.reduced[:n_plate]) / force,
            np.linalg.norm(plates[:, :3]) / force,
            np.linalg.norm(plates[:, 3:]) / (force * self._length),
            np.linalg.norm(scalars[: layout.n_pressures]) / self._volume,
            np.linalg.norm(scalars[layout.n_pressures :]) / self._length,
        )
        return float(max(parts))

    def factorise(self, at: Linearisation) -> None:
        """Factorise the tangent of a linearisation, for the solves to come."""
        assert at.data is not None  # noqa: S101
        self._factors.factorise(at.data * self._unit_entries)
        self.n_factorisations += 1

    def solve(self, b: Floats) -> Floats:
        """K^-1 b with the tangent factorised last; b (n_unknowns,) or (n_unknowns, k)."""
        unit = self._unit if b.ndim == 1 else self._unit[:, None]
        return unit * self._factors.solve(unit * b)

    def equilibrium(self, guess: State, controls: Controls) -> Equilibrium:
        """Newton's method from a guess. Never raises for a solve that fails: the status says why."""
        system, layout = self.system, self.system.layout
        tension = np.where(controls.is_held, controls.tension, guess.tension)
        state = replace(guess, tension=tension)
        refresh = True
        previous = np.inf
        for iteration in range(MAX_ITERATIONS):
            at = system.linearise(state, controls, self.theta, tangent=refresh)
            if at.J_min <= 0.0:
                return Equilibrium(state, False, iteration, np.inf, _inverted(at.J_min))
            residual = self.norm(at)
            if not np.isfinite(residual):
                return Equilibrium(state, False, iteration, residual, "the residual is not finite")
            if residual < TOLERANCE:
                return Equilibrium(state, True, iteration, residual)
            if residual > 1e3 * previous or residual > 1e6:
                return Equilibrium(
                    state, False, iteration, residual, f"Newton's method diverged (residual {residual:.1e})"
                )
            try:
                if refresh:
                    self.factorise(at)
                dz = -self.solve(at.reduced)
            except SimulationError as error:
                return Equilibrium(state, False, iteration, residual, str(error))
            step = self._limited(dz)
            if step < 1.0 and not refresh:  # an old tangent may point astray; a fresh one says whether it did
                refresh, previous = True, np.inf
                continue
            candidate = self._admissible(state, step * dz)
            if candidate is None:
                return Equilibrium(state, False, iteration, residual, "every step inverts an element (J <= 0)")
            state = candidate
            refresh = not self._serves(residual, previous)
            previous = residual
        return Equilibrium(
            state,
            False,
            MAX_ITERATIONS,
            residual,
            f"residual {residual:.1e} after {MAX_ITERATIONS} iterations, tolerance {TOLERANCE:.0e}",
        )

    def tangent_at(self, state: State, controls: Controls) -> Linearisation:
        """Linearise and factorise at an equilibrium, for predictors and sensitivities."""
        at = self.system.linearise(state, controls, self.theta)
        self.factorise(at)
        return at

    def release(self) -> None:
        """Give the factors' memory back."""
        self._factors.release()

    def _serves(self, residual: float, previous: float) -> bool:
        return residual < 1e-3 if not np.isfinite(previous) else residual < REUSE_BELOW * previous

    def _limited(self, dz: Floats) -> float:
        """A step length that turns no plate by more than a radian and moves no point by more than a third of the robot."""
        layout = self.system.layout
        plates = dz[layout.first_plate_unknown : layout.first_scalar_unknown].reshape(-1, 6)
        turn = float(np.abs(plates[:, 3:]).max(initial=0.0))
        move = float(np.abs(dz[: layout.first_plate_unknown]).max(initial=0.0)) / self._length
        return min(1.0, 1.0 / max(turn, 1e-300), 0.33 / max(move, 1e-300))

    def _admissible(self, state: State, dz: Floats) -> State | None:
        for _ in range(MAX_CUTS):
            candidate = moved(self.system.layout, state, dz)
            if all(float(solid.invariants(candidate.x)[3].min()) > 0.0 for solid in self.system.solids):
                return candidate
            dz = 0.5 * dz
        return None


def _units(system: System, shear: float, length: float) -> Floats:
    """Units of the unknowns in which the tangent's entries are of one size; pivots are judged against each other."""
    layout = system.layout
    n_tets = sum(len(s.conn) for s in system.solids)
    volume = sum(float(s.w.sum()) for s in system.solids)
    h = (6.0 * volume / n_tets) ** (1.0 / 3.0)
    unit = np.ones(layout.n_unknowns)
    plates = unit[layout.first_plate_unknown : layout.first_scalar_unknown].reshape(-1, 6)
    plates[:, 3:] = 4.0 / length
    unit[layout.first_scalar_unknown :] = shear / h
    unit[layout.first_scalar_unknown + layout.n_pressures :] = shear * h
    return unit


def _inverted(J: float) -> str:
    return f"an element is inverted (J = {J:.2g})"
