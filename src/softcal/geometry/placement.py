"""Where a part is put: turned about its own origin, then moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from softcal.checks import frozen_floats
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline
from softcal.geometry.mesh import TetMesh
from softcal.geometry.pose import Pose


def placement(position: Sequence[float], turns: Sequence[tuple[Sequence[float], float]]) -> Pose:
    """A part turned about axes through its own origin by angles [rad], one after the other, then moved [m].

    Raises
    ------
    MeshError
        For an axis without a direction.
    """
    rotation = np.eye(3)
    for axis, angle in turns:
        vector = frozen_floats(axis, name="axis", shape=(3,))
        size = float(np.linalg.norm(vector))
        if not size > 0.0:
            raise MeshError(
                Fault("the axis of a turn has no direction", got=str(np.asarray(axis).tolist()), allowed="not zero")
            )
        rotation = Rotation.from_rotvec(vector / size * angle).as_matrix() @ rotation
    return Pose(rotation, np.asarray(position, dtype=np.float64))


def placed_mesh(mesh: TetMesh, pose: Pose) -> TetMesh:
    """A mesh where it is put, its sets kept."""
    return replace(mesh, points=pose.apply(mesh.points))


def placed_centreline(line: Centreline, pose: Pose) -> Centreline:
    """A rod's centreline where it is put."""
    return Centreline(pose.apply(line.nodes), pose.rotation @ line.triads, line.lengths)
