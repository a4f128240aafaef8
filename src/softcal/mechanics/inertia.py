"""Mass: of bodies between the points of their mesh, of plates and rods on their frames.

    T = 1/2 sum over points a, b of M_ab v_a . v_b  +  1/2 sum over frames and their particles of m |c' + R' s|^2

The mass on a frame enters by its moments: mass sum m, first sum m s and second sum m s s^T, with arms s from the
reference point in the axes at rest. They determine the whole inertia of a rigid body: with S the last, its tensor is J
= tr(S) I - S. Points that follow frames, or are tied, add their mass to their masters as P^T M P.

The acceleration of a particle on a frame is A + B s with A = c'' and B = R'', so that gyroscopic moments are in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.frame_blocks import UNPLANNED, FrameBlocks, frame_blocks
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.state import State

N_GAUSS = 4  # per direction: exact for the mass of a quadratic tet with straight edges, and nearly so for a bent one
CHUNK = 2000  # tets at a time


class FrameMasses(NamedTuple):
    """Moments of the mass on frames.

    Attributes
    ----------
    mass
        Sum of m (n_frames,) [kg].
    first
        Sum of m s (n_frames, 3) [kg m].
    second
        Sum of m s s^T (n_frames, 3, 3) [kg m^2].
    """

    mass: Floats
    first: Floats
    second: Floats

    def add(self, frames: Ints, mass: Floats, arm: Floats, tensor: Floats) -> None:
        """Add rigid bodies to frames.

        Parameters
        ----------
        frames
            Frame of each body (n,).
        mass
            Their masses (n,) [kg].
        arm
            Their centres less the frames' references at rest (n, 3) [m].
        tensor
            Their second moments about the centres (n, 3, 3) [kg m^2].
        """
        np.add.at(self.mass, frames, mass)
        np.add.at(self.first, frames, mass[:, None] * arm)
        np.add.at(self.second, frames, tensor + mass[:, None, None] * arm[:, :, None] * arm[:, None, :])


class Rates(NamedTuple):
    """Velocities, or accelerations.

    Attributes
    ----------
    points
        Of points (n_points, 3) [m/s, or m/s^2].
    frames
        Of frames (n_frames, 3) [m/s, or m/s^2].
    turning
        R' or R'' of the frames (n_frames, 3, 3) [1/s, or 1/s^2].
    """

    points: Floats
    frames: Floats
    turning: Floats


class InertialForces(NamedTuple):
    """Mass times accelerations.

    Attributes
    ----------
    full
        Forces on all entities (3 n_points + n_pressures,) [N].
    on_frames
        Force [N] and moment [N m] on each moving frame (n_moving_frames, 6).
    """

    full: Floats
    on_frames: Floats


class Momentum(NamedTuple):
    """Momentum and energy of the motion.

    Attributes
    ----------
    linear
        Linear momentum (3,) [kg m/s].
    angular
        Angular momentum about the origin (3,) [kg m^2/s].
    kinetic_energy
        Kinetic energy [J].
    """

    linear: Floats
    angular: Floats
    kinetic_energy: float


@dataclass(frozen=True)
class Inertia:
    """The mass of a robot.

    Attributes
    ----------
    layout
        The layout of its points and frames.
    matrix
        M, sparse (n_points, n_points) [kg], the same for each direction.
    carried
        Moments of the mass on the frames.
    data
        M where the tangent's pattern has it, in its long array [kg].
    blocks
        Where the moving frames' own entries go.
    """

    layout: Layout
    matrix: Any
    carried: FrameMasses
    data: Floats
    blocks: FrameBlocks

    def planned(self, pattern: Pattern) -> Inertia:
        """The inertia with its places in a pattern that contains the mass matrix's connectivity."""
        upper = self.pairs
        data = np.zeros(pattern.size)
        if upper.nnz:
            start = pattern.pair(upper.row.astype(np.int64), upper.col.astype(np.int64))
            for i in range(3):
                np.add.at(data, start[:, i] + i, upper.data)
        moving = np.arange(self.layout.n_moving_frames)[:, None]
        return replace(self, data=data, blocks=frame_blocks(self.layout, pattern, moving))

    @property
    def pairs(self) -> Any:
        """The mass matrix's upper triangle, sparse."""
        import scipy.sparse as sp

        return sp.triu(self.matrix, format="coo")

    @property
    def is_none(self) -> bool:
        """Whether nothing that moves has mass."""
        return not self.data.any() and not self.carried.mass[: self.layout.n_moving_frames].any()

    def forces(self, rotation: Floats, accelerations: Rates) -> InertialForces:
        """Mass times accelerations, with frames turned by rotation (n_frames, 3, 3)."""
        n = self.layout.n_moving_frames
        full = np.concatenate([(self.matrix @ accelerations.points).ravel(), np.zeros(self.layout.n_pressures)])
        mass, first, _ = (array[:n] for array in self.carried)
        A, B = accelerations.frames[:n], accelerations.turning[:n]
        force = mass[:, None] * A + _times(B, first)
        return InertialForces(full, np.concatenate([force, axial(self._turned(rotation, A, B))], axis=1))

    def tangent(self, rotation: Floats, accelerations: Rates, rate: float) -> Floats:
        """Derivative (n, 6, 6) of the moving frames' forces by their increments: the second derivative of the forces'
        potential, for accelerations that are functions of positions and rotations.

        Parameters
        ----------
        rotation
            Rotation matrices of the frames (n_frames, 3, 3).
        accelerations
            Accelerations [m/s^2; 1/s^2].
        rate
            Change of the accelerations over that of positions and rotations [1/s^2].
        """
        n = self.layout.n_moving_frames
        mass, first, second = (array[:n] for array in self.carried)
        R = rotation[:n]
        G = self._turned(rotation, accelerations.frames[:n], accelerations.turning[:n])
        S = R @ second @ np.swapaxes(R, 1, 2)
        one = np.eye(3)
        out = np.zeros((n, 6, 6))
        out[:, :3, :3] = rate * mass[:, None, None] * one
        spin = np.cross(_times(R, first)[:, None, :], one)  # w x (R d) = spin w
        out[:, :3, 3:] = rate * spin
        out[:, 3:, :3] = rate * np.swapaxes(spin, 1, 2)
        inertia = np.trace(S, axis1=1, axis2=2)[:, None, None] * one - S
        bend = 0.5 * (G + np.swapaxes(G, 1, 2)) - np.trace(G, axis1=1, axis2=2)[:, None, None] * one
        out[:, 3:, 3:] = rate * inertia + bend
        return out

    def momentum(self, state: State, velocities: Rates) -> Momentum:
        """Linear and angular momentum, and kinetic energy."""
        p = self.matrix @ velocities.points
        mass, first, second = self.carried
        frames, turning = velocities.frames, velocities.turning
        of_frames = mass[:, None] * frames + _times(turning, first)
        linear = p.sum(axis=0) + of_frames.sum(axis=0)
        G = _outer(_times(state.rotation, first), frames) + state.rotation @ second @ np.swapaxes(turning, 1, 2)
        angular = np.cross(state.x, p).sum(axis=0) + (np.cross(state.position, of_frames) + axial(G)).sum(axis=0)
        twice = np.sum(p * velocities.points) + np.sum(frames * (of_frames + _times(turning, first)))
        twice += np.sum(turning * (turning @ second))
        return Momentum(linear, angular, 0.5 * float(twice))

    def _turned(self, rotation: Floats, A: Floats, B: Floats) -> Floats:
        """sum m (R s) (A + B s)^T of the moving frames (n, 3, 3)."""
        n = len(A)
        _, first, second = (array[:n] for array in self.carried)
        return rotation[:n] @ (_outer(first, A) + second @ np.swapaxes(B, 1, 2))


