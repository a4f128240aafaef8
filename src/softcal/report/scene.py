"""Three-dimensional scenes: parts that PyVista draws, labels, and parallel projections."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from softcal.checks import Floats, Ints, frozen_floats, frozen_ints
from softcal.geometry.ring import across, ring_points

SIDES = 20  # of a tube
SLIMMEST = 0.5  # width of a picture over its height: beside a thin robot there is room for names
RIM, HOLE = 96, 16  # points on the rim of a disc, and on that of a hole


@dataclass(frozen=True, kw_only=True)
class Part(ABC):
    """A shape. colour: a name, or RGB (n, 3) from 0 to 1 of each point or triangle; bulky: labels keep clear of it."""

    colour: str | Floats
    opacity: float = 1.0
    bulky: bool = False
    smooth: ClassVar[bool] = False  # shaded without facets

    @property
    @abstractmethod
    def extent(self) -> Floats:
        """Points (n, 3) [m] that must be in the picture."""

    @abstractmethod
    def mesh(self) -> Any:
        """The shape as PyVista's `PolyData`, with a "colour" of each point or cell where it has several."""

    @property
    def rgb(self) -> dict[str, Any]:
        """The colours as data of a mesh; empty where there is only one."""
        return {} if isinstance(self.colour, str) else {"colour": np.round(255 * self.colour).astype(np.uint8)}


@dataclass(frozen=True)
class Surface(Part):
    """Triangles (k, 3) over points (n, 3) [m]; edges: points along each of the lines (e, 2 or more) drawn on it."""

    points: Floats
    triangles: Ints
    bulky: bool = field(default=True, kw_only=True)
    edges: Ints | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", frozen_floats(self.points, name="surface points", shape=(None, 3)))
        object.__setattr__(self, "triangles", frozen_ints(self.triangles, name="triangles", shape=(None, 3)))

    @property
    def extent(self) -> Floats:
        return self.points[np.unique(self.triangles)]

    def mesh(self) -> Any:
        import pyvista as pv

        mesh = pv.PolyData.from_regular_faces(np.array(self.points), np.array(self.triangles))
        (mesh.point_data if len(self.colour) == mesh.n_points else mesh.cell_data).update(self.rgb)
        return mesh


@dataclass(frozen=True)
class Tube(Part):
    """A polyline (k, 3) [m] with a radius [m], or one for each of its points (k,)."""

    path: Floats
    radius: float | Floats
    smooth: ClassVar[bool] = True

    @property
    def extent(self) -> Floats:
        around = np.broadcast_to(self.radius, len(self.path))[:, None]
        return np.concatenate([self.path - around, self.path + around]) if self.bulky else self.path

    def mesh(self) -> Any:
        import pyvista as pv

        line = pv.MultipleLines(np.array(self.path))
        line.point_data.update(self.rgb)
        if not isinstance(self.radius, np.ndarray):
            return line.tube(radius=self.radius, n_sides=SIDES, capping=True)
        line.point_data["radius"] = self.radius
        return line.tube(scalars="radius", absolute=True, n_sides=SIDES, capping=True)


