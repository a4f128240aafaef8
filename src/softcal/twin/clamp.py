"""The clamp of a body: by how much it reaches further into the body than the fixed nodes do.

The cross-section behind the fixed face is constant for some length, and within that zone the undeformed mesh is moved:
the face by the depth, what lies further in by less, the end of the zone not at all. So a bar has exactly the stiffness
of one that is shorter by the depth. All else that depends on the mesh, such as weight, tractions and chambers, is that
of the moved one; a point on the body keeps its place in it. Through the change of a cross-section nothing can be moved
without another shape, which the depth does not stand for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.arrays import UnitVector
from softcal.checks import Floats, Ints
from softcal.declare import Declared
from softcal.display import displayed
from softcal.errors import Fault, InputError
from softcal.geometry.mesh import TetMesh
from softcal.geometry.quadratic import to_linear
from softcal.geometry.regions import ROUNDING
from softcal.geometry.surface import boundary_faces
from softcal.quantities import QUANTITIES, Length, Quantity
from softcal.units import format_quantity

# By how much the cross-section may differ from that of the face, relative to its area, within the zone that is moved.
CONSTANT = 0.1
# Least length of that zone, in square roots of the face's area.
SHORTEST = 0.02


@displayed
@dataclass(frozen=True)
class Clamp(Declared):
    """The clamp of a body at a plane face.

    Attributes
    ----------
    direction : Unit vector (3,) from the face into the body, in the rest frame
    depth : How much further into the body it reaches than the fixed nodes [m]; less, where negative
    """

    direction: UnitVector
    depth: Length = 0.0


@dataclass(frozen=True)
class Zone:
    """The zone in which a clamp moves the mesh.

    Attributes
    ----------
    direction : Unit vector (3,)
    face : Height of the fixed face along it [m]
    length : That of the zone behind the face [m]
    before : That of the fixed part before the face [m]
    """

    direction: Floats
    face: float
    length: float
    before: float = 0.0

    @property
    def depths(self) -> Quantity:
        """The kind of quantity of the depth: up to half the zone, deeper or less deep."""
        return replace(QUANTITIES["length"], lower=-0.5 * self.length, upper=0.5 * self.length, ends="[]")

    def shares(self, mesh: TetMesh) -> Floats:
        """Shares of the face's motion that nodes (n_points,) follow: one in it, less before, zero beyond the zone."""
        height = mesh.points @ self.direction - self.face
        length = np.where(height < 0.0, -max(self.before, self.length), self.length)
        share = np.clip(1.0 - height / length, 0.0, 1.0)
        for k, (a, b) in enumerate(mesh.cell.edges):  # so that a straight edge stays straight
            share[mesh.tets[:, 4 + k]] = 0.5 * (share[mesh.tets[:, a]] + share[mesh.tets[:, b]])
        return share


def clamp_zone(mesh: TetMesh, fixed: Ints, clamp: Clamp, *, where: str = "") -> Zone:
    """The zone of a mesh that a clamp can move. The clamp's depth must be within the range of the zone.

    Parameters
    ----------
    mesh
        The mesh [m].
    fixed
        Nodes that do not move (n,).
    clamp
        The clamp.
    where
        Place for error messages.

    Raises
    ------
    InputError
        Where no fixed face lies behind the body in this direction, where the fixed region does not end at a plane,
        where the cross-section changes right behind the face, or for a depth that is out of range.
    """
    direction = np.asarray(clamp.direction)
    height = mesh.points @ direction
    slack = ROUNDING * float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    is_fixed = np.zeros(mesh.n_points, dtype=bool)
    is_fixed[fixed] = True
    free = mesh.corners[~is_fixed[mesh.corners]]
    before = is_fixed & (height < height[free].min(initial=np.inf) - slack)
    if not len(free) or not before.any():
        got = f"the direction ({', '.join(f'{x:.4g}' for x in direction)})"
        allowed = "a direction from the fixed face into the body, with fixed nodes alone behind the first free one"
        ends_fixed = height[is_fixed].max(initial=-np.inf) > height[free].max(initial=-np.inf)
        attempt = "the opposite direction" if ends_fixed else ""
        raise InputError(Fault("no fixed face lies behind the body", where, got, allowed, attempt))
    face = float(height[before].max())
    # The length [m] behind the face over which the cross-section is constant, up to the square root of its area. The
    # section's area changes by the area of the surface as seen along the direction.
    straight = to_linear(mesh)
    a, b, c = np.moveaxis(straight.points[boundary_faces(straight)], 1, 0)
    seen = 0.5 * np.cross(b - a, c - a) @ direction
    heights = np.stack([a, b, c]) @ direction - face
    at_face = heights.max(axis=0) <= slack
    area = -float(seen[at_face].sum())
    middle, change = heights.mean(axis=0)[~at_face], np.abs(seen[~at_face])
    order = np.argsort(middle)
    ends = middle[order][np.cumsum(change[order]) > CONSTANT * area]
    size = np.sqrt(max(area, 0.0))
    length = min(float(ends.min(initial=np.inf)), float(size))
    if not length > SHORTEST * size:
        raise InputError(
            Fault(
                "the cross-section of the body changes right behind its fixed face, so that no depth of the clamp can "
                "be defined",
                where,
                got=f"a constant one for {format_quantity(max(length, 0.0), 'm')}",
                allowed="a face behind which the body is prismatic",
            )
        )
    beyond = height[is_fixed & (height > face + slack) & (height < face + length)]
    if len(beyond):
        raise InputError(
            Fault(
                "the fixed region does not end at a plane across the direction",
                where,
                got=f"fixed nodes up to {format_quantity(float(beyond.max()) - face, 'm')} beyond the first free ones",
                allowed="a plane face, with free nodes alone beyond it",
            )
        )
    zone = Zone(direction, face, length, face - float(height[before].min()))
    zone.depths.checked(clamp.depth, where=f"{where}.depth" if where else "depth")
    return zone
