"""Dead moments: couples on frames that keep their direction in space as the frames turn.

Such a couple has no potential: turned about two axes in either order, it does different work. Its part of the tangent
is therefore not symmetric. The tangents of the other terms are second derivatives by exp(omega) R; that of their
gradient g along a further turn omega' differs by 1/2 omega' x g. In equilibrium a frame's g is the moment m on it, so
that the tangent needs -1/2 m x, which has rank two and borders it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.layout import Layout
from softcal.mechanics.term import Given, Sum, Term, Theta


@dataclass(frozen=True)
class Moments(Term):
    """Dead moments on frames by parameter: total = sum of value * per_unit[name], (n_frames, 3) [N m].

    Attributes
    ----------
    layout
        Numbers of the frames' unknowns.
    per_unit
        Parameter -> moments on all frames per unit of it (n_frames, 3) [-].
    """

    layout: Layout
    per_unit: Mapping[str, Floats]

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(self.per_unit)

    def total(self, theta: Theta) -> Floats:
        """Moment on every frame (n_frames, 3) [N m]."""
        return sum((theta[name] * unit for name, unit in self.per_unit.items()), np.zeros((self.layout.n_frames, 3)))

    def add(self, into: Sum, given: Given) -> None:
        if not self.per_unit:
            return
        moments = given.controls.load * self.total(given.theta)
        self._add(into, moments)
        into.squares += float(np.square(moments).sum()) / self._extent**2
        if into.data is not None:
            # -1/2 m x on a frame's rotation, as two products of a column and a row (n_unknowns - n_actuators,).
            for frame in np.flatnonzero(moments[: self.layout.n_moving_frames].any(axis=1)):
                size = float(np.linalg.norm(moments[frame]))
                e3 = moments[frame] / size
                e1 = np.cross(e3, np.eye(3)[np.argmin(np.abs(e3))])
                e1 /= np.linalg.norm(e1)
                e2 = np.cross(e3, e1)
                at = self.layout.first_frame_unknown + 6 * int(frame) + 3
                for column, row in ((e1, e2), (-e2, e1)):
                    whole = np.zeros((2, self.layout.first_effort_unknown))
                    whole[0, at : at + 3], whole[1, at : at + 3] = 0.5 * size * column, row
                    into.rank_one_own.append((whole[0], whole[1]))

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        for name in into.keys() & self.per_unit.keys():
            self._add(into[name], given.controls.load * self.per_unit[name])

    def add_by_load(self, into: Sum, given: Given) -> None:
        self._add(into, self.total(given.theta))

    def energy(self, given: Given) -> float:
        """None: a dead moment has no potential."""
        return 0.0

    @property
    def _extent(self) -> float:
        return float(np.linalg.norm(np.ptp(self.layout.X, axis=0)))

    def _add(self, into: Sum, moments: Floats) -> None:
        layout = self.layout
        frames = into.own[layout.first_frame_unknown : layout.first_pressure_unknown].reshape(-1, 6)
        frames[:, 3:] -= moments[: layout.n_moving_frames]
