"""The elasticity of a rod's elements at their strains, and as a history takes it: by the elements' volume.

So energies are in J/m^3 and moduli and thresholds in Pa, as of solids.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.inelastic import Stressed
from softcal.materials.stress_at import NO_TANGENT
from softcal.mechanics import rod_kernels


@dataclass(frozen=True)
class RodLaw:
    """Elements of a rod.

    Attributes
    ----------
    by_bending, by_shear
        Their flexibility (n, 6, 6) is (by_bending + (1 + nu) by_shear) / E.
    volumes
        At rest (n,) [m^3].
    E, nu
        Young's modulus [Pa] and Poisson's ratio.
    strain
        (rho, theta) less those at rest (n, 6) [m, rad].
    """

    by_bending: Floats
    by_shear: Floats
    volumes: Floats
    E: float
    nu: float
    strain: Floats

    @cached_property
    def S(self) -> Floats:
        """The stiffness (n, 6, 6)."""
        return self._stiffness(self.E, self.nu)

    @cached_property
    def forces(self) -> Floats:
        """Forces and moments (n, 6) [N, N m]."""
        return _times(self.S, self.strain)

    @property
    def energies(self) -> Floats:
        """Energies of the elements (n,) [J]."""
        return 0.5 * (self.forces * self.strain).sum(axis=1)

    def stressed(self, *, tangent: bool) -> Stressed:
        """By volume."""
        volume = self.volumes[:, None]
        D = self.S / volume[:, None] if tangent else NO_TANGENT
        isochoric = self._stiffness(3.0, 0.5) / volume[:, None]
        return Stressed(self.strain, self.energies / self.volumes, self.forces / volume, D, isochoric)

    def by_constant(self, name: str) -> tuple[Floats, Floats] | None:
        """By volume, the derivatives of the energy (n,) and the forces (n, 6) by a constant; None of what is none."""
        stress = self.forces / (self.volumes[:, None] * self.E)
        if name == "poissons_ratio":
            stress = -_times(self.S, _times(self.by_shear, stress))
        elif name != "youngs_modulus":
            return None
        return 0.5 * (stress * self.strain).sum(axis=1), stress

    def _stiffness(self, E: float, nu: float) -> Floats:
        S = np.empty_like(self.by_bending)
        rod_kernels.stiffness(self.by_bending, self.by_shear, E, nu, S)
        return S


def _times(matrices: Floats, vectors: Floats) -> Floats:
    return np.einsum("nij,nj->ni", matrices, vectors)
