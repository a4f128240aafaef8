"""The parts of a material's history by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache

from softcal.errors import Fault, ParameterError, unknown
from softcal.materials.flow import Flow
from softcal.materials.inelastic import History, Inelastic
from softcal.materials.maxwell import Maxwell
from softcal.materials.parameter import Parameter
from softcal.materials.relaxation import Relaxation
from softcal.materials.softening import Softening

MOST_BRANCHES = 6
# In the order in which they change the law's stress, whatever that in which a body names them.
PARTS: dict[str, Inelastic] = {
    "softening": Softening(),
    **{f"relaxation-{n}": Relaxation(n) for n in range(1, MOST_BRANCHES + 1)},
    **{f"maxwell-{n}": Maxwell(n) for n in range(1, MOST_BRANCHES + 1)},
    "flow": Flow(),
    "flow-at-once": Flow(at_once=True),
}


def history_of(names: Sequence[str], where: str = "history", *, of_rod: bool = False) -> History:
    """The history of some parts, of a body's or a rod's material.

    Parameters
    ----------
    names
        Names of the parts.
    where
        Place for error messages.
    of_rod
        Whether it is of a rod.

    Raises
    ------
    ParameterError
        For an unknown part, one that a rod does not have, one named twice, and more than one relaxation or flow.
    """
    faults = [unknown("there is no such part of a history", where, name, PARTS) for name in names if name not in PARTS]
    sections = ", ".join(name for name, part in PARTS.items() if part.of_sections)
    faults += [
        Fault("the sections of a rod have no such part of a history", where, f"'{name}'", sections)
        for name in names
        if of_rod and name in PARTS and not PARTS[name].of_sections
    ]
    kinds = [name.partition("-")[0] for name in names]
    faults += [
        Fault("a history can have only one part of this kind", where, f"{kinds.count(kind)} of {kind}", "one")
        for kind in dict.fromkeys(kinds)
        if kinds.count(kind) > 1
    ]
    if faults:
        raise ParameterError(faults)
    return History(tuple(part for name, part in PARTS.items() if name in names))


@cache
def history_constants() -> Mapping[str, Parameter]:
    """The constants of every part, by name."""
    return {one.name: one for one in History(tuple(PARTS.values())).parameters}