@dataclass(frozen=True)
class Wire(Part):
    """Several polylines (k, 3) [m] with a radius [m]."""

    paths: tuple[Floats, ...]
    radius: float
    smooth: ClassVar[bool] = True

    @property
    def extent(self) -> Floats:
        return np.concatenate(self.paths)

    def mesh(self) -> Any:
        return polylines(self.paths).tube(radius=self.radius, n_sides=SIDES // 2, capping=True)


@dataclass(frozen=True)
class Ball(Part):
    """A point (3,) [m] with a radius [m]."""

    at: Floats
    radius: float
    smooth: ClassVar[bool] = True

    @property
    def extent(self) -> Floats:
        return self.at[None]

    def mesh(self) -> Any:
        import pyvista as pv

        return pv.Sphere(radius=self.radius, center=tuple(self.at))


@dataclass(frozen=True)
class Arrow(Part):
    """An arrow from `tail` to `tip` (3,) [m]."""

    tail: Floats
    tip: Floats
    radius: float

    @property
    def extent(self) -> Floats:
        return np.stack([self.tail, self.tip])

    def mesh(self) -> Any:
        import pyvista as pv

        along = self.tip - self.tail
        share = self.radius / float(np.linalg.norm(along))
        return pv.Arrow(
            start=tuple(self.tail),
            direction=tuple(along),
            scale="auto",
            tip_length=min(0.4, 5 * share),
            tip_radius=2.4 * share,
            shaft_radius=share,
        )


@dataclass(frozen=True)
class FlatDisc(Part):
    """A flat cylinder around `centre` (3,) [m] with a unit axis, and open holes around points (n, 3) [m]."""

    centre: Floats
    axis: Floats
    radius: float
    thickness: float
    holes: Floats = field(default_factory=lambda: np.empty((0, 3)))
    hole_radius: float = 0.0
    bulky: bool = field(default=True, kw_only=True)

    @property
    def extent(self) -> Floats:
        return ring_points(self.centre, self.axis, across(self.axis), self.radius, RIM)

    def mesh(self) -> Any:
        import pyvista as pv

        side = across(self.axis)
        frame = np.column_stack([side, np.cross(self.axis, side), self.axis])
        # In the disc's own frame; a hole is run around the other way.
        x, _, z = np.eye(3)
        loops = [ring_points(np.zeros(3), z, x, self.radius, RIM)]
        loops += [
            ring_points(at * [1, 1, 0], -z, x, self.hole_radius, HOLE) for at in (self.holes - self.centre) @ frame
        ]
        starts = np.cumsum([0, *map(len, loops[:-1])])
        faces = np.concatenate([[len(loop), *(first + np.arange(len(loop)))] for first, loop in zip(starts, loops)])
        outline = pv.PolyData(np.concatenate(loops), faces=faces)
        flat = pv.PolyData(np.array(outline.points)).delaunay_2d(edge_source=outline)
        solid = flat.translate((0.0, 0.0, -0.5 * self.thickness)).extrude((0.0, 0.0, self.thickness), capping=True)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = frame, self.centre
        return solid.triangulate().transform(pose, inplace=False)


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


def polylines(paths: Sequence[Floats]) -> Any:
    """Polylines (k, 3) as PyVista's `PolyData`."""
    import pyvista as pv

    starts = np.cumsum([0, *map(len, paths[:-1])])
    lines = [np.concatenate([[len(path)], start + np.arange(len(path))]) for start, path in zip(starts, paths)]
    return pv.PolyData(np.concatenate(paths), lines=np.concatenate(lines))


def length_scale(points: Floats) -> float:
    """The diagonal of the bounding box [m]."""
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def refined(path: Floats) -> Floats:
    """A polyline (k, 3) with each segment divided into 32."""
    share = np.linspace(0, 1, 33)[:-1, None]
    return np.concatenate([*(a + share * (b - a) for a, b in pairwise(path)), path[-1:]])


def bending_camera(points: Floats, up: Floats, towards: Floats) -> Projection:
    """A projection slightly from the side and above.

    Parameters
    ----------
    points
        All that must fit into the picture (n, 3) [m].
    up
        Upright direction (3,) [-].
    towards
        Direction to the right (3,) [-], as far as it is across `up`.
    """
    up = up / np.linalg.norm(up)
    right = towards - (towards @ up) * up
    if np.linalg.norm(right) < 1e-9:
        right = across(up)
    right /= np.linalg.norm(right)
    back: Floats = np.asarray(np.cross(right, up), dtype=np.float64)
    back = (
        back * np.cos(0.40) + np.cross(up, back) * np.sin(0.40) + up * (up @ back) * (1 - np.cos(0.40))
    )  # turned about `up`
    back = back * np.cos(0.28) + up * np.sin(0.28)
    right = np.asarray(np.cross(up, back), dtype=np.float64)
    right /= np.linalg.norm(right)
    frame_up: Floats = np.asarray(np.cross(back, right), dtype=np.float64)
    return fitted(Projection(right, frame_up, back, (0.0, 1.0, 0.0, 1.0)), points)


def fitted(camera: Projection, points: Floats) -> Projection:
    """The same view with a window that contains all points and a margin, and is no slimmer than `SLIMMEST`."""
    flat = camera.project(points)[:, :2]
    low, high = flat.min(axis=0), flat.max(axis=0)
    margin = np.array([0.13, 0.05]) * float(np.max(high - low))
    width, height = high - low + 2 * margin
    margin[0] += 0.5 * max(0.0, SLIMMEST * height - width)
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


def extent_points(scenes: tuple[Scene, ...]) -> Floats:
    """All points (n, 3) [m] of the scenes."""
    return np.concatenate([part.extent for scene in scenes for part in scene.parts])
