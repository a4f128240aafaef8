"""Unit conversion: text with a unit to SI, and SI to text for display. The only module that knows millimetres."""

from __future__ import annotations

import contextlib
import functools
import math
import re
import tokenize
from typing import TYPE_CHECKING, Any

from softcal.errors import Fault, UnitError

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pint

# SI unit of each kind of quantity -> display unit.
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
    "pixel": "px",
}

# All known units, in Pint's syntax. Angle, pixel and count are dimensions of their own, not ratios or lengths.
_DEFINITIONS = """\
nano- = 1e-9 = n-
micro- = 1e-6 = µ- = μ- = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
deci- = 1e-1 = d-
deca- = 1e+1 = da-
hecto- = 1e2 = h-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
metre = [length] = m = meter = metres = meters
second = [time] = s = sec = seconds = secs
gram = [mass] = g = grams = gramme = grammes
radian = [angle] = rad = radians
pixel = [image] = px = pixels
ampere = [current] = A = amperes = amps
count = [count] = counts = tick = ticks = pulse = pulses
percent = 0.01 = %
ppm = 1e-6
inch = 0.0254 * metre = in = inches
foot = 0.3048 * metre = ft = feet
thou = 0.001 * inch
minute = 60 * second = min = minutes
hour = 3600 * second = h = hr = hours
hertz = 1 / second = Hz
degree = 3.141592653589793 / 180 * radian = deg = ° = º = degrees
arcminute = degree / 60 = arcmin
arcsecond = degree / 3600 = arcsec
turn = 2 * 3.141592653589793 * radian = rev = turns = revolution = revolutions
pound = 453.59237 * gram = lb = lbs = pounds
ounce = pound / 16 = oz = ounces
tonne = 1000 * kilogram = t
litre = 0.001 * metre ** 3 = L = l = liter
newton = kilogram * metre / second ** 2 = N = newtons = Newton
standard_gravity = 9.80665 * metre / second ** 2 = g0 = g_0 = g_n
gram_force = gram * standard_gravity = gf = pond
kilogram_force = kilogram * standard_gravity = kgf = kp = kilopond
pound_force = pound * standard_gravity = lbf = lbsf
ounce_force = ounce * standard_gravity = ozf
dyne = 1e-5 * newton = dyn
pascal = newton / metre ** 2 = Pa = Pascal
bar = 1e5 * pascal
millibar = 100 * pascal = mbar
atmosphere = 101325 * pascal = atm
psi = pound_force / inch ** 2
millimetre_of_mercury = 133.322387415 * pascal = mmHg
torr = 101325 / 760 * pascal = Torr
ksi = 1000 * psi
joule = newton * metre = J
watt = joule / second = W
volt = watt / ampere = V
"""

