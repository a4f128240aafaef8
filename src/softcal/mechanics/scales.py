"""The sizes by which a robot's equations are scaled, collected from its terms."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.layout import Layout
from softcal.mechanics.state import State, rest_state


@dataclass
class Sizes:
    """Collected from terms (`Term.measure`).

    Attributes
    ----------
    shear_modulus
        The largest [Pa].
    volume, meshed
        Volume of all material, and of the tets alone [m^3].
    n_tets
        Number of tets.
    stiffness
        Diagonal of the frames' own tangent at rest (n_unknowns,) [N/m, or N m].
    rest, extent
        The undeformed robot, and its size [m].
    """

    layout: Layout
    shear_modulus: float = 0.0
    volume: float = 0.0
    meshed: float = 0.0
    n_tets: int = 0
    stiffness: Floats = field(init=False)
    rest: State = field(init=False)
    extent: float = field(init=False)

    def __post_init__(self) -> None:
        self.stiffness = np.zeros(self.layout.n_unknowns)
        self.rest = rest_state(self.layout)
        self.extent = float(np.linalg.norm(np.ptp(self.layout.X, axis=0)))

    @property
    def force(self) -> float:
        """A force [N] that bends the whole robot visibly: shear modulus times the square of area over length."""
        return self.shear_modulus * (self.volume / self.extent**2) ** 2

    def positions(self) -> Ints:
        """Unknowns that are positions: of free points, and of moving frames, on which material rides."""
        first = self.layout.first_frame_unknown
        frames = np.arange(first, self.layout.first_pressure_unknown).reshape(-1, 6)
        return np.concatenate([np.arange(first), frames[:, :3].ravel()])

    def units(self) -> Floats:
        """Units of the unknowns in which the tangent's entries are of one size; pivots are compared with each other.

        That size is the one of a free point's entries in metres: shear modulus times length of an element.
        """
        layout = self.layout
        h = (6.0 * self.meshed / self.n_tets) ** (1.0 / 3.0) if self.n_tets else self.extent
        unit = np.ones(layout.first_effort_unknown)
        of_frames = slice(layout.first_frame_unknown, layout.first_pressure_unknown)
        frames, stiffness = unit[of_frames].reshape(-1, 6), self.stiffness[of_frames].reshape(-1, 6)
        frames[:, 3:] = 4.0 / self.extent
        stiff = stiffness[:, 0] > 0.0
        for part in (slice(0, 3), slice(3, 6)):
            frames[stiff, part] = np.sqrt(self.shear_modulus * h / stiffness[stiff, part].mean(axis=1))[:, None]
        unit[layout.first_pressure_unknown :] = self.shear_modulus / h
        return unit
