"""Declarations for project files: frozen dataclasses that pydantic reads by their annotations; Python users need no
pydantic.

The annotations carry kinds of quantity and limits of counts (`softcal.quantities`, `softcal.limits`): a file's "38 mm"
is read by them, a Python user gives numbers in SI. Pydantic is imported only where a file is read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Union, get_args, get_origin, get_type_hints

from softcal.errors import Fault, InputError, nearest

if TYPE_CHECKING:
    from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

# The kind of error that carries a whole `Fault`: its context has the fault's fields.
FAULT = "softcal_fault"


class Declared:
    """Base of the frozen dataclasses that a mapping of a project file can describe, its keys being the fields.

    An unknown key is a fault that names the nearest known one. A fault raised by `__post_init__` is reported at the
    field that its `where` names, or at the mapping.
    """

    def __post_init__(self) -> None:
        """Refuse numbers outside the ranges of their annotations: in a file they are refused as they are read.

        Raises
        ------
        InputError
            With every such number, by the name of its field.
        """
        if faults := self.range_faults():
            raise InputError(faults)

    def range_faults(self) -> list[Fault]:
        """The faults of the numbers, each by the name of its field."""
        given = {name: value for name in _ranges(type(self)) if (value := getattr(self, name)) is not None}
        faults = (_ranges(type(self))[name].fault(value, name) for name, value in given.items())
        return [fault for fault in faults if fault]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        from pydantic_core import core_schema

        assert is_dataclass(cls)  # noqa: S101
        known = {field.name for field in fields(cls) if field.init}

        def read(data: Any, read_fields: Callable[[Any], Any]) -> Any:
            try:
                if not isinstance(data, dict):
                    return read_fields(data)
                return read_mapping(cls.__name__, data, known, read_fields)
            except InputError as error:
                raise _located(cls.__name__, error, known, data) from error

        return core_schema.no_info_wrap_validator_function(read, handler(source))


class Range(Protocol):
    """The admissible range of a number, such as a kind of quantity, or a limit of a count."""

    def fault(self, value: float, where: str = "") -> Fault | None:
        """The fault of a number, or None."""
        ...


@cache
def _ranges(cls: type) -> dict[str, Range]:
    """The ranges of the fields that are numbers, or None, by name."""
    hints = get_type_hints(cls, include_extras=True)
    kinds = {
        name: get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,) for name, hint in hints.items()
    }
    return {
        name: range_
        for name, several in kinds.items()
        for one in several
        if get_origin(one) is Annotated and get_args(one)[0] in (float, int)
        for range_ in get_args(one)[1:]
        if hasattr(range_, "fault")
    }


@dataclass(frozen=True)
class Reading:
    """Reads a field by a function that raises InputErrors: before, after or instead of the conversion of its type."""

    function: Callable[[Any], Any]
    when: Literal["before", "after", "instead"] = "before"

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        from pydantic_core import core_schema

        def read(value: object) -> object:
            try:
                return self.function(value)
            except InputError as error:
                raise as_pydantic(error.faults[0]) from error

        if self.when == "instead":
            return core_schema.no_info_plain_validator_function(read)
        if self.when == "before":
            return core_schema.no_info_before_validator_function(read, handler(source))
        return core_schema.no_info_after_validator_function(read, handler(source))


def listed(value: object) -> object:
    """A single entry as a list of one."""
    return [value] if isinstance(value, str | dict) else value


def shown(value: object) -> str:
    """A value as messages show it, shortened where it is long."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def as_pydantic(fault: Fault) -> PydanticCustomError:
    """An error to raise in a validator, which ends as the fault at the key that was being read."""
    from pydantic_core import PydanticCustomError

    return PydanticCustomError(FAULT, "{what}", {**vars(fault)})


def read_mapping(
    title: str,
    given: Mapping[str, Any],
    known: Collection[str],
    read: Callable[[dict[str, Any]], Any],
    errors: Collection[InitErrorDetails] = (),
) -> Any:
    """What `read` makes of the known keys of a mapping; errors: what was found wrong with it before.

    Raises
    ------
    pydantic_core.ValidationError
        With all that is wrong, each unknown key with the nearest known one.
    """
    from pydantic_core import InitErrorDetails, ValidationError

    unknown = [key for key in given if key not in known]
    # A required key that was only mistyped is one mistake, reported once.
    meant = {(nearest(str(key), known).strip("'"),) for key in unknown}
    found = [
        InitErrorDetails(
            type=as_pydantic(Fault("unknown key", "", f"'{key}'", ", ".join(sorted(known)), nearest(str(key), known))),
            loc=(key,),
            input=given[key],
        )
        for key in unknown
    ]
    found += errors
    try:
        made = read({key: value for key, value in given.items() if key in known})
    except ValidationError as error:
        if not found:
            raise
        found += [_again(one) for one in error.errors()]
    else:
        if not found:
            return made
    told = [one for one in found if not (one["type"] == "missing" and one.get("loc") in meant)]
    raise ValidationError.from_exception_data(title, told)


def _again(found: Any) -> InitErrorDetails:
    """An error of pydantic's, to be raised once more."""
    from pydantic_core import InitErrorDetails, PydanticCustomError

    kind, context = found["type"], found.get("ctx", {})
    if kind == FAULT:
        return InitErrorDetails(
            type=PydanticCustomError(FAULT, "{what}", context), loc=found["loc"], input=found["input"]
        )
    return InitErrorDetails(type=kind, loc=found["loc"], input=found["input"], ctx=context)


def _located(title: str, error: InputError, known: Collection[str], data: object) -> Any:
    """The faults of a class as errors of pydantic's, each at the field that its `where` names."""
    from pydantic_core import InitErrorDetails, ValidationError

    found: list[InitErrorDetails] = []
    for fault in error.faults:
        key = fault.where if fault.where in known else ""
        told = Fault(fault.what, "" if key else fault.where, fault.got, fault.allowed, fault.attempt)
        found.append(InitErrorDetails(type=as_pydantic(told), loc=(key,) if key else (), input=data))
    return ValidationError.from_exception_data(title, found)
