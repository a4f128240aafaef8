"""The constants that laws in isochoric invariants share: coefficients of the energy, and the bulk modulus."""

from __future__ import annotations

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
