"""The clearance between a robot's surface and obstacles, with its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints, ReadOnly
from softcal.display import displayed
from softcal.geometry.mesh import TetMesh
from softcal.geometry.obstacle import Obstacle
from softcal.mechanics.state import State, rest_state
from softcal.mechanics.system import System
from softcal.twin.contacts import disc_skin
from softcal.twin.cores import body_skin
from softcal.twin.robot import Robot

NEAR = 0.3  # of the robot's extent: points further from an obstacle are left out, but for the nearest
BESIDE = 0.1  # of a triangle's size: nearer ones count as touching
NO_TRIANGLES: Ints = np.zeros((0, 3), dtype=np.int64)


@displayed
@dataclass(frozen=True)
class Clearances(ReadOnly):
    """Distances of the points of a robot's surface that are near obstacles, at one state.

    Attributes
    ----------
    obstacles, parts
        The obstacle, and the part of the robot, of each point (n,).
    points
        The points (n, 3) [m].
    values
        Their distances from the obstacle (n,) [m], negative inside.
    corners, shares, normals
        Numbers (n, 3) of the vertices of the surface between which each point is, its shares (n, 3) of these, and the
        gradient of its distance (n, 3).
    """

    obstacles: tuple[str, ...]
    parts: tuple[str, ...]
    points: Floats
    values: Floats
    corners: Ints
    shares: Floats
    normals: Floats

    def nearest(self, obstacle: str) -> int:
        """The number of the point that is nearest to an obstacle, or deepest in it."""
        own = np.array([one == obstacle for one in self.obstacles])
        return int(np.argmin(np.where(own, self.values, np.inf)))


@dataclass(frozen=True)
class RobotSurface:
    """The moving surface of a robot: the skins of its bodies, its rods as tubes, and the discs of its plates.

    Attributes
    ----------
    system
        The robot's equations.
    points, weights
        The layout's points of which the first vertices are weighted sums (k,), and the weights: sparse (n, k).
    frames, arms
        The frames that carry the other vertices (m,), and these from there at rest (m, 3) [m].
    triangles
        By their vertices (t, 3); those of a rod have two that are equal.
    radius
        By which the surface is further out than each vertex (n + m,) [m].
    names, owner
        The parts, and the number of that of each vertex (n + m,).
    """

    system: System
    points: Ints
    weights: Any
    frames: Ints
    arms: Floats
    triangles: Ints
    radius: Floats
    names: tuple[str, ...]
    owner: Ints

    def at(self, state: State) -> Floats:
        """The vertices (n + m, 3) [m] at a state."""
        turned = np.einsum("nij,nj->ni", state.rotation[self.frames], self.arms)
        return np.concatenate([self.weights @ state.x[self.points], state.position[self.frames] + turned])

    def rates(self, state: State, dz: Floats) -> Floats:
        """Rates of the vertices (n + m, 3, k) by rates dz (n_unknowns, k) of the unknowns."""
        layout, k = self.system.layout, dz.shape[1]
        moves = self.system.motion.matrix(state) @ dz[: layout.first_effort_unknown]
        moves = moves[: 3 * layout.n_points].reshape(-1, 3 * k)[self.points]
        frames = np.zeros((layout.n_frames, 6, k))
        moving = dz[layout.first_frame_unknown : layout.first_pressure_unknown]
        frames[: layout.n_moving_frames] = moving.reshape(-1, 6, k)
        turned = np.einsum("nij,nj->ni", state.rotation[self.frames], self.arms)
        own = frames[self.frames]
        carried: Floats = own[:, :3] + np.asarray(np.cross(own[:, 3:], turned[:, :, None], axis=1), dtype=np.float64)
        return np.concatenate([(self.weights @ moves).reshape(-1, 3, k), carried])

    def clearances(self, state: State, obstacles: Mapping[str, Obstacle], extent: float) -> Clearances:
        """The distances of the surface: of every vertex, and of the deepest point of each triangle that may touch an
        obstacle, or be nearer to it than any vertex.

        Parameters
        ----------
        state
            The state.
        obstacles
            The obstacles by name.
        extent
            Extent of the robot [m].
        """
        x = self.at(state)
        own = np.unique(self.triangles)
        middle = x[self.triangles].mean(axis=1)
        size = np.linalg.norm(x[self.triangles] - middle[:, None], axis=2).max(axis=1)
        thick = self.radius[self.triangles].max(axis=1)
        corners, shares, of = [NO_TRIANGLES], [np.zeros((0, 3))], list[str]()
        for name, obstacle in obstacles.items():
            distance = obstacle.distances(x[own])[0] - self.radius[own]
            least = obstacle.distances(middle)[0] - size - thick
            close = self.triangles[least < np.maximum(BESIDE * size, distance.min())]
            near = own[distance <= max(NEAR * extent, distance.min())]
            corners += [np.repeat(near[:, None], 3, axis=1), close]
            shares += [np.tile([1.0, 0.0, 0.0], (len(near), 1)), obstacle.deepest(x[close])]
            of += [name] * (len(near) + len(close))
        among, share = np.concatenate(corners), np.concatenate(shares)
        points, radius = (np.einsum("nk,nk...->n...", share, each[among]) for each in (x, self.radius))
        values, normals = np.zeros(len(of)), np.zeros((len(of), 3))
        for name, obstacle in obstacles.items():
            rows = np.flatnonzero([one == name for one in of])
            values[rows], normals[rows] = obstacle.distances(points[rows])
        parts = tuple(self.names[k] for k in self.owner[among[:, 0]].tolist())
        return Clearances(tuple(of), parts, points, values - radius, among, share, normals)


def build_surface(
    robot: Robot, system: System, meshes: Mapping[str, TetMesh], first: Mapping[str, int], frame: Mapping[str, int]
) -> RobotSurface:
    """The surface of a robot without the triangles that are fixed in space.

    Parameters
    ----------
    robot
        The robot.
    system
        Its equations.
    meshes
        Body -> the mesh of its elements [m].
    first
        Body or rod -> the number of its first point.
    frame
        Plate -> the number of its frame.
    """
    import scipy.sparse as sp

    n_points = system.layout.n_points
    blocks: list[Any] = [sp.csr_matrix((0, n_points))]
    triangles, radius, owner, names = [NO_TRIANGLES], [np.zeros(0)], [np.zeros(0, dtype=np.int64)], list[str]()

    def add(name: str, faces: Ints, radii: Floats) -> None:
        """Add a part, whose vertices follow those of the previous parts."""
        triangles.append(sum(map(len, radius)) + faces)
        radius.append(radii)
        owner.append(np.full(len(radii), len(names)))
        names.append(name)

    for body, mesh in meshes.items():
        skin = body_skin(mesh)
        entries = skin.weights.data, skin.weights.indices + first[body], skin.weights.indptr
        blocks.append(sp.csr_matrix(entries, (len(skin.X), n_points)))
        add(body, skin.triangles, np.zeros(len(skin.X)))
    for rod in robot.rods:
        i, stations = np.arange(len(rod.centreline.nodes)), rod.centreline.stations
        blocks.append(sp.csr_matrix((np.ones(len(i)), (i, first[rod.name] + i)), (len(i), n_points)))
        radii = [0.5 * rod.section.at(share).outer_diameter for share in (stations / stations[-1]).tolist()]
        add(rod.name, np.stack([i[:-1], i[1:], i[1:]], axis=1), np.array(radii))
    weights: Any = sp.vstack(blocks, format="csr")
    frames, arms = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))]
    for plate in robot.plates:
        if plate.disc is not None:
            skin, faces = disc_skin(plate.disc)
            frames.append(np.full(len(skin), frame[plate.name]))
            arms.append(skin - plate.reference)
            add(plate.name, faces, np.zeros(len(skin)))
    points, carried = np.unique(weights.indices).astype(np.int64), np.concatenate(frames)
    followed = np.diff(system.motion.matrix(rest_state(system.layout)).indptr)[: 3 * n_points]
    followed = followed.reshape(-1, 3).sum(axis=1) > 0
    moves = np.concatenate([weights @ followed > 0.0, carried < system.layout.n_moving_frames])
    every = np.concatenate(triangles)
    return RobotSurface(
        system=system,
        points=points,
        weights=weights[:, points],
        frames=carried,
        arms=np.concatenate(arms),
        triangles=every[moves[every].any(axis=1)],
        radius=np.concatenate(radius),
        names=tuple(names),
        owner=np.concatenate(owner),
    )
