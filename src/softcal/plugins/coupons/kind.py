"""The kinds of coupon test, in closed form: the deformation of an incompressible coupon, and the measured stress; and
what a law predicts of them.

Of principal stretches lambda1, lambda2 and lambda3 = 1/(lambda1 lambda2) the third side is free: the pressure keeps its
stress zero, so that the nominal stresses are

    P_i = lambda_i S_i - lambda3^2 S_3 / lambda_i,    i = 1, 2

S being the second Piola-Kirchhoff stress of the energy alone. In simple shear, F = I + gamma e1 e2, the pressure does
not enter the shear stress P_12 = S_12 + gamma S_22, which is nominal and true at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from softcal.checks import Floats
from softcal.materials.components import PAIRS
from softcal.materials.law import Law, compile_law
from softcal.materials.stress_at import Deformation, Points, points

_SHEAR = PAIRS.index((0, 1))


@dataclass(frozen=True)
class CouponStates:
    """The states of a test.

    Attributes
    ----------
    points
        Deformation of the n states.
    by_stress
        The k measured nominal stresses by the components of S, shape (k, n, 6) [-].
    """

    points: Points
    by_stress: Floats


@dataclass(frozen=True)
class CouponKind:
    """A kind of coupon test.

    Attributes
    ----------
    name
        What the option `--test` calls it.
    axes
        What ends the names of the measured columns, one for each of k axes.
    strains
        Name of a column -> the strain that `states` takes, from its values.
    stresses
        Name of a column -> the nominal stress [Pa], from its values and that strain.
    states
        From the strains (n, k) to the states.
    smallest
        The strain [-] that must be exceeded, or None.
    """

    name: str
    axes: tuple[str, ...]
    strains: Mapping[str, Callable[[Floats], Floats]]
    stresses: Mapping[str, Callable[[Floats, Floats], Floats]]
    states: Callable[[Floats], CouponStates]
    smallest: float | None = 0.0

    @property
    def at_rest(self) -> float:
        """The strain at rest [-]: of a stretch one."""
        return 1.0 if self.smallest is not None else 0.0

    @property
    def components(self) -> tuple[str, ...]:
        """Names of the stresses, one for each axis."""
        return tuple(f"stress{axis}" for axis in self.axes)


def principal_states(first: Floats, second: Floats, n_measured: int) -> CouponStates:
    """The states of a coupon that is stretched along two axes.

    Parameters
    ----------
    first, second
        Stretches (n,) along the axes [-].
    n_measured
        Number of axes whose stress is measured: 1, the first, or 2.
    """
    stretches = np.stack([first, second, 1.0 / (first * second)], axis=1)
    by_stress = np.zeros((n_measured, len(first), 6))
    for i in range(n_measured):
        by_stress[i, :, i] = stretches[:, i]
        by_stress[i, :, 2] = -(stretches[:, 2] ** 2) / stretches[:, i]
    return CouponStates(points(stretches[:, :, None] * np.eye(3)), by_stress)


def _sheared(strain: Floats) -> CouponStates:
    gamma = strain[:, 0]
    F = np.tile(np.eye(3), (len(gamma), 1, 1))
    F[:, 0, 1] = gamma
    by_stress = np.zeros((1, len(gamma), 6))
    by_stress[0, :, _SHEAR], by_stress[0, :, 1] = 1.0, gamma
    return CouponStates(points(F), by_stress)


_STRETCHES: Mapping[str, Callable[[Floats], Floats]] = {
    "stretch": lambda values: values,
    "engineering_strain": lambda values: 1.0 + values,
}
# At constant volume the true stress is the nominal one times the stretch along it.
_STRESSES: Mapping[str, Callable[[Floats, Floats], Floats]] = {
    "nominal_stress": lambda values, _: values,
    "true_stress": lambda values, stretch: values / stretch,
}


def _stretched(name: str, second: Callable[[Floats], Floats]) -> CouponKind:
    """A test along one axis; second: stretch along the next one by that stretch."""
    return CouponKind(name, ("",), _STRETCHES, _STRESSES, lambda x: principal_states(x[:, 0], second(x[:, 0]), 1))


_KINDS = (
    _stretched("uniaxial", lambda stretch: stretch**-0.5),
    _stretched("planar", np.ones_like),
    _stretched("equibiaxial", lambda stretch: stretch),
    CouponKind("biaxial", ("_1", "_2"), _STRETCHES, _STRESSES, lambda x: principal_states(x[:, 0], x[:, 1], 2)),
    CouponKind(
        "shear",
        ("",),
        dict.fromkeys(("amount_of_shear", "shear_gamma"), lambda values: values),
        dict.fromkeys(("shear_stress", "nominal_shear_stress"), lambda values, _: values),
        _sheared,
        smallest=None,
    ),
)
KINDS: Mapping[str, CouponKind] = {kind.name: kind for kind in _KINDS}


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
