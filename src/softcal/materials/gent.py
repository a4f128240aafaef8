"""Gent's law: a neo-Hookean energy of chains that can be stretched so far only."""

from __future__ import annotations

from softcal.materials.isochoric import BULK
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

# Above I1_bar - 3 = Jm the energy does not exist: NaN there tells the solver to take a shorter step.
GENT = Law(
    name="gent",
    parameters=(
        Parameter("shear_modulus", "mu", "μ", QUANTITIES["modulus"], typical=4e5),
        Parameter("limit", "Jm", "J_m", QUANTITIES["positive ratio"], typical=50.0),
        BULK,
    ),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional="-mu*Jm/2*log(1 - (I1_bar - 3)/Jm)",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Gent, Rubber Chemistry and Technology 69 (1996) 59",
)
