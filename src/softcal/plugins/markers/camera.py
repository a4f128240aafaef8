"""A calibrated camera: projection of points to pixels, and rays of pixels.

Pinhole with Brown's distortion, in OpenCV's conventions: x right, y down, z along the view; the centre of the image's
first pixel is (0, 0); with a = x/z, b = y/z, r² = a² + b²,
a' = a (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 a b + p2 (r² + 2 a²),
b' = b (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 b²) + 2 p2 a b.

References
----------
Brown, Close-range camera calibration, Photogrammetric Engineering 37 (1971).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from softcal.checks import Floats, frozen_floats
from softcal.errors import Fault, InputError

Image = NDArray[np.uint8]  # (height, width) grey levels

_UNDISTORTION_STEPS = 20
_ACROSS, _CLOSE = 17, 1e-3  # test points along each side of the image; accuracy of the inverse distortion there [px]


@dataclass(frozen=True)
class Camera:
    """Resolution [px], focal lengths and principal point in a matrix (3, 3) [px], distortion (k1, k2, p1, p2, k3)."""

    width: int
    height: int
    matrix: Floats
    distortion: Floats

    def __post_init__(self) -> None:
        matrix = frozen_floats(self.matrix, name="camera matrix", shape=(3, 3))
        object.__setattr__(self, "matrix", matrix)
        object.__setattr__(self, "distortion", frozen_floats(self.distortion, name="distortion", shape=(5,)))
        if not (self.width > 0 and self.height > 0 and matrix[0, 0] > 0 and matrix[1, 1] > 0):
            raise InputError(
                Fault(
                    "this is not a camera",
                    got=f"{self.width} x {self.height} px, focal lengths {matrix[0, 0]:g} and {matrix[1, 1]:g} px",
                    allowed="numbers above zero",
                )
            )

    @property
    def focal(self) -> Floats:
        """Focal lengths along x and y [px], shape (2,)."""
        return np.array([self.matrix[0, 0], self.matrix[1, 1]])

    @property
    def centre(self) -> Floats:
        """Principal point [px], shape (2,)."""
        return self.matrix[:2, 2]

    def project(self, points: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3) [m] in the camera's frame, which must lie in front of it."""
        return self.pixels(points[:, :2] / points[:, 2:])

    def project_with_slope(self, points: Floats) -> tuple[Floats, Floats]:
        """Pixels (n, 2) of points (n, 3) [m] in the camera's frame, and their derivative by the points (n, 2, 3)."""
        directions = points[:, :2] / points[:, 2:]
        by_direction = self._distorted_slope(directions) * self.focal[:, None]
        slope = np.zeros((len(points), 2, 3))
        slope[:, :, :2] = by_direction
        slope[:, :, 2] = -np.einsum("nij,nj->ni", by_direction, directions)
        return self.pixels(directions), slope / points[:, 2, None, None]

    def pixels(self, directions: Floats) -> Floats:
        """Pixels (n, 2) of directions (x/z, y/z), shape (n, 2)."""
        return self._distorted(directions) * self.focal + self.centre

    def directions(self, pixels: Floats) -> Floats:
        """Directions (x/z, y/z), shape (n, 2), of pixels (n, 2): distortion inverted by Newton's method."""
        seen = (np.asarray(pixels, dtype=np.float64) - self.centre) / self.focal
        found = seen.copy()
        for _ in range(_UNDISTORTION_STEPS):
            error = self._distorted(found) - seen
            if not error.size or np.abs(error).max() < 1e-13:
                break
            slope = self._distorted_slope(found)
            (a, b), (c, d) = (slope[..., 0, 0], slope[..., 0, 1]), (slope[..., 1, 0], slope[..., 1, 1])
            u, v = error[..., 0], error[..., 1]
            found -= np.stack([d * u - b * v, a * v - c * u], axis=-1) / (a * d - b * c)[..., None]
        return found

    @property
    def is_reversible(self) -> bool:
        """Whether the distortion is invertible in the middle half of the image.

        Near the corners, where a calibration has few points, the polynomial of a good camera may not be.
        """
        across = np.linspace(0.25, 0.75, _ACROSS)
        pixels = np.stack(np.meshgrid(across * self.width, across * self.height), axis=-1).reshape(-1, 2)
        with np.errstate(all="ignore"):
            found = self.directions(pixels)
            off = np.abs(self.pixels(found) - pixels).max()
            slope = self._distorted_slope(found)
            return bool(off < _CLOSE and (np.linalg.det(slope) > 0).all())

    def _distorted(self, directions: Floats) -> Floats:
        k1, k2, p1, p2, k3 = self.distortion
        a, b = directions[..., 0], directions[..., 1]
        r2 = a * a + b * b
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        return np.stack(
            [
                a * radial + 2 * p1 * a * b + p2 * (r2 + 2 * a * a),
                b * radial + p1 * (r2 + 2 * b * b) + 2 * p2 * a * b,
            ],
            axis=-1,
        )

    def _distorted_slope(self, directions: Floats) -> Floats:
        k1, k2, p1, p2, k3 = self.distortion
        a, b = directions[..., 0], directions[..., 1]
        r2 = a * a + b * b
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        by_r2 = k1 + r2 * (2 * k2 + 3 * k3 * r2)
        slope = np.empty((*directions.shape, 2))
        slope[..., 0, 0] = radial + 2 * a * a * by_r2 + 2 * p1 * b + 6 * p2 * a
        slope[..., 0, 1] = slope[..., 1, 0] = 2 * a * b * by_r2 + 2 * p1 * a + 2 * p2 * b
        slope[..., 1, 1] = radial + 2 * b * b * by_r2 + 6 * p1 * b + 2 * p2 * a
        return slope
