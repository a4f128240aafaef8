"""Sections whose keys include the constants of a law, which the section itself names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field
from pydantic_core import InitErrorDetails

from softcal.declare import listed
from softcal.errors import Fault, InputError
from softcal.materials.catalogue import LAWS, LawName, constants_of
from softcal.materials.elastic_constants import LINEAR_ELASTIC
from softcal.materials.histories import PARTS, history_of
from softcal.materials.inelastic import History
from softcal.materials.parameter import Parameter, complete
from softcal.project.section import Section, read_quantities
from softcal.twin.robot import Body


class ConstantsSection(Section):
    """A mapping with keys of its own and with a material's constants [text with a unit].

    Attributes
    ----------
    constants
        The constants that are given [SI], by name; no key of the file.
    """

    constants: Mapping[str, float] = Field(default_factory=dict)

    @classmethod
    def _allowed(cls, given: Mapping[str, Any]) -> set[str]:
        return super()._allowed(given) - {"constants"} | set(cls._of_law(given))

    @classmethod
    def _read(cls, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[InitErrorDetails]]:
        """The constants among the keys, read as quantities of their kinds, and collected."""
        fields = super()._allowed(given)
        own = {key: value for key, value in given.items() if key in fields}
        kinds = {name: constant.quantity for name, constant in cls._of_law(given).items()}
        constants, errors = read_quantities(given, kinds)
        missing = (name for name in cls._required(given) if name not in given)
        errors += [InitErrorDetails(type="missing", loc=(name,), input=dict(given)) for name in missing]
        return {**own, "constants": constants}, errors

    @classmethod
    def _of_law(cls, given: Mapping[str, Any]) -> Mapping[str, Parameter]:
        """The constants that are allowed; those of every law if the law is unknown here."""
        return constants_of(LAWS)

    @classmethod
    def _required(cls, given: Mapping[str, Any]) -> tuple[str, ...]:
        """The constants that are required."""
        return ()


class HistorySection(ConstantsSection):
    """Constants of a material and of its history."""

    history: Annotated[tuple[str, ...], BeforeValidator(listed)] = Body.history

    def _check(self) -> None:
        history_of(self.history)

    @classmethod
    def _elastic(cls, given: Mapping[str, Any]) -> Sequence[Parameter] | None:
        """Constants of the elastic law; None if the law is unknown here."""
        return LINEAR_ELASTIC

    @classmethod
    def _of_law(cls, given: Mapping[str, Any]) -> Mapping[str, Parameter]:
        elastic = cls._elastic(given)
        if elastic is None:
            return constants_of(LAWS)
        return {one.name: one for one in (*elastic, *cls._of_history(given))}

    @classmethod
    def _required(cls, given: Mapping[str, Any]) -> tuple[str, ...]:
        elastic = cls._elastic(given)
        named = () if elastic is None else (*elastic, *cls._of_history(given))
        return tuple(one.name for one in named if one.default is None)

    @classmethod
    def _of_history(cls, given: Mapping[str, Any]) -> tuple[Parameter, ...]:
        """The constants of the history's parts; parts that do not exist, a fault reported elsewhere, have none."""
        names = listed(given.get("history"))
        known = [PARTS[name] for name in names if name in PARTS] if isinstance(names, list) else []
        return History(tuple(known)).parameters


class LawSection(HistorySection):
    """Constants of the law and of its history."""

    law: LawName = Body.law

    @classmethod
    def _elastic(cls, given: Mapping[str, Any]) -> Sequence[Parameter] | None:
        return _constants_of(given.get("law", cls.model_fields["law"].default))


class SmallStrainSection(HistorySection):
    """Constants at small strain: Young's modulus and Poisson's ratio, or a law that has them, with its constants; and
    the constants of the history.
    """

    law: LawName | None = None

    @classmethod
    def _elastic(cls, given: Mapping[str, Any]) -> Sequence[Parameter] | None:
        name = given.get("law")
        return LINEAR_ELASTIC if name is None else _constants_of(name)

    def _check(self) -> None:
        super()._check()
        if self.law is not None and LAWS[self.law].is_directed:
            allowed = "a law without a build direction"
            raise InputError(Fault("a rod has one modulus", "law", f"'{self.law}'", allowed))

    @property
    def at_small_strain(self) -> dict[str, float]:
        """Constants of a rod's material [SI]; for a law its moduli at small strain.

        Raises
        ------
        ParameterError
            For constants that the law does not allow.
        """
        if self.law is None:
            return dict(self.constants)
        law = LAWS[self.law]
        own = {name: value for name, value in self.constants.items() if name in law.names}
        theta = complete(own, law.parameters, owner=law.name)
        return {**law.at_small_strain(theta), **{k: v for k, v in self.constants.items() if k not in own}}


def _constants_of(name: object) -> Sequence[Parameter] | None:
    """The law's constants; None if the law is unknown (reported elsewhere)."""
    law = LAWS.get(name) if isinstance(name, str) else None
    return None if law is None else law.parameters
