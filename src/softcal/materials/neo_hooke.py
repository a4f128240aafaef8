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
