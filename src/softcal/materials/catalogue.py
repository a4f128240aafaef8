"""The laws there are, by name: softcal's own, and those that are registered from outside."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib.metadata import entry_points

from softcal.errors import Fault, ParameterError
from softcal.materials.law import FIRST, Law
from softcal.materials.mooney_rivlin import MOONEY_RIVLIN
from softcal.materials.neo_hooke import NEO_HOOKE, NEO_HOOKE_ISOCHORIC
from softcal.materials.parameter import Parameter
from softcal.materials.yeoh import YEOH

PLUGINS = "softcal.laws"  # the entry points of installed packages that bring laws
# What else a body has in a project file: no constant can be called so.
TAKEN = ("density", "element", "fixed", "law", "materials", "mesh", "placement", "region", "regions")


class Catalogue(Mapping[str, Law]):
    """Laws by name. Packages that bring their own, by entry points named `softcal.laws`, are asked once."""

    def __init__(self, laws: tuple[Law, ...]) -> None:
        self._laws: dict[str, Law] = {}
        self._own = frozenset(law.name for law in laws)
        self._asked = True
        for law in laws:
            self.add(law)
        self._asked = False

    def __getitem__(self, name: str) -> Law:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    @property
    def registered(self) -> tuple[Law, ...]:
        """The laws that are not softcal's own, as another process would have to be told."""
        return tuple(law for name, law in self._all().items() if name not in self._own)

    def constants(self) -> dict[str, Parameter]:
        """Every constant of any law by name; of one that several laws have, the first law's."""
        found: dict[str, Parameter] = {}
        for law in self.values():
            for parameter in law.parameters:
                found.setdefault(parameter.name, parameter)
        return found

    def add(self, law: Law) -> None:
        """See `register_law`.

        Raises
        ------
        ParameterError
            Where another law has the name, or its names cannot be told apart.
        """
        if faults := [*_faults(law), *self._clashes(law)]:
            raise ParameterError(faults)
        self._laws[law.name] = law

    def remove(self, name: str) -> None:
        """Forget a law that was registered from outside.

        Raises
        ------
        ParameterError
            For one of softcal's own.
        """
        if name in self._own:
            raise ParameterError(Fault("softcal's own laws stay", where="law", got=name))
        self._all().pop(name, None)

    def _all(self) -> dict[str, Law]:
        if not self._asked:
            self._asked = True
            for plugin in entry_points(group=PLUGINS):
                law = plugin.load()
                if not isinstance(law, Law):
                    raise ParameterError(
                        Fault("this entry point names no law", where=PLUGINS, got=plugin.value, allowed="a softcal.Law")
                    )
                self.add(law)
        return self._laws

    def _clashes(self, law: Law) -> list[Fault]:
        known = self._laws.get(law.name)
        if known is not None and known != law:
            return [Fault("there is another law of this name", where="law", got=law.name, attempt="another name")]
        constants = self.constants()
        return [
            Fault(
                "another law has a constant of this name in another unit",
                where=f"{law.name}.{parameter.name}",
                got=parameter.quantity.unit,
                allowed=constants[parameter.name].quantity.unit,
                attempt="another name",
            )
            for parameter in law.parameters
            if parameter.name in constants and constants[parameter.name].quantity.unit != parameter.quantity.unit
        ]


def _faults(law: Law) -> list[Fault]:
    """What is wrong with a law's names."""
    letters = [parameter.symbol for parameter in law.parameters]
    names = [*law.names, *letters, *law.symbols]
    faults = [
        Fault("this cannot be a name", where=f"law {law.name}", got=f"'{name}'", allowed="letters, digits and _")
        for name in names
        if not name.isidentifier()
    ]
    faults += [
        Fault("this stands for an invariant", where=f"law {law.name}", got=name, attempt="another letter")
        for name in [*letters, *law.symbols]
        if name in FIRST
    ]
    faults += [
        Fault("a body has something else of this name", where=f"law {law.name}", got=name, attempt="another name")
        for name in law.names
        if name in TAKEN
    ]
    for kind, given in (("constants", list(law.names)), ("symbols", [*letters, *law.symbols])):
        twice = sorted({name for name in given if given.count(name) > 1})
        if twice:
            faults.append(Fault(f"two {kind} have one name", where=f"law {law.name}", got=", ".join(twice)))
    if not law.parameters:
        faults.append(Fault("the law has no constants", where=f"law {law.name}"))
    return faults


LAWS = Catalogue((NEO_HOOKE, NEO_HOOKE_ISOCHORIC, YEOH, MOONEY_RIVLIN))


def law_named(name: str, *, where: str = "law") -> Law:
    """The law of a name.

    Raises
    ------
    ParameterError
        Where there is none.
    """
    if name not in LAWS:
        raise ParameterError(Fault("there is no such law", where=where, got=name, allowed=", ".join(LAWS)))
    return LAWS[name]


def register_law(law: Law) -> Law:
    """Add a law of one's own: project files, parameters, charts and checks know it by its name from then on.

    A package does the same for every process by an entry point of the group `softcal.laws` that names the `Law`.

    Parameters
    ----------
    law
        The energy and its constants. Constants of one name have one unit in all laws.

    Returns
    -------
    Law
        The same law, so that the call can stand around its definition.

    Raises
    ------
    ParameterError
        Where another law has the name, a constant's name is taken with another unit, or names cannot be told apart.
    """
    LAWS.add(law)
    return law
