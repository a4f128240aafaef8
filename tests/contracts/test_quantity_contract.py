"""Every kind of quantity refuses another kind's units, numbers outside its range, and what is no number at all."""

from __future__ import annotations

import math

import pytest

from softcal.errors import InputError, ParameterError, UnitError
from softcal.quantities import QUANTITIES
from softcal.units import SI_UNITS, format_quantity, parse_quantity

KINDS = sorted(QUANTITIES)
# A unit of every dimension that a user may write; "%" is a ratio's, "px" neither a length nor a ratio.
OTHERS = ("mm", "px", "deg", "rad", "%", "N", "kgf", "MPa", "g", "ms", "mm/s", "kg/m^3", "1/s", "mm^2", "turn", "ppm")
SAME = {
    "m": ("mm", '"', "in", "µm"),
    "px": ("px", "pixels"),
    "rad": ("deg", "°", "rad", "turn"),
    "1": ("%", "ppm", ""),
    "N": ("kN", "kgf", "lbf"),
    "Pa": ("MPa", "N/mm^2", "N/mm2", "psi", "kgf/cm^2"),
    "kg": ("g", "lbs", "lb", "oz", "t"),
    "s": ("ms", "min", "h"),
    "m/s": ("mm/s", "mm/min", "in/s"),
    "1/s": ("Hz", "1/min"),
    "m^2": ("mm^2", "mm²"),
    "kg/m^3": ("g/cm^3", "g/cm3", "kg/m³"),
}


def dimension(unit: str) -> str:
    return next((si for si, units in SAME.items() if unit in units or unit == si), unit)


MIXED = [(kind, unit) for kind in KINDS for unit in OTHERS if dimension(unit) != QUANTITIES[kind].unit]


@pytest.mark.parametrize(("kind", "unit"), MIXED)
def test_units_of_another_dimension_are_refused(kind: str, unit: str):
    with pytest.raises(UnitError, match=r"^robot\.x: the unit does not fit; got "):
        QUANTITIES[kind].read(f"1 {unit}", where="robot.x")


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_units_are_read(kind: str):
    quantity = QUANTITIES[kind]
    for unit in SAME.get(quantity.unit, (quantity.unit,)):
        inside = [v for v in (1e-3, 1.5, 100.0, 2e6) if quantity.allows(parse_quantity(f"{v} {unit}", quantity.unit))]
        assert inside, unit
        assert all(quantity.allows(quantity.read(f"{value} {unit}")) for value in inside), unit


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_outside_the_range_are_refused(kind: str):
    quantity = QUANTITIES[kind]
    span = quantity.upper - quantity.lower
    outside = [quantity.lower - 1e-6 * span, quantity.upper + 1e-6 * span, math.nan, math.inf, -math.inf]
    outside += [end for end, sign in zip((quantity.lower, quantity.upper), quantity.ends, strict=True) if sign in "()"]
    outside += [0.0, -0.0, quantity.least / 2] if quantity.least else []
    for value in outside:
        with pytest.raises(ParameterError, match=r"out of range; got .*; allowed: "):
            quantity.checked(value, where="robot.x")
    inside = [end for end, sign in zip((quantity.lower, quantity.upper), quantity.ends, strict=True) if sign in "[]"]
    for value in (*inside, 0.5 * (quantity.lower + quantity.upper) or 1.0):
        assert quantity.checked(value) == value


@pytest.mark.parametrize(
    "text", ["", " ", "soft", "nan mm", ".inf", "1e999 m", "1,5 mm", "--1 mm", "1 2 mm", "0x10", "1e"]
)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_number_is_refused(kind: str, text: str):
    with pytest.raises(InputError) as error:
        QUANTITIES[kind].read(text, where="robot.x")
    assert str(error.value).startswith("robot.x: ")


@pytest.mark.parametrize("value", [None, True, [], {}, [1.0], b"1", math.nan, math.inf, 10**400])
@pytest.mark.parametrize("kind", KINDS)
def test_values_of_another_type_are_refused(kind: str, value: object):
    with pytest.raises(InputError):
        QUANTITIES[kind].read(value)


def test_every_dimension_has_a_quantity():
    assert set(SI_UNITS.values()) <= {quantity.unit for quantity in QUANTITIES.values()}


@pytest.mark.parametrize("kind", KINDS)
def test_a_range_is_told_so_that_it_can_be_typed(kind: str):
    quantity = QUANTITIES[kind]
    fault = quantity.fault(2 * abs(quantity.upper) + 1)
    assert fault is not None
    assert f"{quantity.upper:g}" in fault.allowed
    value = 0.25 if quantity.allows(0.25) else 1.0
    assert quantity.read(format_quantity(value, quantity.unit, quantity.unit)) == value
