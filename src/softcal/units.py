"""The only place that knows millimetres: text with a unit in, SI out, and back for people."""

from __future__ import annotations

import functools
import math
import re
import tokenize
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from softcal.errors import Fault, UnitError

if TYPE_CHECKING:
    import pint

# The unit in which each kind of quantity is held inside, and the one in which people read it.
SI_UNITS = {
    "length": "m",
    "force": "N",
    "pressure": "Pa",
    "angle": "rad",
    "time": "s",
    "mass": "kg",
    "density": "kg/m^3",
    "acceleration": "m/s^2",
    "speed": "m/s",
    "ratio": "1",
}

# What pint would compute for ages, or until its parser overflows: powers of powers, long numbers, long text.
_ENDLESS = re.compile(r"(\*\*|\^)[^*/^]*(\*\*|\^)|\)\s*(\*\*|\^)|\d{3}|^.{41}", re.DOTALL)


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry()
    registry.define("kgf = kilogram_force")
    return registry


def _pint_errors() -> tuple[type[Exception], ...]:
    """What pint raises for text that is no unit, or a unit of another dimension; its parser adds Python's own."""
    import pint

    return (
        pint.errors.PintError,
        tokenize.TokenError,
        ArithmeticError,
        AssertionError,
        SyntaxError,
        TypeError,
        ValueError,
    )


def unit_factor(unit: str, si_unit: str, *, where: str = "") -> float:
    """Factor that turns a number in `unit` into one in `si_unit`.

    Raises
    ------
    UnitError
        Where the unit is unknown or measures something else.
    """
    fault = Fault(
        "the unit does not fit", where=where, got=f"'{unit}'", allowed=f"a unit that converts to {si_unit or '1'}"
    )
    if _ENDLESS.search(unit):
        raise UnitError(fault)
    registry = _registry()
    try:
        return float(registry.Quantity(1.0, _plain(unit)).to(_plain(si_unit)).magnitude)
    except _pint_errors() as error:
        if si_unit == "N" and _is_mass(unit):
            fault = replace(fault, attempt="kgf for a weight; a mass may hang only where a key says that it is one")
        raise UnitError(fault) from error


def _is_mass(unit: str) -> bool:
    try:
        return bool(_registry().Quantity(1.0, _plain(unit)).check("[mass]"))
    except _pint_errors():
        return False


def parse_quantity(value: object, si_unit: str, *, where: str = "") -> float:
    """A number in `si_unit` from text such as "2.3 MPa"; a plain number only where `si_unit` is "1".

    Raises
    ------
    UnitError
        Where the unit is missing, unknown or of another dimension, or the number is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise _unreadable(value, si_unit, where)
    if not isinstance(value, str):
        if si_unit != "1" and value != 0:
            raise UnitError(
                Fault(
                    "the unit is missing",
                    where=where,
                    got=f"{value!r}",
                    allowed=f"a number with a unit that converts to {si_unit}, such as '{value} {si_unit}'",
                )
            )
        number, unit = float(value), "1"
        factor = 1.0
    else:
        match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", value)
        if match is None:
            raise _unreadable(value, si_unit, where)
        number, unit = float(match[1]), match[2]
        if not unit and si_unit != "1" and number != 0:
            raise UnitError(
                Fault(
                    "the unit is missing",
                    where=where,
                    got=f"'{value}'",
                    allowed=f"a number with a unit that converts to {si_unit}, such as '{value.strip()} {si_unit}'",
                )
            )
        factor = unit_factor(unit, si_unit, where=where) if unit else 1.0
    if not math.isfinite(number):
        raise UnitError(Fault("the number is not finite", where=where, got=f"{value!r}"))
    return number * factor


def format_quantity(value: float, si_unit: str, unit: str | None = None, *, digits: int = 4) -> str:
    """Text such as "2.3 MPa" for a number held in `si_unit`."""
    shown = unit or readable_unit(value, si_unit)
    number = value / unit_factor(shown, si_unit)
    text = f"{number:.{digits}g}"
    return text if shown == "1" else f"{text} {shown}"


def readable_unit(value: float, si_unit: str) -> str:
    """The unit in which a person would read `value` [si_unit]."""
    if si_unit == "Pa":
        for unit in ("GPa", "MPa", "kPa"):
            if abs(value) >= 0.999 * unit_factor(unit, "Pa"):
                return unit
        return "Pa" if abs(value) < 100 else "kPa"
    if si_unit == "kg" and abs(value) < 0.9995:
        return "g"
    return {"m": "mm", "rad": "deg"}.get(si_unit, si_unit)


def _plain(unit: str) -> str:
    return {"1": "dimensionless", "": "dimensionless", "%": "percent", "°": "degree"}.get(unit, unit)


def _unreadable(value: object, si_unit: str, where: str) -> UnitError:
    example = "0.45" if si_unit == "1" else f"'1.5 {si_unit}'"
    return UnitError(Fault("this is not a quantity", where=where, got=f"{value!r}", allowed=f"for example {example}"))
