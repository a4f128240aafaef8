"""Arruda's and Boyce's law: eight chains of limited length, as a series of five terms."""

from __future__ import annotations

from softcal.materials.isochoric import BULK
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

_LOCKING = Parameter("locking_stretch", "lm", "λ_m", QUANTITIES["locking stretch"], typical=3.0)
_COEFFICIENTS = (
    "1/2",
    "1/20",
    "11/1050",
    "19/7000",
    "519/673750",
)


def series(square: str) -> str:
    """The energy over the chains' modulus, with this square of the locking stretch."""
    return " + ".join(
        f"{factor}/({square})**{k}*(I1_bar**{k + 1} - {3 ** (k + 1)})" for k, factor in enumerate(_COEFFICIENTS)
    )


CHAIN_MODULUS = Parameter("chain_modulus", "mu", "μ", QUANTITIES["modulus"], typical=4e5)
ARRUDA_BOYCE = Law(
    name="arruda-boyce",
    parameters=(CHAIN_MODULUS, _LOCKING, BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional=f"mu*({series('lm**2')})",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389; "
    "CalculiX's and Abaqus' *HYPERELASTIC, ARRUDA-BOYCE",
)
