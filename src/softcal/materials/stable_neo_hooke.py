"""The stable neo-Hookean law: finite at J = 0 and beyond, for robots in motion."""

from __future__ import annotations

from softcal.materials.elastic_constants import LAME_MODULUS, SHEAR_MODULUS, YOUNGS_MODULUS, poissons_ratio
from softcal.materials.law import Law

# Below nu = -0.3 a compressed body would have less energy than at rest. SOFA writes
# (lmbda + mu)/2 (J - 1 - mu/(lmbda + mu))^2, which differs by a constant.
STABLE_NEO_HOOKE = Law(
    name="stable-neo-hooke",
    parameters=(
        YOUNGS_MODULUS,
        poissons_ratio(-0.25),
    ),
    symbols={"mu": SHEAR_MODULUS, "lmbda": LAME_MODULUS},
    distortional="mu/2*(I1 - 3) - mu*(J - 1)",
    volumetric_strain="J - 1",
    bulk="lmbda + mu",
    reference="Smith, de Goes and Kim, ACM Trans. Graph. 37 (2018) 12, as of Kim and Eberle (2022); SOFA's "
    "StableNeoHookean",
)
