"""The laws by name: softcal's own, and those that are registered from outside."""

from __future__ import annotations

import keyword
import math
import unicodedata
from collections.abc import Iterator, Mapping
from typing import Annotated

from softcal.catalogue import Catalogue
from softcal.declare import member_of
from softcal.errors import Fault
from softcal.materials.expression import FUNCTIONS, Measure, measured
from softcal.materials.histories import history_constants
from softcal.materials.isochoric import (
    ARRUDA_BOYCE,
    GENT,
    MOONEY_RIVLIN,
    MOONEY_RIVLIN_3,
    MOONEY_RIVLIN_5,
    OGDEN,
    SOFA_ARRUDA_BOYCE,
    SOFA_MOONEY_RIVLIN,
    SOFA_OGDEN,
    YEOH,
)
from softcal.materials.law import AT_REST, STRETCHES, Law
from softcal.materials.neo_hooke import (
    NEO_HOOKE,
    NEO_HOOKE_FIBRES,
    NEO_HOOKE_ISOCHORIC,
    NEO_HOOKE_LAYERED,
    STABLE_NEO_HOOKE,
)
from softcal.materials.parameter import Parameter
from softcal.materials.stvenant_kirchhoff import STVENANT_KIRCHHOFF

# The other keys of a body in a project file: reserved names.
TAKEN = (
    "build_direction",
    "clamp",
    "density",
    "element",
    "fixed",
    "history",
    "law",
    "materials",
    "mesh",
    "placement",
    "region",
    "regions",
    "shape",
    "winding",
)

# What else has a meaning in the texts, or in the functions that are made of them.
RESERVED = (*AT_REST, *FUNCTIONS, "pi", "e", *(f"ln_{name}" for name in STRETCHES))


def _faults(law: Law, known: Mapping[str, Law]) -> list[Fault]:
    """The faults of a law's names, beside those of the other laws."""
    if not isinstance(law, Law):
        return [Fault("this is not a law", where="law", got=repr(law)[:60], allowed="a softcal.Law")]
    if law.name != law.name.strip() or not law.name.isprintable() or not law.name:
        return [Fault("this cannot be a name", "law", repr(law.name)[:60], "letters, digits, - and _")]
    letters = [parameter.symbol for parameter in law.parameters]
    names = [*law.names, *letters, *law.symbols]
    faults = [
        Fault("this cannot be a name", where=f"law {law.name}", got=repr(name), allowed="letters, digits and _")
        for name in names
        if not (isinstance(name, str) and name.isidentifier())
        or keyword.iskeyword(name)
        or unicodedata.normalize("NFKC", name) != name
    ]
    if faults:
        return faults
    faults += [
        Fault(
            "this stands for an invariant, a function or a number",
            where=f"law {law.name}",
            got=name,
            attempt="another letter",
        )
        for name in [*letters, *law.symbols]
        if name in RESERVED
    ]
    faults += [
        Fault("the name is taken by a key of a body", where=f"law {law.name}", got=name, attempt="another name")
        for name in law.names
        if name in TAKEN
    ]
    for kind, given in (("constants", list(law.names)), ("symbols", [*letters, *law.symbols])):
        twice = sorted({name for name in given if given.count(name) > 1})
        if twice:
            faults.append(Fault(f"two {kind} have one name", where=f"law {law.name}", got=", ".join(twice)))
    if not law.parameters:
        faults.append(Fault("the law has no constants", where=f"law {law.name}"))
    others = constants_of(known)
    clashes = [
        Fault(
            "another law has a constant of this name in another unit",
            where=f"{law.name}.{one.name}",
            got=one.quantity.unit,
            allowed=others[one.name].quantity.unit,
            attempt="another name",
        )
        for one in law.parameters
        if one.name in others and others[one.name].quantity.unit != one.quantity.unit
    ]
    return [*faults, *clashes, *(() if faults else _text_faults(law))]


def _text_faults(law: Law) -> Iterator[Fault]:
    """The faults of the texts of a law whose names are in order."""
    constants = frozenset(parameter.symbol for parameter in law.parameters)
    scope: dict[str, Measure | None] = dict.fromkeys(law.symbols)
    scope |= {name: Measure(names=frozenset({name})) for name in constants}
    scope |= {name: Measure(AT_REST[name], names=frozenset({name})) for name in (*law.variables, "J")}
    scope["pi"] = Measure(math.pi)
    for symbol, text in law.symbols.items():
        scope[symbol], faults = measured(text, f"law {law.name}, symbols.{symbol}", scope)
        yield from faults
    for what, names, allowed in (
        ("distortional", frozenset(AT_REST) | constants, ""),
        ("volumetric_strain", frozenset({"J"}), "J and numbers"),
        ("bulk", constants, "constants and numbers"),
        ("shifted", constants, "constants and numbers"),
    ):
        measure, faults = measured(getattr(law, what), f"law {law.name}, {what}", scope)
        yield from faults
        if others := measure.names - names - set(FUNCTIONS):
            yield Fault("a symbol is not allowed", f"law {law.name}, {what}", ", ".join(sorted(others)), allowed)


def constants_of(laws: Mapping[str, Law]) -> dict[str, Parameter]:
    """The constants of all laws and histories by name; where several laws have the name, the first law's constant."""
    found: dict[str, Parameter] = {}
    for parameter in (*(one for law in laws.values() for one in law.parameters), *history_constants().values()):
        found.setdefault(parameter.name, parameter)
    return found


_OWN = (
    NEO_HOOKE,
    NEO_HOOKE_ISOCHORIC,
    STABLE_NEO_HOOKE,
    STVENANT_KIRCHHOFF,
    NEO_HOOKE_LAYERED,
    NEO_HOOKE_FIBRES,
    YEOH,
    MOONEY_RIVLIN,
    MOONEY_RIVLIN_3,
    MOONEY_RIVLIN_5,
    GENT,
    ARRUDA_BOYCE,
    *OGDEN,
    SOFA_MOONEY_RIVLIN,
    SOFA_OGDEN,
    SOFA_ARRUDA_BOYCE,
)
LAWS = Catalogue("law", "softcal.laws", _faults, own=_OWN)
# The name of a law, as a project file gives it.
LawName = Annotated[str, member_of(LAWS)]


def _require_rest(law: Law) -> None:
    from softcal.materials.at_rest import require_rest

    require_rest(law)


register_law = LAWS.registrar(
    "register_law", "Add a law: project files, parameters, charts and checks then accept its name.", _require_rest
)
