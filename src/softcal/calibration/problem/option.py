"""Options of losses and optimisers: numbers of their own that project files give under `calibration`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from softcal.declare import Checked
from softcal.display import displayed
from softcal.errors import Fault
from softcal.limits import Limit
from softcal.quantities import Quantity

# What else the `calibration` of a project file, or the record of a search, has: no option can be called so.
TAKEN = ("axes", "batch", "fit", "hold_out", "importance_kind", "loss", "method", "options", "seed", "split", "trials")


@displayed
@dataclass(frozen=True)
class Option(Checked):
    """A number that project files can give a loss or an optimiser under `calibration`, such as alpha or starts.

    Attributes
    ----------
    name
        Its key.
    kind
        What it may be: a quantity, or a count within limits.
    default
        Its value where none is given [SI].
    """

    name: str
    kind: Quantity | Limit
    default: float


class HasOptions(Protocol):
    """A class of a family whose members have options."""

    @property
    def options(self) -> tuple[Option, ...]: ...


FAMILIES: dict[str, Mapping[str, HasOptions]] = {}
"""The families whose members' options are keys of one section, by what a member is called."""


def options_of(*families: Mapping[str, HasOptions]) -> dict[str, Option]:
    """Every option of any member of the families, by default of all there are, by its name."""
    members = [member for family in families or FAMILIES.values() for member in family.values()]
    return {option.name: option for member in members for option in member.options}


def option_faults(member: HasOptions, of: str, where: str, known: Mapping[str, HasOptions]) -> list[Fault]:
    """The options of a new member that are something else already: of the calibration, or of another member.

    of: its family, of which `known` has the members so far.

    Parameters
    ----------
    member, of
        The new member, and its family.
    where
        The member, in a message.
    known
        Name -> member of the family so far.
    """
    if not member.options:
        return []
    taken = options_of(known, *(family for what, family in FAMILIES.items() if what != of))
    faults: list[Fault] = []
    for option in member.options:
        if option.name in TAKEN:
            what = "the name is taken by another setting of the calibration"
            faults.append(Fault(what, where, option.name, attempt="another name"))
        elif taken.get(option.name, option) != option:
            what = f"another {' or '.join(FAMILIES)} has an option of this name and of another kind or default"
            faults.append(Fault(what, where, option.name, attempt="another name"))
    return faults
