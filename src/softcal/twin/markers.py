"""Places of markers on the parts that carry them: as drawn, with offsets that move with the part.

On a plate an offset turns with it, on a rod with its section; on a body it is turned and stretched by the deformation
gradient where the marker is drawn. No equilibrium depends on it: another offset needs no other system of equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats
from softcal.geometry.mesh import TetMesh
from softcal.mechanics.attachment import attach_directions
from softcal.twin.loads import Weights
from softcal.twin.robot import Marker


@dataclass(frozen=True)
class MarkerPlace:
    """The place of a marker on its part.

    Attributes
    ----------
    marker : It, with its offset
    drawn : The weighted points of where it is drawn
    directions : On a body or rod, the derivatives of its place by each offset, as weighted points; on a plate none
    """

    marker: Marker
    drawn: Weights
    directions: tuple[Weights, ...] = ()

    def of(self, marker: Marker) -> MarkerPlace:
        """The place of the same marker with another offset."""
        return replace(self, marker=marker)

    @property
    def turns(self) -> bool:
        """Whether the marker is on a plate."""
        return not self.directions

    @property
    def points(self) -> Weights:
        """The position as a weighted sum of the system's points; for a marker on a plate, its drawn position."""
        moved = zip(self.marker.offset.tolist(), self.directions, strict=False)
        return [*self.drawn, *((p, of * w) for of, way in moved if of != 0.0 for p, w in way)]

    def axes(self, x: Floats, R: Floats) -> Floats:
        """The derivatives (3, 3) of the marker's position by its offset, in columns; x, R: see `position`."""
        if self.turns:
            return R
        return np.column_stack([sum((w * x[p] for p, w in way), np.zeros(3)) for way in self.directions])

    def position(self, x: Floats, R: Floats) -> Floats:
        """Its position (3,) [m], with points at x (n_points, 3) [m], its plate turned by R (3, 3)."""
        found = sum((w * x[p] for p, w in self.points), np.zeros(3))
        return found + R @ self.marker.offset if self.turns else found


def directions_in(mesh: TetMesh, marker: Marker, first: int) -> tuple[Weights, ...]:
    """`MarkerPlace.directions` in a body.

    Parameters
    ----------
    mesh
        The body's mesh [m].
    marker
        The marker.
    first
        Number of the body's first point in the system.
    """
    nodes, rates = attach_directions(mesh, marker.at, where=marker.name)
    return tuple([(first + int(n), float(r)) for n, r in zip(nodes, column, strict=True)] for column in rates.T)
