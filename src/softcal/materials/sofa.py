"""SOFA's laws that differ from other programs': their volumetric part is kappa/2 (ln J)^2, Ogden's has one term, and
the chains of Arruda and Boyce lock at a stretch of sqrt(8).
"""

from __future__ import annotations

from softcal.materials.arruda_boyce import CHAIN_MODULUS, series
from softcal.materials.isochoric import BULK
from softcal.materials.law import Law
from softcal.materials.mooney_rivlin import mooney_rivlin
from softcal.materials.ogden import ogden

SOFA_MOONEY_RIVLIN = mooney_rivlin("sofa-mooney-rivlin", ("C10", "C01"), "SOFA's MooneyRivlin", "log(J)")
SOFA_OGDEN = ogden("sofa-ogden", 1, "log(J)")
SOFA_ARRUDA_BOYCE = Law(
    name="sofa-arruda-boyce",
    parameters=(CHAIN_MODULUS, BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional=f"mu*({series('8')})",
    volumetric_strain="log(J)",
    bulk="kappa",
    reference="Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389; SOFA's ArrudaBoyce",
)
