"""Declarations: frozen dataclasses and functions that check their values by their annotations.
Pydantic reads the former from project files; Python users need none.

The annotations carry kinds of quantity and limits of counts (`softcal.quantities`, `softcal.limits`): a file's "38 mm"
is read by them, a Python user gives numbers in SI. Pydantic is imported only where a file is read.
"""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, wraps
from itertools import islice, zip_longest
from numbers import Integral, Real
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    NoReturn,
    ParamSpec,
    Protocol,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from softcal.errors import Fault, InputError, unknown, unknown_keys

if TYPE_CHECKING:
    from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError

# The kind of error that carries a whole `Fault`: its context has the fault's fields.
FAULT = "softcal_fault"


class Checked:
    """Base of the frozen dataclasses whose values are of the kinds of their annotations, and in their ranges.

    Lists are kept as tuples, and arrays and mappings as copies.
    """

    def __post_init__(self) -> None:
        """Refuse values of another kind than their annotations say, or outside their ranges.

        Raises
        ------
        InputError
            With every such value, by the name of its field.
        """
        faults: list[Fault] = []
        kept = {
            name: _kept(getattr(self, name), hint, self._where(name), faults)
            for name, hint in _hints(type(self)).items()
        }
        if faults:
            raise InputError(faults)
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    def _where(self, name: str) -> str:
        """Name of a field in messages."""
        return name


class Declared(Checked):
    """Base of the frozen dataclasses that a mapping of a project file can describe, its keys being the fields.

    An unknown key is a fault that names the nearest known one. A fault raised by `__post_init__` is reported at the
    field that its `where` names, or at the mapping.
    """

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        from pydantic_core import core_schema

        assert is_dataclass(cls)  # noqa: S101
        known = {field.name for field in fields(cls) if field.init}

        def read(data: Any, read_fields: Callable[[Any], Any]) -> Any:
            return read_mapping(cls.__name__, data, known, read_fields) if isinstance(data, dict) else read_fields(data)

        return core_schema.no_info_wrap_validator_function(read, handler(source))


@cache
def _hints(cls: type[Checked]) -> dict[str, Any]:
    """The annotations of the fields by name; a field that is None by default may be None."""
    assert is_dataclass(cls)  # noqa: S101
    hints = get_type_hints(cls, include_extras=True)
    return {one.name: hints[one.name] | None if one.default is None else hints[one.name] for one in fields(cls)}


P = ParamSpec("P")
R = TypeVar("R")


