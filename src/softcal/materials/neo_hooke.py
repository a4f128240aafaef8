"""Neo-Hookean laws: compressible, isochoric, finite at J = 0 and beyond for robots in motion; and of bodies that are
stiffer along directions than across, printed in layers or with fibres wound around an axis.
"""

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
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

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
    parameters=(YOUNGS_MODULUS, poissons_ratio(-0.5)),
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

# The same c as neo-hooke's, as at rest both first parts have the same second derivatives: with c > 2/3 they would give
# way to changes of volume that the linear pressure does not see.
# Below nu = -0.3 a compressed body would have less energy than at rest. SOFA writes
# (lmbda + mu)/2 (J - 1 - mu/(lmbda + mu))^2, which differs by a constant.
STABLE_NEO_HOOKE = Law(
    name="stable-neo-hooke",
    parameters=(YOUNGS_MODULUS, poissons_ratio(-0.25)),
    symbols={"mu": SHEAR_MODULUS, "lmbda": LAME_MODULUS, "c": TO_PRESSURE},
    distortional="mu/2*(I1 - 3) - mu*(J - 1) + (1 - c)*mu/2*(J - 1)**2",
    volumetric_strain="J - 1",
    bulk="lmbda + c*mu",
    shifted="c*mu",
    reference="Smith, de Goes and Kim, ACM Trans. Graph. 37 (2018) 12, as of Kim and Eberle (2022); SOFA's "
    "StableNeoHookean",
)

# A neo-Hookean body with c/2 (I4_bar - 1 - ln I4_bar) of the squared stretch along the direction; about rest that is
# c/4 (I4_bar - 1)^2. Of an incompressible body the stiffness along it is 3 mu + 2 c = 3 mu times the ratio. Unlike the
# square, it is convex at any stretch for c > -mu, which is a ratio above 1/3.
NEO_HOOKE_LAYERED = Law(
    name="neo-hooke-layered",
    parameters=(
        YOUNGS_MODULUS,
        POISSONS_RATIO,
        Parameter("build_ratio", "r", "r", QUANTITIES["build ratio"], typical=1.6),
    ),
    symbols={
        "mu": SHEAR_MODULUS,
        "kappa": BULK_MODULUS,
        "c": "Rational(3, 2)*mu*(r - 1)",
        "I4_bar": "J**Rational(-2, 3)*I4",
    },
    distortional="mu/2*(J**Rational(-2, 3)*I1 - 3) + c/2*(I4_bar - 1 - log(I4_bar))",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Transversely isotropic, after Spencer (1984), Continuum Theory of the Mechanics of Fibre-Reinforced "
    "Composites; the energy of the direction is softcal's",
)

# The same energy of two families, half of the fibres each: Ef/8 (I4_bar - 1 - ln I4_bar), about rest Ef/4 strain^2. So
# fibres of one direction, in both families, add Ef to the modulus along it.
NEO_HOOKE_FIBRES = Law(
    name="neo-hooke-fibres",
    parameters=(
        YOUNGS_MODULUS,
        POISSONS_RATIO,
        Parameter("fibre_modulus", "Ef", "E_f", QUANTITIES["fibre modulus"], typical=1e7),
    ),
    symbols={
        "mu": SHEAR_MODULUS,
        "kappa": BULK_MODULUS,
        "I4_bar": "J**Rational(-2, 3)*I4",
        "I6_bar": "J**Rational(-2, 3)*I6",
    },
    distortional="mu/2*(J**Rational(-2, 3)*I1 - 3) + Ef/8*(I4_bar - 1 - log(I4_bar) + I6_bar - 1 - log(I6_bar))",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Two families of fibres, after Spencer (1984), Continuum Theory of the Mechanics of Fibre-Reinforced "
    "Composites; the energy of the fibres is softcal's",
)
