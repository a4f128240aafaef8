"""The stable neo-Hookean law: finite at J = 0 and beyond, for robots in motion."""

from __future__ import annotations

from softcal.materials.elastic_constants import LAME_MODULUS, SHEAR_MODULUS, YOUNGS_MODULUS, poissons_ratio
from softcal.materials.law import Law
from softcal.materials.neo_hooke import TO_PRESSURE

# The same c as neo-hooke's, as at rest both first parts have the same second derivatives: with c > 2/3 they would give
# way to changes of volume that the linear pressure does not see.
# Below nu = -0.3 a compressed body would have less energy than at rest. SOFA writes
# (lmbda + mu)/2 (J - 1 - mu/(lmbda + mu))^2, which differs by a constant.
STABLE_NEO_HOOKE = Law(
    name="stable-neo-hooke",
    parameters=(
        YOUNGS_MODULUS,
        poissons_ratio(-0.25),
    ),
    symbols={"mu": SHEAR_MODULUS, "lmbda": LAME_MODULUS, "c": TO_PRESSURE},
    distortional="mu/2*(I1 - 3) - mu*(J - 1) + (1 - c)*mu/2*(J - 1)**2",
    volumetric_strain="J - 1",
    bulk="lmbda + c*mu",
    shifted="c*mu",
    reference="Smith, de Goes and Kim, ACM Trans. Graph. 37 (2018) 12, as of Kim and Eberle (2022); SOFA's "
    "StableNeoHookean",
)
