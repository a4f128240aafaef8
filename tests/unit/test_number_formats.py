"""Numbers as people read them: whatever their size, what is shown is the number to the digits that it has."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from report_example import E_NAME, bench_experiment, example_content, tpe_result

from softcal.analysis.agreement import Agreement
from softcal.analysis.mesh_verdict import times_text
from softcal.calibration.results.digits import interval_text
from softcal.calibration.results.result import Distance
from softcal.calibration.statistics.estimate import Estimate
from softcal.cli.calibration_table import print_results, value_text
from softcal.report.agreement import chance_text, range_text, size_text
from softcal.report.closeness import Miss, closeness, miss_text
from softcal.report.format import duration, file_stem, joined, number
from softcal.report.tables import all_parameters_table
from softcal.twin.crossings import span_in_words
from softcal.units import format_quantity, plain, readable_unit, rounded
from tests.strategies import numbers

SIGNED = st.builds(lambda sign, exponent: sign * 10.0**exponent, st.sampled_from((-1, 1)), numbers(-12, 12))
DIGITS = st.integers(1, 10)


def read(text: str) -> list[float]:
    return [float(found) for found in re.findall(r"-?\d[\d.]*(?:e[+-]\d+)?", text)]


@given(SIGNED, DIGITS)
@example(999_999.49, 4)
@example(9.9996e-5, 4)
def test_plain_is_the_number_to_its_digits(value: float, digits: int):
    text = plain(value, digits)
    assert float(text) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))
    if 1e-4 <= abs(value) < 999_999:
        assert "e" not in text


@given(SIGNED, DIGITS)
def test_number_is_the_number_to_its_digits(value: float, digits: int):
    text = number(value, digits)
    assert float(text) == pytest.approx(value, rel=0.51 * 10.0 ** (1 - digits))
    if 1.1e-4 <= abs(value) < 9e5:
        assert "e" not in text


@pytest.mark.parametrize(("value", "text"), [(math.inf, "inf"), (-math.inf, "-inf"), (-0.0, "0"), (2.5e6, "2.50e+06")])
def test_numbers_at_the_ends(value: float, text: str):
    assert number(value) == text


@given(SIGNED, numbers(-14, 6))
@example(1.983, -12.0)
@example(-0.04, 0.0)
def test_a_number_is_told_to_the_second_digit_of_its_uncertainty(value: float, exponent: float):
    uncertainty = 10.0**exponent
    text = rounded(value, uncertainty)
    (told,) = read(text)
    assert abs(told - value) <= 0.06 * uncertainty + 1e-9 * abs(value)  # ten digits at most
    last = Decimal(text).as_tuple().exponent
    assert isinstance(last, int)
    assert 10.0**last > 0.0099 * uncertainty or "." not in text  # a whole number may end in zeros
    assert text not in ("-0", "-0.0", "-0.00")


def test_an_uncertainty_decides_the_digits():
    assert rounded(1.98321, 0.0213) == "1.983"
    assert rounded(0.45, 0.0996) == "0.45"
    assert rounded(707.0, 4975.0) == "700"
    assert rounded(60.0, 4975.0, least=1) == "60"
    assert rounded(-0.04, 3.1) == "0.0"
    assert rounded(1.2345678e9, 1e6) == "1.2346e+09"
    assert rounded(0.0, 0.1) == rounded(-0.0, 0.1) == "0"


@pytest.mark.parametrize("unknown", [None, 0.0, -1.0, math.inf, math.nan])
def test_where_the_uncertainty_is_not_known_a_number_has_three_digits(unknown: float | None):
    assert rounded(1.98321, unknown) == "1.98"


@given(numbers(1e-6, 1e9), numbers(1e-7, 0.5), st.sampled_from(("Pa", "m", "N", "rad", "kg", "1")))
@example(3.187e6, 3e-5, "Pa")
def test_the_ends_of_an_interval_are_told_apart(value: float, share: float, unit: str):
    low, high = value * (1 - share), value * (1 + share)
    text = interval_text(Estimate(value, unit, False, 0.0, 1e10, value * share / 1.96, (low, high)))
    below, above = read(text)
    factor = high / read(format_quantity(high, unit, readable_unit(value, unit), digits=15))[0]
    assert (above - below) * factor == pytest.approx(high - low, rel=0.11)


def test_a_value_is_told_as_far_as_its_error_reaches():
    estimate = Estimate(3.18704e6, "Pa", False, 1e5, 4e7, 21.0)
    assert value_text(estimate) == "3.187040 ± 0.000021 MPa"
    assert value_text(replace(estimate, standard_error=7.3e3)) == "3.187 ± 0.007 MPa"
    assert value_text(replace(estimate, standard_error=None)) == "3.19 MPa"
    narrow = replace(estimate, interval=(3.186999e6, 3.187082e6))
    assert interval_text(narrow) == "3.186999 to 3.187082 MPa"
    wide = replace(estimate, standard_error=1.15e5, interval=(2.8137e6, 3.7632e6))
    assert (value_text(wide), interval_text(wide)) == ("3.19 ± 0.12 MPa", "2.81 to 3.76 MPa")


def test_the_report_tells_the_ends_of_an_interval_apart():
    content = example_content(n_trials=12)
    joint = content.results["joint"]
    estimate = replace(joint.parameters[E_NAME], value=1.2e6, interval=(1.199996e6, 1.200004e6))
    close = replace(content, results={"joint": replace(joint, parameters={E_NAME: estimate})})
    (row,) = all_parameters_table(close).rows
    assert "1.1999960 to 1.2000040" in row


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 s"), (0.0123, "0.0123 s"), (89.9, "89.9 s"), (90.0, "1.5 min"), (5399.0, "90.0 min"), (5400.0, "1.5 h")],
)
def test_time_spans(seconds: float, text: str):
    assert duration(seconds) == text


@given(numbers(0.01, 1e6))
def test_a_time_span_reads_back(seconds: float):
    text = duration(seconds)
    factor = {"s": 1.0, "min": 60.0, "h": 3600.0}[text.split()[-1]]
    assert read(text)[0] * factor == pytest.approx(seconds, rel=0.04)


@given(numbers(-1e4, 1e4).filter(lambda x: abs(x) > 1e-3))
def test_times_have_no_exponent_and_no_sign(times: float):
    text = times_text(times)
    assert "e" not in text
    assert float(text) == pytest.approx(abs(times), rel=0.06)


def test_distances_are_told_in_millimetres_and_per_cent_of_the_length(capsys):
    experiments = [bench_experiment("20mm", 0.02, 1.2e6)]
    result = tpe_result(experiments, 1.2e6, 0.45, n_trials=12)
    fit = result.experiments["20mm"]
    distances = {"m1": Distance(0.001, 0.004, 0.002, 10), "m2": Distance(0.003, 0.005, 0.004, 10)}
    for length, text in ((None, "2 and 5 mm "), (0.5, "2 and 5 mm (0.4 and 1 %)")):
        seen = replace(fit, distances=distances, length=length)
        print_results({"20mm": replace(result, experiments={"20mm": seen})}, verbose=True)
        (line,) = [line for line in capsys.readouterr().out.splitlines() if "distance, mean and largest, 20mm" in line]
        assert text in line


def test_lists_and_file_names_in_words():
    assert joined([]) == ""
    assert joined(["a"]) == "a"
    assert joined(["a", "b", "c"]) == "a, b and c"
    assert joined(["a, b", "c"]) == "a, b; c"
    assert joined(["E (a, b)", "c"]) == "E (a, b) and c"
    assert file_stem("20.5 mm / ν") == "20-5-mm"
    assert file_stem("ν") == "unnamed"


def fits(low: float, high: float, unit: str, chance: float | None, n: int = 2) -> Agreement:
    estimates = {name: Estimate(v, unit, False, 0.0, 1e9) for name, v in (("a", low), ("b", high))}
    return Agreement("neck.x", estimates, None, n - 1, chance)


@pytest.mark.parametrize(
    ("chance", "text"), [(None, "p unknown"), (0.314, "p = 0.31"), (2e-9, "p = 2.0e-09"), (1e-11, "p < 1e-10")]
)
def test_a_probability_by_chance(chance: float | None, text: str):
    assert chance_text(fits(1e6, 2e6, "Pa", chance, 5)) == text


@pytest.mark.parametrize("chance", [0.314, 1e-11])
def test_below_five_tests_a_comparison_has_a_level_and_no_probability(chance: float):
    assert chance_text(fits(1e6, 2e6, "Pa", chance, 4)) == "at the 5 % level"


def test_how_far_fits_are_apart():
    assert size_text(fits(0.95e6, 1.05e6, "Pa", None)) == "10 %"
    assert size_text(fits(-1e-3, 2e-3, "m", None)) == "3.0 mm"
    assert size_text(fits(0.40, 0.45, "1", None)) == "0.050"
    assert range_text(fits(0.95e6, 1.05e6, "Pa", None)) == "0.95 to 1.05 MPa"
    assert range_text(fits(0.40, 0.45, "1", None)) == "0.4 to 0.45"
    known = fits(0.95e6, 1.05e6, "Pa", None)
    sure = {name: replace(one, standard_error=2e4) for name, one in known.estimates.items()}
    assert range_text(replace(known, estimates=sure)) == "0.950 to 1.050 MPa"
    vague = {name: replace(one, standard_error=2e6) for name, one in known.estimates.items()}
    assert size_text(replace(known, estimates=vague)) == "10 %"


def test_what_is_missed():
    missed = Miss("20mm", "force", 0.4, "N", 0.05, 8.0)
    assert miss_text(missed) == "the force to 0.400 N RMS (5.0 % of its range, 8.0 times the noise of its record)"
    assert miss_text(replace(missed, in_noise=None)) == "the force to 0.400 N RMS (5.0 % of its range)"
    assert miss_text(replace(missed, share=None, in_noise=None)) == "the force to 0.400 N RMS"


def test_a_channel_without_a_range_is_judged_beside_others_and_by_one_sample() -> None:
    force = Miss("20mm", "force", 0.4, "N", 0.07, 8.0)
    pitch = Miss("20mm", "pitch", 0.2, "rad", None, 40.0)
    told = "that is poor (all measured values of the pitch are the same, and the twin's differ from them)"
    assert closeness([force, pitch]) == closeness([pitch]) == (told, "warning")
    assert closeness([force])[1] == "note"
    assert closeness([replace(pitch, in_noise=0.5)])[1] == "good"


def test_where_something_crosses():
    assert span_in_words(None, None, "front") == "from the start on"
    assert span_in_words(None, 0.0123, "front") == "from the start to 12.3 mm of shortening of front"
    assert span_in_words(0.0123, None, "front") == "from 12.3 mm of shortening of front on"
    assert span_in_words(0.0123, 0.02, "front") == "from 12.3 to 20 mm of shortening of front"


def test_an_end_that_is_a_bound_is_shown_as_it_was_written():
    """A Poisson's ratio of 0.5 is not allowed, and none was asked for."""
    nu = Estimate(0.43, "1", False, 0.4, 0.4999, 0.02, (0.4, 0.4999))
    assert interval_text(nu) == "0.4 to 0.4999"
    inside = Estimate(0.43, "1", False, 0.1, 0.4999, 0.02, (0.391, 0.469123456))
    assert interval_text(inside) == "0.391 to 0.469"
    log = Estimate(3e6, "Pa", False, 1e5, 4e8, None, (2e5, 3e8), scale="log")
    assert interval_text(log) == "0.2 to 300 MPa"
