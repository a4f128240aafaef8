"""Dead loads: forces on points that keep their direction. Weight is one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.mechanics.term import ByTheta, Given, Sum, Term, Theta


@dataclass(frozen=True)
class Loads(Term):
    """Dead forces on the points by parameter: total = constant + sum of value * per_unit[name], (n_points, 3) [N].

    Weight is such a force: a body's density or a plate's mass times its force per unit.
    """

    constant: Floats
    per_unit: Mapping[str, Floats]

    @property
    def parameters(self) -> tuple[str, ...]:
        return tuple(self.per_unit)

    @cached_property
    def total(self) -> ByTheta[Floats]:
        """Force on every point (n_points, 3) [N] by the parameters' values."""
        return ByTheta(self._total)

    def _total(self, theta: Theta) -> Floats:
        force = self.constant.copy()
        for name, unit in self.per_unit.items():
            force += theta[name] * unit
        return force

    def add(self, into: Sum, given: Given) -> None:
        into.points -= given.controls.load * self.total(given.theta)

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        for name in into.keys() & self.per_unit.keys():
            into[name].points -= given.controls.load * self.per_unit[name]

    def add_by_load(self, into: Sum, given: Given) -> None:
        into.points -= self.total(given.theta)

    def energy(self, given: Given) -> float:
        return -given.controls.load * float(np.sum(self.total(given.theta) * given.state.x))
