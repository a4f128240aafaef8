"""Obstacles of space, by the distance of points from them, negative inside, and by the deepest point of a triangle.

They are convex, and so is the distance d of a convex body, with |d(p) - d(q)| <= |p - q|. Its least value on a line
across a triangle is where its slope changes its sign, and is convex from line to line: nested sections end at the
deepest point. There d d / d corner_i = w_i n, with the point's shares w of the corners and n = grad d: that the point
moves along the triangle counts in second order only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from softcal.arrays import Position, UnitVector
from softcal.checks import Floats, Ints
from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.geometry.ring import across
from softcal.quantities import Size

CUTS = np.arange(1, 9) / 9.0  # of what is left of a triangle in each round; the best one and its neighbours stay
ROUNDS, HALVINGS = 9, 20  # across it and along: 1e-6 of it


class Obstacle(Declared, ABC):
    """A convex body of space that a robot does not enter."""

    @abstractmethod
    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        """Distances (n,) [m] of points (n, 3) from it, negative inside, and their gradients (n, 3)."""

    @abstractmethod
    def drawn(self, around: Floats, extent: float) -> tuple[Floats, Ints]:
        """Points (n, 3) [m] and triangles (k, 3) of its surface, for a picture around a point (3,) [m].

        Parameters
        ----------
        around
            The point (3,) [m].
        extent
            Of what is in the picture [m]: that of what has no end itself.
        """

    def deepest(self, corners: Floats) -> Floats:
        """Shares (k, 3) of the corners (k, 3, 3) [m] of triangles at the place of each that is deepest in it."""
        k = len(corners)
        origin, aside, along = corners[:, :1], corners[:, 1:2] - corners[:, :1], corners[:, 2:] - corners[:, :1]
        begin, width = np.zeros(k), np.ones(k)
        u = v = np.zeros((k, 1))
        best: Ints = np.zeros(k, dtype=np.int64)
        for _ in range(ROUNDS):
            u = begin[:, None] + width[:, None] * CUTS
            low, high = np.zeros_like(u), 1.0 - u
            for _ in range(HALVINGS):
                v = 0.5 * (low + high)
                points = origin + u[:, :, None] * aside + v[:, :, None] * along
                slope = np.sum(self.distances(points.reshape(-1, 3))[1].reshape(points.shape) * along, axis=2)
                low, high = np.where(slope < 0.0, v, low), np.where(slope < 0.0, high, v)
            points = origin + u[:, :, None] * aside + v[:, :, None] * along
            best = self.distances(points.reshape(-1, 3))[0].reshape(u.shape).argmin(axis=1)
            begin, width = begin + width * best / 9.0, width * 2.0 / 9.0
        u, v = (each[np.arange(k), best] for each in (u, v))
        return np.stack([1.0 - u - v, u, v], axis=1)


@displayed
@dataclass(frozen=True)
class HalfSpace(Obstacle):
    """The half-space behind a plane.

    Attributes
    ----------
    point
        A point (3,) of the plane [m].
    normal
        Its direction (3,) to the free side.
    """

    point: Position
    normal: UnitVector

    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        return (points - self.point) @ self.normal, np.broadcast_to(self.normal, points.shape)

    def deepest(self, corners: Floats) -> Floats:
        return np.eye(3)[((corners - self.point) @ self.normal).argmin(axis=1)]

    def drawn(self, around: Floats, extent: float) -> tuple[Floats, Ints]:
        a: Floats = 0.7 * extent * across(self.normal)
        b: Floats = np.asarray(np.cross(self.normal, a), dtype=np.float64)
        middle = around - ((around - self.point) @ self.normal) * self.normal
        return middle + np.array([a + b, b - a, -a - b, a - b]), np.array([(0, 1, 2), (0, 2, 3)])


@displayed
@dataclass(frozen=True)
class SphereObstacle(Obstacle):
    """A ball: centre (3,) and radius [m]."""

    centre: Position
    radius: Size

    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        away = points - self.centre
        length = np.linalg.norm(away, axis=1)
        return length - self.radius, away / np.maximum(length, 1e-300)[:, None]

    def drawn(self, around: Floats, extent: float) -> tuple[Floats, Ints]:
        n, m = 24, 12
        around, up = np.meshgrid(2.0 * np.pi * np.arange(n) / n, np.pi * np.arange(m + 1) / m)
        rings = np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)], axis=2)
        i, j = (k.ravel() for k in np.meshgrid(np.arange(m), np.arange(n), indexing="ij"))
        a, b, c, d = n * i + j, n * i + (j + 1) % n, n * (i + 1) + j, n * (i + 1) + (j + 1) % n
        return self.centre + self.radius * rings.reshape(-1, 3), np.concatenate([np.c_[a, c, d], np.c_[a, d, b]])


@displayed
@dataclass(frozen=True)
class BoxObstacle(Obstacle):
    """A box along the axes, between two corners (3,) [m]."""

    lower: Position
    upper: Position

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.all(self.lower < self.upper):
            got = f"{self.lower.tolist()} to {self.upper.tolist()} m"
            raise InputError(Fault("a box is turned inside out, or flat", got=got, allowed="lower < upper"))

    def distances(self, points: Floats) -> tuple[Floats, Floats]:
        away = points - 0.5 * (self.lower + self.upper)
        over = np.abs(away) - 0.5 * (self.upper - self.lower)
        side, out = np.where(away < 0.0, -1.0, 1.0), np.maximum(over, 0.0)
        length = np.linalg.norm(out, axis=1)
        inside = np.eye(3)[np.argmax(over, axis=1)]  # the nearest face
        normals = np.where(length[:, None] > 0.0, out / np.maximum(length, 1e-300)[:, None], inside)
        return length + np.minimum(over.max(axis=1), 0.0), side * normals

    def drawn(self, around: Floats, extent: float) -> tuple[Floats, Ints]:
        shares = np.array([(i & 1, i >> 1 & 1, i >> 2) for i in range(8)])
        faces = [(0, 3, 1), (0, 2, 3), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 7, 3), (2, 6, 7), (0, 6, 2),
                 (0, 4, 6), (1, 3, 7), (1, 7, 5)]  # fmt: skip
        return self.lower + shares * (self.upper - self.lower), np.array(faces)
