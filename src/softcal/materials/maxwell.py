"""Maxwell branches at large strains: springs in series with dashpots, beside the law.

Each branch has the energy mu_i |A - A_i|^2 in a strain A of exponent m (`strain_measure.py`), and its inner strain A_i
follows at a rate (A - A_i) / tau_i. So its elastic strain h_i = A - A_i obeys

    dh_i/dt + h_i / tau_i = dA/dt,    S += sum_i 2 mu_i h_i : dA/dE

exact where A changes at a constant rate from one sample to the next. The branch is linear in A, and what it dissipates,
2 mu_i |h_i|^2 / tau_i, is never below zero. `relaxation` relaxes the second Piola-Kirchhoff stress of the law instead,
whose components turn and grow with the strain where the body is still: at a large shear it is no measure of the stress.

Liu, Guan, Zhao and Luo, Comput. Methods Appl. Mech. Engrg. 430 (2024) 117248.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softcal.checks import Floats
from softcal.materials.branches import Branches, stacked
from softcal.materials.components import TWICE
from softcal.materials.inelastic import Constants, Inelastic, Left, PointRates, Stressed
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

if TYPE_CHECKING:
    from softcal.materials.strain_measure import MeasuredStrain

EXPONENT = "branch_exponent"


@dataclass(frozen=True)
class Maxwell(Inelastic):
    """branches: their number. Its memory at a point: A of the previous sample, then h_i of each branch."""

    branches: int

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        own = [
            parameter
            for i in range(1, self.branches + 1)
            for parameter in (
                Parameter(modulus_of(i), f"mu_b{i}", f"μ_b{i}", QUANTITIES["modulus"], typical=2e5 / i),
                Parameter(time_of(i), f"tau_b{i}", f"τ_b{i}", QUANTITIES["relaxation time"], typical=0.1 * 10.0**i),
            )
        ]
        return (*own, Parameter(EXPONENT, "m_b", "m_b", QUANTITIES["exponent"], typical=1.0, default=0.0))

    @property
    def size(self) -> int:
        return self._kept.size

    @property
    def needs_time(self) -> bool:
        return True

    @property
    def of_sections(self) -> bool:
        return False  # it measures the strain of a solid

    def respond(self, at: Stressed, memory: Floats, elapsed: float, constants: Constants) -> Left:
        """The response of the material with the branches parallel to the law. Arguments: see `Inelastic.respond`."""
        mu = stacked(constants, self._moduli)
        strain = _measured(at, constants)
        kept = self._kept.follow(strain.A, memory, elapsed, constants)
        T = 2.0 * np.einsum("b,nbm->nm", mu, kept.h) / TWICE
        slopes, bend = strain.derivatives(T, second=len(at.D) > 0)
        stiffness, tangent = float(mu @ kept.a), at.D
        if len(tangent):
            tangent = tangent + bend + 2.0 * stiffness * np.einsum("nak,a,nal->nkl", slopes, 1.0 / TWICE, slopes)
        past = stiffness * strain.A + 2.0 * np.einsum("b,nbm->nm", mu, kept.past)
        W = at.W + (past * strain.A / TWICE).sum(axis=1)
        return Left(at._replace(W=W, S=at.S + np.einsum("na,nak->nk", T, slopes), D=tangent), kept.memory)

    def rates(
        self,
        at: Stressed,
        by: PointRates,
        memory: tuple[Floats, Floats],
        elapsed: float,
        constants: tuple[Constants, Constants],
    ) -> tuple[PointRates, Floats]:
        """See `Inelastic.rates`."""
        values, changes = constants
        mu, dmu = (stacked(one, self._moduli) for one in constants)
        dm = np.asarray(changes.get(EXPONENT, 0.0))
        strain = _measured(at, values)
        A, kept = strain.A, self._kept.follow(strain.A, memory[0], elapsed, values)
        T = 2.0 * np.einsum("b,nbm->nm", mu, kept.h) / TWICE
        moved = bool(by.E.any())
        slopes, bend = strain.derivatives(T, second=moved)
        dA, dS = np.einsum("nak,nk->na", slopes, by.E), np.zeros_like(by.S)
        if moved:
            dS += np.einsum("nkl,nl->nk", bend, by.E)
        if dm.any():
            dA_dm, dS_dm = strain.by_exponent(T)
            dA, dS = dA + dm[..., None] * dA_dm, dS + dm[..., None] * dS_dm
        rates = self._kept.rates((A, dA), memory, elapsed, constants)
        dT = 2.0 * (dmu[..., None] * kept.h + mu[:, None] * rates.h).sum(axis=1) / TWICE
        S = by.S + dS + np.einsum("na,nak->nk", dT, slopes)
        changed = (dmu * kept.a + mu * rates.a).sum(axis=-1)[..., None] * A
        changed = changed + 2.0 * (dmu[..., None] * kept.past + mu[:, None] * rates.past).sum(axis=1)
        W = by.W + (T * dA).sum(axis=1) + (changed * A / TWICE).sum(axis=1)
        return PointRates(by.E, W, S), rates.memory

    @property
    def _kept(self) -> Branches:
        return Branches(tuple(time_of(i) for i in range(1, self.branches + 1)))

    @property
    def _moduli(self) -> list[str]:
        return [modulus_of(i) for i in range(1, self.branches + 1)]


def modulus_of(branch: int) -> str:
    """The name of the modulus of a branch, counted from 1."""
    return f"branch_modulus{branch}"


def time_of(branch: int) -> str:
    """The name of the relaxation time of a branch, counted from 1."""
    return f"branch_time{branch}"


def _measured(at: Stressed, constants: Constants) -> MeasuredStrain:
    from softcal.materials.strain_measure import MeasuredStrain  # whose kernels take long to load

    return MeasuredStrain(at.E, constants[EXPONENT])
