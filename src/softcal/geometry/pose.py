"""Pose of a rigid body: rotation and position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from softcal.checks import Floats, frozen_floats


@dataclass(frozen=True)
class Pose:
    """Rotation (3, 3) and position (3,) [m] from body coordinates to those of a frame: R x + t."""

    rotation: Floats
    position: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_floats(self.rotation, name="rotation", shape=(3, 3)))
        object.__setattr__(self, "position", frozen_floats(self.position, name="position", shape=(3,)))

    @staticmethod
    def of(rotation_vector: ArrayLike = (0.0, 0.0, 0.0), position: ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """The pose of a rotation vector [rad] and a position [m]."""
        turned = Rotation.from_rotvec(np.asarray(rotation_vector, dtype=np.float64))
        return Pose(turned.as_matrix(), np.asarray(position, dtype=np.float64))

    @property
    def rotation_vector(self) -> Floats:
        """Axis times angle [rad], shape (3,)."""
        return Rotation.from_matrix(self.rotation).as_rotvec()

    def apply(self, points: Floats) -> Floats:
        """Points (n, 3) [m] of the body in frame coordinates."""
        return points @ self.rotation.T + self.position

    def after(self, first: Pose) -> Pose:
        """Composition: `first`, then this pose."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.position + self.position)

    def inverse(self) -> Pose:
        """The inverse pose."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)

    def moved(self, step: Floats) -> Pose:
        """The pose after a small rotation (about the frame's axes) and translation: `step` (6,)."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return Pose(turn @ self.rotation, self.position + step[3:])

    def angle_to(self, other: Pose) -> float:
        """Angle [rad] between the two rotations."""
        return float(Rotation.from_matrix(self.rotation.T @ other.rotation).magnitude())
