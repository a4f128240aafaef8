"""The law of a solid at its quadrature points, as a history takes it.

That is its distortional part; the volumetric one, which carries the pressure of a mixed element, stays elastic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled
from softcal.materials.inelastic import Stressed
from softcal.materials.stress_at import Deformation


@dataclass(frozen=True)
class SolidLaw:
    """The law at deformations; values: of its constants, in its order."""

    deformation: Deformation
    values: tuple[float, ...]

    def stressed(self, *, tangent: bool) -> Stressed:
        """The law alone."""
        return self._elastic(tangent=True) if tangent else self._untangented

    def by_constant(self, name: str) -> tuple[Floats, Floats] | None:
        """Derivatives of energy (n,) and stress (n, 6) by one of its constants; None of what is no constant of it."""
        names = self.deformation.law.parameters
        if name not in names:
            return None
        energies, stresses = self._by_constants
        return energies[names.index(name)], stresses[names.index(name)]

    def strain_rates(self, dF: Floats) -> Floats:
        """Those of the strains (n, 6), with doubled shears, by those of the deformation gradients (n, 3, 3)."""
        half = np.einsum("nki,nkj->nij", self.deformation.at.F, dF)
        return doubled(0.5 * (half + np.swapaxes(half, 1, 2)))

    def _elastic(self, *, tangent: bool) -> Stressed:
        F = self.deformation.at.F
        S, D = self.deformation.stress(self.values, tangent=tangent)
        strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(3))
        return Stressed(doubled(strain), self.deformation.energy(self.values), S, D)

    @cached_property
    def _untangented(self) -> Stressed:
        return self._elastic(tangent=False)

    @cached_property
    def _by_constants(self) -> tuple[Floats, list[Floats]]:
        return self.deformation.energy_by_parameters(self.values), self.deformation.stress_by_parameters(self.values)
