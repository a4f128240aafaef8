"""Placement of a part: rotations about its own origin, then a translation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np

from softcal.declare import Declared, Reading, listed
from softcal.geometry.mesh import TetMesh
from softcal.quantities import Angle, Direction, Point

if TYPE_CHECKING:
    from softcal.geometry.centreline import Centreline
    from softcal.geometry.pose import Pose


@dataclass(frozen=True)
class Turn(Declared):
    """A turn by an angle [rad] about an axis through the part's own origin."""

    axis: Direction
    angle: Angle


@dataclass(frozen=True)
class Placement(Declared):
    """Placement of a part: turned about its own origin, one turn after the other, then moved by `position` [m]."""

    position: Point = (0.0, 0.0, 0.0)
    rotation: Annotated[tuple[Turn, ...], Reading(listed)] = ()

    @property
    def pose(self) -> Pose:
        """The motion of the part's points."""
        from scipy.spatial.transform import Rotation

        from softcal.geometry.pose import Pose

        rotation = np.eye(3)
        for turn in self.rotation:
            axis = np.asarray(turn.axis, dtype=np.float64) / float(np.linalg.norm(turn.axis))
            rotation = Rotation.from_rotvec(axis * turn.angle).as_matrix() @ rotation
        return Pose(rotation, np.asarray(self.position, dtype=np.float64))


def placed_mesh(mesh: TetMesh, pose: Pose) -> TetMesh:
    """A mesh moved to a pose, with its sets."""
    return replace(mesh, points=pose.apply(mesh.points))


def placed_centreline(line: Centreline, pose: Pose) -> Centreline:
    """A rod's centreline moved to a pose."""
    return replace(line, nodes=pose.apply(line.nodes), triads=pose.rotation @ line.triads)
