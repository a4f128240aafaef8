"""Declarations for project files: frozen dataclasses that pydantic reads by their annotations; Python users need no
pydantic.

The annotations carry kinds of quantity and limits of counts (`softcal.quantities`, `softcal.limits`): a file's "38 mm"
is read by them, a Python user gives numbers in SI. Pydantic is imported only where a file is read.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
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
        """Refuse values of another kind than their annotations say, or outside their ranges: in a file they are
        refused as they are read.

        Raises
        ------
        InputError
            With every such value, by the name of its field.
        """
        if faults := self.range_faults():
            raise InputError(faults)

    def range_faults(self) -> list[Fault]:
        """The faults of the values, each by the name of its field."""
        found: list[Fault | None] = []
        for name, hint in _hints(type(self)).items():
            value = getattr(self, name)
            if not _fits(value, hint):
                found.append(Fault("this is of the wrong kind", name, shown(value), _in_words(hint)))
            elif value is not None and name in _ranges(type(self)):
                found.append(_ranges(type(self))[name].fault(value, name))
        return [fault for fault in found if fault]

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        from pydantic_core import core_schema

        assert is_dataclass(cls)  # noqa: S101
        known = {field.name for field in fields(cls) if field.init}

        def read(data: Any, read_fields: Callable[[Any], Any]) -> Any:
            return read_mapping(cls.__name__, data, known, read_fields) if isinstance(data, dict) else read_fields(data)

        return core_schema.no_info_wrap_validator_function(read, handler(source))


class Range(Protocol):
    """What a value is allowed to be, such as a kind of quantity, a limit of a count, or the members of a family."""

    def fault(self, value: Any, where: str = "") -> Fault | None:
        """The fault of a value, or None."""
        ...


@cache
def _hints(cls: type[Declared]) -> dict[str, Any]:
    """The annotations of the fields by name; a field that is None by default may be None."""
    assert is_dataclass(cls)  # noqa: S101
    hints = get_type_hints(cls, include_extras=True)
    return {one.name: hints[one.name] | None if one.default is None else hints[one.name] for one in fields(cls)}


_KINDS = {float: (Real, "a number in SI"), int: (Integral, "a whole number"), str: (str, "text")}


def _fits(value: object, hint: Any) -> bool:
    """Whether a value is of the kind of an annotation; of lists and arrays, which are checked elsewhere, any is."""
    if get_origin(hint) in (Union, UnionType):
        return any(_fits(value, one) for one in get_args(hint))
    if get_origin(hint) is Annotated:
        return _fits(value, get_args(hint)[0])
    if get_origin(hint) is Literal:
        return value in get_args(hint)
    if get_origin(hint) is Mapping:
        return isinstance(value, Mapping)
    if hint in _KINDS:
        return isinstance(value, _KINDS[hint][0]) and not isinstance(value, bool)
    checked = isinstance(hint, type) and (hint in (bool, NoneType) or issubclass(hint, Declared))
    return isinstance(value, hint) if checked else True


def _in_words(hint: Any) -> str:
    """What values an annotation allows."""
    if get_origin(hint) in (Union, UnionType):
        return " or ".join(_in_words(one) for one in get_args(hint))
    if get_origin(hint) is Annotated:
        return _in_words(get_args(hint)[0])
    if get_origin(hint) is Literal:
        return ", ".join(map(repr, get_args(hint)))
    words = {bool: "True or False", NoneType: "None", **{kind: words for kind, (_, words) in _KINDS.items()}}
    if get_origin(hint) is Mapping:
        return f"a mapping to {_in_words(get_args(hint)[1])}"
    return words[hint] if hint in words else f"a {hint.__name__}"


@cache
def _ranges(cls: type[Declared]) -> dict[str, Range]:
    """The ranges of the fields that are numbers or names, or None, by name."""
    kinds = {
        name: get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        for name, hint in _hints(cls).items()
    }
    return {
        name: range_
        for name, several in kinds.items()
        for one in several
        if get_origin(one) is Annotated and get_args(one)[0] in (float, int, str)
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


class Family(Protocol):
    """An extensible family, such as the elements: a catalogue of its members."""

    def __contains__(self, name: object, /) -> bool: ...

    def unknown(self, name: str, where: str = "") -> Fault:
        """The fault of a name without a member."""
        ...


@dataclass(frozen=True, eq=False)
class MemberOf:
    """Annotates the name of a member of a family that others can add to: `Annotated[str, MemberOf(ELEMENTS)]`."""

    family: Family

    def fault(self, value: str, where: str = "") -> Fault | None:
        """The fault of a name, or None."""
        return None if value in self.family else self.family.unknown(value, where)

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        return Reading(self._checked, "after").__get_pydantic_core_schema__(source, handler)

    def _checked(self, value: str) -> str:
        if fault := self.fault(value):
            raise InputError(fault)
        return value


def require_one(declared: object, keys: Sequence[str], what: str, *, nothing: str = "neither", allowed: str) -> None:
    """Check that just one of the fields is given; `what` is wrong where it is `nothing`, or several.

    Raises
    ------
    InputError
        Where it is not.
    """
    given = [key for key in keys if getattr(declared, key) is not None]
    if len(given) != 1:
        raise InputError(Fault(what, "", " and ".join(given) or nothing, allowed))


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

    A fault that `read` raises is reported at the key that its `where` names (`base.height`), or at the mapping.

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
    except InputError as error:
        found += _located(error, known, given)
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


def _located(error: InputError, known: Collection[str], data: object) -> list[InitErrorDetails]:
    """The faults of a mapping as errors of pydantic's."""
    from pydantic_core import InitErrorDetails

    found: list[InitErrorDetails] = []
    for fault in error.faults:
        keys = tuple(fault.where.split("."))
        told = replace(fault, where="") if keys[0] in known else fault
        found.append(InitErrorDetails(type=as_pydantic(told), loc=keys if keys[0] in known else (), input=data))
    return found
