"""The sum of terms: gradient and tangent of the total potential at a state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from softcal.checks import Floats, Ints
from softcal.errors import SimulationError
from softcal.mechanics.cable import CablePlaces, CableTerm
from softcal.mechanics.cable_friction import Loss, factor_rates, friction_loss, loss_border
from softcal.mechanics.contact import ContactTerm, Touch
from softcal.mechanics.frame_blocks import FrameBlocks, frame_blocks, moving_pairs
from softcal.mechanics.layout import FIXED, Layout
from softcal.mechanics.motion import Motion, build_motion
from softcal.mechanics.pattern import Pattern, build_pattern
from softcal.mechanics.rod import RodTerm
from softcal.mechanics.solid import SolidPlaces, SolidTerm
from softcal.mechanics.state import State


@dataclass(frozen=True)
class Controls:
    """Per cable: is_held (its tension is given) with that tension [N], else its shortening [m]; load: factor on all
    dead loads, one but while they are put on.
    """

    is_held: np.ndarray
    tension: Floats
    shortening: Floats
    load: float = 1.0


@dataclass(frozen=True)
class Loads:
    """Dead forces on the points by parameter: total = constant + sum of value * per_unit[name], (n_points, 3) [N].

    Weight is such a force: a body's density or a plate's mass times its force per unit.
    """

    constant: Floats
    per_unit: Mapping[str, Floats]

    def total(self, theta: Mapping[str, float]) -> Floats:
        """Force on every point (n_points, 3) [N]."""
        force = self.constant.copy()
        for name, unit in self.per_unit.items():
            force += theta[name] * unit
        return force


@dataclass(frozen=True)
class Border:
    """Columns and rows (n_unknowns - n_cables, k) around the sparse tangent K, with a diagonal corner (k,):

        [ K     columns ]
        [ rows^T corner ]

    The first ones belong to the tensions of `taut` cables (corner zero: their length is prescribed), the others to the
    turning angles of cables with friction (corner -1).
    """

    taut: Ints
    columns: Floats
    rows: Floats
    corner: Floats


@dataclass(frozen=True)
class Linearisation:
    """Gradient and tangent at a state.

    full: gradient on all entities; reduced: on the unknowns; forces: the norm of the nodal forces before they cancel
    [N]; J_min: the smallest volume ratio; turn: the largest angle between neighbouring nodes of rods [rad]; data: the
    sparse tangent's triangle, or None; border: what the tensions and the cables' friction add to it; touch: what
    contacts add to the tangent outside its pattern (sparse, upper triangle), or None.
    """

    full: Floats
    reduced: Floats
    forces: float
    J_min: float
    turn: float
    data: Floats | None
    border: Border
    kinematics: tuple[tuple[Floats, Floats, Floats, Floats], ...]
    touch: Any = None

    @property
    def is_admissible(self) -> bool:
        """Whether no element is inverted, and no rod winds by half a turn between two nodes."""
        return self.J_min > 0.0 and self.turn < LARGEST_TURN

    @property
    def why_not(self) -> str:
        """What is inadmissible, in words."""
        if not self.J_min > 0.0:
            return f"it inverts an element (J = {self.J_min:.2g})"
        return f"a rod turns by {np.degrees(self.turn):.0f} deg between two nodes"


LARGEST_TURN = 0.9 * np.pi  # [rad] between two neighbouring nodes of a rod

NO_BORDER = Border(np.zeros(0, dtype=np.int64), np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0))


@dataclass(frozen=True)
class System:
    """Everything about the robot that no parameter changes; parameters theta [SI] come with each call."""

    layout: Layout
    pattern: Pattern
    motion: Motion
    solids: tuple[SolidTerm, ...]
    solid_places: tuple[SolidPlaces, ...]
    rods: tuple[RodTerm, ...]
    rod_blocks: tuple[FrameBlocks, ...]
    cables: CableTerm
    cable_places: CablePlaces
    loads: Loads
    contacts: tuple[ContactTerm, ...]
    stiffness_length: float  # [m]: area over length of the robot, for scales of force

    def linearise(
        self, state: State, controls: Controls, theta: Mapping[str, float], *, tangent: bool = True
    ) -> Linearisation:
        """Gradient and, on demand, tangent. Where the state is inadmissible the gradient is empty."""
        layout = self.layout
        kinematics = tuple(solid.invariants(state.x) for solid in self.solids)
        J_min = min((float(k[3].min()) for k in kinematics), default=1.0)
        rods = tuple(
            rod.assemble(state.position, state.rotation, part_theta(theta, rod.name), tangent=tangent)
            for rod in self.rods
        )
        turn = max((rod.turn for rod in rods), default=0.0)
        if not J_min > 0.0 or not turn < LARGEST_TURN:
            return Linearisation(np.zeros(0), np.zeros(0), 0.0, J_min, turn, None, NO_BORDER, kinematics)
        full = np.zeros(3 * layout.n_points + layout.n_pressures)
        data = np.zeros(self.pattern.size) if tangent else None
        for solid, places, known in zip(self.solids, self.solid_places, kinematics, strict=True):
            solid.assemble(state.x, state.pressure, known, part_theta(theta, solid.name), full, data, places)
        loss = friction_loss(self.cables, state.x, self._friction(theta))
        pull = state.tension[self.cables.cable] * loss.factor
        self.cables.assemble(state.x, pull, full, data, self.cable_places)
        full[: 3 * layout.n_points] -= controls.load * self.loads.total(theta).ravel()
        touches = [contact.at(state.x, hessian=tangent) for contact in self.contacts]
        for touch in touches:
            full[: 3 * layout.n_points] += touch.gradient.ravel()
        gap = self.cables.lengths(state.x) - self.cables.rest_length + controls.shortening
        reduced = np.concatenate([self.motion.reduce_gradient(state, full), np.where(controls.is_held, 0.0, gap)])
        nodal = full[: 3 * layout.n_points]
        square = float(nodal @ nodal)
        for rod, blocks in zip(rods, self.rod_blocks, strict=True):
            blocks.add_gradient(reduced, rod.gradient)
            square += float(np.square(rod.gradient[:, :3]).sum())
        at = Linearisation(full, reduced, float(np.sqrt(square)), J_min, turn, None, NO_BORDER, kinematics)
        if data is None:
            return at
        self.motion.reduce_tangent(state, full, data)
        for rod, blocks in zip(rods, self.rod_blocks, strict=True):
            if rod.tangent is not None:
                blocks.add_tangent(data, rod.tangent)
        border = self._border(state, controls, loss)
        return replace(at, data=data[: self.pattern.nnz], border=border, touch=self._touch(state, touches))

    def softened(self, state: State, theta: Mapping[str, float]) -> str:
        """Which bodies are compressed so far that their laws give way, as a sentence with a blank before it, or ""."""
        ratios = [s.softened(s.invariants(state.x), part_theta(theta, s.name)) for s in self.solids]
        return "".join(
            f" Body {solid.name} is compressed to {ratio:.2g} of its volume, where its law {solid.law.name} gives way: "
            "more compression takes less pressure there."
            for solid, ratio in zip(self.solids, ratios, strict=True)
            if ratio < 1.0
        )

    def tangent_times(self, at: Linearisation, dz: Floats) -> Floats:
        """The bordered tangent of a linearisation times rates dz (n_unknowns, k) of the unknowns.

        Raises
        ------
        SimulationError
            Where the state is inadmissible and has no tangent.
        """
        import scipy.sparse as sp

        if at.data is None:
            raise SimulationError("There is no tangent.")
        n, taut = self.layout.first_tension_unknown, at.border.taut
        upper: Any = sp.csr_matrix((at.data, self.pattern.indices, self.pattern.indptr), shape=(n, n))
        if at.touch is not None:
            upper = upper + at.touch
        x, columns, rows = dz[:n], at.border.columns, at.border.rows
        out = np.zeros_like(dz)
        out[:n] = upper @ x + upper.T @ x - upper.diagonal()[:, None] * x
        if len(at.border.corner):
            k = len(taut)
            out[:n] += columns[:, :k] @ dz[n + taut] + columns[:, k:] @ (rows[:, k:].T @ x)
            out[n + taut] = rows[:, :k].T @ x
        return out

    def free_way(self, state: State, to: State) -> float:
        """The part of the straight way between two states that leads through no contact, one where all of it does."""
        return min((contact.free_way(state.x, to.x) for contact in self.contacts), default=1.0)

    def _touch(self, state: State, touches: list[Touch]) -> Any:
        """The contacts' tangent on the unknowns, upper triangle, or None where nothing touches."""
        import scipy.sparse as sp

        hessians = [touch.hessian for touch in touches if touch.hessian is not None]
        if not hessians:
            return None
        P = self.motion.matrix(state)[: 3 * self.layout.n_points]
        return sp.triu(P.T @ sum(hessians[1:], hessians[0]) @ P, format="csr")

    def length_gradient(self, state: State, i_cable: int) -> Floats:
        """dL/dz of one cable on the unknowns but the tensions (n_unknowns - n_cables,)."""
        return self._segment_gradient(state, (self.cables.cable == i_cable).astype(float))

    def shortening_by_offset(self, state: State) -> Floats:
        """d shortening of each cable / d its routing offset (n_cables,), the robot at rest."""
        return self.cables.rest_by_offset - self.cables.lengths_by_offset(state.x)

    def pull(self, state: State, i_cable: int, theta: Mapping[str, float]) -> Floats:
        """d gradient / d tension of one cable: its length's gradient, less what friction takes."""
        loss = friction_loss(self.cables, state.x, self._friction(theta))
        return self._segment_gradient(state, np.where(self.cables.cable == i_cable, loss.factor, 0.0))

    def _segment_gradient(self, state: State, weights: Floats) -> Floats:
        layout = self.layout
        full = self.cables.segment_gradient(state.x, weights, 3 * layout.n_points + layout.n_pressures)
        return self.motion.reduce_gradient(state, full)

    def _friction(self, theta: Mapping[str, float]) -> Floats:
        return np.array([theta[f"{name}.friction_coefficient"] for name in self.cables.names])

    def _border(self, state: State, controls: Controls, loss: Loss) -> Border:
        taut = np.flatnonzero(~controls.is_held)
        columns = [self._segment_gradient(state, np.where(self.cables.cable == i, loss.factor, 0.0)) for i in taut]
        rows = columns.copy()
        if len(loss.mu):
            rows = [self.length_gradient(state, int(i)) for i in taut]
            rider = self.layout.rider
            moves = (rider != FIXED) & (rider < self.layout.n_moving_frames)
            size = 3 * self.layout.n_points + self.layout.n_pressures
            u, v = loss_border(self.cables, state.x, loss, state.tension, moves, size)
            columns += [self.motion.reduce_gradient(state, column) for column in u.T]
            rows += [self.motion.reduce_gradient(state, row) for row in v.T]
        if not columns:
            return NO_BORDER
        corner = np.concatenate([np.zeros(len(taut)), -np.ones(len(columns) - len(taut))])
        return Border(taut, np.stack(columns, axis=1), np.stack(rows, axis=1), corner)

    def gradient_by_parameters(
        self, state: State, at: Linearisation, theta: Mapping[str, float], names: tuple[str, ...]
    ) -> Floats:
        """d reduced gradient / d parameter, (n_unknowns, n_names)."""
        layout = self.layout
        full = {name: np.zeros(3 * layout.n_points + layout.n_pressures) for name in names}
        for solid, known in zip(self.solids, at.kinematics, strict=True):
            own = part_theta(full, solid.name)
            solid.gradient_by_parameters(state.x, state.pressure, known, part_theta(theta, solid.name), own)
        for name, unit in self.loads.per_unit.items():
            if name in full:
                full[name][: 3 * layout.n_points] -= unit.ravel()
        loss = friction_loss(self.cables, state.x, self._friction(theta), by_all=True)
        for i, cable in enumerate(self.cables.names):
            name = f"{cable}.friction_coefficient"
            if name in full:
                weights = np.where(self.cables.cable == i, state.tension[i] * loss.by_mu, 0.0)
                full[name] += self.cables.segment_gradient(state.x, weights, len(full[name]))
            name = f"{cable}.routing_offset"
            if name in full:
                own = np.where(self.cables.cable == i, state.tension[i], 0.0)
                rates = factor_rates(loss, self.cables.vectors_by_offset(state.x))
                full[name] += self.cables.gradient_by_offset(state.x, own * loss.factor, own * rates, len(full[name]))
        offsets = {f"{cable}.routing_offset": i for i, cable in enumerate(self.cables.names)}
        out = np.zeros((layout.n_unknowns, len(names)))
        for k, name in enumerate(names):
            out[: layout.first_tension_unknown, k] = self.motion.reduce_gradient(state, full[name])
            if name in offsets and (i := offsets[name]) in at.border.taut:
                out[layout.first_tension_unknown + i, k] = -self.shortening_by_offset(state)[i]
        for rod, blocks in zip(self.rods, self.rod_blocks, strict=True):
            wanted = {key: k for k, name in enumerate(names) if (key := name.removeprefix(f"{rod.name}.")) != name}
            if not wanted:
                continue
            by = rod.gradient_by_parameters(state.position, state.rotation, part_theta(theta, rod.name))
            for key in wanted.keys() & by.keys():
                blocks.add_gradient(out[:, wanted[key]], by[key])
        return out


