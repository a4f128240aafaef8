"""A term that remembers, and all that one takes: points on springs whose feet slip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.checks import Floats, Ints
from softcal.mechanics.layout import Layout
from softcal.mechanics.pattern import Pattern
from softcal.mechanics.state import State
from softcal.mechanics.term import Connectivity, Given, Sum, Term


@dataclass(frozen=True)
class SliderFoundation(Term):
    """Springs under some points, elastic and then plastic: f = k d of their stretch d = x - X - s, and where that would
    be more than f_y, f = f_y d/|d|: the feet slip by s -> x - X - f/k (return mapping). Memory: the slips s.
    """

    points: Ints
    X: Floats
    name: str = "slider"
    places: Ints | None = None

    @property
    def parameters(self) -> tuple[str, str]:
        return f"{self.name}.stiffness", f"{self.name}.yield_force"

    def connectivity(self, layout: Layout) -> Connectivity:
        return Connectivity([self.points[:, None]])

    def plan(self, layout: Layout, pattern: Pattern) -> SliderFoundation:
        return replace(self, places=pattern.blocks(self.points[:, None])[:, 0])

    def first_memory(self) -> Floats:
        return np.zeros(3 * len(self.points))

    def advance(self, given: Given) -> Floats:
        spring = self._springs(given)
        return (spring.slip + spring.stretch - spring.force / spring.k).ravel()

    def add_by_memory(self, into: Sum, given: Given, rate: Floats) -> None:
        into.points[self.points] -= self._springs(given).by_stretch(rate.reshape(-1, 3))

    def advance_rate(self, given: Given, parameter: str, rate: State, memory_rate: Floats) -> Floats:
        spring, slips, moves = self._springs(given), memory_rate.reshape(-1, 3), rate.x[self.points]
        forces = spring.by_stretch(moves - slips) + self._by(parameter, spring)
        out = moves - forces / spring.k
        if parameter == self.parameters[0]:
            out += spring.force / spring.k**2
        return out.ravel()

    def add(self, into: Sum, given: Given) -> None:
        spring = self._springs(given)
        into.points[self.points] += spring.force
        if into.data is not None:
            for i in range(3):
                for j in range(i, 3):
                    np.add.at(into.data, self.places[:, i] + j, spring.tangent[:, i, j])

    def add_by_parameters(self, into: Mapping[str, Sum], given: Given) -> None:
        for name in into.keys() & set(self.parameters):
            into[name].points[self.points] += self._by(name, self._springs(given))

    def energy(self, given: Given) -> float:
        spring = self._springs(given)
        elastic = 0.5 * spring.k * spring.length**2
        sliding = spring.most * spring.length - 0.5 * spring.most**2 / spring.k
        return float(np.where(spring.slides, sliding, elastic).sum())

    def _springs(self, given: Given) -> Springs:
        slip = given.memory.reshape(-1, 3)
        stretch = given.state.x[self.points] - self.X[self.points] - slip
        return Springs(*(given.theta[name] for name in self.parameters), slip, stretch)

    def _by(self, parameter: str, spring: Springs) -> Floats:
        """d force / d parameter (n, 3)."""
        if parameter not in self.parameters:
            return np.zeros_like(spring.stretch)
        slides = spring.slides[:, None]
        is_stiffness = parameter == self.parameters[0]
        return np.where(slides, 0.0, spring.stretch) if is_stiffness else np.where(slides, spring.way, 0.0)


@dataclass(frozen=True)
class Springs:
    """Springs at stretches (n, 3) [m]: stiffness k [N/m], largest force [N], slips (n, 3) [m]."""

    k: float
    most: float
    slip: Floats
    stretch: Floats

    @property
    def length(self) -> Floats:
        return np.linalg.norm(self.stretch, axis=1)

    @property
    def slides(self) -> np.ndarray:
        return self.k * self.length > self.most

    @property
    def way(self) -> Floats:
        return self.stretch / np.maximum(self.length, 1e-300)[:, None]

    @property
    def force(self) -> Floats:
        return np.where(self.slides[:, None], self.most * self.way, self.k * self.stretch)

    @property
    def tangent(self) -> Floats:
        across = np.eye(3) - self.way[:, :, None] * self.way[:, None, :]
        sliding = (self.most / np.maximum(self.length, self.most / self.k))[:, None, None] * across
        return np.where(self.slides[:, None, None], sliding, self.k * np.eye(3))

    def by_stretch(self, rate: Floats) -> Floats:
        return np.einsum("nij,nj->ni", self.tangent, rate)
