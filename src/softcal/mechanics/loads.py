"""Dead loads: forces on points that keep their direction. Weight is one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.term import ByTheta, Given, Sum, Term, Theta
from softcal.quantities import GRAVITY


@dataclass(frozen=True)
class Loads(Term):
    """Dead forces on the points (n_points, 3) [N]: total = constant + sum of value * per_unit[name] + sum of value *
    weighed[name] g, with the acceleration g of `GRAVITY`.

    Attributes
    ----------
    constant
        Forces (n_points, 3) [N] that no parameter changes.
    per_unit
        Parameter -> force (n_points, 3) [N] per unit of it.
    weighed
        Density of a material or mass of a plate -> mass (n_points,) [kg] of each point per unit of it.
    """

    constant: Floats
    per_unit: Mapping[str, Floats]
    weighed: Mapping[str, Floats] = field(default_factory=dict[str, Floats])

    @property
    def parameters(self) -> tuple[str, ...]:
        return (*self.per_unit, *self.weighed, *(GRAVITY if self.weighed else ()))

    @cached_property
    def total(self) -> ByTheta[Floats]:
        """Force on every point (n_points, 3) [N] by the parameters' values."""
        return ByTheta(self._total)

    def _total(self, theta: Theta) -> Floats:
        force = self.constant.copy()
        for name, unit in self.per_unit.items():
            force += theta[name] * unit
        if self.weighed:
            force += self._masses(theta)[:, None] * self._gravity(theta)
        return force

    def _masses(self, theta: Theta) -> Floats:
        return sum((theta[name] * mass for name, mass in self.weighed.items()), np.zeros(len(self.constant)))

    def _gravity(self, theta: Theta) -> Floats:
        return np.array([theta[name] for name in GRAVITY])

    def add(self, into: Sum, given: Given) -> None:
        into.points -= given.controls.load * self.total(given.theta)

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        load, theta = given.controls.load, given.theta
        for name in into.keys() & self.per_unit.keys():
            into[name].points -= load * self.per_unit[name]
        for name in into.keys() & self.weighed.keys():
            into[name].points -= load * self.weighed[name][:, None] * self._gravity(theta)
        if self.weighed:
            for axis, name in enumerate(GRAVITY):
                if name in into:
                    into[name].points[:, axis] -= load * self._masses(theta)

    def add_by_load(self, into: Sum, given: Given) -> None:
        into.points -= self.total(given.theta)

    def energy(self, given: Given) -> float:
        return -given.controls.load * float(np.sum(self.total(given.theta) * given.state.x))
