"""Where a part is put: turned about its own origin, then moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats, frozen_floats
from softcal.errors import Fault, MeshError
from softcal.geometry.centreline import Centreline
from softcal.geometry.mesh import TetMesh


@dataclass(frozen=True)
class Placement:
    """x = rotation X + position [m]; the rotation is a matrix (3, 3) that keeps hands and lengths."""

    rotation: Floats
    position: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "rotation", frozen_floats(self.rotation, name="rotation", shape=(3, 3)))
        object.__setattr__(self, "position", frozen_floats(self.position, name="position", shape=(3,)))
        off = float(np.abs(self.rotation.T @ self.rotation - np.eye(3)).max())
        if off > 1e-9 or np.linalg.det(self.rotation) < 0.0:
            raise MeshError(Fault("the matrix is no rotation", where="placement", got=f"{off:.3g} off"))

    def points(self, points: Floats) -> Floats:
        """Points (n, 3) [m] where they are put."""
        return points @ self.rotation.T + self.position

    def mesh(self, mesh: TetMesh) -> TetMesh:
        """A mesh where it is put, its sets kept."""
        return replace(mesh, points=self.points(mesh.points))

    def centreline(self, line: Centreline) -> Centreline:
        """A rod's centreline where it is put."""
        return Centreline(self.points(line.nodes), self.rotation @ line.triads, line.lengths)


def placement(position: Sequence[float], turns: Sequence[tuple[Sequence[float], float]]) -> Placement:
    """A part turned about axes through its own origin by angles [rad], one after the other, then moved [m].

    Raises
    ------
    MeshError
        For an axis without a direction.
    """
    from scipy.spatial.transform import Rotation

    rotation = np.eye(3)
    for axis, angle in turns:
        vector = frozen_floats(axis, name="axis", shape=(3,))
        size = float(np.linalg.norm(vector))
        if not size > 0.0:
            raise MeshError(
                Fault("the axis of a turn has no direction", got=str(np.asarray(axis).tolist()), allowed="not zero")
            )
        rotation = Rotation.from_rotvec(vector / size * angle).as_matrix() @ rotation
    return Placement(rotation, np.asarray(position, dtype=np.float64))
