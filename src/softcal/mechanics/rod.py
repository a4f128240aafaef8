"""Geometrically exact rods (Simo-Reissner): two-node elements whose strains are constant along them.

An element's ends have the positions x_a, x_b and the triads Lambda_a, Lambda_b. What lies between is the helix that
screws the one into the other, so with (rho, theta) the screw's translation and rotation, in the axes of a,

    exp(theta) = Lambda_a^T Lambda_b,    rho = Jl^-1(theta) Lambda_a^T (x_b - x_a)

force and moment strains are rho/L and theta/L (Sonneville, Cardona and Bruels, 2014: a straight line in SE(3)), less
those at rest. They do not change in a rigid motion. The energy is

    E_el = 1/2 (xi - xi_0) . S (xi - xi_0),    xi = (rho, theta)

where S is no diag(kGA, kGA, EA, EI1, EI2, GJ) / L but the inverse of the flexibility of the whole element, that of what
lies between its ends (`rod_flexibility.py`). In small displacements
from rest, straight rods and helices loaded at their nodes so are exact with one element; in large ones, those in pure
bending, stretching and twisting still are, and others converge with the square of the element's length or faster.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline
from softcal.geometry.section import CrossSection
from softcal.materials.elastic_constants import LINEAR_ELASTIC
from softcal.materials.inelastic import ELASTIC, History
from softcal.mechanics import rod_kernels
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.frame_blocks import UNPLANNED, FrameBlocks, frame_blocks
from softcal.mechanics.layout import Layout
from softcal.mechanics.passed import Passed
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.rod_flexibility import flexibility
from softcal.mechanics.rod_law import RodLaw
from softcal.mechanics.scales import Sizes
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Given, Sum, Term, Theta, part_theta

LARGEST_TURN = 0.9 * np.pi  # [rad] between two neighbouring nodes
NEAR = 0.9  # of the stretch that an element bears
NOTICED = 0.3  # of it: one element alone then deflects 6 % too far across its tension, two 1 %


class RodForces(NamedTuple):
    """energy [J]; gradient (n, 12) by (dc_a, omega_a, dc_b, omega_b) of each element; tangent (n, 12, 12)."""

    energy: float
    gradient: Floats
    tangent: Floats


@dataclass(frozen=True)
class RodTerm(Term):
    """The n elements of a rod.

    Attributes
    ----------
    name
        What its parameters' names begin with.
    volumes
        Volumes of its elements at rest (n,) [m^3].
    frames
        Frames that each element's ends ride on (n, 2).
    arm, triad
        The ends less their frames' reference points (n, 2, 3) [m], and their sections' axes d1, d2, d3 in columns
        (n, 2, 3, 3), at rest.
    length, xi_rest
        Arc length (n,) [m], and (rho, theta) (n, 6) [m, rad], at rest.
    by_bending, by_shear
        The flexibility of the elements (n, 6, 6) is (by_bending + (1 + nu) by_shear) / E.
    history
        What the material does beyond its elasticity.
    """

    name: str
    volumes: Floats
    frames: Ints
    arm: Floats
    triad: Floats
    length: Floats
    xi_rest: Floats
    by_bending: Floats
    by_shear: Floats
    history: History = ELASTIC
    blocks: FrameBlocks = UNPLANNED

    @property
    def parameters(self) -> tuple[str, ...]:
        constants = (*LINEAR_ELASTIC, *self.history.parameters)
        return tuple(f"{self.name}.{one.name}" for one in constants)

    def connectivity(self, layout: Layout) -> Connectivity:
        """The frames of each element."""
        return Connectivity(frames=[self.frames])

    def plan(self, layout: Layout, pattern: Pattern) -> RodTerm:
        return replace(self, blocks=frame_blocks(layout, pattern, self.frames))

    def kinematics(self, state: State) -> tuple[Floats, Floats]:
        """(rho, theta) (n, 6) and the angle between the ends (n,) [rad] of each element."""
        return self._coordinates(state.position, state.rotation)

    def why_not(self, known: tuple[Floats, Floats]) -> str:
        turn = float(known[1].max())
        return "" if turn < LARGEST_TURN else f"a rod turns by {np.degrees(turn):.0f} deg between two nodes"

    def add(self, into: Sum, given: Given) -> None:
        pose = given.state.position, given.state.rotation
        conjugate, D = self._response(given, tangent=into.data is not None)
        if into.data is None:
            gradient = self._gradient(*pose, conjugate)
        else:
            gradient, tangent = self._derivatives(*pose, conjugate, D)
            self.blocks.add_tangent(into.data, tangent)
        self.blocks.add_gradient(into.own, gradient)
        into.squares += float(np.square(gradient[:, :3]).sum())

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        wanted = part_theta(into, self.name)
        if not wanted:
            return
        passed = self._passed(given)
        for parameter in self.parameters:
            name = parameter.removeprefix(f"{self.name}.")
            if name in wanted:
                elastic = None if self.history.parts else passed.law.by_constant(name)
                self._add_stress(wanted[name], given, elastic[1] if elastic else passed.rates(constant=name)[0])

    def energy(self, given: Given) -> float:
        passed = self._passed(given._replace(known=self.kinematics(given.state)))
        if not self.history.parts:
            return float(passed.law.energies.sum())
        return float(self.volumes @ passed.respond(tangent=False).at.W)

    # Of a material with a history, its memory in the elements.

    def first_memory(self) -> Floats:
        return np.zeros(len(self.volumes) * self.history.size)

    def advance(self, given: Given) -> Floats:
        if not self.history.parts:
            return given.memory
        return self._passed(given).respond(tangent=False).memory.ravel()

    def add_by_memory(self, into: Sum, given: Given, rate: Floats) -> None:
        """Add d gradient / d memory times a rate of the memory; nothing without a history."""
        if self.history.parts:
            self._add_stress(into, given, self._passed(given).rates(memory=rate)[0])

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        """The derivative of the memory in the elements that the state leaves, by a parameter."""
        if not self.history.parts:
            return memory_rate
        # Rates of (rho, theta) (n, 6) at rates of the frames.
        spin = rate.rotation @ np.swapaxes(given.state.rotation, 1, 2)
        turning = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        moves = np.concatenate([rate.position, turning], axis=1)[self.frames].reshape(-1, 12)
        strain = np.empty((len(moves), 6))
        for i, unit in enumerate(np.eye(6)):
            ways = self._gradient(given.state.position, given.state.rotation, np.tile(unit, (len(moves), 1)))
            strain[:, i] = (ways * moves).sum(axis=1)
        return self._passed(given).rates(strain, memory_rate, parameter.removeprefix(f"{self.name}."))[1]

    def measure(self, sizes: Sizes, theta: Theta) -> None:
        own = part_theta(theta, self.name)
        sizes.shear_modulus = max(sizes.shear_modulus, 0.5 * own["youngs_modulus"] / (1.0 + own["poissons_ratio"]))
        sizes.volume += float(self.volumes.sum())
        tangent = self.assemble(sizes.rest.position, sizes.rest.rotation, own).tangent
        self.blocks.add_gradient(sizes.stiffness, np.einsum("nii->ni", tangent))

    def why_unlike(self, state: State) -> str:
        """Where the tension is near that at which the sections of an element turn by themselves: N l^2 = 12 EI of a
        straight one, whose residual bending then gives way as a soft shear would.
        """
        stretch, bears = self._most_stretched(state)
        if stretch < NEAR * bears:
            return ""
        return (
            f"rod {self.name} is stretched by {100.0 * stretch:.3g} %, and one of its elements bears about "
            f"{100.0 * bears:.3g} %: it is too long for its tension, under which it then bends as no rod does; "
            "elements half as long bear four times as much"
        )

    def remark(self, state: State, theta: Theta) -> str:
        stretch, bears = self._most_stretched(state)
        if stretch < NOTICED * bears:
            return ""
        return (
            f" Rod {self.name} is stretched by {100.0 * stretch:.3g} %, of the {100.0 * bears:.3g} % that one of its "
            "elements bears: its deflections across the tension may be too large by some per cent. Elements half as "
            "long bear four times as much."
        )

    def _most_stretched(self, state: State) -> tuple[float, float]:
        """The stretch of the element that comes nearest to the stretch that it bears, and the latter [-]."""
        flexibility = np.einsum("nii->ni", self.by_bending + 4.0 / 3.0 * self.by_shear)
        stretch = self.strains(state.position, state.rotation)[:, 2]
        bears = flexibility[:, 2] / flexibility[:, :2].max(axis=1)
        at = int(np.argmax(stretch / bears))
        return float(stretch[at]), float(bears[at])

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """Stiffness times 1 + r_s / h, about a strain between that at rest and that at the step's start; where the
        material has a history, r_s / h of the stiffness about the latter, beside it.
        """
        if step.share == 0.0:
            return (self,)
        xi, _ = before.known
        if self.history.parts:
            flexibility = {"by_bending": self.by_bending / step.share, "by_shear": self.by_shear / step.share}
            return self, replace(self, xi_rest=xi, history=ELASTIC, **flexibility)
        damped = replace(
            self,
            xi_rest=(self.xi_rest + step.share * xi) / (1.0 + step.share),
            by_bending=self.by_bending / (1.0 + step.share),
            by_shear=self.by_shear / (1.0 + step.share),
        )
        return (damped,)

    def assemble(self, position: Floats, rotation: Floats, theta: Mapping[str, float]) -> RodForces:
        """Energy, gradient and tangent, by increments from these poses: position + dc and exp(omega) rotation.

        Parameters
        ----------
        position, rotation
            Of all frames of the robot (n_frames, 3) [m] and (n_frames, 3, 3).
        theta
            youngs_modulus [Pa] and poissons_ratio.
        """
        law = self._law(self._coordinates(position, rotation)[0], theta)
        return RodForces(float(law.energies.sum()), *self._derivatives(position, rotation, law.forces, law.S))

    def strains(self, position: Floats, rotation: Floats) -> Floats:
        """Strains in the middle of the elements (n, 6): stretch and shear [-], then curvature and twist [1/m]."""
        xi, _ = self._coordinates(position, rotation)
        return (xi - self.xi_rest) / self.length[:, None]

    def _law(self, xi: Floats, theta: Mapping[str, float]) -> RodLaw:
        E, nu = theta["youngs_modulus"], theta["poissons_ratio"]
        return RodLaw(self.by_bending, self.by_shear, self.volumes, E, nu, xi - self.xi_rest)

    def _passed(self, given: Given) -> Passed[RodLaw]:
        theta = part_theta(given.theta, self.name)
        law, constants = self._law(given.known[0], theta), self.history.constants(theta)
        return Passed(self.history, law, constants, given.memory, given.controls.elapsed)

    def _response(self, given: Given, *, tangent: bool) -> tuple[Floats, Floats]:
        """Forces and moments (n, 6), and their derivatives by the strains (n, 6, 6)."""
        if not self.history.parts:
            law = self._law(given.known[0], part_theta(given.theta, self.name))
            return law.forces, law.S
        at = self._passed(given).respond(tangent=tangent).at
        return self.volumes[:, None] * at.S, self.volumes[: len(at.D), None, None] * at.D

    def _add_stress(self, into: Sum, given: Given, by_volume: Floats) -> None:
        """Add the gradient of forces and moments, which are given by volume (n, 6)."""
        forces = self.volumes[:, None] * by_volume
        self.blocks.add_gradient(into.own, self._gradient(given.state.position, given.state.rotation, forces))

    def _coordinates(self, position: Floats, rotation: Floats) -> tuple[Floats, Floats]:
        xi, turn = np.empty((len(self.frames), 6)), np.empty(len(self.frames))
        rod_kernels.coordinates(position, rotation, self.frames, self.arm, self.triad, xi, turn)
        return xi, turn

    def _gradient(self, position: Floats, rotation: Floats, conjugate: Floats) -> Floats:
        gradient = np.empty((len(self.frames), 12))
        ends = (position, rotation, self.frames, self.arm, self.triad)
        rod_kernels.derivatives(*ends, conjugate, self.by_bending, False, gradient, np.empty((0, 12, 12)))
        return gradient

    def _derivatives(self, position: Floats, rotation: Floats, conjugate: Floats, S: Floats) -> tuple[Floats, Floats]:
        """Gradient and tangent."""
        n = len(self.frames)
        gradient, tangent = np.empty((n, 12)), np.empty((n, 12, 12))
        ends = (position, rotation, self.frames, self.arm, self.triad)
        rod_kernels.derivatives(*ends, conjugate, S, True, gradient, tangent)
        return gradient, tangent


def build_rod(
    name: str,
    section: CrossSection,
    centreline: Centreline,
    node_frames: ArrayLike,
    references: Floats,
    elements: Ints | None = None,
) -> RodTerm:
    """The term of a rod whose nodes ride on frames.

    Parameters
    ----------
    name
        What its parameters' names begin with.
    section
        The same all along, or varied.
    centreline
        The rod at rest; stress-free there.
    node_frames
        The frame that each node (m,) rides on: one of its own, or a disc's.
    references
        Rest positions of all frames' reference points (n_frames, 3) [m].
    elements
        Numbers of its elements (k,), from 0 at its start; all if None.

    Returns
    -------
    RodTerm
        Without the elements that have both ends on one frame, which cannot deform.

    Raises
    ------
    MeshError
        Where the numbers do not fit, no element is left, or the rod turns by more than a right angle from one node to
        the next.
    """
    frame = np.asarray(node_frames, dtype=np.int64)
    m = len(centreline.nodes)
    if frame.shape != (m,) or frame.min() < 0 or frame.max() >= len(references):
        raise MeshError(
            Fault(
                "the frames of a rod's nodes do not fit",
                where=name,
                got=f"{frame.size} numbers from {frame.min()} to {frame.max()}",
                allowed=f"one per node ({m}), from 0 to {len(references) - 1}",
            )
        )
    first = np.arange(m - 1) if elements is None else elements
    ends = np.stack([first, first + 1], axis=1)
    ends = ends[frame[ends[:, 0]] != frame[ends[:, 1]]]
    if len(ends) == 0:
        raise MeshError(Fault("all nodes of a rod are attached to one frame", where=name, attempt="leave the rod out"))
    nodes, triads = np.array(centreline.nodes), np.array(centreline.triads)
    xi, turn = np.empty((len(ends), 6)), np.empty(len(ends))
    still, no_arm = np.tile(np.eye(3), (m, 1, 1)), np.zeros((len(ends), 2, 3))
    rod_kernels.coordinates(nodes, still, ends, no_arm, triads[ends], xi, turn)
    if turn.max() > np.pi / 2 + 1e-9:
        at = int(np.argmax(turn))
        raise MeshError(
            Fault(
                "a rod turns too much from one node to the next",
                where=f"{name}, node {ends[at, 1]}",
                got=f"{np.degrees(turn[at]):.0f} deg",
                allowed="at most 90 deg",
                attempt="more elements",
            )
        )
    length = centreline.lengths[ends[:, 0]]
    shares = centreline.stations[ends] / centreline.stations[-1]
    bending, shear, area = flexibility(section, shares, xi, length)
    return RodTerm(
        name=name,
        volumes=area * length,
        frames=frame[ends],
        arm=nodes[ends] - references[frame[ends]],
        triad=triads[ends],
        length=length,
        xi_rest=xi,
        by_bending=bending,
        by_shear=shear,
    )
