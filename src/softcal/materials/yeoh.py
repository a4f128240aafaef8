"""Yeoh's law: an energy by the first invariant alone, for elastomers that stiffen as they are stretched."""

from __future__ import annotations

from softcal.materials.isochoric import BULK, first, polynomial
from softcal.materials.law import Law

YEOH = Law(
    name="yeoh",
    parameters=(first("C10", "C₁₀"), polynomial("C20", "C₂₀", 2e3), polynomial("C30", "C₃₀", 2e2), BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional="C10*(I1_bar - 3) + C20*(I1_bar - 3)**2 + C30*(I1_bar - 3)**3",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Yeoh, Rubber Chemistry and Technology 66 (1993) 754; CalculiX's and Abaqus' *HYPERELASTIC, YEOH",
)
