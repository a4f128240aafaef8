"""The supports of points, and the numbering of unknowns.

Points are every body's nodes and the few extra ones that actuators, masses and loads need. A point is free, fixed,
follows a frame, or is tied to other points as their weighted sum. A frame is a pose with six unknowns: a rigid plate's,
or that of a rod's cross-section. Points and nodal pressures are the *entities* that terms connect; the unknowns z are
the free points, then six per moving frame, then the pressures, then the actuators' efforts. The tangent of all but the
efforts is a sparse matrix; the few efforts border it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.links import NO_TIES, Links, Ties, compose

FREE, FIXED, TIED = -1, -2, -3


@dataclass(frozen=True)
class Layout:
    """The supports of the points, and the numbers of the unknowns.

    Attributes
    ----------
    X
        Positions of the points at rest (n_points, 3) [m].
    rider
        FREE, FIXED, TIED or the number of its frame, for each point (n_points,).
    references
        Reference points of the frames at rest (n_frames, 3) [m].
    n_pressures, n_actuators
        Numbers of nodal pressures and of efforts.
    n_fixed_frames
        Number of frames that do not move; they are the last ones.
    ties
        The masters of the tied points.
    """

    X: Floats
    rider: Ints
    references: Floats
    n_pressures: int
    n_actuators: int
    n_fixed_frames: int = 0
    ties: Ties = field(default=NO_TIES)

    @property
    def n_points(self) -> int:
        return len(self.X)

    @property
    def n_frames(self) -> int:
        """All frames, the fixed ones last."""
        return len(self.references)

    @property
    def n_moving_frames(self) -> int:
        return len(self.references) - self.n_fixed_frames

    @property
    def n_components(self) -> int:
        """The number of components of a gradient on all entities: three per point, one per pressure."""
        return 3 * self.n_points + self.n_pressures

    @property
    def n_entities(self) -> int:
        return self.n_points + self.n_pressures

    @cached_property
    def free_points(self) -> Ints:
        return np.flatnonzero(self.rider == FREE)

    @cached_property
    def links(self) -> Links:
        """The dependence of the points that are neither free nor fixed on the free ones and the moving frames."""
        rider = np.where(self.rider >= self.n_moving_frames, FIXED, self.rider)
        return compose(self.X, rider, rider == FREE, self.references, self.ties)

    @cached_property
    def first_frame_unknown(self) -> int:
        return 3 * len(self.free_points)

    @cached_property
    def first_pressure_unknown(self) -> int:
        return self.first_frame_unknown + 6 * self.n_moving_frames

    @cached_property
    def first_effort_unknown(self) -> int:
        """Also the size of the sparse matrix."""
        return self.first_pressure_unknown + self.n_pressures

    @cached_property
    def n_unknowns(self) -> int:
        return self.first_effort_unknown + self.n_actuators
