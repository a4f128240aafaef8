"""Mooney's and Rivlin's laws: polynomials of both invariants, of two, three and five terms."""

from __future__ import annotations

from softcal.materials.isochoric import BULK, first, polynomial
from softcal.materials.law import Law

# Term -> the powers of I1_bar - 3 and I2_bar - 3, and a typical coefficient [Pa].
_TERMS = {"C10": (1, 0, 0.0), "C01": (0, 1, 5e4), "C11": (1, 1, 1e3), "C20": (2, 0, 2e3), "C02": (0, 2, 5e2)}


def mooney_rivlin(name: str, terms: tuple[str, ...], reference: str, volumetric_strain: str = "J - 1") -> Law:
    """The law with some of the terms, C10 the first of them.

    Parameters
    ----------
    name
        Name of the law.
    terms
        Names of its coefficients, C10 the first.
    reference
        The programs that have the law.
    volumetric_strain
        g(J), as text.
    """
    own = [f"{term}*(I1_bar - 3)**{_TERMS[term][0]}*(I2_bar - 3)**{_TERMS[term][1]}" for term in terms]
    return Law(
        name=name,
        parameters=(
            first("C10", "C₁₀"),
            *(polynomial(term, "C" + term[1:].translate(_SUBSCRIPTS), _TERMS[term][2]) for term in terms[1:]),
            BULK,
        ),
        symbols={"I1_bar": "J**Rational(-2, 3)*I1", "I2_bar": "J**Rational(-4, 3)*I2"},
        distortional=" + ".join(own),
        volumetric_strain=volumetric_strain,
        bulk="kappa",
        reference=f"Rivlin and Saunders, Phil. Trans. R. Soc. A 243 (1951) 251; {reference}",
    )


_SUBSCRIPTS = str.maketrans("012", "₀₁₂")
_POLYNOMIAL = "CalculiX's and Abaqus' *HYPERELASTIC, POLYNOMIAL, N=2"
MOONEY_RIVLIN = mooney_rivlin("mooney-rivlin", ("C10", "C01"), "CalculiX's and Abaqus' *HYPERELASTIC, MOONEY-RIVLIN")
MOONEY_RIVLIN_3 = mooney_rivlin("mooney-rivlin-3", ("C10", "C01", "C11"), _POLYNOMIAL)
MOONEY_RIVLIN_5 = mooney_rivlin("mooney-rivlin-5", ("C10", "C01", "C11", "C20", "C02"), _POLYNOMIAL)
