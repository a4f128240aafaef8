"""Neo-Hookean laws."""

from __future__ import annotations

from softcal.materials.elastic_constants import BULK_MODULUS, SHEAR_MODULUS
from softcal.materials.law import Law

# mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2 with lambda = kappa - 2 mu/3. The volumetric part has kappa, not lambda:
# it is positive for every Poisson's ratio, and a mixed element with it is nearer to a fine mesh.
NEO_HOOKE = Law(
    name="neo-hooke",
    parameters={"youngs_modulus": "E", "poissons_ratio": "nu"},
    symbols={"mu": SHEAR_MODULUS, "kappa": BULK_MODULUS},
    distortional="mu/2*(I1 - 3) - mu*log(J) - mu/3*log(J)**2",
    volumetric_strain="log(J)",
    bulk="kappa",
    shear="mu",
    reference="Bonet and Wood (2008), compressible neo-Hookean material; SOFA's NeoHookean; paper A, Eqs. (2)-(3)",
    # With lambda < 0 an even compression to lengths below sqrt(-3 nu / (1 - 2 nu)) needs less and less pressure: 0.87
    # at -0.5, 0.98 at -0.9.
    lower={"poissons_ratio": -0.5},
)

# In CalculiX's and Abaqus' words C10 = mu/2 and D1 = 2/kappa.
NEO_HOOKE_ISOCHORIC = Law(
    name="neo-hooke-isochoric",
    parameters={"youngs_modulus": "E", "poissons_ratio": "nu"},
    symbols={"mu": SHEAR_MODULUS, "kappa": BULK_MODULUS},
    distortional="mu/2*(J**Rational(-2, 3)*I1 - 3)",
    volumetric_strain="J - 1",
    bulk="kappa",
    shear="mu",
    reference="Isochoric split of the neo-Hookean energy; CalculiX's and Abaqus' *HYPERELASTIC, NEO HOOKE",
)
