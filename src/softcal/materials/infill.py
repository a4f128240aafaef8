"""The stiffness of a print by its infill, and the band in which it is plausible."""

from __future__ import annotations

from dataclasses import dataclass

from softcal.errors import Fault, InputError


@dataclass(frozen=True)
class PrintInfill:
    """Eq. (5) of paper A: E_eff = E_bulk * phi**gamma, with the ranges that are taken for plausible.

    bulk_modulus [Pa]: lowest and highest; infill phi [-], 0 < phi <= 1; exponent gamma [-]: lowest and highest.
    """

    bulk_modulus: tuple[float, float]
    infill: float
    exponent: tuple[float, float]

    def __post_init__(self) -> None:
        faults: list[Fault] = []
        if not 0 < self.infill <= 1:
            faults.append(
                Fault("the infill is no fraction", where="infill", got=f"{self.infill}", allowed="0 < phi <= 1")
            )
        for name, (low, high) in (("bulk_modulus", self.bulk_modulus), ("exponent", self.exponent)):
            if not 0 < low <= high:
                faults.append(Fault("the range is reversed or not positive", where=name, got=f"{low} to {high}"))
        if faults:
            raise InputError(faults)

    @property
    def effective_modulus(self) -> tuple[float, float]:
        """Lowest and highest E_eff [Pa]; the lowest has the softest bulk and the largest exponent."""
        low, high = self.bulk_modulus
        return (
            effective_modulus(low, self.infill, self.exponent[1]),
            effective_modulus(high, self.infill, self.exponent[0]),
        )


def effective_modulus(bulk_modulus: float, infill: float, exponent: float) -> float:
    """E_eff = E_bulk phi^gamma [Pa]: Young's modulus of a print with infill fraction phi (paper A, Eq. 5)."""
    return bulk_modulus * infill**exponent
