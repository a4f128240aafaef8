"""Bodies that are stiffer along directions than across: printed in layers, or with fibres wound around an axis."""

from __future__ import annotations

from softcal.materials.elastic_constants import BULK_MODULUS, POISSONS_RATIO, SHEAR_MODULUS, YOUNGS_MODULUS
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

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
