"""The base of every section of the project file, and the quantities in it: text with a unit in, SI out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Sized
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    ModelWrapValidatorHandler,
    PlainValidator,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from softcal.catalogue import Catalogue
from softcal.errors import Fault, InputError, nearest
from softcal.limits import LIMITS
from softcal.project.document import Findings, KeyPath
from softcal.quantities import QUANTITIES, Quantity

# The kind of error that carries a whole `Fault`: its context has got, allowed and attempt.
FAULT = "softcal_fault"


def fault_error(what: str, *, got: str = "", allowed: str = "", attempt: str = "") -> PydanticCustomError:
    """An error to raise in a validator, which ends as a `Fault` at the key that was being read."""
    return PydanticCustomError(FAULT, "{what}", {"what": what, "got": got, "allowed": allowed, "attempt": attempt})


def require_one(section: BaseModel, keys: Sequence[str], what: str, *, nothing: str = "neither", allowed: str) -> None:
    """Check in a validator that just one of the keys is given; `what` is wrong where it is `nothing`, or several."""
    given = [key for key in keys if getattr(section, key) is not None]
    if len(given) != 1:
        raise fault_error(what, got=" and ".join(given) or nothing, allowed=allowed)


class Section(BaseModel):
    """A mapping of the project file: frozen, and an unknown key in it is a fault that names the nearest known one."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="wrap")
    @classmethod
    def _known_keys(cls, data: Any, handler: ModelWrapValidatorHandler[Any]) -> Any:
        if not isinstance(data, dict):
            return handler(data)
        given: dict[str, Any] = data
        known = cls._allowed(given)
        unknown = [key for key in given if key not in known]
        errors = [
            InitErrorDetails(
                type=fault_error(
                    "unknown key",
                    got=f"'{key}'",
                    allowed=", ".join(sorted(known)),
                    attempt=nearest(key, known),
                ),
                loc=(key,),
                input=given[key],
            )
            for key in unknown
        ]
        # A required key that was only mistyped is one mistake, told once.
        meant = {(nearest(key, known).strip("'"),) for key in unknown}
        read, faults = cls._read({key: value for key, value in given.items() if key in known})
        errors += [fault for fault in faults if not (fault["type"] == "missing" and fault.get("loc") in meant)]
        try:
            section = handler(read)
        except ValidationError as error:
            if not errors and not faults:
                raise
            errors += [
                _details(found)
                for found in error.errors()
                if not (found["type"] == "missing" and found["loc"] in meant)
            ]
        else:
            if not errors:
                return section
        raise ValidationError.from_exception_data(cls.__name__, errors)

    @classmethod
    def _allowed(cls, given: Mapping[str, Any]) -> set[str]:
        """The keys that a mapping may have, of which some may depend on others of it."""
        return {info.alias or name for name, info in cls.model_fields.items()}

    @classmethod
    def _read(cls, given: Mapping[str, Any]) -> tuple[dict[str, Any], list[InitErrorDetails]]:
        """The fields' values as pydantic is to read them, and what is wrong with the others."""
        return dict(given), []


S = TypeVar("S", bound=Section)
T = TypeVar("T", bound=Sized)


def quantity(kind: str) -> Callable[[object], float]:
    """A reader of a kind of quantity, by the kind's name; see `reader`."""
    return reader(QUANTITIES[kind])


def reader(kind: Quantity) -> Callable[[object], float]:
    """A reader of a kind of quantity: text with a unit in, a number in SI out, in the range of its kind."""

    def read(value: object) -> float:
        try:
            return kind.read(value)
        except InputError as error:
            fault = error.faults[0]
            raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt) from error

    return read


def counted(kind: str) -> BeforeValidator:
    """A whole number of something there is a limit of."""
    limit = LIMITS[kind]

    def check(value: object) -> object:
        if isinstance(value, bool) or not isinstance(value, int):
            raise fault_error("this is of the wrong kind", got=_shown(value), allowed="a whole number")
        if fault := limit.fault(value):
            raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        return value

    return BeforeValidator(check)


def member_of(catalogue: Catalogue[Any]) -> AfterValidator:
    """The name of a member of a family that others can add to."""

    def check(name: str) -> str:
        if name not in catalogue:
            fault = catalogue.unknown(name)
            raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        return name

    return AfterValidator(check)


def at_most(kind: str) -> AfterValidator:
    """A check that a list or mapping has no more entries than there may be."""
    limit = LIMITS[kind]

    def check(value: T) -> T:
        if value and (fault := limit.fault(len(value))):
            raise fault_error(fault.what, got=fault.got, allowed=fault.allowed, attempt=fault.attempt)
        return value

    return AfterValidator(check)