def checked_arguments(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which refuses arguments of another kind than their annotations say, or outside their ranges, by an
    InputError with every such argument; and keeps the others as `Checked` does.

    Raises
    ------
    InputError
        Where it is called with such arguments.
    """

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        hints, faults = _argument_hints(function), list[Fault]()
        named = [
            _kept(one, hints[name], name, faults) if name in hints else one
            for name, one in zip_longest(islice(hints, len(args)), args)
        ]
        kept = {name: _kept(one, hints[name], name, faults) if name in hints else one for name, one in kwargs.items()}
        if faults:
            raise InputError(faults)
        return cast("Callable[..., R]", function)(*named, **kept)

    return checked


@cache
def _argument_hints(function: Callable[..., Any]) -> dict[str, Any]:
    """The annotations of the arguments by name, in their order; one that is None by default may be None. *args and
    the like are omitted.
    """
    hints = get_type_hints(function, include_extras=True)
    single = [one for one in inspect.signature(function).parameters.values() if one.kind not in _MANY]
    hints = {one.name: hints.get(one.name, Any) for one in single}
    return {one.name: hints[one.name] | None if one.default is None else hints[one.name] for one in single}


_MANY = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


class FixedMapping(dict[Any, Any]):
    """A read-only mapping, as the arrays of a frozen object: objects computed from it would not follow a change."""

    def _refused(self, *_: object, **__: object) -> NoReturn:
        raise TypeError("this mapping is read-only: dataclasses.replace returns a changed copy of its object")

    __setitem__ = __delitem__ = __ior__ = clear = pop = popitem = setdefault = update = _refused  # pyright: ignore[reportAssignmentType, reportIncompatibleMethodOverride]

    def __reduce__(self) -> tuple[object, ...]:
        return type(self), (dict(self),)


def as_annotated(value: Any, hint: Any, where: str) -> Any:
    """A value [SI] of Python's, as a field of an annotation keeps it.

    Parameters
    ----------
    value
        The value.
    hint
        Type of the field, with its annotation.
    where
        Name of the field, for errors.

    Raises
    ------
    InputError
        With all that is wrong with it.
    """
    faults: list[Fault] = []
    kept = _kept(value, hint, where, faults)
    if faults:
        raise InputError(faults)
    return kept


def _kept(value: Any, hint: Any, where: str, faults: list[Fault], *, has_range: bool = False) -> Any:
    """As `as_annotated`, but adds its faults to `faults`; has_range: whether another mark checks the range."""
    origin, of = get_origin(hint), get_args(hint)
    if origin is Annotated:
        n_faults = len(faults)
        checks = [mark for mark in of[1:] if hasattr(mark, "checked")]
        kept = _kept(value, of[0], where, faults, has_range=bool(checks))
        for mark in checks:
            if len(faults) == n_faults:
                try:
                    kept = mark.checked(kept, where=where)
                except InputError as error:
                    faults += error.faults
        return kept
    if (hint is Path or Path in of) and (fault := _path_fault(value)):
        faults.append(Fault(fault, where, shown(value)))
        return value
    if origin in _UNIONS and (member := next((one for one in of if _fits(value, one)), None)) is not None:
        return _kept(value, member, where, faults)
    if origin in _LISTS and (entries := _entries(value, _kinds(origin, of))) is not None:
        return tuple(_kept(one, kind, f"{where}[{i}]", faults) for i, (one, kind) in enumerate(entries))
    if origin is Mapping and isinstance(value, Mapping):
        given: Mapping[Any, Any] = value
        if of[0] is str and (others := [key for key in given if not isinstance(key, str)]):
            faults.append(Fault("a name is of the wrong kind", where, shown(others[0]), "text"))
        return FixedMapping({key: _kept(one, of[1], f"{where}.{key}", faults) for key, one in given.items()})
    if not _fits(value, hint):
        faults.append(Fault("this is of the wrong kind", where, shown(value), _in_words(hint)))
    elif hint is str and "\0" in value:
        faults.append(Fault("a zero byte is no text", where, shown(value)))
    elif hint in (float, int):  # kept in Python's arithmetic: that of NumPy's short floats rounds, or overflows
        plain = int(value) if isinstance(value, Integral) else float(value)
        if hint is float and not _is_finite(plain) and not (has_range and isinstance(plain, float)):
            faults.append(Fault("this is not finite", where, shown(value), _in_words(hint)))
        return plain
    return value


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def _path_fault(value: object) -> str:
    """Why no system has a file of this path; "" where one may, or where it is none."""
    if not isinstance(value, str | os.PathLike):
        return ""
    try:
        raw = os.fsencode(Path(value))
    except UnicodeEncodeError:
        return "half a character is no text"
    except Exception:  # noqa: BLE001 (whatever an object of a caller's does)
        return "this is no path of text"
    is_long = len(raw) >= 4096 or max(map(len, raw.replace(b"\\", b"/").split(b"/"))) > 255
    return "a zero byte is no text" if b"\0" in raw else "this path is too long" * is_long


_UNIONS = (Union, UnionType)
_LISTS = (tuple, Sequence, Collection)
_KINDS = {
    float: (Real, "a number in SI"),
    int: (Integral, "a whole number"),
    str: (str, "text"),
    Path: (os.PathLike, "a path"),
}


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of the kind of an annotation, whatever its range."""
    origin, of = get_origin(hint), get_args(hint)
    if origin in _UNIONS:
        return any(_fits(value, one) for one in of)
    if origin is Annotated:
        return _fits(value, of[0])
    if origin is Literal:
        return any(_fits(value, type(one)) and value == one for one in of)
    if origin in _LISTS:
        entries = _entries(value, _kinds(origin, of))
        return entries is not None and all(_fits(one, kind) for one, kind in entries)
    if origin is Mapping:
        return isinstance(value, Mapping)
    if origin is Callable:
        return callable(value)
    if hint in _KINDS:
        return isinstance(value, _KINDS[hint][0]) and not isinstance(value, bool)
    if hint is Any:
        return True
    return isinstance(value, hint) if isinstance(hint, type) else value is not None


def _kinds(origin: Any, of: tuple[Any, ...]) -> tuple[Any, ...]:
    """The annotations of a tuple's entries; a list has one annotation for all."""
    return of if origin is tuple else (*of, ...)


def _entries(value: Any, kinds: tuple[Any, ...]) -> list[tuple[Any, Any]] | None:
    """The entries of a list or array, each with its annotation among those of a tuple; None where they do not match."""
    given = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(given, str | bytes | bytearray | memoryview | Mapping) or not isinstance(given, Collection):
        return None
    of = kinds[:1] * len(given) if kinds[-1:] == (...,) else kinds
    return [*zip(given, of, strict=True)] if len(given) == len(of) else None


def _in_words(hint: Any) -> str:
    """The values that an annotation allows, in words."""
    origin, of = get_origin(hint), get_args(hint)
    if origin in _UNIONS:  # of which a path takes text too
        return " or ".join(_in_words(one) for one in of if one is not str or Path not in of)
    if origin is Annotated:
        return _in_words(of[0])
    if origin is Literal:
        return ", ".join(map(repr, of))
    if origin in _LISTS:
        kinds = _kinds(origin, of)
        return f"a list, each {_in_words(of[0])}" if kinds[-1] is ... else f"{len(of)} entries, each {_in_words(of[0])}"
    if origin is Mapping:
        return f"a mapping to {_in_words(of[1])}"
    if origin is Callable:
        return "a function"
    words = {bool: "True or False", NoneType: "None", **{kind: words for kind, (_, words) in _KINDS.items()}}
    if hint in words or not isinstance(hint, type):
        return words.get(hint, "an array")
    return f"{'an' if hint.__name__[0] in 'AEIOU' else 'a'} {hint.__name__}"


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


@dataclass(frozen=True)
class ByShape:
    """Annotation of a union of a value, a mapping and lists: input is read as the member with its shape, and only that
    member's faults are reported.
    """

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        from pydantic import TypeAdapter

        members = get_args(source)
        readers = {_shape(member): TypeAdapter(member) for member in reversed(members)}

        def read(value: Any) -> Any:
            shape = "mapping" if isinstance(value, dict) else "value"
            if isinstance(value, list):
                rows: list[object] = value
                shape = "table" if any(isinstance(row, list) for row in rows) else "list"
            return readers.get(shape, readers[_shape(members[0])]).validate_python(value)

        return Reading(read, "instead").__get_pydantic_core_schema__(source, handler)


def _shape(hint: Any) -> str:
    """The shape of what an annotation allows."""
    origin, of = get_origin(hint), get_args(hint)
    if origin is tuple:
        return "table" if get_origin(of[0]) is tuple else "list"
    return _shape(of[0]) if origin is Annotated else "mapping" if origin is Mapping else "value"


class Family(Protocol):
    """An extensible family, such as the elements: a catalogue of its members."""

    def __contains__(self, name: object, /) -> bool: ...

    def unknown(self, name: str, where: str = "") -> Fault:
        """The fault of a name without a member."""
        ...


@dataclass(frozen=True)
class Check:
    """Annotates a field by a function of a value and its place, which returns the value as it is kept.

    Files and Python's values are checked by it alike, after the annotated kind; it raises an InputError.
    """

    function: Callable[[Any, str], Any]

    def checked(self, value: Any, *, where: str = "") -> Any:
        """The value as it is kept."""
        return self.function(value, where)

    def __get_pydantic_core_schema__(self, source: object, handler: Callable[[object], CoreSchema]) -> CoreSchema:
        return Reading(self.checked, "after").__get_pydantic_core_schema__(source, handler)


def _no_nan(value: float, where: str) -> float:
    if math.isnan(value):
        raise InputError(Fault("this is not a number", where, "NaN", "a number in SI, or infinity"))
    return value


OrInfinite = Annotated[float, Check(_no_nan)]
"""A number that may be infinite."""


def member_of(family: Family) -> Check:
    """For the name of a member of a family that others can add to: `Annotated[str, member_of(ELEMENTS)]`.

    Raises
    ------
    InputError
        As it checks a name without a member.
    """

    def named(value: str, where: str) -> str:
        if value not in family:
            raise InputError(family.unknown(value, where))
        return value

    return Check(named)


def require_one(declared: object, keys: Sequence[str], what: str, *, nothing: str = "neither", allowed: str) -> None:
    """Check that just one of some fields is given.

    Parameters
    ----------
    declared
        The object with the fields.
    keys
        Names of the fields.
    what
        Sentence of the fault.
    nothing
        The fault's word for none of them.
    allowed
        What is allowed, for the fault.

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
    try:
        text = repr(value)
    except Exception:  # noqa: BLE001 (whatever an object of a caller's does, or lists of too many levels)
        text = f"a {type(value).__name__}"
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
    """The values that `read` returns for the known keys of a mapping.

    A fault that `read` raises is reported at the key that its `where` names (`base.height`), or at the mapping.

    Parameters
    ----------
    title
        Name of the mapping, for errors.
    given
        The mapping.
    known
        Its keys that are allowed.
    read
        Called with the entries of the known keys.
    errors
        Faults that were seen before.

    Raises
    ------
    pydantic_core.ValidationError
        With all that is wrong, each unknown key with the nearest known one.
    """
    from pydantic_core import InitErrorDetails, ValidationError

    others, meant = unknown_keys(given, known)
    found = [
        InitErrorDetails(
            type=as_pydantic(unknown("unknown key", "", str(key), sorted(known))),
            loc=(key,),
            input=given[key],
        )
        for key in others
    ]
    found += errors
    try:
        made = read({key: value for key, value in given.items() if key in known})
    except ValidationError as error:
        if not found:
            raise
        found += [_again(one) for one in error.errors()]
    except InputError as error:
        for fault in error.faults:
            keys = tuple(fault.where.split("."))
            is_known = keys[0] in known
            if others and not is_known:
                continue  # as of a mapping without bodies, which an unknown key may have stated
            placed = as_pydantic(replace(fault, where="") if is_known else fault)
            found.append(InitErrorDetails(type=placed, loc=keys if is_known else (), input=given))
    else:
        if not found:
            return made
    told = [one for one in found if not (one["type"] == "missing" and one.get("loc") in {(key,) for key in meant})]
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
