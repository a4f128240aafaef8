"""Three-dimensional scenes as plain data: coloured surfaces, tubes, balls, arrows, and parallel projections."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.geometry.ring import across


@dataclass(frozen=True)
class Surface:
    """Triangles (k, 3) over points (n, 3) [m]; colours (n, 3) per point or (k, 3) per triangle, RGB from 0 to 1."""

    points: Floats
    triangles: Ints
    colours: Floats
    opacity: float = 1.0
    edges: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, name="surface points", shape=(None, 3)))
        object.__setattr__(self, "triangles", frozen_ints(self.triangles, name="triangles", shape=(None, 3)))
        object.__setattr__(self, "colours", frozen_floats(self.colours, name="colours", shape=(None, 3)))

    @property
    def per_point(self) -> bool:
        """Whether the colours belong to points rather than triangles."""
        return len(self.colours) == len(self.points)


@dataclass(frozen=True)
class Tube:
    """A polyline (k, 3) [m] drawn with a radius [m]."""

    path: Floats
    radius: float
    colour: str


@dataclass(frozen=True)
class Ball:
    """A point (3,) [m] drawn with a radius [m]."""

    at: Floats
    radius: float
    colour: str


@dataclass(frozen=True)
class Arrow:
    """An arrow from `tail` to `tip` (3,) [m]."""

    tail: Floats
    tip: Floats
    radius: float
    colour: str


Part = Surface | Tube | Ball | Arrow


@dataclass(frozen=True)
class Label:
    """Label of a part; at: candidate anchors (n, 3) [m] of the label's line, the clearest one is used."""

    text: str
    at: Floats


@dataclass(frozen=True)
class Scene:
    """One picture: parts and labels."""

    title: str
    parts: tuple[Part, ...]
    labels: tuple[Label, ...] = ()


@dataclass(frozen=True)
class Projection:
    """A parallel projection: orthonormal `right` and `up` in the picture, `back` towards the viewer.

    window: (left, right, bottom, top) [m] in the picture's plane, measured from the frame's origin.
    """

    right: Floats
    up: Floats
    back: Floats
    window: tuple[float, float, float, float]

    def project(self, points: Floats) -> Floats:
        """Picture coordinates and depth (towards the viewer) of points, shape (n, 3) [m]."""
        return np.asarray(points, dtype=np.float64) @ np.stack([self.right, self.up, self.back], axis=1)


def length_scale(points: Floats) -> float:
    """The diagonal of the bounding box [m]."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def refined(path: Floats) -> Floats:
    """A polyline (k, 3) with each segment divided into 32."""
    share = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate([*(a + share * (b - a) for a, b in pairwise(path)), path[-1:]])


def bending_camera(points: Floats, up: Floats, towards: Floats) -> Projection:
    """A projection with `up` [-] upright and `towards` [-] to the right, slightly from the side and above.

    points (n, 3) [m]: all that must fit into the picture.
    """
    up = up / np.linalg.norm(up)
    right = towards - (towards @ up) * up
    if np.linalg.norm(right) < 1e-9:
        right = across(up)
    right /= np.linalg.norm(right)
    back: Floats = np.asarray(np.cross(right, up), dtype=np.float64)
    back = _turned(back, up, 0.40)
    back = back * np.cos(0.28) + up * np.sin(0.28)
    right = np.asarray(np.cross(up, back), dtype=np.float64)
    right /= np.linalg.norm(right)
    frame_up: Floats = np.asarray(np.cross(back, right), dtype=np.float64)
    return fitted(Projection(right, frame_up, back, (0.0, 1.0, 0.0, 1.0)), points)


def fitted(camera: Projection, points: Floats) -> Projection:
    """The same view with a window that contains all points and a margin."""
    flat = camera.project(points)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    margin = np.array([0.13, 0.05]) * float(np.max(high - low))
    (left, bottom), (right, top) = low - margin, high + margin
    return Projection(camera.right, camera.up, camera.back, (float(left), float(right), float(bottom), float(top)))


def alike(cameras: tuple[Projection, ...]) -> tuple[Projection, ...]:
    """The same views with windows of equal size, so that pictures side by side have one scale."""
    windows = np.array([camera.window for camera in cameras])
    middles = 0.5 * (windows[:, 0::2] + windows[:, 1::2])
    half = 0.5 * (windows[:, 1::2] - windows[:, 0::2]).max(axis=0)
    return tuple(
        Projection(camera.right, camera.up, camera.back, (x - half[0], x + half[0], y - half[1], y + half[1]))
        for camera, (x, y) in zip(cameras, middles.tolist(), strict=True)
    )


def _turned(vector: Floats, axis: Floats, angle: float) -> Floats:
    return (
        vector * np.cos(angle) + np.cross(axis, vector) * np.sin(angle) + axis * (axis @ vector) * (1 - np.cos(angle))
    )


def extent_points(scenes: tuple[Scene, ...]) -> Floats:
    """All points (n, 3) [m] of the scenes."""
    found: list[Floats] = []
    for scene in scenes:
        for part in scene.parts:
            if isinstance(part, Surface):
                found.append(part.points[np.unique(part.triangles)])
            elif isinstance(part, Tube):
                found.append(part.path)
            elif isinstance(part, Ball):
                found.append(part.at[None])
            else:
                found.append(np.stack([part.tail, part.tip]))
    return np.concatenate(found)