def build_inertia(
    layout: Layout, pattern: Pattern, elements: Sequence[tuple[Ints, Floats]], carried: FrameMasses
) -> Inertia:
    """The inertia of elements and frames.

    Elements that cannot deform move on a frame, or not at all, and are left out here: see `ride_along`.

    Parameters
    ----------
    layout
        Numbering of points, frames and unknowns.
    pattern
        Sparsity of the tangent.
    elements
        Points (n, k) and mass matrices (n, k, k) [kg] of elements of one kind each.
    carried
        Masses on frames.
    """
    import scipy.sparse as sp

    n = layout.n_points
    empty = np.zeros(0, dtype=np.int64)
    rows = np.concatenate([empty, *(np.repeat(conn, conn.shape[1], axis=1).ravel() for conn, _ in elements)])
    columns = np.concatenate([empty, *(np.tile(conn, (1, conn.shape[1])).ravel() for conn, _ in elements)])
    values = np.concatenate([np.zeros(0), *(masses.ravel() for _, masses in elements)])
    filled = values != 0.0
    matrix = sp.csr_matrix((values[filled], (rows[filled], columns[filled])), shape=(n, n))
    return Inertia(layout, matrix, carried, np.zeros(0), UNPLANNED).planned(pattern)


def no_frame_masses(layout: Layout) -> FrameMasses:
    """Frames without mass, to add to."""
    n = layout.n_frames
    return FrameMasses(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)))


