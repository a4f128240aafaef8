"""Equilibrium at given controls: a modified Newton method that keeps a factorisation as long as it converges fast."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.mechanics.dense import Dense, dense_tangent
from softcal.mechanics.linear_solve import Factorisation, factorisation
from softcal.mechanics.path_limits import PathLimits
from softcal.mechanics.redundancy import require_independent
from softcal.mechanics.state import State, moved
from softcal.mechanics.system import NO_BORDER, Controls, Linearisation, System
from softcal.mechanics.touched_pattern import TouchedPattern
from softcal.mechanics.wire_contact import CLEARANCE

TOLERANCE = 1e-9  # residual over its scale
FREE = 1e-6  # of the forces: largest force along a free mode, for a motion as long as the robot; less counts as zero
ROUNDING = 4.0 * float(np.finfo(float).eps)  # of the largest coordinate: rounding error of positions
MAX_ITERATIONS = 25
WITHOUT_RIDGES = 2  # iterations without a smaller residual, before ridges between triangles count as flat
PATIENCE = 6  # iterations without a smaller residual
WITH_CONTACT = 4  # times as many of both where surfaces may touch: the set of contacts must be found too
REUSE_BELOW = 0.1  # a factorisation is kept while each step shrinks the residual at least tenfold
SMALL_START = 1e-3  # and from a first residual as small as this
FARTHEST = 10.0  # of the robot's extent
TORN = f"the robot would stretch to more than {FARTHEST:.0f} times its size"
NO_MODES: Floats = np.zeros((0, 0))
AS_MANY = 0.3  # of the unknowns: as many products of low rank make the tangent a dense matrix
MAX_CUTS = 8  # halvings of a step that would invert an element
TURN_PER_STEP = 1.0  # [rad] of a plate, or of a rod's section, at most
MOVE_PER_STEP = 0.33  # of the robot's extent, at most


@dataclass(frozen=True)
class Equilibrium:
    """The result of a solve for equilibrium.

    Attributes
    ----------
    state
        The last state.
    converged
        Whether it is an equilibrium.
    n_iterations
        Number of iterations.
    residual
        Residual over its scale [-].
    status
        Why it did not converge, a sentence; "" where it did.
    work
        Energy released in a snap-through [J].
    """

    state: State
    converged: bool
    n_iterations: int
    residual: float
    status: str = ""
    work: float = 0.0


class Statics:
    """A system at parameters theta, and the factorisation of its tangent kept from solve to solve.

    The tangent of all unknowns but the efforts is sparse and symmetric, K; efforts and friction border it:

        [ K   C ] [dz]   [b]
        [ R^T D ] [dw] = [c]    =>  dw = (R^T K^-1 C - D)^-1 (R^T K^-1 b - c),  dz = K^-1 (b - C dw)

    so the factorisation has no zeros on the diagonal.

    limits: of the work on each load path; the processor time counts from here on.
    """

    def __init__(self, system: System, theta: Mapping[str, float], limits: PathLimits | None = None) -> None:
        self.system = system
        self.limits, self.begun = limits or PathLimits(), time.process_time()
        self.theta = dict(theta)
        self.n_factorisations = 0
        self._planned: Factorisation = factorisation(system.pattern.indptr, system.pattern.indices)
        self._touched = TouchedPattern(system.pattern)
        self._factors = self._planned
        sizes = system.sizes(theta)
        self._force_floor = 1e-4 * sizes.force
        self.length = sizes.extent
        self._farthest = float(np.abs(system.layout.X).max())
        # The diagonal is first in each row of an upper triangle.
        self._diagonal = system.pattern.indptr[sizes.positions()]
        self._rounding = 0.0
        self._volume = sizes.meshed / max(system.layout.n_pressures, 1)
        scales = (term.coordinate_scales(sizes.extent) for term in system.actuated)
        self._coordinates = np.concatenate([np.zeros(0), *scales])
        self.unit = sizes.units()
        entries = self.unit[system.pattern.rows] * self.unit[system.pattern.indices]
        self._unit_places = np.flatnonzero(entries != 1.0)  # most are one: points are in metres
        self._unit_entries = entries[self._unit_places]
        self._border = NO_BORDER
        self._columns_solved: Floats | None = None
        # Modes (n_unknowns - n_actuators, k) excluded from the steps of `equilibrium`, see `exclude`: they appear with
        # the first buckling, and are not computed before.
        self.free_modes, self.seeks_free_modes = NO_MODES, False

    def norm(self, at: Linearisation) -> float:
        """The residual over its scale: forces over the reactions, volumes over a node's, coordinates over theirs.

        Forces due to the rounding of the positions count as zero: with linear elements near nu = 0.5 and small loads
        they exceed TOLERANCE times the reactions, and no iteration can remove them.
        """
        return self.measured(at.reduced, self.force_scale(at))

    def measured(self, reduced: Floats, force: float) -> float:
        """The norm of a gradient (n_unknowns,), forces over `force` [N]."""
        layout = self.system.layout
        frames = reduced[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        parts = (
            reduced[: layout.first_frame_unknown] / force,
            frames[:, :3].ravel() / force,
            frames[:, 3:].ravel() / (force * self.length),
            reduced[layout.first_pressure_unknown : layout.first_effort_unknown] / self._volume,
            reduced[layout.first_effort_unknown :] / self._coordinates,
        )
        return float(np.sqrt(max(part @ part for part in parts)))

    def force_scale(self, at: Linearisation) -> float:
        """The scale [N] of residual forces."""
        return max(at.forces, self._force_floor, self._rounding / TOLERANCE)

    def stiffness(self, at: Linearisation) -> float:
        """The typical diagonal entry of a tangent [N/m], by its points and frames in their units.

        Raises
        ------
        SimulationError
            Where no tangent was requested.
        """
        if at.data is None:
            raise SimulationError("There is no tangent.")
        moving = slice(self.system.layout.first_pressure_unknown)
        diagonal = at.data[self.system.pattern.indptr[:-1][moving]]
        return float(np.abs(diagonal * self.unit[moving] ** 2).mean())

    def factorise(self, at: Linearisation, drag: float = 0.0, free: Floats = NO_MODES) -> None:
        """Factorise the tangent of a linearisation, for the following solves.

        drag: of every point and frame against its motion [N/m], see `stiffness`. free: modes excluded from solutions,
        see `exclude`.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        if at.data is None:
            raise SimulationError("There is no tangent to factorise.")
        self._factors = self._planned
        data = at.data.copy()
        if drag > 0.0:
            moving = slice(self.system.layout.first_pressure_unknown)
            data[self.system.pattern.indptr[:-1][moving]] += drag / self.unit[moving] ** 2
        border = at.border
        if len(border.corner) - len(border.driven) > AS_MANY * len(self.unit):
            whole, border = dense_tangent(self.system.pattern, data, at.touch, border)
            self._factors = Dense(self.unit[:, None] * whole * self.unit)
        elif at.touch is None:
            data[self._unit_places] *= self._unit_entries
            self._factors.factorise(data)
        else:
            self._factors = self._touched.factorise(data, at.touch, self.unit)
        self._rounding = ROUNDING * self._farthest * float(np.linalg.norm(at.data[self._diagonal]))
        self.n_factorisations += 1
        self._border = border
        self._columns_solved = None
        if free.size:
            self.exclude(free)

    def exclude(self, modes: Floats) -> None:
        """Exclude modes (n_unknowns - n_actuators, k) from solutions dz of the factorised tangent: modes^T dz = 0.

        Their multipliers are forces along the modes; for free modes of the robot, they are zero.
        """
        border = self._border
        solved = self._sparse_solve(border.columns.reshape(len(modes), -1), modes)
        k = len(border.corner)
        require_independent(self.system, border, self.unit, solved)
        # A free mode would give entries of the multipliers' matrix that are too large beside the others.
        size = np.sqrt(np.abs(np.einsum("nk,nk->k", modes, solved[:, k:])))
        solved[:, k:] /= size
        self._border = replace(
            border,
            columns=np.concatenate([border.columns.reshape(len(modes), -1), modes / size], axis=1),
            rows=np.concatenate([border.rows.reshape(len(modes), -1), modes / size], axis=1),
            corner=np.concatenate([border.corner, np.zeros(modes.shape[1])]),
        )
        self._columns_solved = solved

    def solve(self, b: Floats) -> Floats:
        """The unknowns' response to b (n_unknowns,) or (n_unknowns, k), with the tangent factorised last.

        Raises
        ------
        SimulationError
            Where the bordered tangent is singular, or actuators are driven to coordinates that depend on each other.
        """
        n = self.system.layout.first_effort_unknown
        columns = b.reshape(len(b), -1)
        out = np.zeros_like(columns)
        border = self._border
        k = len(border.corner)
        columns_solved, y = self._with_border_solved(columns[:n])
        if k:
            rows_y = border.rows.T @ y
            rows_y[: len(border.driven)] -= columns[n + border.driven]
            try:
                w = np.linalg.solve(border.rows.T @ columns_solved - np.diag(border.corner), rows_y)
            except np.linalg.LinAlgError as error:
                raise SimulationError("The tangent is singular.") from error
            y -= columns_solved @ w
            out[n + border.driven] = w[: len(border.driven)]
        out[:n] = y
        return out.reshape(b.shape)

    def _with_border_solved(self, b: Floats) -> tuple[Floats, Floats]:
        """K^-1 of the border's columns, and of b (n, m): of the first one in one pass over the factors, not two."""
        k = len(self._border.corner)
        if k == 0 or self._columns_solved is not None:
            columns = self._border.columns if self._columns_solved is None else self._columns_solved
            return columns, self._sparse_solve(b) if b.shape[1] else b
        both = self._sparse_solve(self._border.columns, b)
        require_independent(self.system, self._border, self.unit, both)
        self._columns_solved = both[:, :k]
        return self._columns_solved, both[:, k:]

    def equilibrium(self, guess: State, controls: Controls) -> Equilibrium:
        """Newton's method from a guess. Never raises where it fails: the status says why."""
        system, free = self.system, self.free_modes
        state = replace(guess, effort=np.where(controls.is_held, controls.effort, guess.effort))
        at = system.linearise(state, controls, self.theta)
        if not at.is_admissible:
            return Equilibrium(state, False, 0, np.inf, f"the guess is not admissible: {at.why_not}")
        previous = residual = best = np.inf
        best_iteration = 0
        more = WITH_CONTACT if system.contacts else 1
        for iteration in range(more * MAX_ITERATIONS):
            residual = self.norm(at)
            if residual < best:
                best, best_iteration = residual, iteration
            elif iteration - best_iteration >= more * PATIENCE:
                status = f"Newton's method stalled (residual {best:.1e}, tolerance {TOLERANCE:.0e})"
                return Equilibrium(state, False, iteration, residual, status)
            across = self.measured(self._across(at.reduced, free), self.force_scale(at)) if free.size else residual
            if residual < TOLERANCE or max(across / TOLERANCE, residual / FREE) < 1.0:
                torn = self.is_torn(state)
                return Equilibrium(state, not torn, iteration, residual, TORN if torn else "")
            if not residual < min(1e3 * previous, 1e6):
                return Equilibrium(
                    state, False, iteration, residual, f"Newton's method diverged (residual {residual:.1e})"
                )
            if free.size and across < TOLERANCE:
                free = NO_MODES  # the modes need a force after all: the remaining residual is along them
            is_fresh = at.data is not None
            try:
                if is_fresh:
                    self.factorise(at, free=free)
                dz = -self.solve(at.reduced)
            except SimulationError as error:
                return Equilibrium(
                    state, False, iteration, residual, f"the tangent is singular: {str(error).rstrip('.')}"
                )
            step = self.limited(dz)
            serves = step == 1.0 and residual < (SMALL_START if np.isinf(previous) else REUSE_BELOW * previous)
            work = float(dz @ at.reduced)
            for _ in range(MAX_CUTS):
                candidate, part = self._before_touch(state, step * dz)
                step, serves = step * part, serves and part == 1.0
                convex = iteration - best_iteration >= WITHOUT_RIDGES
                at = system.linearise(candidate, controls, self.theta, tangent=not serves, convex=convex)
                # The line search: a step must not lead to an inadmissible state, nor leave more work along itself than
                # it began with. Small residuals are exempt; there Newton's method converges by itself, except where
                # surfaces are about to touch.
                trusted = residual < SMALL_START and not system.contacts
                if at.is_admissible and (trusted or abs(dz @ at.reduced) <= abs(work)):
                    break
                step, serves = 0.5 * step, False
            else:
                if is_fresh:
                    status = "no step along Newton's direction is admissible"
                    return Equilibrium(state, False, iteration, residual, status)
                at = system.linearise(state, controls, self.theta)  # the kept factorisation serves no longer
                continue
            state, previous = candidate, residual
        return Equilibrium(
            state,
            False,
            more * MAX_ITERATIONS,
            residual,
            f"residual {residual:.1e} after {more * MAX_ITERATIONS} iterations, tolerance {TOLERANCE:.0e}",
        )

    def _across(self, reduced: Floats, modes: Floats) -> Floats:
        """The gradient less its part along modes as `exclude` takes them."""
        out = reduced.copy()
        n = len(self.unit)
        units = modes * self.unit[:, None]
        units = units / np.linalg.norm(units, axis=0)
        out[:n] -= units @ (units.T @ (reduced[:n] * self.unit)) / self.unit
        return out

    def reachable(self, state: State, dz: Floats) -> State:
        """The state after a step dz, or after the part of it before the first contact."""
        return self._before_touch(state, dz)[0]

    def _before_touch(self, state: State, dz: Floats) -> tuple[State, float]:
        """The state after dz, or after the part of it (also returned) that is free of contact."""
        part = 1.0
        candidate = moved(self.system.layout, state, dz)
        for _ in range(MAX_CUTS):
            free = self.system.free_way(state, candidate)
            if free == 1.0:
                return candidate, part
            part *= CLEARANCE * free
            candidate = moved(self.system.layout, state, part * dz)
        return state, 0.0

    def is_torn(self, state: State) -> bool:
        """Whether the robot is stretched beyond the validity of any law: past a limit point loads may pull it to any
        length.
        """
        return float(np.ptp(state.x, axis=0).max()) > FARTHEST * self.length

    def tangent_at(self, state: State, controls: Controls) -> Linearisation:
        """Linearise and factorise at an equilibrium, for predictors and sensitivities.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        at = self.system.linearise(state, controls, self.theta)
        self.factorise(at)
        if at.touch is not None and self.n_unstable() > 0:
            # A point on a ridge between triangles has a negative stiffness across, as wide as the ridge is blunt.
            at = self.system.linearise(state, controls, self.theta, convex=True)
            self.factorise(at)
        return at

    def n_unstable(self) -> int:
        """Number of unstable directions of the state whose tangent was factorised last; zero where it is stable.

        The potential has a minimum among the states with these coordinates where the bordered tangent has as many
        negative eigenvalues as it has multipliers: pressures, efforts of driven actuators. Friction makes the border
        unsymmetric; its sign changes where the tangent becomes singular, as without friction. Dead moments have no
        potential, and the symmetric part of the tangent depends on how rotations are parametrised: there statics show
        only whether the determinant has the sign of a stable state (divergence), so that the number is 0 or 1.
        """
        border = self._border
        n = self.system.layout.first_effort_unknown
        n_negative = self._factors.n_negative
        if len(border.corner):
            columns_solved, _ = self._with_border_solved(np.zeros((n, 0)))
            schur = border.rows.T @ columns_solved - np.diag(border.corner)
            n_negative += int(np.count_nonzero(np.linalg.eigvals(schur).real > 0.0))
        n_unstable = n_negative - self.system.layout.n_pressures - len(border.corner)
        return n_unstable % 2 if border.has_moments else n_unstable

    def release(self) -> None:
        """Release the factors' memory."""
        self._touched.release()
        self._planned.release()

    def _sparse_solve(self, *blocks: Floats) -> Floats:
        """K^-1 of the blocks' columns, side by side, in column order as the factors require."""
        scaled = np.empty((len(self.unit), sum(block.shape[1] for block in blocks)), order="F")
        first = 0
        for block in blocks:
            np.multiply(block, self.unit[:, None], out=scaled[:, first : first + block.shape[1]])
            first += block.shape[1]
        solved = self._factors.solve(scaled)
        solved *= self.unit[:, None]
        return solved

    def reach(self, dz: Floats) -> float:
        """The largest displacement by a step [m]; a frame turns an arm as long as the robot."""
        layout = self.system.layout
        frames = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        return max(
            float(np.abs(dz[: layout.first_frame_unknown]).max(initial=0.0)),
            float(np.abs(frames[:, :3]).max(initial=0.0)),
            self.length * float(np.abs(frames[:, 3:]).max(initial=0.0)),
        )

    def limited(self, dz: Floats) -> float:
        """A step length that neither turns a frame nor moves a point too far at once."""
        layout = self.system.layout
        frames = dz[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        turn = float(np.abs(frames[:, 3:]).max(initial=0.0))
        move = float(np.abs(dz[: layout.first_frame_unknown]).max(initial=0.0)) / self.length
        return min(1.0, TURN_PER_STEP / max(turn, 1e-300), MOVE_PER_STEP / max(move, 1e-300))
