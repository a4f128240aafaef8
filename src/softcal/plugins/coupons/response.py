"""What a law predicts of a coupon test: nominal stresses, and their derivatives by the law's constants."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.law import Law, compile_law
from softcal.materials.stress_at import Deformation
from softcal.plugins.coupons.kind import CouponStates


class LawResponse:
    """The nominal stresses of a law in the states of a test."""

    def __init__(self, law: Law, states: CouponStates) -> None:
        self._law, self._states = law, states

    @cached_property
    def _deformation(self) -> Deformation:
        return Deformation(compile_law(self._law), self._states.points)

    def stress(self, values: tuple[float, ...]) -> Floats:
        """Nominal stresses (n, k) [Pa] at the values of all constants; not finite where the energy does not exist."""
        with np.errstate(all="ignore"):
            S = self._deformation.stress(values, tangent=False).S
            return np.einsum("knc,nc->nk", self._states.by_stress, S)

    def by_constants(self, values: tuple[float, ...]) -> Floats:
        """Their derivatives (n, k, constants)."""
        with np.errstate(all="ignore"):
            dS = np.array(self._deformation.stress_by_parameters(values))
            return np.einsum("knc,pnc->nkp", self._states.by_stress, dS)
