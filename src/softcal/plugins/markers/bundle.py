"""Bundle adjustment: poses of cameras and bodies that minimise the reprojection error of all points.

Each sighting gives pixels of points of one body from one viewpoint. The unknowns are the viewpoints' poses (base frame
to camera frame) and the bodies' poses in the base frame; the base is fixed. The squared reprojection errors are
minimised by the Levenberg-Marquardt method; a step is a rotation and a translation of each pose.

References
----------
Triggs, McLauchlan, Hartley and Fitzgibbon, Bundle adjustment: a modern synthesis, Vision Algorithms (2000).
Collins and Bartoli, Infinitesimal plane-based pose estimation, International Journal of Computer Vision 109 (2014).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from softcal.checks import Floats, Ints
from softcal.geometry.pose import Pose
from softcal.plugins.markers.camera import Camera

BASE = -1  # number of the fixed body

_MOST_STEPS = 100
_SMALLEST_GAIN = 1e-7  # of the cost, relative
_SMALL = 400  # unknowns up to which dense matrices are faster
_NEAREST = 1e-3  # depth below which a point counts as behind the camera [m]


@dataclass(frozen=True)
class Sighting:
    """Points (n, 3) [m] of a body, in its own frame, observed from a viewpoint at pixels (n, 2).

    weight: weight of its residuals.
    """

    view: int
    body: int
    points: Floats
    pixels: Floats
    weight: float = 1.0


@dataclass(frozen=True)
class Bundle:
    """Poses of viewpoints (base frame to camera frame) and of bodies (body frame to base frame)."""

    camera: Camera
    views: tuple[Pose, ...]
    bodies: tuple[Pose, ...]

    def residuals(self, sighting: Sighting) -> Floats:
        """Computed minus observed pixels, shape (n, 2)."""
        return self.camera.project(self._in_camera(sighting)) - sighting.pixels

    def cost(self, sightings: Sequence[Sighting]) -> float:
        """Sum of squared weighted residuals [px²]; infinite if a point would be behind a camera."""
        total = 0.0
        for sighting in sightings:
            if self._in_camera(sighting)[:, 2].min() < _NEAREST:
                return np.inf
            total += float(np.sum(self.residuals(sighting) ** 2)) * sighting.weight**2
        return total

    def moved(self, step: Floats, *, hold_views: bool = False) -> Bundle:
        """The bundle after a step of all free poses, six numbers each: rotation [rad] and translation [m]."""
        parts = step.reshape(-1, 6)
        n_views = 0 if hold_views else len(self.views)
        views = self.views if hold_views else tuple(p.moved(d) for p, d in zip(self.views, parts, strict=False))
        return replace(
            self, views=views, bodies=tuple(p.moved(d) for p, d in zip(self.bodies, parts[n_views:], strict=True))
        )

    def _in_camera(self, sighting: Sighting) -> Floats:
        points = sighting.points if sighting.body == BASE else self.bodies[sighting.body].apply(sighting.points)
        return self.views[sighting.view].apply(points)

    def slopes(self, sighting: Sighting) -> tuple[Floats, Floats]:
        """Derivatives of the pixels by the steps of the viewpoint and of the body, each (2 n, 6)."""
        view = self.views[sighting.view]
        turned = np.zeros_like(sighting.points)
        points = sighting.points
        if sighting.body != BASE:
            body = self.bodies[sighting.body]
            turned = points @ body.rotation.T
            points = turned + body.position
        from_camera = points @ view.rotation.T
        _, slope = self.camera.project_with_slope(from_camera + view.position)
        by_view = np.concatenate([slope @ _cross(from_camera), slope], axis=2)
        in_base = slope @ view.rotation
        by_body = np.concatenate([in_base @ _cross(turned), in_base], axis=2)
        return by_view.reshape(-1, 6), by_body.reshape(-1, 6)


@dataclass(frozen=True)
class Adjustment:
    """The bundle at a local minimum of the cost [px²], and the normal matrix there."""

    bundle: Bundle
    cost: float
    converged: bool
    normal: Any  # (n, n), full or sparse: the squared slopes, viewpoints first unless held
    n_held: int  # viewpoints that were not free

    def covariances(self, bodies: Sequence[int]) -> Floats:
        """Covariance (n, 6, 6) of the step of each body, for residuals of 1 px: rotation [rad], translation [m]."""
        n_views = len(self.bundle.views) - self.n_held
        scale = 1 / np.sqrt(self.normal.diagonal())
        scaling = _diagonal(scale, self.normal)
        solve = _solver(scaling @ self.normal @ scaling)
        found = np.empty((len(bodies), 6, 6))
        for i, body in enumerate(bodies):
            place = 6 * (n_views + body) + np.arange(6)
            unit = np.zeros((self.normal.shape[0], 6))
            unit[place, np.arange(6)] = 1.0
            found[i] = solve(unit)[place] * scale[place, None] * scale[place]
        return found


def adjust(start: Bundle, sightings: Sequence[Sighting], *, hold_views: bool = False) -> Adjustment:
    """The bundle near `start` that minimises the cost of all sightings.

    Parameters
    ----------
    start
        Start of the search; every pose must have a sighting.
    sightings
        The observations.
    hold_views
        Whether the viewpoints are fixed.
    """
    bundle, cost, damping = start, start.cost(sightings), 1e-4
    normal, downhill = _normal_equations(bundle, sightings, hold_views)
    converged = False
    for _ in range(_MOST_STEPS):
        diagonal = normal.diagonal()
        solve = _solver(normal + _diagonal(damping * diagonal + 1e-12 * diagonal.max(), normal))
        candidate = bundle.moved(solve(downhill), hold_views=hold_views)
        lower = candidate.cost(sightings)
        if not lower <= cost:
            damping *= 10
            if damping > 1e8:
                converged = True  # no descent step within floating-point precision
                break
            continue
        gain, bundle, cost = cost - lower, candidate, lower
        damping = max(damping / 10, 1e-12)
        normal, downhill = _normal_equations(bundle, sightings, hold_views)
        if gain <= _SMALLEST_GAIN * max(cost, 1e-9):
            converged = True
            break
    return Adjustment(bundle, cost, converged, normal, len(bundle.views) if hold_views else 0)


def _normal_equations(bundle: Bundle, sightings: Sequence[Sighting], hold_views: bool) -> tuple[Any, Floats]:
    """Normal matrix (dense or sparse) and negative gradient of half the cost."""
    n_views = 0 if hold_views else len(bundle.views)
    size = 6 * (n_views + len(bundle.bodies))
    downhill = np.zeros(size)
    blocks: list[tuple[Ints, Floats]] = []
    for sighting in sightings:
        by_view, by_body = bundle.slopes(sighting)
        parts: list[tuple[int, Floats]] = []
        if not hold_views:
            parts.append((6 * sighting.view, by_view))
        if sighting.body != BASE:
            parts.append((6 * (n_views + sighting.body), by_body))
        if not parts:
            continue
        slope = np.concatenate([part for _, part in parts], axis=1) * sighting.weight
        place = np.concatenate([first + np.arange(6) for first, _ in parts])
        downhill[place] -= slope.T @ (bundle.residuals(sighting).ravel() * sighting.weight)
        blocks.append((place, slope.T @ slope))
    if size <= _SMALL:
        matrix = np.zeros((size, size))
        for place, block in blocks:
            matrix[np.ix_(place, place)] += block
        return matrix, downhill
    from scipy.sparse import coo_matrix

    rows = np.concatenate([np.repeat(place, len(place)) for place, _ in blocks])
    columns = np.concatenate([np.tile(place, len(place)) for place, _ in blocks])
    values = np.concatenate([block.ravel() for _, block in blocks])
    return coo_matrix((values, (rows, columns)), (size, size)).tocsc(), downhill


def _diagonal(values: Floats, like: Any) -> Any:
    """A diagonal matrix, dense or sparse like another."""
    from scipy.sparse import diags

    return np.diag(values) if isinstance(like, np.ndarray) else diags(values)


def _solver(matrix: Any) -> Callable[[Floats], Floats]:
    """Solver of a matrix, dense or sparse."""
    from scipy.linalg import lu_factor, lu_solve
    from scipy.sparse.linalg import splu

    if not isinstance(matrix, np.ndarray):
        return splu(matrix.tocsc()).solve
    factors = lu_factor(matrix, check_finite=False)
    return lambda right: lu_solve(factors, right, check_finite=False)


def _cross(vectors: Floats) -> Floats:
    """-[v]x (n, 3, 3): derivative of a rotated vector by the rotation."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=-1).reshape(-1, 3, 3)