def ride_along(carried: FrameMasses, layout: Layout, points: Ints, masses: Floats) -> None:
    """Add the mass of elements whose nodes all follow one frame to that frame.

    Parameters
    ----------
    carried
        Masses on frames, changed.
    layout
        Numbering of points, frames and unknowns.
    points
        Points of the elements (n, k).
    masses
        Their mass matrices (n, k, k) [kg].
    """
    frames = layout.rider[points[:, 0]]
    arms = layout.X[points] - layout.references[frames][:, None, :]
    of_nodes = masses.sum(axis=2)
    np.add.at(carried.mass, frames, of_nodes.sum(axis=1))
    np.add.at(carried.first, frames, np.einsum("ea,eai->ei", of_nodes, arms))
    np.add.at(carried.second, frames, np.einsum("eab,eai,ebj->eij", masses, arms, arms))


def second_moments(tensor: Floats) -> Floats:
    """sum m s s^T (3, 3) of an inertia tensor J = sum m (s.s I - s s^T)."""
    return 0.5 * float(np.trace(tensor)) * np.eye(3) - tensor


def element_masses(mesh: TetMesh, *, lumped: bool = False) -> Floats:
    """Integrals of N_a N_b over each tet (n_tets, k, k) [m^3], to be multiplied by its density.

    Lumped, the diagonal of that matrix scaled to the tet's volume: Hinton, Rock and Zienkiewicz (1976); for linear tets
    a quarter of it on each node.
    """
    points, weights = _gauss()
    N = mesh.cell.functions(points)
    dN_dL = mesh.cell.gradients(points)
    dN_dxi = dN_dL[:, :, 1:] - dN_dL[:, :, :1]
    products = (N[:, :, None] * N[:, None, :]).reshape(len(points), -1)
    k = mesh.tets.shape[1]
    out = np.empty((mesh.n_tets, k, k))
    for first in range(0, mesh.n_tets, CHUNK):
        X = mesh.points[mesh.tets[first : first + CHUNK]]
        det = np.linalg.det(np.einsum("eai,qak->eqik", X, dN_dxi))
        out[first : first + CHUNK] = (det * weights @ products).reshape(-1, k, k)
    if not lumped:
        return out
    diagonal = np.einsum("eaa->ea", out)
    scaled = diagonal * (out.sum(axis=(1, 2)) / diagonal.sum(axis=1))[:, None]
    return scaled[:, :, None] * np.eye(k)


def axial(G: Floats) -> Floats:
    """sum of a x b (n, 3) for G = sum of a b^T (n, 3, 3)."""
    return np.stack([G[:, 1, 2] - G[:, 2, 1], G[:, 2, 0] - G[:, 0, 2], G[:, 0, 1] - G[:, 1, 0]], axis=1)


def _gauss() -> tuple[Floats, Floats]:
    """Barycentric points (n, 4) and weights (n,), sum 1/6: Gauss's rule on the cube, collapsed to the tetrahedron."""
    t, w = np.polynomial.legendre.leggauss(N_GAUSS)
    t, w = 0.5 * (t + 1.0), 0.5 * w
    a, b, c = (grid.ravel() for grid in np.meshgrid(t, t, t, indexing="ij"))
    wa, wb, wc = (grid.ravel() for grid in np.meshgrid(w, w, w, indexing="ij"))
    xi, eta, zeta = a, b * (1.0 - a), c * (1.0 - a) * (1.0 - b)
    points = np.stack([1.0 - xi - eta - zeta, xi, eta, zeta], axis=1)
    return points, wa * wb * wc * (1.0 - a) ** 2 * (1.0 - b)


def _outer(a: Floats, b: Floats) -> Floats:
    return a[:, :, None] * b[:, None, :]


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return np.einsum("nij,nj->ni", matrices, vectors)
