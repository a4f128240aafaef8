"""A constant of a material: its name, its range, and its notation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault, InputError, ParameterError, unknown
from softcal.quantities import Quantity


@displayed
@dataclass(frozen=True)
class Parameter(Checked):
    """A constant of a law, or of a rod.

    Attributes
    ----------
    name
        The key in project files and in dotted names, such as `youngs_modulus`.
    symbol
        Its letter in the law's texts, such as `E`.
    label
        Its notation in charts and reports, such as `ν`.
    quantity
        The kind of quantity: its unit and the range in which the law is valid.
    typical
        A value [unit of the quantity] of a soft print: suggested in messages, and used by tests of the law.
    default
        Default value [unit of the quantity]; None if a value is required.
    """

    name: str
    symbol: str
    label: str
    quantity: Quantity
    typical: float
    default: float | None = None

    def __post_init__(self) -> None:
        """Refuse values of another kind or out of range.

        Raises
        ------
        InputError
            With all of them.
        """
        super().__post_init__()
        values = {"typical": self.typical, "default": self.default}
        faults = (self.quantity.fault(one, f"{self.name}, {what}") for what, one in values.items() if one is not None)
        if found := [fault for fault in faults if fault]:
            raise InputError(found)


def complete(given: Mapping[str, float], constants: Sequence[Parameter], *, owner: str) -> dict[str, float]:
    """The constants [SI] of a part in their order, with the defaults of those that are not stated.

    Parameters
    ----------
    given
        Constants that are stated, by name [SI].
    constants
        All constants.
    owner
        Name of the part.

    Raises
    ------
    ParameterError
        For unknown constants, missing ones without a default, and values out of range; all at once.
    """
    names = [constant.name for constant in constants]
    faults = [
        unknown("there is no such constant", f"{owner}.{name}", name, names, got="")
        for name in given
        if name not in names
    ]
    faults += [
        Fault("this constant must be given", where=f"{owner}.{one.name}", allowed=f"{one.quantity.allowed}")
        for one in constants
        if one.name not in given and one.default is None
    ]
    found = (one.quantity.fault(given[one.name], f"{owner}.{one.name}") for one in constants if one.name in given)
    faults += [fault for fault in found if fault]
    if faults:
        raise ParameterError(faults)
    return {one.name: given[one.name] if one.default is None else given.get(one.name, one.default) for one in constants}
