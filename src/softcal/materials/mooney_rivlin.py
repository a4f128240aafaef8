"""Mooney's and Rivlin's law: an energy linear in both invariants."""

from __future__ import annotations

from softcal.materials.isochoric import BULK, first, polynomial
from softcal.materials.law import Law

MOONEY_RIVLIN = Law(
    name="mooney-rivlin",
    parameters=(first("C10", "C₁₀"), polynomial("C01", "C₀₁", 5e4), BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1", "I2_bar": "J**Rational(-4, 3)*I2"},
    distortional="C10*(I1_bar - 3) + C01*(I2_bar - 3)",
    volumetric_strain="J - 1",
    bulk="kappa",
    shear="2*(C10 + C01)",
    reference="Rivlin and Saunders, Phil. Trans. R. Soc. A 243 (1951) 251; CalculiX's and Abaqus' *HYPERELASTIC, "
    "MOONEY-RIVLIN",
)
