"""Neo-Hookean laws."""

from __future__ import annotations

from softcal.materials.elastic_constants import LAME_LAMBDA, SHEAR_MODULUS
from softcal.materials.law import Law

NEO_HOOKE = Law(
    name="neo-hooke",
    parameters={"youngs_modulus": "E", "poissons_ratio": "nu"},
    symbols={"mu": SHEAR_MODULUS, "lmbda": LAME_LAMBDA},
    distortional="mu/2*(I1 - 3) - mu*log(J)",
    volumetric_strain="log(J)",
    bulk="lmbda",
    shear="mu",
    reference="Bonet and Wood (2008), compressible neo-Hookean material; SOFA's NeoHookean; paper A, Eqs. (2)-(3)",
)

# In CalculiX's and Abaqus' words C10 = mu/2 and D1 = 2/kappa.
NEO_HOOKE_ISOCHORIC = Law(
    name="neo-hooke-isochoric",
    parameters={"youngs_modulus": "E", "poissons_ratio": "nu"},
    symbols={"mu": SHEAR_MODULUS, "kappa": "E/(3*(1 - 2*nu))"},
    distortional="mu/2*(J**Rational(-2, 3)*I1 - 3)",
    volumetric_strain="J - 1",
    bulk="kappa",
    shear="mu",
    reference="Isochoric split of the neo-Hookean energy; CalculiX's and Abaqus' *HYPERELASTIC, NEO HOOKE",
)
