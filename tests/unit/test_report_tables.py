"""The rows of the tables and the sentences of the verdict, against numbers worked out by hand."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from report_example import E_NAME, NU_NAME, column_mesh, example_content, tpe_result, twin_view

from softcal.calibration.results.digits import interval_share
from softcal.calibration.results.result import CalibrationResult, ExperimentFit, Trial
from softcal.calibration.search.outcome import bound_note
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.errors import InputError
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.materials.infill import PrintInfill
from softcal.report.conclusions import conclusions, verdict
from softcal.report.content import ExperimentContent, Landscape, ReportContent
from softcal.report.format import (
    joined,
    number,
    parameter_label,
    parameters_in_words,
)
from softcal.report.html import render_page
from softcal.report.section import all_tables
from softcal.report.tables import (
    errors_table,
    grouped_failures,
    parameters_table,
    provenance_rows,
    share_of_peak,
)
from softcal.twin.parameter_name import parameter_name


def small_content(**changes: object) -> ReportContent:
    d = np.linspace(0.0, 0.02, 5)
    force = 400.0 * d
    data = Dataset("20mm", {"shortening": Channel(d, "m"), "tension": Channel(force, "N")})
    fit = ExperimentFit(
        {"tension": 0.4}, {"tension": 0.1}, {"tension": force}, {"tension": force + 0.4}, {"tension": "N"}
    )
    defaults: dict[str, object] = {
        "parameters": {
            E_NAME: Estimate(2.3e6, "Pa", False, 1e5, 4e7, 2e4),
            NU_NAME: Estimate(0.431, "1", False, 0.4, 0.4999),
        },
        "loss": 0.12, "loss_name": "papers", "method": "tpe", "seed": 7, "n_solves": 3, "n_factorisations": 90,
        "wall_s": 12.0, "status": "Converged", "experiments": {"20mm": fit},
        "importance": {E_NAME: 0.99, NU_NAME: 0.01},
        "trials": (Trial(0, {E_NAME: 1e6, NU_NAME: 0.45}, "COMPLETE", 0.12),), "n_failed_trials": 0,
    }  # fmt: skip
    return ReportContent(
        "neck", {"20mm": CalibrationResult(**{**defaults, **changes})}, {"20mm": ExperimentContent("20mm", data, data)}
    )


def texts(content: ReportContent, tone: str) -> str:
    return " ".join(sentence.text for sentence in conclusions(content) if sentence.tone == tone)


def test_table_one_is_in_megapascals() -> None:
    table = parameters_table(small_content())
    assert [column.header for column in table.columns][:4] == ["Calibration", "E [MPa]", "± E [MPa]", "ν"]
    assert table.rows[0] == (
        "20mm",
        pytest.approx(2.3),
        pytest.approx(0.02),
        0.431,
        None,
        0.99,
        0.01,
        0.12,
        "none",
        None,
    )
    assert table.shown()[0][1:5] == ["2.300", "0.020", "0.431", "–"]


def test_table_one_holds_the_other_fitted_values_in_words() -> None:
    """A slack of every test and an offset, each with its error and unit; nothing where nothing else was fitted."""
    table = parameters_table(example_content(n_trials=5))
    rows = {row[0]: dict(zip((column.header for column in table.columns), row, strict=True)) for row in table.rows}
    assert rows["All jointly"]["Other fitted values"] == (
        "slack (front, 20 mm, 2 mm/s): 2.00 ± 0.10 mm; slack (front, 20 mm, 5 mm/s): 3.00 ± 0.10 mm; "
        "slack (front, 35 mm, 2 mm/s): 4.00 ± 0.10 mm"
    )
    assert rows["20 mm, 2 mm/s"]["Other fitted values"] is None
    offset = {E_NAME: Estimate(2.3e6, "Pa", False, 1e5, 4e7), "plate.pitch_offset": Estimate(0.01, "rad", False, -1, 1)}
    assert "pitch offset (plate): 0.573 deg" in render(small_content(parameters=offset))


def test_a_report_does_not_speak_of_papers() -> None:
    """Who reads it need not know whose tables and equations it follows; `papers` is the name of a loss."""
    page = render(example_content(n_trials=5))
    assert "plausible for the print's infill" in unescape(page)
    words = re.findall(r"[Pp]aper\w*|Eqs?\.", re.sub(r"<td[^>]*>papers</td>", "", page))
    assert words == []


def render(content: ReportContent) -> str:
    return render_page(content, [])


def test_table_two_gives_pitch_in_both_units() -> None:
    content = example_content(n_trials=5)
    table = errors_table(content)
    headers = [column.header for column in table.columns]
    row = dict(zip(headers, table.rows[0], strict=True))
    fit = content.results["20 mm, 2 mm/s"].experiments["20 mm, 2 mm/s"]
    assert row["Force RMSE [N]"] == fit.rmse["tension"]
    assert row["Pitch RMSE [deg]"] == pytest.approx(np.rad2deg(fit.rmse["pitch"]))
    assert row["Pitch RMSE, detrended [rad]"] == fit.rmse_detrended["pitch"]
    unmeasured = dict(zip(headers, table.rows[1], strict=True))
    assert unmeasured["Pitch RMSE [rad]"] is None
    assert not any("Shortening" in header for header in headers)


def test_share_of_peak_uses_the_measured_peak() -> None:
    fit = small_content().headline_result.experiments["20mm"]
    assert share_of_peak(fit) == pytest.approx(0.4 / 8.0)
    assert share_of_peak(fit, "pitch") is None


def test_csv_holds_numbers_in_full_and_units_in_headings() -> None:
    for table in all_tables(example_content(n_trials=40)).values():
        rows = list(csv.reader(io.StringIO(table.as_csv())))
        assert rows[0] == [column.header for column in table.columns]
        assert len(rows) == len(table.rows) + 1
    value = list(csv.reader(io.StringIO(parameters_table(small_content(loss=0.123456789)).as_csv())))[1][7]
    assert float(value) == 0.123456789


def test_failures_are_grouped_whatever_numbers_they_hold() -> None:
    reasons = ("det F below zero in tet 5", "det F below zero in tet 1841", "no equilibrium after 25 iterations")
    trials = tuple(Trial(i, {}, "FAILED", None, reason) for i, reason in enumerate(reasons))
    groups = grouped_failures(small_content(trials=trials, n_failed_trials=3).headline_result)
    assert groups == [("det F below zero in tet 5", 2, 0), ("no equilibrium after 25 iterations", 1, 2)]


def test_provenance_is_told_in_order() -> None:
    steps = (Step("pulley friction", {"n": 2, "factor": 0.53349}, "divided"), Step("zero", {"where": [1.0, 2.0]}))
    data = Dataset("a", {"tension": Channel(np.ones(2), "N")}, steps)
    assert provenance_rows(data) == [
        ("pulley friction", "n = 2, factor = 0.53349", "divided"),
        ("zero", "where = [1, 2]", ""),
    ]


def test_a_bound_is_a_warning_with_its_value() -> None:
    at_bound = {E_NAME: Estimate(4e7, "Pa", True, 1e5, 4e7)}
    assert "E is at its upper bound of 40 MPa" in texts(small_content(parameters=at_bound), "warning")
    assert "No parameter is at a bound" in texts(small_content(), "good")


def test_a_twin_that_falls_in_its_furthest_test_is_a_warning():
    twin = twin_view(column_mesh())
    told = "Not stable at 12 mm of shortening of front, the robot buckles or snaps to another equilibrium."
    assert "stable" not in texts(replace(small_content(), twin=twin), "warning")
    assert told in texts(replace(small_content(), twin=replace(twin, instabilities=told)), "warning")


def test_a_twin_that_passes_through_itself_in_its_furthest_test_is_a_warning():
    twin = twin_view(column_mesh())
    assert "intersects" not in texts(replace(small_content(), twin=twin), "warning")
    told = "bar intersects itself from 2.56 mm of shortening of front on, by about 1.4 mm: set contact: true."
    assert told in texts(replace(small_content(), twin=replace(twin, crossings=told)), "warning")
    out = "The other cables pull back out under tension, by up to 1.2 mm (at sample 2)."
    assert "pull back out" not in texts(replace(small_content(), twin=twin), "warning")
    assert out in texts(replace(small_content(), twin=replace(twin, drawn_out=out)), "warning")


def test_a_bound_is_told_once() -> None:
    at_bound = {E_NAME: Estimate(4e7, "Pa", True, 1e5, 4e7)}
    note = bound_note(E_NAME, at_bound[E_NAME])
    content = small_content(parameters=at_bound, notes=(note, Remark("Another note.")))
    assert "Another note." in texts(content, "note")
    assert note.text not in texts(content, "note")


def test_several_moduli_are_named_and_have_a_table_of_all() -> None:
    several = {f"spring{k}.youngs_modulus": Estimate(k * 1e8, "Pa", False, 1e7, 1e10, 1e6) for k in (7, 8)}
    content = small_content(parameters=several, importance={})
    assert "E (spring7) = 700.0 ± 1.0 MPa and E (spring8) = 800.0 ± 1.0 MPa" in verdict(content).text
    assert "spring8.youngs_modulus" in render_page(content, [])
    assert "Table I." not in render_page(content, [])
    assert "Table I." in render_page(small_content(), [])


def test_identifiability_follows_the_interval_then_the_importance() -> None:
    wide = {NU_NAME: Estimate(0.45, "1", False, 0.4, 0.4999, 0.03)}
    assert "ν is not identified" in texts(small_content(parameters=wide), "warning")
    narrow = {NU_NAME: Estimate(0.45, "1", False, 0.4, 0.4999, 0.001)}
    assert "Identified" in texts(small_content(parameters=narrow), "good")
    by_trials = small_content(extra={"importance_kind": "fanova"})
    assert "ν explains 1.0 % of the loss's variation over the search" in texts(by_trials, "note")
    local = small_content(extra={"importance_kind": "sensitivity"})
    assert "variation over the search" not in " ".join(texts(local, tone) for tone in ("good", "note", "warning"))
    assert interval_share(Estimate(0.45, "1", False, 0.4, 0.5, 0.01)) == pytest.approx(0.392, abs=1e-3)
    modulus = Estimate(1e6, "Pa", False, 1e5, 1e7, 1e4, scale="log")
    assert interval_share(modulus) == pytest.approx(2 * 0.0196 / np.log(100), rel=1e-2)
    narrow = replace(modulus, lower=5e5, upper=2e6)  # less than a decade, and searched by its logarithm all the same
    assert interval_share(narrow) == pytest.approx(2 * 0.0196 / np.log(4), rel=1e-2)
    offset = Estimate(0.002, "N", False, 0.001, 0.5, 0.015, (0.001, 0.030))  # bounds of one sign, and of decades
    assert interval_share(offset) == pytest.approx(0.029 / 0.499)


def test_failed_trials_are_counted_with_their_reason() -> None:
    trials = (Trial(0, {}, "FAILED", None, "J fell below zero"), *(Trial(i, {}, "COMPLETE", 1.0) for i in range(1, 4)))
    content = small_content(trials=trials, n_failed_trials=1)
    assert "1 of 4 trials could not be simulated. Most often: J fell below zero." in texts(content, "warning")


def test_the_headline_names_estimates_fit_and_gravest_doubt() -> None:
    modulus = Estimate(2.3e6, "Pa", False, 1e5, 4e7, 2e4)
    wide = {E_NAME: modulus, NU_NAME: Estimate(0.431, "1", False, 0.4, 0.4999, 0.03)}
    found = verdict(small_content(parameters=wide))
    assert found.sentences[0] == "E = 2.300 ± 0.020 MPa and ν anywhere in 0.4 to 0.4999, from one test."
    assert found.sentences[1] == "The data do not determine ν: its interval covers nearly the whole allowed range."
    assert found.sentences[-1] == "The twin reproduces the force with an RMS error of 5.0 % of its range."
    assert found.warnings == ()  # its sentence says so
    assert found.tone == "warning"
    known = replace(wide[NU_NAME], standard_error=0.02)
    found = verdict(small_content(parameters={**wide, NU_NAME: known}))
    assert found.warnings == ("ν is not identified by these data: its 95 % interval covers 78 % of the allowed range.",)
    assert "do not determine" not in found.text
    assert verdict(small_content()).tone == "good"


def test_eq_5_by_arithmetic() -> None:
    low, high = PrintInfill((8e6, 12e6), 0.3, (1.2, 1.6)).effective_modulus
    assert (low / 1e6, high / 1e6) == (pytest.approx(1.1654, abs=1e-3), pytest.approx(2.8299, abs=1e-3))
    with pytest.raises(InputError, match="reversed"):
        PrintInfill((12e6, 8e6), 1.3, (1.2, 1.6))


def test_content_refuses_what_does_not_fit_together() -> None:
    content = small_content()
    with pytest.raises(InputError, match="experiment without data"):
        replace(content, experiments={})
    with pytest.raises(InputError, match="at least one"):
        replace(content, results={}, headline="")
    with pytest.raises(InputError, match="headline of a calibration that does not exist"):
        replace(content, headline="40mm")
    with pytest.raises(InputError, match="wrong shape"):
        Landscape(E_NAME, NU_NAME, np.ones(3), np.ones(2), np.ones((3, 2)))


def test_the_joint_result_comes_first() -> None:
    content = example_content(n_trials=5)
    assert content.headline == "joint"
    assert content.headline_result is content.results["joint"]


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (1.0, 3, "1.00"),
        (0.9996, 3, "1.00"),
        (12345.0, 3, "12345"),
        (1.234e-7, 3, "1.23e-07"),
        (-2.5, 2, "-2.5"),
    ],
)
def test_numbers_keep_their_digits(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_parameter_names_in_words() -> None:
    own = "front.slack[20.5 mm]"
    assert parameter_name(own).kind == "slack"
    assert parameter_name(own).base == "front.slack"
    assert parameter_label(own) == "slack (front, 20.5 mm)"
    assert parameter_label(E_NAME, [E_NAME, NU_NAME]) == "E"
    assert parameter_label(E_NAME, ["arm.youngs_modulus"]) == "E (neck)"
    slacks = [E_NAME, "front.slack[a]", "front.slack[b]"]
    assert parameters_in_words(slacks, ["a", "b", "c"]) == "E and slack (front) per experiment"
    assert parameters_in_words(slacks, ["a", "monday 1", "monday 2"]) == "E and slack (front) per set-up"
    assert joined(["20 mm, 2 mm/s", "40 mm"]) == "20 mm, 2 mm/s; 40 mm"


def test_a_search_without_intervals_says_nothing_of_them() -> None:
    content = example_content(n_trials=5)
    name = "20 mm, 2 mm/s"
    alone = replace(
        content, results={name: tpe_result([content.experiments[name]], 1.2e6, 0.45, n_trials=5)}, headline=name
    )
    assert not any("interval" in sentence.text for sentence in conclusions(alone))


def test_a_channel_that_no_fit_compares_has_no_columns() -> None:
    given = example_content()
    headers = all_tables(given)["table-2-errors"].as_csv().splitlines()[0]
    assert "Pitch RMSE [deg]" in headers
    assert "Shortening" not in headers
    force = {
        label: replace(
            result,
            experiments={
                name: replace(fit, rmse={"tension": 0.1}, rmse_detrended={"tension": 0.1})
                for name, fit in result.experiments.items()
            },
        )
        for label, result in given.results.items()
    }
    headers = all_tables(replace(given, results=force))["table-2-errors"].as_csv().splitlines()[0]
    assert "Force RMSE [N]" in headers
    assert "Pitch" not in headers
