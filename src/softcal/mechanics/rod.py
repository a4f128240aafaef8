"""Geometrically exact rods (Simo-Reissner): two-node elements whose strains are constant along them.

An element's ends have the positions x_a, x_b and the triads Lambda_a, Lambda_b. What lies between is the helix that
screws the one into the other, so with (rho, theta) the screw's translation and rotation, in the axes of a,

    exp(theta) = Lambda_a^T Lambda_b,    rho = Jl^-1(theta) Lambda_a^T (x_b - x_a)

force and moment strains are rho/L and theta/L (Sonneville, Cardona and Bruels, 2014: a straight line in SE(3)), less
those at rest. They do not change in a rigid motion. The energy is

    E_el = 1/2 (xi - xi_0) . S (xi - xi_0),    xi = (rho, theta)

where S is no diag(kGA, kGA, EA, EI1, EI2, GJ) / L but the inverse of the flexibility of the whole element,

    S^-1 = Z int_0^L B(s)^T diag(1/kGA, 1/kGA, 1/EA, 1/EI1, 1/EI2, 1/GJ) B(s) ds Z^T

with B(s) what equilibrium makes of a wrench at the middle on the way along the rod at rest (MacNeal's residual bending
flexibility, and its counterpart for curved rods), and Z the step from the middle's twist to xi. In small displacements
from rest, straight rods and helices loaded at their nodes so are exact with one element; in large ones, those in pure
bending, stretching and twisting still are, and others converge with the square of the element's length or faster.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from softcal.checks import Floats, Ints
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline
from softcal.geometry.section import CrossSection, SectionConstants
from softcal.mechanics import rod_kernels
from softcal.mechanics.damping import TimeStep
from softcal.mechanics.frame_blocks import UNPLANNED, FrameBlocks, frame_blocks
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.scales import Sizes
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Given, Sum, Term, Theta, part_theta

LARGEST_TURN = 0.9 * np.pi  # [rad] between two neighbouring nodes
# Gauss points for an element's flexibility and terms of the exponential: enough for the last digits while an element
# turns by less than pi.
N_GAUSS = 8
N_SERIES = 28


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
    volume
        Of its elements at rest [m^3].
    frames
        Frames that each element's ends ride on (n, 2).
    arm, triad
        The ends less their frames' reference points (n, 2, 3) [m], and their sections' axes d1, d2, d3 in columns
        (n, 2, 3, 3), at rest.
    length, xi_rest
        Arc length (n,) [m], and (rho, theta) (n, 6) [m, rad], at rest.
    by_bending, by_shear
        The flexibility of the elements (n, 6, 6) is (by_bending + (1 + nu) by_shear) / E.
    """

    name: str
    volume: float
    frames: Ints
    arm: Floats
    triad: Floats
    length: Floats
    xi_rest: Floats
    by_bending: Floats
    by_shear: Floats
    blocks: FrameBlocks = UNPLANNED

    @property
    def parameters(self) -> tuple[str, ...]:
        return (f"{self.name}.youngs_modulus", f"{self.name}.poissons_ratio")

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
        pose, S = (given.state.position, given.state.rotation), self._stiffness(part_theta(given.theta, self.name))
        conjugate = _times(S, given.known[0] - self.xi_rest)
        if into.data is None:
            gradient = self._gradient(*pose, conjugate)
        else:
            gradient, tangent = self._derivatives(*pose, conjugate, S)
            self.blocks.add_tangent(into.data, tangent)
        self.blocks.add_gradient(into.own, gradient)
        into.squares += float(np.square(gradient[:, :3]).sum())

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        wanted, own = part_theta(into, self.name), part_theta(given.theta, self.name)
        by = self.gradient_by_parameters(given.state.position, given.state.rotation, own) if wanted else {}
        for name in wanted.keys() & by.keys():
            self.blocks.add_gradient(wanted[name].own, by[name])

    def energy(self, given: Given) -> float:
        deviation = given.known[0] - self.xi_rest
        return 0.5 * float(np.sum(_times(self._stiffness(part_theta(given.theta, self.name)), deviation) * deviation))

    def measure(self, sizes: Sizes, theta: Theta) -> None:
        own = part_theta(theta, self.name)
        sizes.shear_modulus = max(sizes.shear_modulus, 0.5 * own["youngs_modulus"] / (1.0 + own["poissons_ratio"]))
        sizes.volume += self.volume
        tangent = self.assemble(sizes.rest.position, sizes.rest.rotation, own).tangent
        self.blocks.add_gradient(sizes.stiffness, np.einsum("nii->ni", tangent))
        frames = np.unique(self.frames)
        sizes.frames.append(frames[frames < sizes.layout.n_moving_frames])

    def in_step(self, before: Given, step: TimeStep) -> Sequence[Term]:
        """Stiffness times 1 + r_s / h, about a strain between that at rest and that at the step's start."""
        if step.share == 0.0:
            return (self,)
        xi, _ = before.known
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
        S = self._stiffness(theta)
        deviation = self._coordinates(position, rotation)[0] - self.xi_rest
        conjugate = _times(S, deviation)
        energy = 0.5 * float(np.sum(conjugate * deviation))
        return RodForces(energy, *self._derivatives(position, rotation, conjugate, S))

    def gradient_by_parameters(
        self, position: Floats, rotation: Floats, theta: Mapping[str, float]
    ) -> dict[str, Floats]:
        """d gradient / d parameter (n, 12) of youngs_modulus and poissons_ratio."""
        E = theta["youngs_modulus"]
        S = self._stiffness(theta)
        xi, _ = self._coordinates(position, rotation)
        by_E = _times(S, xi - self.xi_rest) / E
        by_nu = -_times(S, _times(self.by_shear, by_E))
        return {
            "youngs_modulus": self._gradient(position, rotation, by_E),
            "poissons_ratio": self._gradient(position, rotation, by_nu),
        }

    def strains(self, position: Floats, rotation: Floats) -> Floats:
        """Strains in the middle of the elements (n, 6): stretch and shear [-], then curvature and twist [1/m]."""
        xi, _ = self._coordinates(position, rotation)
        return (xi - self.xi_rest) / self.length[:, None]

    def _stiffness(self, theta: Mapping[str, float]) -> Floats:
        S = np.empty_like(self.by_bending)
        E, nu = theta["youngs_modulus"], theta["poissons_ratio"]
        rod_kernels.stiffness(self.by_bending, self.by_shear, E, nu, S)
        return S

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
        raise MeshError(Fault("all of a rod rides on one frame", where=name, attempt="leave the rod out"))
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
    bending, shear, area = _flexibility(section, shares, xi, length)
    return RodTerm(
        name=name,
        volume=float(area @ length),
        frames=frame[ends],
        arm=nodes[ends] - references[frame[ends]],
        triad=triads[ends],
        length=length,
        xi_rest=xi,
        by_bending=bending,
        by_shear=shear,
    )


