"""The stiffness of a print by its infill, and the band in which it is plausible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from softcal.declare import Check, Declared
from softcal.errors import Fault, InputError
from softcal.quantities import Exponent, Infill, Modulus


def _ordered(value: tuple[float, float], where: str) -> tuple[float, float]:
    low, high = value
    if not 0 < low <= high:
        raise InputError(Fault("the range is reversed or not positive", where, f"{low} to {high}"))
    return value


@dataclass(frozen=True)
class PrintInfill(Declared):
    """Eq. (5) of paper A: E_eff = E_bulk * phi**gamma, with plausible ranges of its constants.

    bulk_youngs_modulus [Pa]: lowest and highest; infill phi [-], 0 < phi <= 1; exponent gamma [-]: lowest and highest.
    """

    bulk_youngs_modulus: Annotated[tuple[Modulus, Modulus], Check(_ordered)]
    infill: Infill
    exponent: Annotated[tuple[Exponent, Exponent], Check(_ordered)]

    @property
    def effective_modulus(self) -> tuple[float, float]:
        """Lowest and highest E_eff [Pa]; the lowest has the softest bulk and the largest exponent."""
        low, high = self.bulk_youngs_modulus
        return (
            effective_modulus(low, self.infill, self.exponent[1]),
            effective_modulus(high, self.infill, self.exponent[0]),
        )


def effective_modulus(bulk_modulus: float, infill: float, exponent: float) -> float:
    """E_eff = E_bulk phi^gamma [Pa]: Young's modulus of a print with infill fraction phi (paper A, Eq. 5).

    Parameters
    ----------
    bulk_modulus
        E_bulk [Pa].
    infill
        phi [-].
    exponent
        gamma [-].
    """
    return bulk_modulus * infill**exponent