Length = Annotated[float, BeforeValidator(quantity("length"))]
Size = Annotated[float, BeforeValidator(quantity("size"))]
Clearance = Annotated[float, BeforeValidator(quantity("clearance"))]
Slack = Annotated[float, BeforeValidator(quantity("slack"))]
Area = Annotated[float, BeforeValidator(quantity("area"))]
SecondMoment = Annotated[float, BeforeValidator(quantity("second moment"))]
Angle = Annotated[float, BeforeValidator(quantity("angle"))]
Force = Annotated[float, BeforeValidator(quantity("force"))]
TensionOffset = Annotated[float, BeforeValidator(quantity("tension offset"))]
Pressure = Annotated[float, BeforeValidator(quantity("pressure"))]
Modulus = Annotated[float, BeforeValidator(quantity("modulus"))]
PoissonsRatio = Annotated[float, BeforeValidator(quantity("Poisson's ratio"))]
Wrap = Annotated[float, BeforeValidator(quantity("wrap angle"))]
Friction = Annotated[float, BeforeValidator(quantity("friction coefficient"))]
Mass = Annotated[float, BeforeValidator(quantity("mass"))]
Density = Annotated[float, BeforeValidator(quantity("density"))]
MomentOfInertia = Annotated[float, BeforeValidator(quantity("moment of inertia"))]
Acceleration = Annotated[float, BeforeValidator(quantity("acceleration"))]
Time = Annotated[float, BeforeValidator(quantity("time"))]
Duration = Annotated[float, BeforeValidator(quantity("duration"))]
Speed = Annotated[float, BeforeValidator(quantity("speed"))]
Rate = Annotated[float, BeforeValidator(quantity("rate"))]
Ratio = Annotated[float, BeforeValidator(quantity("ratio"))]
PositiveRatio = Annotated[float, BeforeValidator(quantity("positive ratio"))]
Share = Annotated[float, BeforeValidator(quantity("share"))]
Turns = Annotated[float, BeforeValidator(quantity("number of turns"))]
Factor = Annotated[float, BeforeValidator(quantity("scale factor"))]
Point = tuple[Length, Length, Length]
ForceVector = tuple[Force, Force, Force]
Traction = tuple[Pressure, Pressure, Pressure]
Gravity = tuple[Acceleration, Acceleration, Acceleration]


def _pointing(value: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(value):
        raise fault_error("the direction has no length", got="[0, 0, 0]", allowed="such as [0, 0, 1]")
    return value


Direction = Annotated[tuple[Ratio, Ratio, Ratio], AfterValidator(_pointing)]


def _given(value: object) -> str | float:
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise fault_error("this is of the wrong kind", got=_shown(value), allowed="a number, or text with a unit")
    return value


# A quantity whose unit is not known until names are resolved, such as the bound of a parameter.
Given = Annotated[str | float, PlainValidator(_given)]


def listed(value: object) -> object:
    """One entry as a list of it."""
    return [value] if isinstance(value, str | dict) else value


def numbered(value: object) -> object:
    """As `listed`, and a bare number as a list of it too."""
    return [value] if isinstance(value, int | float) and not isinstance(value, bool) else listed(value)


def validated(model: type[S], data: object, path: KeyPath, findings: Findings) -> S | None:
    """`data` as a section, or None with every fault of it recorded."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        for found in error.errors():
            _record(found, data, path, findings)
        return None


def changed(section: S, changes: Mapping[str, object], where: str) -> S:
    """A section with some values replaced, checked like those of a file.

    Raises
    ------
    InputError
        Where a value is not allowed; `where` comes before its key.
    """
    try:
        return type(section).model_validate({**dict(section), **changes})
    except ValidationError as error:
        faults: list[Fault] = []
        for found in error.errors():
            faults.append(_fault(found, where + ".".join(str(part) for part in found["loc"])))
        raise InputError(faults) from error


def _details(found: Any) -> InitErrorDetails:
    if found["type"] == FAULT:
        kind = PydanticCustomError(FAULT, "{what}", found["ctx"])
    else:
        what, got, allowed = _wording(found)
        kind = fault_error(what, got=got, allowed=allowed)
    return InitErrorDetails(type=kind, loc=found["loc"], input=found["input"])


def _record(found: Any, data: object, path: KeyPath, findings: Findings) -> None:
    place = (*path, *_keys(found["loc"], data))
    findings.faults.append(_fault(found, findings.document.where(place)))


def _fault(found: Any, where: str) -> Fault:
    """An error of pydantic's, or one of ours that it carried, as a fault."""
    if found["type"] == FAULT:
        told = found["ctx"]
        return Fault(told["what"], where, told["got"], told["allowed"], told["attempt"])
    what, got, allowed = _wording(found)
    return Fault(what, where, got, allowed)


def _keys(location: tuple[str | int, ...], data: object) -> tuple[str | int, ...]:
    """The part of a pydantic location that stands in the file: the tags of unions do not."""
    keys: list[str | int] = []
    here: Any = data
    for i, part in enumerate(location):
        if isinstance(here, dict) and part in here:
            here = here[part]
        elif isinstance(here, list) and isinstance(part, int) and part < len(here):
            here = here[part]
        elif i < len(location) - 1:
            continue
        keys.append(part)
    return tuple(keys)


_KINDS = {
    "dict_type": "a mapping of keys",
    "model_type": "a mapping of keys",
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
    """What, got and allowed for one of pydantic's own errors."""
    kind, context, got = found["type"], found.get("ctx", {}), _shown(found["input"])
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


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
