"""Laws in isochoric invariants and stretches, and the constants that they share: polynomials (Mooney and Rivlin, Yeoh),
chains of limited length (Gent; Arruda and Boyce), sums of powers (Ogden); and SOFA's forms of them.
"""

from __future__ import annotations

from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

BULK = Parameter("bulk_modulus", "kappa", "κ", QUANTITIES["modulus"], typical=5e6)


def first(name: str, label: str) -> Parameter:
    """The coefficient [Pa] that carries the shear modulus: above zero, and required."""
    return Parameter(name, name, label, QUANTITIES["modulus"], typical=5e6)


def polynomial(name: str, label: str, typical: float) -> Parameter:
    """A further coefficient [Pa], of either sign; its default is zero.

    Parameters
    ----------
    name
        Its name.
    label
        Its symbol, to be printed.
    typical
        A typical value [Pa].
    """
    return Parameter(name, name, label, QUANTITIES["coefficient"], typical, default=0.0)


# Term -> the powers of I1_bar - 3 and I2_bar - 3, and a typical coefficient [Pa].
_TERMS = {"C10": (1, 0, 0.0), "C01": (0, 1, 5e4), "C11": (1, 1, 1e3), "C20": (2, 0, 2e3), "C02": (0, 2, 5e2)}


def mooney_rivlin(name: str, terms: tuple[str, ...], reference: str, volumetric_strain: str = "J - 1") -> Law:
    """Mooney's and Rivlin's law with some of the terms, C10 the first of them.

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

# The first invariant alone, for elastomers that stiffen as they are stretched.
YEOH = Law(
    name="yeoh",
    parameters=(first("C10", "C₁₀"), polynomial("C20", "C₂₀", 2e3), polynomial("C30", "C₃₀", 2e2), BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional="C10*(I1_bar - 3) + C20*(I1_bar - 3)**2 + C30*(I1_bar - 3)**3",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Yeoh, Rubber Chemistry and Technology 66 (1993) 754; CalculiX's and Abaqus' *HYPERELASTIC, YEOH",
)

# Above I1_bar - 3 = Jm the energy does not exist: NaN there tells the solver to take a shorter step.
GENT = Law(
    name="gent",
    parameters=(
        Parameter("shear_modulus", "mu", "μ", QUANTITIES["modulus"], typical=4e5),
        Parameter("limit", "Jm", "J_m", QUANTITIES["positive ratio"], typical=50.0),
        BULK,
    ),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional="-mu*Jm/2*log(1 - (I1_bar - 3)/Jm)",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Gent, Rubber Chemistry and Technology 69 (1996) 59",
)

_LOCKING = Parameter("locking_stretch", "lm", "λ_m", QUANTITIES["locking stretch"], typical=3.0)
_COEFFICIENTS = ("1/2", "1/20", "11/1050", "19/7000", "519/673750")


def series(square: str) -> str:
    """Arruda's and Boyce's energy of eight chains, five terms over their modulus; square: of the locking stretch."""
    return " + ".join(
        f"{factor}/({square})**{k}*(I1_bar**{k + 1} - {3 ** (k + 1)})" for k, factor in enumerate(_COEFFICIENTS)
    )


CHAIN_MODULUS = Parameter("chain_modulus", "mu", "μ", QUANTITIES["modulus"], typical=4e5)
ARRUDA_BOYCE = Law(
    name="arruda-boyce",
    parameters=(CHAIN_MODULUS, _LOCKING, BULK),
    symbols={"I1_bar": "J**Rational(-2, 3)*I1"},
    distortional=f"mu*({series('lm**2')})",
    volumetric_strain="J - 1",
    bulk="kappa",
    reference="Arruda and Boyce, J. Mech. Phys. Solids 41 (1993) 389; "
    "CalculiX's and Abaqus' *HYPERELASTIC, ARRUDA-BOYCE",
)

MOST_TERMS = 4
# Values of rubber, after Treloar's measurements (Ogden 1972), in Pa: each mu alpha is above zero.
_TYPICAL = ((6.3e5, 1.3), (1.2e3, 5.0), (-1e4, -2.0), (1e3, 3.0))


def ogden(name: str, terms: int, volumetric_strain: str = "J - 1") -> Law:
    """Ogden's law of so many terms.

    With Ogden's constants the shear modulus is sum mu_p alpha_p / 2. CalculiX and Abaqus write 2 mu_p / alpha_p^2, so
    that theirs are mu_p alpha_p / 2; SOFA's single mu is mu_1 alpha_1.

    Parameters
    ----------
    name
        Name of the law.
    terms
        Number of terms.
    volumetric_strain
        g(J), as text.
    """
    parameters = [
        Parameter(f"{constant}{p}", f"{constant}{p}", f"{letter}{p}", QUANTITIES[kind], typical)
        for p, values in enumerate(_TYPICAL[:terms], start=1)
        for constant, letter, kind, typical in (
            ("mu", "μ", "coefficient", values[0]),
            ("alpha", "α", "exponent of stretches", values[1]),
        )
    ]
    own = [
        f"mu{p}/alpha{p}*(J**(-alpha{p}/3)*(lambda1**alpha{p} + lambda2**alpha{p} + lambda3**alpha{p}) - 3)"
        for p in range(1, terms + 1)
    ]
    return Law(
        name=name,
        parameters=(*parameters, BULK),
        symbols={},
        distortional=" + ".join(own),
        volumetric_strain=volumetric_strain,
        bulk="kappa",
        reference="Ogden, Proc. R. Soc. Lond. A 326 (1972) 565",
    )


OGDEN = tuple(ogden(f"ogden-{terms}", terms) for terms in range(1, MOST_TERMS + 1))

# SOFA's laws that differ from other programs': their volumetric part is kappa/2 (ln J)^2, Ogden's has one term, and the
# chains of Arruda and Boyce lock at a stretch of sqrt(8).
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
