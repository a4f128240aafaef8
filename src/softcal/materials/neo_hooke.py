"""Neo-Hookean laws."""

from __future__ import annotations

from softcal.materials.elastic_constants import (
    BULK_MODULUS,
    LAME_MODULUS,
    POISSONS_RATIO,
    SHEAR_MODULUS,
    YOUNGS_MODULUS,
    poissons_ratio,
)
from softcal.materials.law import Law

# mu/2 (I1 - 3) - mu ln J + lambda/2 (ln J)^2, of which c mu/2 (ln J)^2 shifts from the first part to the second: the
# law is the same for every c. A mixed element needs M = lambda + c mu > 0, and c <= 2/3, so that the first part alone
# resists a change of volume that the pressure does not see. With c = 2/3 M is the bulk modulus, and nothing keeps a
# strongly compressed element from J = 0; with c = 0 it is lambda, which is no modulus where nu <= 0. Hence a c that
# goes from 2/3 at nu = -1/2 to 0 at 1/2, where it matters least.
TO_PRESSURE = "Rational(2, 3)*(1 - (nu + Rational(1, 2))**4)**2"
NEO_HOOKE = Law(
    name="neo-hooke",
    # With lambda < 0 a uniform compression to lengths below sqrt(-3 nu / (1 - 2 nu)) softens: 0.87
    # at -0.5, 0.98 at -0.9.
    parameters=(
        YOUNGS_MODULUS,
        poissons_ratio(-0.5),
    ),
    symbols={"mu": SHEAR_MODULUS, "lmbda": LAME_MODULUS, "c": TO_PRESSURE},
    distortional="mu/2*(I1 - 3) - mu*log(J) - c*mu/2*log(J)**2",
    volumetric_strain="log(J)",
    bulk="lmbda + c*mu",
    shifted="c*mu",
    reference="Bonet and Wood (2008), compressible neo-Hookean material; SOFA's NeoHookean; paper A, Eqs. (2)-(3)",
)

# In CalculiX's and Abaqus' words C10 = mu/2 and D1 = 2/kappa.
NEO_HOOKE_ISOCHORIC = Law(
    name="neo-hooke-isochoric",
    parameters=(YOUNGS_MODULUS, POISSONS_RATIO),
    symbols={"mu": SHEAR_MODULUS, "kappa": BULK_MODULUS},
    distortional="mu/2*(J**Rational(-2, 3)*I1 - 3)",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Isochoric split of the neo-Hookean energy; CalculiX's and Abaqus' *HYPERELASTIC, NEO HOOKE",
)
