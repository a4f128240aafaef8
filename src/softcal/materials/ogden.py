"""Ogden's laws: sums of powers of the principal stretches, of one to four terms."""

from __future__ import annotations

from softcal.materials.isochoric import BULK
from softcal.materials.law import Law
from softcal.materials.parameter import Parameter
from softcal.quantities import QUANTITIES

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
