"""Reading of sections of the project file: by a pydantic model, or by a declaration in Python; and their faults."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    ConfigDict,
    ModelWrapValidatorHandler,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails

from softcal.declare import FAULT, Reading, as_pydantic, listed, read_mapping, shown
from softcal.errors import Fault, InputError, nearest
from softcal.limits import Limit
from softcal.project.document import Document, Findings, KeyPath
from softcal.quantities import Quantity


class Section(BaseModel):
    """A mapping of the project file: frozen, and an unknown key in it is a fault that names the nearest known one."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="wrap")
    @classmethod
    def _known_keys(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        if not isinstance(data, dict):
            return handler(data)
        known = cls._allowed(data)
        read, faults = cls._read({key: value for key, value in data.items() if key in known})

        def made(_: Any) -> Any:
            section = handler(read)
            section._check()  # noqa: SLF001
            return section

        return read_mapping(cls.__name__, data, known, made, faults)

    def _check(self) -> None:
        """Raise an InputError if values contradict each other, with faults at their keys or at the mapping."""

    @classmethod
    def _allowed(cls, given: Mapping[str, Any]) -> set[str]:
        """Allowed keys of a mapping; some may depend on others of its keys."""
        return {info.alias or name for name, info in cls.model_fields.items()}

    @classmethod
    def _read(cls, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[InitErrorDetails]]:
        """The fields' values as input of pydantic, and the faults of the others."""
        return dict(given), []


S = TypeVar("S", bound=Section)
T = TypeVar("T")


def read_quantities(
    given: Mapping[str, Any], kinds: Mapping[str, Quantity | Limit]
) -> tuple[dict[str, float], list[InitErrorDetails]]:
    """The values of the keys present, each read as a quantity or count of its kind, and the faults of the others."""
    found: dict[str, float] = {}
    errors: list[InitErrorDetails] = []
    for name in (name for name in kinds if name in given):
        try:
            found[name] = kinds[name].read(given[name])
        except InputError as error:
            errors.append(InitErrorDetails(type=as_pydantic(error.faults[0]), loc=(name,), input=given[name]))
    return found, errors


def _given(value: object) -> str | float:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise InputError(Fault("this is of the wrong kind", got=shown(value), allowed="a number, or text with a unit"))
    return value


# A quantity whose unit is not known until names are resolved, such as the bound of a parameter.
Given = Annotated[str | float, Reading(_given, "instead")]


def numbered(value: object) -> object:
    """See `listed`; also takes a bare number as a list of one."""
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else listed(value)


@cache
def _reader(model: type[T]) -> TypeAdapter[T]:
    return TypeAdapter(model)


def validated(model: type[T], data: object, path: KeyPath, findings: Findings) -> T | None:
    """`data` as a section or as a class declared in Python; None with faults, all of which are recorded.

    Parameters
    ----------
    model
        The class.
    data
        Plain data of the file.
    path
        Key path of the section in the file, for faults.
    findings
        Collects the faults and warnings.
    """
    try:
        return _reader(model).validate_python(data)
    except ValidationError as error:
        for found in error.errors():
            place = (*path, *_keys(found, data))
            findings.faults.append(_fault(found, findings.document.where(place)))
        return None


def entries(model: type[T], key: str, document: Document, findings: Findings) -> dict[str, T]:
    """Entries without faults of a mapping of sections, each checked by itself.

    Parameters
    ----------
    model
        Class of an entry.
    key
        Key of the mapping in the file.
    document
        The project file as plain data.
    findings
        Collects the faults and warnings.
    """
    data = document.data.get(key)
    if data is not None and not isinstance(data, dict):
        findings.add((key,), "this is of the wrong kind", got=repr(data)[:60], allowed="a mapping of names")
    found = {name: validated(model, entry, (key, name), findings) for name, entry in document.mapping(key).items()}
    return {name: entry for name, entry in found.items() if entry is not None}


def changed(section: S, changes: Mapping[str, object], where: Callable[[str], str]) -> S:
    """A section with some values replaced, checked like those of a file.

    Parameters
    ----------
    section
        The section.
    changes
        New values by key.
    where
        Place of a key for faults, such as `--trials` for "trials".

    Raises
    ------
    InputError
        Where a value is not allowed.
    """
    try:
        return type(section).model_validate({**section.model_dump(), **changes})
    except ValidationError as error:
        faults: list[Fault] = []
        for found in error.errors():
            keys = [str(part) if i else where(str(part)) for i, part in enumerate(found["loc"])]
            faults.append(_fault(found, ".".join(keys)))
        raise InputError(faults) from error


def _fault(found: Any, where: str) -> Fault:
    """A fault from an error of pydantic, or the fault of ours that the error carries."""
    if found["type"] == FAULT:
        fault = Fault(**found["ctx"])
        return replace(fault, where=f"{where}: {fault.where}" if fault.where else where)
    what, got, allowed = _wording(found)
    choices = allowed.replace("'", "").split(", ") if found["type"] == "literal_error" else ()
    return Fault(what, where, got, allowed, nearest(str(found["input"]), choices))


def _keys(found: Any, data: object) -> tuple[str | int, ...]:
    """The keys of an error's pydantic location, without the tags of unions: those in the file, and a missing one."""
    location: tuple[str | int, ...] = found["loc"]
    keys: list[str | int] = []
    here: Any = data
    for i, part in enumerate(location):
        if isinstance(here, dict) and part in here:
            here = here[part]
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            here = here[part]
        elif i < len(location) - 1 or found["type"] not in ("missing", FAULT):
            continue
        keys.append(part)
    return tuple(keys)


_KINDS = {
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
    "dataclass_type": "a mapping of keys",
    "model_attributes_type": "a mapping of keys",
    "list_type": "a list: [a, b, …]",
    "tuple_type": "a list: [a, b, …]",
    "string_type": "text",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
    "float_type": "a number",
    "float_parsing": "a number",
}


def _wording(found: Any) -> tuple[str, str, str]:
    """Texts `what`, `got` and `allowed` of a fault for one of pydantic's own errors."""
    kind, context, got = found["type"], found.get("ctx", {}), shown(found["input"])
    if kind == "missing" and isinstance(found["loc"][-1], int):
        return "the list is too short", "", f"an entry number {found['loc'][-1] + 1}"
    if kind == "missing":
        return "a key is missing", "", f"'{found['loc'][-1]}' must be given"
    if kind in _KINDS:
        return "this is of the wrong kind", got, _KINDS[kind]
    if kind == "literal_error":
        return "there is no such choice", got, str(context["expected"]).replace(" or ", ", ")
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length", context.get("max_length"))
        least = "at least" if kind == "too_short" else "at most"
        return "the list has the wrong length", str(context["actual_length"]), f"{least} {wanted}"
    return "the value is not allowed", got, str(found["msg"]).removeprefix("Input should be ")
