"""A constant of a material: what it is called, what it may be, and how it is written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from softcal.errors import Fault, ParameterError
from softcal.quantities import Quantity


@dataclass(frozen=True)
class Parameter:
    """A constant that a law, or a rod, owns.

    Attributes
    ----------
    name
        The key in project files and in dotted names, such as `youngs_modulus`.
    symbol
        The letter that stands for it in the law's texts, such as `E`.
    label
        How charts and reports write it, such as `ν`.
    quantity
        The kind of quantity: its unit and the range in which the law is of use.
    typical
        A value [unit of the quantity] of a soft print: what messages suggest, and what tests of the law begin with.
    default
        The value [unit of the quantity] where none is given; None where one must be.
    """

    name: str
    symbol: str
    label: str
    quantity: Quantity
    typical: float
    default: float | None = None


def complete(given: Mapping[str, float], constants: Sequence[Parameter], *, owner: str) -> dict[str, float]:
    """The constants [SI] of a part in their order, with the defaults of those that are not given.

    Raises
    ------
    ParameterError
        For constants that there are not, and for missing ones without a default; all at once.
    """
    names = [constant.name for constant in constants]
    allowed = ", ".join(names)
    faults = [
        Fault("there is no such constant", where=f"{owner}.{name}", allowed=allowed)
        for name in given
        if name not in names
    ]
    faults += [
        Fault("this constant must be given", where=f"{owner}.{one.name}", allowed=f"{one.quantity.allowed}")
        for one in constants
        if one.name not in given and one.default is None
    ]
    if faults:
        raise ParameterError(faults)
    return {one.name: given[one.name] if one.default is None else given.get(one.name, one.default) for one in constants}