def _compliances(section: SectionConstants) -> tuple[Floats, Floats]:
    """E times the section's compliances (6,): what does not depend on Poisson's ratio, and what goes with 1 + nu."""
    (a1, b1), (a2, b2), A = section.shear1, section.shear2, section.area
    bending = np.array([a1 / A, a2 / A, 1.0 / A, 1.0 / section.I1, 1.0 / section.I2, 0.0])
    return bending, np.array([b1 / A, b2 / A, 0.0, 0.0, 0.0, 2.0 / section.J])


def _flexibility(section: CrossSection, shares: Floats, xi: Floats, length: Floats) -> tuple[Floats, Floats, Floats]:
    """E times the elements' flexibility: what does not depend on Poisson's ratio, and what goes with 1 + nu; and the
    elements' mean areas (n,) [m^2]. shares: of the rod's arc length, at both ends of each (n, 2).
    """
    X = _bracket(xi)
    parts, area = np.zeros((2, len(xi), 6, 6)), np.zeros(len(xi))
    for point, weight in zip(*np.polynomial.legendre.leggauss(N_GAUSS), strict=True):
        here = shares @ [0.5 - 0.5 * point, 0.5 + 0.5 * point]
        constants = [section.at(float(share)) for share in (here[:1] if section.is_uniform else here)]
        bending, shear = (np.array(both) for both in zip(*map(_compliances, constants), strict=True))
        area += 0.5 * weight * np.array([one.area for one in constants])
        B = np.swapaxes(_series(0.5 * point * X, [1.0 / math.factorial(k) for k in range(N_SERIES)]), 1, 2)
        for part, compliance in zip(parts, (bending, shear), strict=True):
            part += 0.5 * weight * np.swapaxes(B, 1, 2) @ (compliance[:, :, None] * B)
    Z = _middle_to_coordinates(xi)
    parts = length[:, None, None] * (Z @ parts @ np.swapaxes(Z, 1, 2))
    return parts[0], parts[1], area


def _middle_to_coordinates(xi: Floats) -> Floats:
    """Z (n, 6, 6) with d xi = Z (twist of b against a, seen from the middle's frame): the inverse of the mean of
    exp(t ad xi) over t from -1/2 to 1/2.
    """
    X = _bracket(xi)
    inverse = _series(X @ X, [0.25**k / math.factorial(2 * k + 1) for k in range(N_SERIES // 2)])
    return np.asarray(np.linalg.inv(inverse), dtype=np.float64)


def _bracket(xi: Floats) -> Floats:
    """ad xi (n, 6, 6) on twists (velocity, spin): (v, w) -> (theta x v + rho x w, theta x w)."""
    spin = np.cross(np.eye(3), xi.reshape(-1, 2, 1, 3))  # (n, 2, 3, 3): rows e_i x rho, that is [rho], and [theta]
    out = np.zeros((len(xi), 6, 6))
    out[:, :3, :3] = out[:, 3:, 3:] = spin[:, 1]
    out[:, :3, 3:] = spin[:, 0]
    return out


def _series(X: Floats, coefficients: Sequence[float]) -> Floats:
    """Sum of c_k X^k."""
    out = np.zeros_like(X)
    for c in reversed(coefficients):
        out = out @ X + c * np.eye(6)
    return out


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return np.einsum("nij,nj->ni", matrices, vectors)
