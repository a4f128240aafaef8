"""Saint-Venant's and Kirchhoff's law: Hooke's law in the Green-Lagrange strain."""

from __future__ import annotations

from softcal.materials.elastic_constants import LAME_MODULUS, SHEAR_MODULUS, YOUNGS_MODULUS, poissons_ratio
from softcal.materials.law import Law

# lmbda/2 (tr E)^2 + mu tr E^2, of which a tenth of the bulk modulus is the volumetric part. The rest stays with the
# displacements, as it resists more than a change of volume: near nu = 1/2 no pressure unlocks this law. In compression
# it softens and folds: at a third of the length there is no force.
STVENANT_KIRCHHOFF = Law(
    name="stvenant-kirchhoff",
    parameters=(
        YOUNGS_MODULUS,
        poissons_ratio(-0.5, upper=0.49, ends="(]", attempt="law neo-hooke"),
    ),
    symbols={
        "mu": SHEAR_MODULUS,
        "lmbda": LAME_MODULUS,
        "kappa": "lmbda/10 + mu/15",
        "tr_E": "(I1 - 3)/2",
        "tr_EE": "(I1**2 - 2*I2 - 2*I1 + 3)/4",
    },
    distortional="lmbda/2*tr_E**2 + mu*tr_EE - kappa/2*(J - 1)**2",
    volumetric_strain="J - 1",
    bulk="kappa",
    shifted="kappa",
    reference="Ciarlet (1988), Mathematical Elasticity I; SOFA's StVenantKirchhoff",
)
