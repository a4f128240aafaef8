"""The axes of a sweep: lists, ranges, units, and what is refused with a reason."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sweep_case import robot

from softcal.errors import InputError
from softcal.project.axes import Axis, doubled, parse_axis
from softcal.quantities import QUANTITIES
from softcal.twin.parameters import ParameterInfo, robot_parameters

KNOWN = robot_parameters(robot())
E, NU = "springs.youngs_modulus", "springs.poissons_ratio"
TIED = {E: ("spring*.youngs_modulus",), NU: ("spring*.poissons_ratio",)}


def axis(name: str, *written: str | float) -> Axis:
    return parse_axis(name, written, KNOWN, TIED)


def test_the_papers_modulus():
    found = axis(E, "10GPa:1GPa:1GPa")
    assert found.values == tuple(n * 1e9 for n in range(10, 0, -1))
    assert found.targets == ("spring1.youngs_modulus", "spring2.youngs_modulus")
    assert found.parameter.label == E
    assert (found.parameter.lower, found.parameter.upper) == (1e9, 10e9)


@pytest.mark.parametrize(
    ("written", "values"),
    [
        (["0.45:0.05:0.05"], [0.45, 0.4, 0.35, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05]),
        (["0.45:0.05:-0.05"], [0.45, 0.4, 0.35, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05]),
        (["0.4999,0.4 : 0.3 : 0.05"], [0.4999, 0.4, 0.35, 0.3]),
        ([0.2, "0.1", 0], [0.2, 0.1, 0.0]),
        (["0.1:0.4:0.2"], [0.1, 0.3]),
    ],
)
def test_lists_and_ranges(written: list[str | float], values: list[float]):
    assert axis(NU, *written).values == tuple(values)


def test_numbers_are_in_si_and_text_has_a_unit():
    assert axis("spring2.youngs_modulus", "1 GPa", 2e9, np.float64(3e9), 4).values == (1e9, 2e9, 3e9, 4.0)
    with pytest.raises(InputError, match="the unit is missing"):
        axis("spring2.youngs_modulus", "1 GPa", "2e9")


def test_one_parameter_or_a_pattern_instead_of_a_tied_name():
    assert axis("spring2.youngs_modulus", "1 GPa", "2000 MPa").targets == ("spring2.youngs_modulus",)
    assert axis("spring?.density", "1 g/cm^3,2 g/cm^3").values == (1000.0, 2000.0)


@given(
    start=st.integers(-50, 50), steps=st.integers(1, 40), step=st.integers(1, 9), extra=st.floats(0, 0.9),
    sign=st.sampled_from([1, -1]),
)  # fmt: skip
def test_a_range_starts_at_its_start_and_never_passes_its_stop(
    start: int, steps: int, step: int, extra: float, sign: int
):
    stop = start + sign * step * (steps + extra)
    known = {"x.force": ParameterInfo("x.force", QUANTITIES["force"], 0.0)}
    values = parse_axis("x.force", [f"{start} N:{stop:.6f} N:{step} N"], known, {}).values
    assert len(values) == steps + 1
    assert values == pytest.approx([start + sign * step * k for k in range(steps + 1)])


@pytest.mark.parametrize(
    ("name", "written", "message"),
    [
        ("springs.young_modulus", "1GPa,2GPa", r"there is no such parameter.*Try: 'springs.youngs_modulus'"),
        ("spring[12].youngs_modulus", "1GPa,2GPa", "there is no such parameter"),
        (E, "10:1:1", "the unit is missing; got '10'"),
        (E, "10GPa:1GPa:1", "the unit is missing; got '1'"),
        (E, "10mm:1mm:1mm", "the unit does not fit"),
        (E, "10GPa:1GPa", "a range has a start, a stop and a step"),
        (E, "1GPa:1GPa:1GPa", "the range is empty"),
        (E, "1GPa:5GPa:0GPa", "the step is zero"),
        (E, "1GPa:5GPa:-1GPa", "the step leads away from the stop"),
        (E, "1GPa:5GPa:1Pa", "there are too many values on an axis; got 4000000001"),
        (E, "1GPa:2GPa:3GPa", r"a sweep needs two values or more; got 1 GPa.*--set"),
        (E, "1GPa", "a sweep needs two values or more"),
        (E, "1GPa,2GPa,1000MPa", "a value appears twice; got 1 GPa"),
        (E, "1GPa,-2GPa", "the modulus is out of range; got -2e"),
        (E, "1GPa,,2GPa", "this is not a quantity"),
    ],
)
def test_what_makes_no_sense_is_refused(name: str, written: str, message: str):
    with pytest.raises(InputError, match=message):
        axis(name, written)


def test_every_fault_of_an_axis_is_told():
    with pytest.raises(InputError) as error:
        axis(E, "10:1GPa:1GPa", "5mm", "3GPa:2GPa")
    assert len(error.value.faults) == 3


@pytest.mark.parametrize(
    ("written", "attempt"),
    [
        (["0.5:0.05:0.05"], "0.4999,0.45:0.05:0.05"),
        (["0.3,0.5"], "0.3,0.4999"),
        (["0.4:0.6:0.1"], "0.4999,0.4"),
        (["0.45", "0.5:0.4:0.1"], "0.45,0.4999,0.4"),
    ],
)
def test_a_ratio_of_a_half_is_refused_with_the_reason_and_the_nearest_allowed(written: list[str], attempt: str):
    with pytest.raises(InputError) as error:
        axis(NU, *written)
    text = str(error.value)
    assert "the volume cannot change" in text
    assert "the nearest being 0.4999" in text
    assert f"Try: {NU}={attempt}." in text
    assert max(axis(NU, attempt).values) == 0.4999


def test_what_is_swept_twice_or_held():
    axes = [axis(E, "1GPa,2GPa"), axis("spring2.youngs_modulus", "1GPa,2GPa"), axis(NU, "0.1,0.2")]
    faults = doubled(axes, ["spring1.poissons_ratio"])
    assert [(fault.where, fault.what) for fault in faults] == [
        ("spring2.youngs_modulus", "the parameter is swept twice"),
        (NU, "the parameter is fixed and swept at once"),
    ]