# The most frequent units: dimension -> unit -> factor to Pint's base units, as Pint has them (a test compares). They
# spare most commands Pint, whose import takes a third of a second.
FREQUENT = {
    "dimensionless": {"1": 1.0, "%": 0.01},
    "[length]": {"m": 1.0, "cm": 0.01, "mm": 0.001},
    "[length] ** 2": {"m^2": 1.0},
    "[length] ** 3": {"m^3": 1.0, "ml": 1e-6, "mm^3": 1e-9},
    "[length] ** 4": {"m^4": 1.0},
    "[mass]": {"kg": 1000.0, "g": 1.0},
    "[mass] / [length] ** 3": {"kg/m^3": 1000.0},
    "[mass] * [length] ** 2": {"kg*m^2": 1000.0},
    "[mass] * [length] / [time] ** 2": {"N": 1000.0, "mN": 1.0, "kgf": 9806.65},
    "[mass] / [length] / [time] ** 2": {"Pa": 1e3, "kPa": 1e6, "MPa": 1e9, "GPa": 1e12},
    "[mass] * [length] ** 2 / [time] ** 2": {"N*m": 1000.0, "N*mm": 1.0},
    "[mass] / [time] ** 2": {"N/m": 1000.0},
    "[time] ** 2 / [mass]": {"m/N": 0.001},
    "[length] ** 4 * [time] ** 2 / [mass]": {"m^3/Pa": 0.001},
    "[length] ** 3 / [time]": {"m^3/s": 1.0, "ml/min": 1e-6 / 60.0},
    "[angle]": {"rad": 1.0, "deg": 0.017453292519943295},
    "[angle] / [length]": {"rad/m": 1.0},
    "[time]": {"s": 1.0, "ms": 0.001},
    "1 / [time]": {"1/s": 1.0},
    "[length] / [time]": {"m/s": 1.0},
    "[length] / [time] ** 2": {"m/s^2": 1.0},
    "[image]": {"px": 1.0},
}
_FREQUENT = {unit: (factor, of) for of, units in FREQUENT.items() for unit, factor in units.items()}
# Common notation -> Pint's notation.
_SPELLINGS = {
    "": "dimensionless",
    "1": "dimensionless",
    '"': "inch",
    "''": "inch",
    "″": "inch",
    "”": "inch",
    "in.": "inch",
    "'": "foot",
    "′": "foot",
    "’": "foot",
}
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "×": "*", "²": "^2", "³": "^3", "⁴": "^4", "−": "-"})
# A unit consists of names with small integer powers, multiplied and divided: no other numbers.
_NAME = r"[^\W\d]+|[%°º]"
_FACTOR = rf"\(*(?:{_NAME})(?:(?:\^|\*\*)-?\d)?\)*"
_UNIT = re.compile(rf"(?:1 ?/ ?)?{_FACTOR}(?: ?[*/. ] ?{_FACTOR})*")
_LONGEST = 40
# "mm2" is "mm^2".
_BARE_POWER = re.compile(r"(?<=[^\W\d_])([2-4])(?!\w)")
_NUMBER = re.compile(r"\s*([-+−]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+−]?[0-9]+)?)\s*(.*?)\s*", re.DOTALL)
_DECIMAL_COMMA = re.compile(r"\s*[-+]?[0-9]+,[0-9]+\s*")

# Wanted SI unit -> likely intended spelling of an unknown unit.
_USUAL = {
    "m": ("m", "mm", "cm", "um", "km", "in", "ft"),
    "N": ("N", "mN", "kN", "kgf", "gf", "lbf"),
    "Pa": ("Pa", "kPa", "MPa", "GPa", "psi", "bar", "mbar", "mmHg", "N/mm^2"),
    "m^3": ("m^3", "ml", "l", "mm^3", "cm^3"),
    "m^3/s": ("ml/min", "ml/s", "l/min", "m^3/s"),
    "rad": ("rad", "mrad", "deg"),
    "s": ("s", "ms", "min", "h"),
    "kg": ("kg", "g", "mg", "lb", "oz"),
    "px": ("px",),
    "1": ("%",),
}
# A mass unit given where a force is wanted -> the corresponding force unit.
_WEIGHTS = {"kg": "kgf", "g": "gf", "lb": "lbf", "lbs": "lbf", "oz": "ozf"}


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint

    registry: pint.UnitRegistry[Any] = pint.UnitRegistry(None)  # pyright: ignore[reportArgumentType]  (none of the units that come with Pint)
    for line in _DEFINITIONS.splitlines():
        registry.define(line)
    return registry


@functools.lru_cache(maxsize=1000)
def _base(unit: str) -> tuple[float, str] | None:
    """Factor to base units, and the dimension; None if the text is no unit."""
    return _FREQUENT.get(unit) or by_pint(unit)


def by_pint(unit: str) -> tuple[float, str] | None:
    """`_base` by Pint."""
    text = re.sub(r" ?(\^|\*\*) ?", r"\1", " ".join(unit.split()))
    text = _SPELLINGS.get(text, _BARE_POWER.sub(r"^\1", text.translate(_SIGNS)))
    if len(text) > _LONGEST or _UNIT.fullmatch(text) is None:
        return None
    import pint

    # Its parser adds Python's own.
    of_python = (tokenize.TokenError, ArithmeticError, AssertionError, SyntaxError, TypeError, ValueError)
    registry = _registry()
    try:
        one = registry.Quantity(1.0, registry.parse_units(text)).to_base_units()
    except (pint.errors.PintError, *of_python):
        return None
    return float(one.magnitude), str(one.dimensionality)


