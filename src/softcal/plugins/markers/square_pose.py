"""Poses of a planar point set from one view: often two solutions, mirrored about the line of sight.

References
----------
Collins and Bartoli, Infinitesimal plane-based pose estimation, International Journal of Computer Vision 109 (2014).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.extras import require_extra
from softcal.geometry.pose import Pose
from softcal.plugins.markers.bundle import BASE, Bundle, Sighting, adjust
from softcal.plugins.markers.camera import Camera

require_extra("markers", "cv2", where="markers")

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
    """Poses that project points (n, 3) [m] to pixels (n, 2), best first; empty if there is none.

    A square or another planar set has up to two, any other set one.
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
