"""The history of a solid's material at its quadrature points: its memory, and rates through it.

The law's distortional stress is changed by the parts of the history; the volumetric part, which carries the pressure of
a mixed element, stays elastic. The memory of a term is that of its points, one after the other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled
from softcal.materials.inelastic import Constants, History, Left, PointRates, Stressed
from softcal.materials.stress_at import NO_TANGENT, Deformation


@dataclass(frozen=True)
class Passed:
    """What a material with a history goes through from one sample to the next.

    Attributes
    ----------
    history
        The parts that change the law's stress.
    deformation
        The law at the points, at the sample.
    values
        The law's constants, in its order.
    constants
        Those of the history, by name.
    memory
        What the sample before left (n_points * size,).
    elapsed
        Time since then [s]; infinity where it was long.
    """

    history: History
    deformation: Deformation
    values: tuple[float, ...]
    constants: Constants
    memory: Floats
    elapsed: float

    def respond(self, *, tangent: bool) -> Left:
        """The material with its history."""
        at = self._elastic(tangent=True) if tangent else self._untangented
        return self.history.respond(at, self._by_point(self.memory), self.elapsed, self.constants)

    def rates(
        self, dF: Floats | None = None, memory: Floats | None = None, constant: int | str | None = None
    ) -> tuple[Floats, Floats]:
        """The rates of the stress (n, 6), and of the memory left (n_points * size,).

        dF: those of the deformation gradients (n, 3, 3); memory: of the one before; constant: the law's of this number,
        or the history's of this name, whose rate is one.
        """
        at = self._untangented if dF is None else self._elastic(tangent=True)
        by = PointRates(np.zeros_like(at.E), np.zeros_like(at.W), np.zeros_like(at.S))
        if dF is not None:
            half = np.einsum("nki,nkj->nij", self.deformation.at.F, dF)
            strain = doubled(0.5 * (half + np.swapaxes(half, 1, 2)))
            by = PointRates(strain, (at.S * strain).sum(axis=1), np.einsum("nab,nb->na", at.D, strain))
            at = at._replace(D=NO_TANGENT)
        changes: Mapping[str, float] = {}
        if isinstance(constant, int):
            energies, stresses = self._by_law
            by = PointRates(by.E, by.W + energies[constant], by.S + stresses[constant])
        elif constant is not None:
            changes = {constant: 1.0}
        own = self._by_point(self.memory)
        change = np.zeros_like(own) if memory is None else self._by_point(memory)
        after, left = self.history.rates(at, by, (own, change), self.elapsed, (self.constants, changes))
        return after.S, left.ravel()

    def _elastic(self, *, tangent: bool) -> Stressed:
        """The law alone."""
        F = self.deformation.at.F
        S, D = self.deformation.stress(self.values, tangent=tangent)
        strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(3))
        return Stressed(doubled(strain), self.deformation.energy(self.values), S, D)

    @cached_property
    def _untangented(self) -> Stressed:
        return self._elastic(tangent=False)

    @cached_property
    def _by_law(self) -> tuple[Floats, list[Floats]]:
        """Derivatives of the law's energy and stress by each of its constants."""
        return self.deformation.energy_by_parameters(self.values), self.deformation.stress_by_parameters(self.values)

    def _by_point(self, memory: Floats) -> Floats:
        return memory.reshape(-1, self.history.size)