_SAME = np.radians(1.0)  # rotation below which two poses are the same


@dataclass(frozen=True)
class PoseCandidate:
    """A pose (points' frame to camera frame) at a local minimum of the cost [px²]."""

    pose: Pose
    cost: float


def square_corners(size: float) -> Floats:
    """Corners (4, 3) [m] of a marker in its own frame (x right, y up, z out), clockwise from the upper left."""
    return np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]]) * size / 2


def pose_candidates(camera: Camera, points: Floats, pixels: Floats) -> tuple[PoseCandidate, ...]:
    """Poses that project points to pixels, best first; empty if there is none.

    A square or another planar set has up to two, mirrored about the line of sight, any other set one.

    Parameters
    ----------
    camera
        The camera of the image.
    points
        Points (n, 3) [m].
    pixels
        Where they are in the image (n, 2) [px].
    """
    import cv2

    flat = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    is_flat = flat[2] < 1e-6 * flat[0]
    method = cv2.SOLVEPNP_IPPE if is_flat else cv2.SOLVEPNP_SQPNP
    directions = camera.directions(pixels)
    found, turns, shifts, _ = cv2.solvePnPGeneric(points, directions[:, None], np.eye(3), np.zeros(5), flags=method)
    candidates: list[PoseCandidate] = []
    sighting = Sighting(0, BASE, points, pixels)
    for turn, shift in zip(turns[:found], shifts[:found], strict=True):
        start = Bundle(camera, (Pose.of(np.ravel(turn), np.ravel(shift)),), ())
        if not np.isfinite(start.cost([sighting])):
            continue
        best = adjust(start, [sighting])
        pose = best.bundle.views[0]
        if all(pose.angle_to(other.pose) > _SAME for other in candidates):
            candidates.append(PoseCandidate(pose, best.cost))
    return tuple(sorted(candidates, key=lambda one: one.cost))
