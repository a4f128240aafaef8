"""The law of a solid at its quadrature points, as a history takes it.

That is its own first part, psi_d with what a law shifts to the volumetric one (`Law.shifted`); the rest stays elastic.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import doubled
from softcal.materials.inelastic import Stressed
from softcal.materials.law import stacked
from softcal.materials.stress_at import NO_TANGENT, Deformation, Stress, add_volumetric, volumetric


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
        """Rates of the strains (n, 6), with doubled shears, by those of the deformation gradients (n, 3, 3)."""
        half = np.einsum("nki,nkj->nij", self.deformation.at.F, dF)
        return doubled(0.5 * (half + np.swapaxes(half, 1, 2)))

    def _elastic(self, *, tangent: bool) -> Stressed:
        F = self.deformation.at.F
        J, shifted = self.deformation.at.J, self._shifted[0]
        S, D = self.deformation.stress(self.values, volumetric(self.deformation.law, J, shifted), tangent=tangent)
        strain = 0.5 * (np.einsum("nki,nkj->nij", F, F) - np.eye(3))
        return Stressed(doubled(strain), self.deformation.energy(self.values) + shifted * self._of_volume, S, D)

    @cached_property
    def _untangented(self) -> Stressed:
        return self._elastic(tangent=False)

    @cached_property
    def _by_constants(self) -> tuple[Floats, list[Floats]]:
        law, at = self.deformation.law, self.deformation.at
        energies = self.deformation.energy_by_parameters(self.values)
        stresses = self.deformation.stress_by_parameters(self.values)
        for i, change in enumerate(self._shifted[1]):
            energies[i] += change * self._of_volume
            add_volumetric(Stress(stresses[i], NO_TANGENT), at, volumetric(law, at.J, change))
        return energies, stresses

    @cached_property
    def _shifted(self) -> tuple[float, list[float]]:
        """The modulus that the law shifts to the volumetric part [Pa], and its derivatives by the constants."""
        shifted, by_constants = self.deformation.law.shifted(*self.values)
        return float(shifted), [float(one) for one in by_constants]

    @cached_property
    def _of_volume(self) -> Floats:
        """g^2/2 (n,), the energy of a volumetric modulus of one."""
        J = self.deformation.at.J
        return 0.5 * stacked(self.deformation.law.strain(J), len(J))[0] ** 2
