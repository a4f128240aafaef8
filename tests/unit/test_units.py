"""Text with a unit in, SI out; whatever else stands there is a UnitError, quickly."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from softcal.errors import UnitError
from softcal.units import (
    FREQUENT,
    SI_UNITS,
    by_pint,
    format_place,
    format_quantity,
    format_range,
    parse_quantity,
    plain,
    readable_unit,
    sensor_factor,
    unit_factor,
)
from tests.strategies import numbers


@pytest.mark.parametrize(
    ("text", "si_unit", "value"),
    [
        ("2.3 MPa", "Pa", 2.3e6),
        ("2.3MPa", "Pa", 2.3e6),
        ("-15 mm/s", "m/s", -0.015),
        ("1e-3 kN", "N", 1.0),
        (".5 kgf", "N", 4.903325),
        ("180 deg", "rad", math.pi),
        ("180°", "rad", math.pi),
        ("30 %", "1", 0.3),
        ("0.45", "1", 0.45),
        (0.45, "1", 0.45),
        ("1.2 g/cm^3", "kg/m^3", 1200.0),
        ("9.81 m/s**2", "m/s^2", 9.81),
        ("2 lbs", "kg", 0.90718474),
        ("1 lbf", "N", 4.4482216152605),
        ("3 N/mm2", "Pa", 3e6),
        ("3 N/mm²", "Pa", 3e6),
        ("7 kg·m²", "kg*m^2", 7.0),
        ('2 "', "m", 0.0508),
        ("1.5 ″", "m", 0.0381),
        ("2'", "m", 0.6096),
        ("−3 mm", "m", -0.003),
        ("12 px", "px", 12.0),
        ("600 mm/min", "m/s", 0.01),
        ("5 daN", "N", 50.0),
        ("10 Hz", "1/s", 10.0),
        ("0", "m", 0.0),
        (0, "m", 0.0),
    ],
)
def test_quantities_are_read(text, si_unit, value):
    assert parse_quantity(text, si_unit) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "si_unit", "message"),
    [
        ("2.3", "Pa", "the unit is missing"),
        (2.3, "Pa", "the unit is missing"),
        ("2.3 mm", "Pa", "the unit does not fit; got 'mm'; allowed: a unit that converts to Pa"),
        ("2.3 MPaa", "Pa", "the unit does not fit"),
        ("two MPa", "Pa", "not a quantity"),
        ("2,3 MPa", "Pa", "not a quantity.*Try: .2.3 MPa."),
        ("2,000,000 Pa", "Pa", r"allowed: for example '1\.5 Pa'\.$"),
        ("3 2 mm", "m", "does not fit"),
        ("5 mm", "px", "does not fit; got 'mm'"),
        ("5 px", "m", "does not fit; got 'px'"),
        ("0.43 deg", "1", "does not fit; got 'deg'; allowed: a plain number, or %"),
        ("0.43 rad", "1", "does not fit"),
        ("270 %", "rad", "does not fit; got '%'"),
        ("1.57", "rad", "the unit is missing"),
        ("2 Mpa", "Pa", "Try: 'MPa'"),
        ("2 lbs", "N", "Try: lbf for a weight"),
        ("2 kg/cm^2", "Pa", "Try: kgf/cm\\^2"),
        ("1e308 km", "m", "not finite"),
        (10**400, "1", "not finite"),
        (True, "1", "not a quantity"),
        (None, "m", "not a quantity"),
        (math.nan, "1", "not finite"),
        ("1e999 mm", "m", "not finite"),
    ],
)
def test_what_is_no_quantity_is_refused(text, si_unit, message):
    with pytest.raises(UnitError, match=message):
        parse_quantity(text, si_unit, where="robot.neck")


@pytest.mark.parametrize(
    ("unit", "constant", "si_unit", "factor"),
    [
        ("counts", "4096 counts/turn", "rad", 2.0 * math.pi / 4096),
        ("counts", "0.1 deg/count", "rad", math.radians(0.1)),
        ("mA", "-0.9 N*m/A", "N*m", -9e-4),
        ("mV", "2 mV/N", "N", 0.5),
        ("V", "2 mV/kgf", "N", 500.0 * 9.80665),
    ],
)
def test_a_sensors_constant_leads_either_way(unit, constant, si_unit, factor):
    assert sensor_factor(unit, constant, si_unit) == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "constant", "si_unit"),
    [
        ("counts", "0 counts/turn", "rad"),
        ("A", "4 counts/turn", "rad"),
        ("deg", "4 counts/turn", "rad"),
        ("cats", "1 N/A", "N"),
    ],
)
def test_a_sensors_constant_that_leads_nowhere_is_refused(unit, constant, si_unit):
    with pytest.raises(UnitError, match=f"got '{constant}' for a column in '{unit}'"):
        sensor_factor(unit, constant, si_unit)


def test_a_refusal_names_its_place():
    with pytest.raises(UnitError, match=r"^robot\.neck\.youngs_modulus: "):
        parse_quantity("2.3", "Pa", where="robot.neck.youngs_modulus")


@pytest.mark.parametrize("unit", ["m**9**9**9", "m^99999999", "9**99999999*m", "((9^9)^9)^99", "(" * 400 + "m"])
def test_endless_units_are_refused_at_once(unit):
    with pytest.raises(UnitError, match="does not fit"):
        unit_factor(unit, "m")


WORDS = ["m", "mm", "kg", "Pa", "degC", "foo", "(", ")", "*", "**", "/", "^", "2", "-1", "0", " ", "[", "'", "\\", "\n"]
WORDS += [".", ",", "if", "lambda", "µ", "°", "@", "%", "and", "~", "+", "-", "1.5.", "0x", "sin(", "1j", "\x00"]


@given(st.lists(st.sampled_from(WORDS), max_size=5).map("".join), st.sampled_from(sorted(SI_UNITS.values())))
def test_any_text_is_a_unit_or_a_unit_error(unit, si_unit):
    with contextlib.suppress(UnitError):
        assert math.isfinite(unit_factor(unit, si_unit))


@given(numbers(1e-6, 1e9), st.sampled_from(sorted(SI_UNITS.values())))
def test_what_is_shown_reads_back(value, si_unit):
    assert parse_quantity(format_quantity(value, si_unit, digits=12), si_unit) == pytest.approx(value, rel=1e-10)


def test_a_small_mass_is_shown_in_grams():
    assert format_quantity(0.0206, "kg") == "20.6 g"
    assert format_quantity(1.0, "kg") == "1 kg"


@pytest.mark.parametrize(("value", "unit"), [(2.3e6, "MPa"), (990e3, "kPa"), (1e9, "GPa"), (50.0, "Pa"), (0.0, "Pa")])
def test_a_modulus_is_shown_as_people_read_it(value, unit):
    assert readable_unit(value, "Pa") == unit


def test_numbers_are_told_without_needless_exponents():
    assert format_quantity(1.4e6, "Pa", "kPa", digits=2) == "1400 kPa"
    assert format_quantity(9.96e6, "Pa", "kPa", digits=2) == "10000 kPa"
    assert format_quantity(2.3e6, "Pa") == "2.3 MPa"
    assert plain(3.0e7) == "3e+07"
    assert plain(2.5e-9, 2) == "2.5e-09"
    assert plain(123456.0) == "123500"


def test_a_range_is_told_as_it_was_written():
    assert format_range(5e4, 1e7, "Pa") == "50 kPa to 10 MPa"
    assert format_range(0.0, 3e-3, "m") == "0 to 3 mm"
    assert format_range(-math.radians(2), math.radians(12), "rad") == "-2 to 12 deg"
    assert format_range(0.3, 0.49999, "1") == "0.3 to 0.49999"


def test_a_point_is_told_in_millimetres_without_rounding_errors():
    assert format_place((0.01, -0.0, 0.1 + 0.2)) == "(10, 0, 300) mm"
    assert format_place((1.2345e-3, -1e-12, 9.0), 2) == "(1.23, 0, 9000) mm"


@pytest.mark.parametrize(("dimension", "unit"), [(of, unit) for of, units in FREQUENT.items() for unit in units])
def test_frequent_units_are_as_pint_has_them(dimension, unit):
    assert by_pint(unit) == (FREQUENT[dimension][unit], dimension)
