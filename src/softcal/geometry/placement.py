"""Placement of a part: rotations about its own origin, then a translation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import numpy as np

from softcal.checks import frozen_floats
from softcal.declare import Declared, Reading, listed
from softcal.errors import Fault, MeshError
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
    """Where a part is put: turned about its own origin, one turn after the other, then moved by `position` [m]."""

    position: Point = (0.0, 0.0, 0.0)
    rotation: Annotated[tuple[Turn, ...], Reading(listed)] = ()

    @property
    def pose(self) -> Pose:
        """As a motion of the part's points.

        Raises
        ------
        MeshError
            For an axis without a direction.
        """
        from scipy.spatial.transform import Rotation

        from softcal.geometry.pose import Pose

        rotation = np.eye(3)
        for turn in self.rotation:
            vector = frozen_floats(turn.axis, name="axis", shape=(3,))
            size = float(np.linalg.norm(vector))
            if not size > 0.0:
                raise MeshError(
                    Fault("the axis of a rotation has no direction", got=str(list(turn.axis)), allowed="not zero")
                )
            rotation = Rotation.from_rotvec(vector / size * turn.angle).as_matrix() @ rotation
        return Pose(rotation, np.asarray(self.position, dtype=np.float64))


def placed_mesh(mesh: TetMesh, pose: Pose) -> TetMesh:
    """A mesh moved to a pose, with its sets."""
    return replace(mesh, points=pose.apply(mesh.points))


def placed_centreline(line: Centreline, pose: Pose) -> Centreline:
    """A rod's centreline moved to a pose."""
    return replace(line, nodes=pose.apply(line.nodes), triads=pose.rotation @ line.triads)
