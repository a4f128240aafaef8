"""Equilibrium at given controls: a modified Newton method that keeps a factorisation as long as it converges fast."""

from __future__ import annotations

import time
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.errors import SimulationError
from softcal.kernel import kernel
from softcal.mechanics.bordered import EXACT, BorderedTangent
from softcal.mechanics.kept_nodes import KeptNode, KeptNodes
from softcal.mechanics.path_limits import PathLimits
from softcal.mechanics.state import State, moved
from softcal.mechanics.system import Controls, Linearisation, System
from softcal.mechanics.wire_contact import CLEARANCE

if TYPE_CHECKING:
    from softcal.mechanics.node import Node

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
FORCING, LEAST_FORCING = 0.1, 1e-4  # relative error of a step: at first as the tangent changes along it, in the end
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
    """A system at parameters theta, and its tangent, whose factorisation is kept from solve to solve.

    limits: of the work on each load path; the processor time counts from here on. kept: nodes of other
    paths at theta, where these are kept.
    """

    def __init__(
        self,
        system: System,
        theta: Mapping[str, float],
        limits: PathLimits | None = None,
        kept: KeptNodes | None = None,
    ) -> None:
        self.system = system
        self._kept, self._n_repeated = kept, 0
        self.limits, self.begun = limits or PathLimits(), time.process_time()
        self.path_begin: int | None = None  # factorisations before the present load path, where there is one
        self.theta = dict(theta)
        sizes = system.sizes(theta)
        self.unit = sizes.units()
        self.tangent = BorderedTangent(system, self.unit)
        self._force_floor = 1e-4 * sizes.force
        self.length = sizes.extent
        self._farthest = float(np.abs(system.layout.X).max())
        # The diagonal is first in each row of an upper triangle.
        self._diagonal = system.pattern.indptr[sizes.positions()]
        self._rounding = 0.0
        self._volume = sizes.meshed / max(system.layout.n_pressures, 1)
        scales = (term.coordinate_scales(sizes.extent) for term in system.actuated)
        self._coordinates = np.concatenate([np.zeros(0), *scales])
        # Modes (n_unknowns - n_actuators, k) excluded from the steps of `equilibrium`, see `exclude`: they appear with
        # the first buckling, and are not computed before.
        self.free_modes, self.seeks_free_modes = NO_MODES, False

    @property
    def n_factorisations(self) -> int:
        """Number of factorisations so far, with those of kept nodes."""
        return self.tangent.n_factorisations + self._n_repeated

    def kept_node(self, key: Hashable, names: tuple[str, ...]) -> KeptNode | None:
        """A node that was kept, with derivatives by parameters `names` (k,); its factorisations count again."""
        kept = None if self._kept is None else self._kept.get(key, names)
        self._n_repeated += 0 if kept is None else kept.n_factorisations
        return kept

    def keep(self, key: Hashable, names: tuple[str, ...], node: Node, next_step: float, *, since: int) -> None:
        """Keep a node, where nodes are kept.

        Parameters
        ----------
        key
            What the node depends on.
        names
            Parameters (k,) of its derivatives.
        node
            The node.
        next_step
            Length of the next step of its path.
        since
            Number of factorisations before it.
        """
        if self._kept is not None:
            self._kept.keep(key, names, KeptNode(node, next_step, self.n_factorisations - since))

    def is_in_vain(self, key: Hashable) -> bool:
        """Whether the same attempt failed before; its factorisations then count again."""
        n = None if self._kept is None else self._kept.in_vain.get(key)
        self._n_repeated += n or 0
        return n is not None

    def keep_in_vain(self, key: Hashable, *, since: int) -> None:
        """Keep, where nodes are kept, that an attempt failed, with the factorisations since a number of them."""
        if self._kept is not None:
            self._kept.in_vain[key] = self.n_factorisations - since

    @property
    def shared_end(self) -> float:
        """`KeptNodes.shared_end`; infinity where nodes are not kept."""
        return np.inf if self._kept is None else self._kept.shared_end

    @shared_end.setter
    def shared_end(self, c: float) -> None:
        if self._kept is not None:
            self._kept.shared_end = c

    def why_over(self) -> str:
        """The limit of the work that is exceeded, as part of a sentence; else "". Solves end there, and load paths."""
        n = 0 if self.path_begin is None else self.n_factorisations - self.path_begin
        return self.limits.why_over(n, self.begun)

    def norm(self, at: Linearisation) -> float:
        """The residual over its scale: forces over the reactions, volumes over a node's, coordinates over theirs.

        Forces due to the rounding of the positions count as zero: with linear elements near nu = 0.5 and small loads
        they exceed TOLERANCE times the reactions, and no iteration can remove them.
        """
        return self.measured(at.reduced, self.force_scale(at))

    def measured(self, reduced: Floats, force: float) -> float:
        """The norm of a gradient (n_unknowns,), forces over `force` [N]."""
        layout = self.system.layout
        firsts = (layout.first_frame_unknown, layout.first_pressure_unknown, layout.first_effort_unknown)
        return _norm(np.ascontiguousarray(reduced), *firsts, force, self.length, self._volume, self._coordinates)

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

        Parameters
        ----------
        at
            The linearisation.
        drag
            Drag of every point and frame against its motion [N/m], see `stiffness`.
        free
            Modes (n_unknowns - n_actuators, k) excluded from solutions, see `exclude`.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        moving = slice(self.system.layout.first_pressure_unknown)
        self.tangent.factorise(at, drag / self.unit[moving] ** 2 if drag > 0.0 else None)
        self._rounding = self._rounding_of(at)
        if free.size:
            self.exclude(free)

    def take(self, at: Linearisation) -> None:
        """Solve with the tangent of a linearisation from now on, by factors that are kept where these serve.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        self.tangent.take(at)
        self._rounding = self._rounding_of(at)

    def forget(self) -> None:
        """Forget the factors: those of a state far from the next one serve no solution there."""
        self.tangent.forget()

    def _rounding_of(self, at: Linearisation) -> float:
        """Forces due to the rounding of the positions [N]."""
        if at.data is None:
            return 0.0
        diagonal = at.data.take(self._diagonal)
        return ROUNDING * self._farthest * float(np.sqrt(diagonal @ diagonal))

    def exclude(self, modes: Floats) -> None:
        """Exclude modes (n_unknowns - n_actuators, k) from solutions dz of the factorised tangent: modes^T dz = 0.

        Their multipliers are forces along the modes; for free modes of the robot, they are zero.
        """
        self.tangent.exclude(modes)

    def solve(self, b: Floats, accuracy: float = EXACT, guess: Floats | None = None) -> Floats:
        """The unknowns' response with the tangent of the last linearisation.

        Parameters
        ----------
        b, accuracy, guess
            See `BorderedTangent.solve`.

        Raises
        ------
        SimulationError
            Where the bordered tangent is singular, or actuators are driven to coordinates that depend on each other.
        """
        return self.tangent.solve(b, accuracy, guess)

    def equilibrium(
        self, guess: State, controls: Controls, tolerance: float | None = None, *, flat_ridges: bool = False
    ) -> Equilibrium:
        """Newton's method from a guess. Never raises where it fails: the status says why.

        Parameters
        ----------
        guess
            The guess.
        controls
            The controls.
        tolerance
            Largest residual over its scale [-]; None: TOLERANCE.
        flat_ridges
            Whether ridges between triangles count as flat at first and while the residual is large: fewer steps from a
            guess in which surfaces overlap all over, but a load path gets more nodes.
        """
        system, free = self.system, self.free_modes
        tolerance = TOLERANCE if tolerance is None else tolerance
        state = replace(guess, effort=np.where(controls.is_held, controls.effort, guess.effort))
        at = system.linearise(state, controls, self.theta, convex=flat_ridges)
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
                status = f"Newton's method stalled (residual {best:.1e}, tolerance {tolerance:.0e})"
                return Equilibrium(state, False, iteration, residual, status)
            across = self.measured(self._across(at.reduced, free), self.force_scale(at)) if free.size else residual
            if residual < tolerance or max(across / tolerance, residual / FREE) < 1.0:
                torn = self.is_torn(state)
                return Equilibrium(state, not torn, iteration, residual, TORN if torn else "")
            if not residual < min(1e3 * previous, 1e6):
                return Equilibrium(
                    state, False, iteration, residual, f"Newton's method diverged (residual {residual:.1e})"
                )
            if over := self.why_over():
                return Equilibrium(state, False, iteration, residual, over)
            if free.size and across < tolerance:
                free = NO_MODES  # the modes need a force after all: the remaining residual is along them
            is_fresh, touches, was_convex = at.data is not None, at.touch is not None, at.is_convex
            try:
                if is_fresh and free.size:
                    self.factorise(at, free=free)
                elif is_fresh:
                    self.take(at)
                needed = max(LEAST_FORCING, 0.1 * tolerance / residual)
                dz = -self.solve(at.reduced, min(max(0.1 * residual, needed), FORCING))
            except SimulationError as error:
                return Equilibrium(
                    state, False, iteration, residual, f"the tangent is singular: {str(error).rstrip('.')}"
                )
            step = self.limited(dz)
            # Solved by iteration, a step costs more than the assembly of its tangent.
            is_kept = step == 1.0 and self.tangent.is_factorised
            serves = is_kept and residual < (SMALL_START if np.isinf(previous) else REUSE_BELOW * previous)
            work = float(dz @ at.reduced)
            least, most = 0.0, np.inf
            lowest, of_lowest = residual, None
            for _ in range(MAX_CUTS):
                candidate, part = self._before_touch(state, step * dz)
                step, serves = step * part, serves and part == 1.0
                convex = (flat_ridges and residual > SMALL_START) or iteration - best_iteration >= WITHOUT_RIDGES
                at = system.linearise(candidate, controls, self.theta, tangent=not serves, convex=convex)
                # The line search: a step must not lead to an inadmissible state, nor leave more work along itself than
                # it began with. Small residuals are exempt; there Newton's method converges by itself, except where
                # surfaces are about to touch.
                trusted = residual < SMALL_START and not system.contacts
                here = float(dz @ at.reduced) if at.is_admissible else np.inf
                if abs(here) <= abs(work) or (trusted and at.is_admissible):
                    break
                if flat_ridges and at.is_admissible and (norm := self.norm(at)) < lowest:
                    lowest, of_lowest = norm, (candidate, at)
                # Across a ridge the energy is concave: downhill all the way, the minimum is further on.
                least, most = (step, most) if touches and part == 1.0 and here < work < 0.0 else (least, step)
                step, serves = (2.0 * step if np.isinf(most) else 0.5 * (least + most)), False
            else:
                is_exact = is_fresh and self.tangent.has_own_factors
                if is_exact and (was_convex or not touches):
                    if of_lowest is None:
                        status = "no step along Newton's direction is admissible"
                        return Equilibrium(state, False, iteration, residual, status)
                    # Far from equilibrium a coordinate's part of the work may cancel the rest, and it measures nothing.
                    (state, at), previous = of_lowest, residual
                    continue
                # Kept factors serve no longer: where surfaces have separated they are too stiff, and their estimate of
                # the error misses the forces there. Or a ridge between triangles gives no direction of descent.
                if not is_exact:
                    self.forget()
                at = system.linearise(state, controls, self.theta, convex=was_convex or is_exact or flat_ridges)
                continue
            state, previous = candidate, residual
        return Equilibrium(
            state,
            False,
            more * MAX_ITERATIONS,
            residual,
            f"residual {residual:.1e} after {more * MAX_ITERATIONS} iterations, tolerance {tolerance:.0e}",
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
        """Linearise at an equilibrium, and take the tangent that shows whether it is stable: the exact one, or where
        surfaces touch on ridges the one with these flat (`is_convex`), which serves no derivatives.

        Raises
        ------
        SimulationError
            Where the tangent is singular.
        """
        at = self.system.linearise(state, controls, self.theta)
        self._take_or_factorise(at)
        if at.touch is not None and self.n_unstable() > 0:
            # A point on a ridge between triangles has a negative stiffness across, as wide as the ridge is blunt.
            at = self.system.linearise(state, controls, self.theta, convex=True)
            self._take_or_factorise(at)
        return at

    def _take_or_factorise(self, at: Linearisation) -> None:
        if self.seeks_free_modes:
            self.factorise(at)
        else:
            self.take(at)

    def n_unstable(self) -> int:
        """Number of unstable directions of the state whose tangent was taken last, see `BorderedTangent`."""
        return self.tangent.n_unstable()

    def release(self) -> None:
        """Release the factors' memory."""
        self.tangent.release()

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


@kernel(error_model="numpy")
def _norm(
    reduced: Floats,
    frames: int,
    pressures: int,
    efforts: int,
    force: float,
    length: float,
    volume: float,
    coordinates: Floats,
) -> float:
    """The largest of the norms of a gradient (n_unknowns,) on points, on the frames' positions and rotations, on
    pressures, and on efforts, each over its scale; frames, pressures, efforts: the first unknown of each.
    """
    points = moves = turns = volumes = paths = 0.0
    for k in range(frames):
        points += (reduced[k] / force) ** 2
    for k in range(frames, pressures, 6):
        for i in range(3):
            moves += (reduced[k + i] / force) ** 2
            turns += (reduced[k + 3 + i] / (force * length)) ** 2
    for k in range(pressures, efforts):
        volumes += (reduced[k] / volume) ** 2
    for k in range(len(coordinates)):
        paths += (reduced[efforts + k] / coordinates[k]) ** 2
    if np.isnan(points + moves + turns + volumes + paths):  # which `max` passes over
        return np.nan
    return np.sqrt(max(points, moves, turns, volumes, paths))
