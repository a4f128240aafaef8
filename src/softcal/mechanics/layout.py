"""Which point moves how, and where its unknowns stand.

Points are every body's nodes and the few extra ones that cables, masses and loads need. A point is free, fixed,
or rides on a rigid plate. Scalars are nodal pressures and cable tensions. Points and scalars together are the
*entities* that terms connect; the unknowns z are the free points, then six per plate, then the scalars.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats, Ints

FREE, FIXED = -1, -2


@dataclass(frozen=True)
class Layout:
    """X: rest positions (n_points, 3) [m]; rider: FREE, FIXED or the plate's number, per point;
    references: rest positions of the plates' reference points (n_plates, 3) [m]."""

    X: Floats
    rider: Ints
    references: Floats
    n_pressures: int
    n_cables: int

    @property
    def n_points(self) -> int:
        return len(self.X)

    @property
    def n_plates(self) -> int:
        return len(self.references)

    @property
    def n_scalars(self) -> int:
        return self.n_pressures + self.n_cables

    @property
    def n_entities(self) -> int:
        return self.n_points + self.n_scalars

    @property
    def free_points(self) -> Ints:
        return np.flatnonzero(self.rider == FREE)

    @property
    def rigid_points(self) -> Ints:
        return np.flatnonzero(self.rider >= 0)

    @property
    def first_plate_unknown(self) -> int:
        return 3 * len(self.free_points)

    @property
    def first_scalar_unknown(self) -> int:
        return self.first_plate_unknown + 6 * self.n_plates

    @property
    def n_unknowns(self) -> int:
        return self.first_scalar_unknown + self.n_scalars

    def pressure_entity(self, i: Ints | int) -> Ints | int:
        return self.n_points + i

    def cable_entity(self, i: Ints | int) -> Ints | int:
        return self.n_points + self.n_pressures + i
