"""Where a rigid body stands and how it is turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from softcal.checks import Floats, frozen_floats


@dataclass(frozen=True)
class Pose:
    """Rotation (3, 3) and position (3,) [m] that turn a body's coordinates into those of a frame: R x + t."""

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
        """Points (n, 3) [m] of the body in the frame."""
        return points @ self.rotation.T + self.position

    def after(self, first: Pose) -> Pose:
        """The pose that does `first`, then this one."""
        return Pose(self.rotation @ first.rotation, self.rotation @ first.position + self.position)

    def inverse(self) -> Pose:
        """The pose that undoes this one."""
        return Pose(self.rotation.T, -self.rotation.T @ self.position)

    def moved(self, step: Floats) -> Pose:
        """The pose after a small turn (about the frame's axes) and shift: `step` = (rotation vector, shift), (6,)."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return Pose(turn @ self.rotation, self.position + step[3:])

    def angle_to(self, other: Pose) -> float:
        """Angle [rad] between the two rotations."""
        return float(Rotation.from_matrix(self.rotation.T @ other.rotation).magnitude())