def unit_factor(unit: str, si_unit: str, *, where: str = "") -> float:
    """Conversion factor from a unit to another of its dimension.

    Parameters
    ----------
    unit
        The unit, such as "MPa".
    si_unit
        The other one, of SI.
    where
        Where the unit is stated, for errors.

    Raises
    ------
    UnitError
        If the unit is unknown or has another dimension.
    """
    given, wanted = _base(unit), _base(si_unit)
    if wanted is None:
        raise ValueError(f"softcal does not know the unit {si_unit}")
    if given is not None and given[1] == wanted[1]:
        return given[0] / wanted[0]
    shown = f"'{unit}'" if len(unit) <= _LONGEST else f"'{unit[:_LONGEST]}…'"
    allowed = f"a unit that converts to {si_unit}" if si_unit != "1" else "a plain number, or %"
    if si_unit == "N" and unit in _WEIGHTS:
        meant = f"{_WEIGHTS[unit]} for a weight; a mass may hang only where a key says that it is one"
    elif si_unit == "Pa" and (match := re.fullmatch(r"(kg|g|lbs?)(/.*)", unit)):
        meant = f"{_WEIGHTS[match[1]]}{match[2]}"
    else:
        same = [usual for usual in _USUAL.get(si_unit, ()) if usual.casefold() == unit.casefold()]
        meant = f"'{same[0]}'" if same else ""
    raise UnitError(Fault("the unit does not fit", where, shown, allowed, meant))


AS_WRITTEN = 10
"""Significant digits with which a number is shown as it was written, without floating-point rounding."""
_PLAIN = 999_999.5
_MOST_DECIMALS = 8


def parse_quantity(value: object, si_unit: str, *, where: str = "") -> float:
    """A number in `si_unit` from text such as "2.3 MPa"; a plain number only if `si_unit` is "1" or it is 0.

    Parameters
    ----------
    value
        Text such as "2.3 MPa"; a plain number only if `si_unit` is "1" or it is 0.
    si_unit
        Unit of the number that is returned.
    where
        Where the value is stated, for errors.

    Raises
    ------
    UnitError
        If the unit is missing, unknown or of another dimension, or the number is not finite.
    """
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise _unreadable(value, si_unit, where)
    if isinstance(value, str):
        match = _NUMBER.fullmatch(value)
        if match is None:
            raise _unreadable(value, si_unit, where)
        if _DECIMAL_COMMA.match(value):
            attempt = f"'{value.strip().replace(',', '.')}'" if value.count(",") == 1 else ""
            raise _unreadable(value, si_unit, where, attempt)
        number, unit = float(match[1].replace("−", "-")), match[2]
    else:
        try:
            number, unit = float(value), ""
        except OverflowError:
            number, unit = math.inf, ""
    if not unit and si_unit != "1" and number != 0:
        usual = "mm" if si_unit == "m" else si_unit
        allowed = f"a number with a unit that converts to {si_unit}, such as '{number:.6g} {usual}'"
        raise UnitError(Fault("the unit is missing", where, _shown(value), allowed))
    number *= unit_factor(unit, si_unit, where=where) if unit else 1.0
    if not math.isfinite(number):
        raise UnitError(Fault("the number is not finite", where=where, got=_shown(value)))
    return number


def has_unit(text: str) -> bool:
    """Whether a text is a number with a unit, such as "1.2 N*m/A"."""
    match = _NUMBER.fullmatch(text)
    return match is not None and bool(match[2]) and _base(match[2]) is not None


def sensor_factor(unit: str, constant: str, si_unit: str, *, where: str = "") -> float:
    """Conversion factor from the numbers that a sensor writes to the quantity that it measures.

    Parameters
    ----------
    unit
        Unit of its numbers, such as "counts", "A" or "mV".
    constant
        The sensor's constant: what it writes for one of the quantity, or the reverse, such as "4096 counts/turn",
        "1.2 N*m/A" or "-2 mV/N".
    si_unit
        SI unit of the quantity.
    where
        Where the unit is stated, for errors.

    Raises
    ------
    UnitError
        If the constant is zero, or leads from the one unit to none of the other.
    """
    for way, power in ((f"{si_unit}/({unit})", 1), (f"({unit})/({si_unit})", -1)):
        if _base(way) is None:
            continue
        with contextlib.suppress(UnitError, ZeroDivisionError):
            return float(parse_quantity(constant, way) ** power)
    got, allowed = f"'{constant}' for a column in '{unit}'", f"a number in {si_unit} per {unit}, or the reverse"
    raise UnitError(Fault("the constant does not convert the column's unit to its channel's", where, got, allowed))