def build_system(
    layout: Layout,
    solids: tuple[SolidTerm, ...],
    cables: CableTerm,
    loads: Loads,
    rods: tuple[RodTerm, ...] = (),
    contacts: tuple[ContactTerm, ...] = (),
) -> System:
    """Plan the pattern of all terms together."""
    connectivities = [solid.connectivity(layout.n_points) for solid in solids] + cables.connectivities()
    none = np.zeros((0, 2), dtype=np.int64)
    pairs = np.concatenate([none, *(moving_pairs(layout, rod.frames) for rod in rods)])
    pattern = build_pattern(layout, connectivities, pairs)
    volume = sum(float(solid.w.sum()) for solid in solids)
    volume += sum(float(rod.length.sum()) * rod.section.area for rod in rods)
    extent = float(np.linalg.norm(np.ptp(layout.X, axis=0)))
    return System(
        layout=layout,
        pattern=pattern,
        motion=build_motion(layout, pattern),
        solids=solids,
        solid_places=tuple(solid.places(pattern, layout.n_points) for solid in solids),
        rods=rods,
        rod_blocks=tuple(frame_blocks(layout, pattern, rod.frames) for rod in rods),
        cables=cables,
        cable_places=cables.places(pattern),
        loads=loads,
        contacts=contacts,
        stiffness_length=volume / extent**2,
    )


Of = TypeVar("Of")


def part_theta(theta: Mapping[str, Of], name: str) -> dict[str, Of]:
    """What belongs to one body or rod, without its name in front."""
    prefix = f"{name}."
    return {key.removeprefix(prefix): value for key, value in theta.items() if key.startswith(prefix)}
