"""Which point moves how, and where its unknowns stand.

Points are every body's nodes and the few extra ones that cables, masses and loads need. A point is free, fixed, or
rides on a rigid plate. Points and nodal pressures are the *entities* that terms connect; the unknowns z are the free
points, then six per plate, then the pressures, then the cables' tensions. The tangent of all but the tensions is a
sparse matrix; the few tensions border it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats, Ints

FREE, FIXED = -1, -2


@dataclass(frozen=True)
class Layout:
    """X: rest positions (n_points, 3) [m]; rider: FREE, FIXED or the plate's number, per point;
    references: rest positions of the plates' reference points (n_plates, 3) [m].
    """

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
    def n_entities(self) -> int:
        return self.n_points + self.n_pressures

    @cached_property
    def free_points(self) -> Ints:
        return np.flatnonzero(self.rider == FREE)

    @cached_property
    def rigid_points(self) -> Ints:
        return np.flatnonzero(self.rider >= 0)

    @cached_property
    def first_plate_unknown(self) -> int:
        return 3 * len(self.free_points)

    @cached_property
    def first_pressure_unknown(self) -> int:
        return self.first_plate_unknown + 6 * self.n_plates

    @cached_property
    def first_tension_unknown(self) -> int:
        """Also the size of the sparse matrix."""
        return self.first_pressure_unknown + self.n_pressures

    @cached_property
    def n_unknowns(self) -> int:
        return self.first_tension_unknown + self.n_cables