def format_quantity(value: float, si_unit: str, unit: str | None = None, *, digits: int = 4) -> str:
    """Text such as "2.3 MPa" for a number in `si_unit`.

    Parameters
    ----------
    value
        The number in `si_unit`.
    si_unit
        Its unit.
    unit
        Unit of the text; None for one that suits the size.
    digits
        Significant digits.
    """
    shown = unit or readable_unit(value, si_unit)
    text = plain(value / unit_factor(shown, si_unit), digits)
    return text if shown == "1" else f"{text} {shown}"


def format_range(low: float, high: float, si_unit: str, *, digits: int = AS_WRITTEN) -> str:
    """Text such as "50 kPa to 10 MPa" or "0 to 3 mm" for a range in `si_unit`.

    Parameters
    ----------
    low, high
        Ends of the range in `si_unit`.
    si_unit
        Their unit.
    digits
        Significant digits.
    """
    above = readable_unit(high, si_unit)
    below = readable_unit(low, si_unit) if low else above
    first = format_quantity(low, si_unit, below, digits=digits)
    return f"{first.removesuffix(f' {above}')} to {format_quantity(high, si_unit, above, digits=digits)}"


def format_place(at: Iterable[float], decimals: int = 6) -> str:
    """Text such as "(10, 0, 42.5) mm" for a point [m], to six digits and so many decimals."""
    return f"({', '.join(f'{round(1e3 * x, decimals) + 0.0:.6g}' for x in at)}) mm"


def digits_that_tell(low: float, high: float) -> int:
    """Significant digits that show the ends of an interval to two digits of its length; four or more."""
    size, apart = max(abs(low), abs(high)), abs(high - low)
    return min(max(4, math.ceil(math.log10(size / apart)) + 2), AS_WRITTEN) if apart > 0.0 else 4


def plain(number: float, digits: int = 4) -> str:
    """A number to `digits` significant digits, with an exponent only below 0.0001 and from a million on."""
    text = f"{number:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(number) < _PLAIN else text


def rounded(value: float, uncertainty: float | None, least: int = 0) -> str:
    """A number to the second significant digit of its uncertainty; to three digits without an uncertainty.

    Parameters
    ----------
    value, uncertainty
        In the same unit.
    least
        Significant digits that are shown however large the uncertainty is.
    """
    if not value or uncertainty is None or not 0.0 < uncertainty < math.inf or not math.isfinite(value):
        return plain(value or 0.0, 3)
    place = _place(uncertainty, 2)
    if least:
        place = min(place, _place(value, least))
    if place < -_MOST_DECIMALS or abs(value) >= _PLAIN:
        return f"{value:.{min(max(math.floor(math.log10(abs(value))) - place, 0), AS_WRITTEN)}e}"
    text = f"{round(value, -place):.{max(-place, 0)}f}"
    return text if float(text) else text.removeprefix("-")


def _place(value: float, digits: int) -> int:
    """Power of ten of a number's last one of so many significant digits."""
    return math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}")))) - digits + 1


def readable_unit(value: float, si_unit: str) -> str:
    """Display unit of `value` [si_unit]."""
    if si_unit == "Pa":
        for unit in ("GPa", "MPa", "kPa"):
            if abs(value) >= 0.999 * unit_factor(unit, "Pa"):
                return unit
        return "Pa" if abs(value) < 100 else "kPa"
    if si_unit == "kg" and abs(value) < 0.9995:
        return "g"
    if si_unit == "N*m" and abs(value) < 0.09995:
        return "N*mm"
    return {"m": "mm", "rad": "deg", "m^3": "ml", "m^3/s": "ml/min", "m/N": "mm/N"}.get(si_unit, si_unit)


def _unreadable(value: object, si_unit: str, where: str, attempt: str = "") -> UnitError:
    example = "0.45" if si_unit == "1" else f"'1.5 {si_unit}'"
    return UnitError(Fault("this is not a quantity", where, _shown(value), f"for example {example}", attempt))


def _shown(value: object) -> str:
    if isinstance(value, int) and abs(value) >= 10**30:  # Python refuses to write more than some thousand digits
        return "a whole number of more than 30 digits"
    text = f"{value:.6g}" if isinstance(value, float) else repr(value)
    return text if len(text) <= 60 else text[:57] + "…"
