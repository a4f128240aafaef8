"""The stiffness of a print by its infill."""

from __future__ import annotations


def effective_modulus(bulk_modulus: float, infill: float, exponent: float) -> float:
    """E_eff = E_bulk phi^gamma [Pa]: Young's modulus of a print with infill fraction phi (paper A, Eq. 5)."""
    return bulk_modulus * infill**exponent
