"""The first screen: each of its sentences where it is true, and absent where it is not; its numbers; its page."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from report_example import E_NAME, NU_NAME, column_mesh, twin_view
from test_report_conclusions import content, fit, modulus, result, separate, told
from test_trend import NECK, joint

import softcal
from softcal.analysis.mesh_changes import Change
from softcal.analysis.mesh_study import Finer, MeshStudy
from softcal.calibration.problem.uncertain import MESH_ERROR
from softcal.calibration.results.digits import interval_share
from softcal.calibration.results.result import CalibrationResult, Distance, ExperimentFit, HeldOut
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.random_effects import Spread
from softcal.calibration.statistics.residuals import ResidualRecord
from softcal.calibration.statistics.sensitivity import not_included
from softcal.cli.calibration_table import print_results
from softcal.report.agreement import agreement_sentences
from softcal.report.conclusions import verdict
from softcal.report.content import ReportContent
from softcal.report.figure import report_pictures
from softcal.report.first_screen import FirstScreen, budget_note, three_sentences
from softcal.report.headline import headline
from softcal.report.html import key_numbers, render_page
from softcal.report.page import marks, moment, unbroken
from softcal.report.positions import prediction_sentence
from softcal.report.statement import SOURCES, legend, percent, source_of, statement
from softcal.twin.finer import Size

AROUND = (1.861e6, 1.981e6)
BUDGET = {"noise": 0.08, "experiments": 0.92}
E = Estimate(1.932357e6, "Pa", False, 1e5, 4e7, 2.07e4, AROUND, scale="log", shares=BUDGET)
NU = Estimate(0.43755, "1", False, 0.4, 0.4999, 0.02, (0.4, 0.4954), shares={"noise": 1.0})
ALIKE, WHITE = ResidualRecord(60, 0.9, 4, 30.0), ResidualRecord(60, 0.05, 29, 30.0)


def fitted(*names: str, estimates: dict[str, Estimate], **more: Any) -> CalibrationResult:
    return result(*names, estimates=estimates, **more)


def sentences(*of: CalibrationResult, study: MeshStudy | None = None) -> list[str]:
    results = {f"fit{i}": one for i, one in enumerate(of)}
    return three_sentences(FirstScreen(results, "fit0", study=study))


def second(estimate: Estimate, *names: str, **more: Any) -> str:
    return sentences(fitted(*(names or ("a", "b", "c")), estimates={E_NAME: estimate}, **more))[1]


def study_of(value: float, estimate: Estimate = E) -> MeshStudy:
    finer = Finer("h/2", "every element halved", Size(8, 0, 100), values={E_NAME: value})
    return MeshStudy({E_NAME: estimate}, (E_NAME,), 0.1, "papers", ("P2P1",), "P2P1", Size(1, 0, 10), (finer,), "h/2")


# What is known of a parameter.


def test_a_parameter_is_its_value_interval_and_budget() -> None:
    one = statement(E_NAME, "E", E)
    assert (one.value, one.interval, one.remark) == ("1.932 MPa", "1.861 to 1.981 MPa", "")
    assert one.sentence == "E = 1.932 MPa (95 %: 1.861 to 1.981 MPa)"
    assert one.budget_text == "tests 92 %, noise 8 %"
    assert [source.kind for source, *_ in one.shares] == ["noise", "experiments"]


@pytest.mark.parametrize("at_bound", [True, False])
def test_an_interval_that_is_nearly_the_whole_range_is_said_to_be_so(at_bound: bool) -> None:
    one = statement(NU_NAME, "ν", replace(NU, at_bound=at_bound))
    assert not one.is_determined
    assert (one.value, one.interval) == ("anywhere in 0.4 to 0.495", "")
    assert one.remark == "the data do not determine it; the twin uses 0.438"
    whole = statement(NU_NAME, "ν", replace(NU, interval=(0.4, 0.4999)))
    assert whole.sentence == "ν anywhere in 0.4 to 0.4999"  # bounds as they were written
    narrower = statement(NU_NAME, "ν", replace(NU, interval=(0.41, 0.48)))
    assert narrower.is_determined
    assert narrower.value == "0.438"


def test_a_parameter_without_an_interval_says_so() -> None:
    bare = replace(E, standard_error=None, interval=None, shares={})
    one = statement(E_NAME, "E", bare)
    assert (one.value, one.interval) == ("1.93 MPa", "")
    assert one.remark == "no interval; searched 100 kPa to 40 MPa"
    assert not one.budget
    held = statement(NU_NAME, "ν", replace(NU, value=0.4, at_bound=True, interval=(0.4, 0.42)))
    assert held.remark == "at a bound"


def test_shares_in_words() -> None:
    assert [percent(share) for share in (0.001, 0.02, 0.5, 0.995, 1.0)] == ["< 1 %", "2 %", "50 %", "> 99 %", "100 %"]


def test_an_uncertain_parameter_is_a_source_with_its_name_and_a_colour() -> None:
    friction = source_of("pulleys.friction_coefficient")
    assert (friction.words, friction.short) == ("the uncertainty of the friction coefficient (pulleys)", "μ")
    assert source_of("*.gain").words == "the uncertainty of *.gain"
    one = statement(
        E_NAME, "E", replace(E, shares={"friction": 0.1, "pulleys.friction_coefficient": 0.7, "noise": 0.2})
    )
    assert [source.kind for source in legend([one])] == ["noise", "friction", "pulleys.friction_coefficient"]
    classes = marks(legend([one]))
    assert classes["friction"] != classes["pulleys.friction_coefficient"]
    assert classes["noise"] == "noise"


# The mesh.


def test_the_mesh_counts_by_the_square_of_its_shift() -> None:
    value = E.value + 2.0 * 2.07e4
    budget = statement(E_NAME, "E", E, study_of(value)).budget
    assert budget == {"noise": pytest.approx(0.016), "experiments": pytest.approx(0.184), "mesh": pytest.approx(0.8)}
    assert sum(budget.values()) == pytest.approx(1.0)
    other = replace(E, value=1.1 * E.value)
    assert "mesh" not in statement(E_NAME, "E", other, study_of(value)).budget  # a study of other values
    included = replace(E, shares={"noise": 0.5, "mesh": 0.5})
    assert statement(E_NAME, "E", included, study_of(value, included)).budget == included.shares


def test_what_is_said_of_the_mesh() -> None:
    made = fitted("a", "b", "c", estimates={E_NAME: E})
    without, study = FirstScreen({"joint": made}, "joint"), study_of(E.value + 2.0 * 2.07e4)
    assert budget_note(without) == ("The mesh's share is not included; softcal mesh-study estimates it.")
    assert "the intervals do not include it" in budget_note(replace(without, study=study))
    text = sentences(made, study=study)[1]
    assert text == "80 % of the squared error of E comes from the mesh."  # whether a finer one reduces it is not known
    own = fitted("a", "b", "c", estimates={E_NAME: replace(E, shares={"noise": 0.4, "mesh": 0.6})})
    assert budget_note(FirstScreen({"joint": own}, "joint")) == "The intervals include the mesh's share."
    assert sentences(own)[1].startswith("60 % of the variance of E comes from the mesh")
    bare = fitted("a", estimates={E_NAME: replace(E, shares={}, interval=None, standard_error=None)})
    assert budget_note(FirstScreen({"a": bare}, "a")) == ""
    page = render(content({"joint": made}))
    assert page.count("mesh's share is not included") == 1


@pytest.mark.parametrize(("orders", "converges"), [((2.0, 1.4), True), ((2.0, None), False), ((), False)])
def test_a_finer_mesh_helps_only_where_its_study_found_orders(
    orders: tuple[float | None, ...], converges: bool
) -> None:
    """The displacement of a point under a load has no limit: its changes have no order."""
    own = replace(E, shares={"noise": 0.4, "mesh": 0.6})
    changes = tuple(Change("a", "tension", "N", 0.1, 0.01, None, 0.1, 1.0, 60, order) for order in orders)
    study = study_of(E.value + 1e4, own)
    study = replace(study, finer=(replace(study.finer[0], changes=changes),))
    text = sentences(fitted("a", "b", "c", estimates={E_NAME: own}), study=study)[1]
    assert ("a finer mesh will reduce it" in text) == converges
    assert "from the mesh" in text


# The largest source of error.


def test_sources_that_are_shown_as_equal_are_both_named() -> None:
    text = second(replace(E, shares={"noise": 0.26, "mesh": 0.372, "pulleys.friction_coefficient": 0.368}))
    assert text == (
        "37 % of the variance of E comes from the mesh: softcal mesh-study shows whether a finer mesh reduces it. As "
        "much comes from the uncertainty of the friction coefficient (pulleys): measuring it more precisely will "
        "reduce it."
    )
    assert "As much" not in second(replace(E, shares={"noise": 0.38, "mesh": 0.37, "prior": 0.25}))


def test_no_source_is_named_for_what_the_data_do_not_determine() -> None:
    """Its interval is that of its own bounds."""
    shares = {"noise": 0.2, "bounds": 0.8}
    assert statement(NU_NAME, "ν", replace(NU, shares=shares)).budget == {}
    assert statement(NU_NAME, "ν", replace(NU, interval=(0.42, 0.45), shares=shares)).budget == shares


def test_tests_that_differ_are_not_helped_by_more_samples() -> None:
    text = second(E)
    assert text.startswith(
        "92 % of the variance of E comes from differences between the tests: more samples of the same"
    )
    assert "further tests, or the cause of the differences, will." in text
    assert "falls with" not in text


def test_what_reduces_noise_depends_on_whether_samples_are_alike() -> None:
    noise = replace(E, shares={"noise": 0.9, "prior": 0.1})

    def at(*records: ResidualRecord) -> str:
        return second(noise, residuals={"a": {str(i): one for i, one in enumerate(records)}})

    further = "will reduce it; softcal next-test ranks further tests."
    assert at(WHITE, WHITE).endswith(f"the noise of the measurements: more samples, or a better sensor, {further}")
    # Of two samples it is not known whether both have the error of a misplaced marker.
    for few in ((), (replace(WHITE, n=2),), (WHITE, replace(WHITE, n=2))):
        assert at(*few).endswith(f"measurements: more independent measurements, or better ones, {further}")
    assert "it is correlated along the records, where a higher sampling rate will not reduce it" in at(ALIKE, ALIKE)
    # A law that is wrong in every test alike is in no further one less.
    assert "further tests, which softcal next-test ranks, will, unless their residuals are the same" in at(ALIKE, ALIKE)
    assert "it is correlated along some of the records, where" in at(ALIKE, WHITE)
    assert "more samples, or" not in at(ALIKE, WHITE)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("prior", "from the priors: a better measurement of what they describe will reduce it."),
        ("mesh", "from the mesh: softcal mesh-study shows whether a finer mesh reduces it."),
        ("pulleys.friction_coefficient", "friction coefficient (pulleys): measuring it more precisely will reduce it."),
    ],
)
def test_other_sources_have_their_own_remedies(kind: str, words: str) -> None:
    text = second(replace(E, shares={kind: 0.6, "noise": 0.4}))
    assert text.startswith("60 % of the variance of E comes from the ")
    assert text.endswith(words)
    assert words not in second(E)


def test_one_test_says_that_others_may_differ() -> None:
    alone = replace(E, shares={"noise": 1.0})
    text = second(alone, "a")
    assert text.startswith("All of the known variance of E comes from the noise of the measurements")
    assert text.endswith("By how much tests differ is not known from one.")
    assert "not known from one" not in second(alone, "a", "b")
    several = sentences(*(fitted(name, estimates={E_NAME: alone}) for name in ("a", "b")))[1]
    assert several.startswith("All of the known variance of E in fit0 comes from")
    assert "not known from one" not in several
    assert second(replace(E, shares={"noise": 0.004, "prior": 0.996})).startswith("More than 99 % of the variance")


def test_what_the_data_do_not_determine_comes_first() -> None:
    made = fitted("a", "b", "c", estimates={E_NAME: E, NU_NAME: NU})
    first, text, _ = sentences(made)
    assert first == "E = 1.932 MPa (95 %: 1.861 to 1.981 MPa) and ν anywhere in 0.4 to 0.495, from 3 tests."
    assert text.startswith("The data do not determine ν: its interval covers nearly the whole allowed range. 92 % of")
    assert sentences(fitted("a", estimates={NU_NAME: NU}))[1].endswith("nearly the whole allowed range.")
    sure = fitted("a", "b", estimates={E_NAME: E, NU_NAME: replace(NU, interval=(0.43, 0.44))})
    assert "do not determine" not in " ".join(sentences(sure))


def test_of_several_parameters_the_least_certain_is_judged() -> None:
    nu = replace(NU, interval=(0.42, 0.45), shares={"prior": 0.7, "noise": 0.3})
    assert (interval_share(nu) or 0.0) > (interval_share(E) or 0.0)
    made = fitted("a", "b", "c", estimates={E_NAME: E, NU_NAME: nu})
    assert sentences(made)[1].startswith("70 % of the variance of ν comes from the priors")


def test_without_intervals_the_reason_is_given() -> None:
    bare = {E_NAME: replace(E, shares={}, interval=None, standard_error=None)}
    first, text, _ = sentences(fitted("a", "b", estimates=bare, converged=False, status="Stopped."))
    assert first == "E = 1.93 MPa, from 2 tests."
    assert text == "Their error is not known: the search did not converge."
    few = replace(fit(), measured={"tension": np.ones(1)}, simulated={"tension": np.ones(1)})
    text = sentences(fitted("a", estimates=bare, made=few))[1]
    assert text.endswith("at least as many parameters as measured values.")
    assert sentences(fitted("a", estimates=bare))[1] == "Their error is not known: no intervals could be computed."
    note = Remark("The data cannot separate a.b and c.d: only a combination of them is determined. Fix one of them.")
    first, text, _ = sentences(fitted("a", estimates=bare, notes=(note,)))
    assert first == "The data cannot separate a.b and c.d; E = 1.93 MPa, from one test."
    assert text == note.text


def test_a_trend_follows_the_largest_source() -> None:
    made = joint(np.array(list(NECK.values())), np.array(list(NECK)))
    found = {E_NAME: replace(made.parameters[E_NAME], interval=(2.8e6, 3.8e6), shares={"experiments": 1.0})}
    text = sentences(replace(made, parameters=found))[1]
    assert "differences between the tests" in text
    assert text.endswith("softening of the material, or an error of the slack or the mesh.")


# What the estimates rest on.


def test_samples_that_tell_less_are_counted() -> None:
    told_by = {"a": {"tension": ALIKE, "pitch": WHITE}}
    (first, *_) = sentences(fitted("a", "b", estimates={E_NAME: E}, residuals=told_by))
    assert first.endswith("from 2 tests whose 120 measured values are correlated and worth 57 independent values.")
    (first, *_) = sentences(fitted("a", "b", estimates={E_NAME: E}, residuals={"a": {"tension": WHITE}}))
    assert first.endswith("from 2 tests.")


def test_what_contradicts_the_data_stands_before_the_estimates() -> None:
    at = replace(NU, value=0.4999, at_bound=True, standard_error=None, beyond=4.2)
    (first, *_) = sentences(fitted("a", estimates={E_NAME: E, NU_NAME: at}))
    assert first.startswith(
        "Model and bounds contradict the data (best fit beyond the bound of ν by about 4 standard errors); E = "
    )
    (first, *_) = sentences(fitted("a", estimates={E_NAME: E, NU_NAME: replace(at, beyond=1.9)}))
    assert first.startswith("E = ")


def test_a_prior_that_contradicts_the_data_stands_before_the_estimates() -> None:
    (first, *_) = sentences(fitted("a", estimates={E_NAME: replace(E, off_prior=49.0), NU_NAME: NU}))
    assert first.startswith("Prior and data contradict each other (that of E by about 49 standard errors); E = ")
    (first, *_) = sentences(fitted("a", estimates={E_NAME: replace(E, off_prior=2.9)}))
    assert first.startswith("E = ")


def test_tests_that_contradict_one_value_stand_before_it() -> None:
    differ, alike = (
        Spread({"a": 2.7e6, "b": 3.6e6, "c": 3.1e6}, 20.0, 2, chance, 4e5, (1.7e6, 5.4e6)) for chance in (1e-3, 0.2)
    )
    (first, *_) = sentences(fitted("a", "b", "c", estimates={E_NAME: E}, spreads={E_NAME: differ}))
    assert first.startswith("No single E fits the tests (2.700 to 3.600 MPa); E = ")
    (first, *_) = sentences(fitted("a", "b", "c", estimates={E_NAME: E}, spreads={E_NAME: alike}))
    assert first.startswith("E = ")
    near = replace(differ, values={"a": 1.91e6, "b": 1.93e6, "c": 1.95e6})  # less than half the interval
    (first, *_) = sentences(fitted("a", "b", "c", estimates={E_NAME: E}, spreads={E_NAME: near}))
    assert first.startswith("E = ")
    mass = {"disc.mass": replace(E, value=15.0, unit="kg", lower=0.0, upper=30.0, scale="linear")}
    both = fitted("a", "b", "c", estimates={E_NAME: E, **mass}, spreads={"disc.mass": differ})
    assert sentences(both)[0].startswith("E = ")  # of the material alone


def test_many_parameters_are_counted_not_listed() -> None:
    several = {f"spring{i}.youngs_modulus": E for i in range(6)}
    (first, *_) = sentences(fitted("a", estimates=several))
    assert "E (spring3)" in first
    assert first.endswith("and 2 more, from one test.")


@pytest.mark.parametrize(("record", "tone"), [(WHITE, "good"), (replace(ALIKE, size=0.1), "note")])
def test_a_summary_is_not_green_where_residuals_are_a_curve(record: ResidualRecord, tone: str) -> None:
    assert (
        verdict(content({"joint": fitted("a", estimates={E_NAME: E}, residuals={"a": {"tension": record}})})).tone
        == tone
    )


# Several separate fits.


def test_separate_fits_that_differ_are_told_as_a_range() -> None:
    report = content(separate((3.513, 0.0036), (3.313, 0.0055), (3.197, 0.012)))
    found = verdict(report)
    assert found.warnings[0].startswith("E differs between the separate fits by 9.4 %")
    assert found.sentences[0] == "E = 3.197 to 3.513 MPa test by test, from 3 separate fits."
    assert "the tests differ in E by more than their noise explains: more samples" in found.sentences[1]
    stopped = separate((3.513, 0.0036), (3.313, 0.0055))
    last = list(stopped)[-1]
    stopped[last] = replace(stopped[last], converged=False)
    assert verdict(content(stopped)).sentences[0].endswith(f"2 separate fits; not found yet: the minimum of {last}.")
    alike = verdict(content(separate((3.3, 0.1), (3.31, 0.1))))
    assert "differ" not in alike.text


def test_a_joint_fit_that_finds_otherwise_is_explained() -> None:
    nu = replace(NU, standard_error=0.02)
    fits = {
        f"test{i}": result(f"test{i}", estimates={E_NAME: modulus(value, 0.02), NU_NAME: nu})
        for i, value in enumerate((1.96, 1.97, 1.98))
    }
    own = {"test0": 1.92e6, "test1": 1.93e6, "test2": 1.94e6}
    spread = Spread(own, 200.0, 2, 1e-12, 1e4, (1.8e6, 2.0e6))

    def said(chance: float, *names: str) -> str:
        estimates = {name: {E_NAME: E, NU_NAME: NU}[name] for name in names}
        both = result("test0", "test1", "test2", estimates=estimates, spreads={E_NAME: replace(spread, chance=chance)})
        separate_fits = {k: replace(v, parameters={n: v.parameters[n] for n in names}) for k, v in fits.items()}
        return agreement_sentences({**separate_fits, "joint": both})[0].text

    text = said(1e-12, E_NAME, NU_NAME)
    assert "no more than their noise explains" in text
    assert (
        " Here each test has its own ν too; with ν at its joint value, in the joint fit, the tests differ (at" in text
    )
    assert "Holm" not in text  # one comparison
    assert said(1e-12, E_NAME).endswith(" In the joint fit the tests differ (at the 5 % level).")
    assert "joint" not in said(0.4, E_NAME, NU_NAME)


def test_what_all_fits_are_uncertain_of_alike_does_not_make_them_agree() -> None:
    common = {"noise": 0.01, "pulleys.friction_coefficient": 0.99}
    fits = separate((3.5, 0.2), (3.2, 0.2))
    assert "no more than" in agreement_sentences(fits)[0].text
    with_friction = {
        label: replace(one, parameters={E_NAME: replace(one.parameters[E_NAME], shares=common)})
        for label, one in fits.items()
    }
    text = agreement_sentences(with_friction)[0].text
    assert "more than their noise explains" in text
    assert "no more than" not in text


def test_a_bound_in_all_fits_is_no_agreement() -> None:
    at_bound = replace(NU, value=0.4, at_bound=True, standard_error=None)
    fits = {name: result(name, estimates={NU_NAME: at_bound}) for name in ("a", "b")}
    (remark,) = agreement_sentences(fits)
    assert remark.text == "ν is the same in all 2 separate fits, 0.4: a bound, which does not show that they agree."
    assert remark.tone == "note"
    inside = {name: result(name, estimates={NU_NAME: NU}) for name in ("a", "b")}
    assert "agree" not in agreement_sentences(inside)[0].text


def test_the_word_agree_is_in_no_other_sentence() -> None:
    close, apart = ((3.3, 0.15), (3.35, 0.12)), ((3.5, 0.01), (3.2, 0.01))
    for pairs in (close, apart, ((3.3, None), (3.3, None))):
        report = content(separate(*pairs))
        assert "agree" not in told(report) + verdict(report).text
    at = Estimate(0.4, "1", True, 0.4, 0.5, None, (0.4, 0.405), beyond=0.5)
    report = content({"a": result("a", estimates={NU_NAME: at})})
    assert "the data exclude neither this value nor values beyond the bound" in told(report)
    assert "agree" not in told(report)


# The page and the terminal.


def render(of: ReportContent) -> str:
    return unescape(render_page(of, []))


def test_the_page_shows_rows_bars_and_a_legend() -> None:
    slack = Estimate(1.45e-3, "m", False, 0.0, 6e-3, 5e-5, (1.3e-3, 1.6e-3), shares={"noise": 1.0})
    estimates = {E_NAME: E, NU_NAME: NU} | {f"front.slack[{name}]": slack for name in ("a", "b", "c")}
    page = render(content({"joint": fitted("a", "b", "c", estimates=estimates)}))
    first = page[page.index('class="panel"') : page.index("Conclusions</h2>")]
    for words in ("1.932 MPa", "95 %: 1.861 to 1.981 MPa", "anywhere in 0.4 to 0.495", "3 more parameters", "of-noise"):
        assert words in first
    assert first.count('class="bar"') == 4  # none of what the data do not determine
    assert 'aria-label="tests 92 %, noise 8 %"' in first
    assert first.index("tests</li>") < first.index('class="verdict')
    assert 'title="92 % from differences between the tests">tests 92 %<' in first
    assert 'title="8 % from the noise of the measurements">8 %<' in first  # no room for the name
    assert "flex-grow: 0.92" in first
    bare = {E_NAME: replace(E, interval=None, standard_error=None, shares={})}
    page = render(content({"joint": fitted("a", "b", estimates=bare)}))
    assert 'class="bar"' not in page
    assert 'class="legend"' not in page


def test_warnings_are_in_front_of_the_sentences() -> None:
    page = render(content({"a": fitted("a", estimates={E_NAME: E}, converged=False, status="Stopped.")}))
    panel = page[page.index('class="verdict is-warning"') :]
    assert panel.index("did not converge") < panel.index('class="panel"') < panel.index("<p>E = 1.932 MPa")
    assert (
        render(content({"a": fitted("a", estimates={E_NAME: E})})).count('class="verdict is-') == 1
    )  # nothing to warn of
    assert unbroken("p = 1.5e-06, e-bike") == "p = 1.5e\N{NON-BREAKING HYPHEN}06, e-bike"


def test_a_body_that_intersects_itself_is_on_the_first_screen() -> None:
    alone = content({"a": fitted("a", estimates={E_NAME: E})})
    assert not verdict(alone).warnings
    crossed = replace(twin_view(column_mesh()), crossings="neck intersects itself: set contact: true.")
    found = verdict(replace(alone, twin=crossed))
    assert found.warnings == ("In the test with the largest drive, neck intersects itself: set contact: true.",)
    assert found.tone == "warning"


def test_a_tile_and_the_sentence_are_of_the_same_error() -> None:
    """Of the test with the largest share of its range, not of that with the largest error."""
    ramp = np.linspace(0.0, 1.0, 9)

    def of(top: float, error: float) -> ExperimentFit:
        values = {"tension": top * ramp}
        return ExperimentFit({"tension": error}, {}, values, values, {"tension": "N"})

    made = fitted("a", "b", estimates={E_NAME: E})
    report = content({"joint": replace(made, experiments={"a": of(10.0, 0.2), "b": of(20.0, 0.3)})})
    (tile,) = [one for one in key_numbers(report) if one.label.startswith("Force")]
    assert (tile.value, tile.unit, tile.remark) == ("0.200", "N", "2.0 % of its range; largest in a")
    assert "the force with an RMS error of 2.0 % of its range at most (a)" in verdict(report).text


def test_the_subject_counts_what_is_not_of_the_material() -> None:
    slack = Estimate(1.45e-3, "m", False, 0.0, 6e-3, 5e-5)
    few = {E_NAME: E, NU_NAME: NU, "front.slack[a]": slack}
    assert headline(content({"joint": fitted("a", "b", estimates=few)})).subject.startswith(
        "E, ν and slack (front, a) "
    )
    many = few | {f"front.slack[{name}]": slack for name in "bcd"}
    subject = headline(content({"joint": fitted(*"abcd", estimates=many)})).subject
    assert subject.startswith("E, ν and 4 further parameters fitted jointly to 4 experiments by ")
    assert moment("2026-11-22T18:51:46+00:00") == "2026-11-22 18:51 UTC"
    assert moment("today") == "today"


def test_a_long_table_is_folded() -> None:
    def page(n: int) -> str:
        distances = {f"m{i}": Distance(1e-3, 1e-3, 1e-3, 2) for i in range(n)}
        made = replace(fit(), distances=distances)
        return render(content({"a": result("a", estimates={E_NAME: E}, made=made)}))

    title = "Distance of the markers from their measured positions"
    assert f"<summary>{title}, 30 rows</summary>" in page(30)
    assert f"<h3>{title}</h3>" in page(3)


def test_the_terminal_ends_with_the_sentences(capsys: pytest.CaptureFixture[str]) -> None:
    made = fitted("a", "b", "c", estimates={E_NAME: E, NU_NAME: NU})
    print_results({"joint": made})
    out = capsys.readouterr().out
    assert out.rstrip().endswith("\n".join(sentences(made)))
    assert "92 % of the variance of E comes from differences between the tests" in out


def test_the_terminal_says_which_intervals_are_without_the_mesh(capsys: pytest.CaptureFixture[str]) -> None:
    def of(*experiments: str, mesh: bool) -> CalibrationResult:
        shares = {"noise": 0.6, **({"mesh": 0.4} if mesh else {})}
        made = result(*experiments, estimates={E_NAME: replace(E, shares=shares)})
        return replace(made, notes=(Remark(not_included([MESH_ERROR] if mesh else [])),))

    separate = {"a": of("a", mesh=False), "b": of("b", mesh=False)}
    print_results({**separate, "joint": of("a", "b", mesh=True)}, verbose=True)
    assert "Those of a, b do not include the error of the mesh." in capsys.readouterr().out
    print_results({"a": of("a", mesh=True), "joint": of("a", "b", mesh=True)}, verbose=True)
    assert "do not include the error of the mesh" not in capsys.readouterr().out


# No number has more digits than its interval allows.

LONG = {
    E_NAME: replace(E, value=1.9323568e6, interval=(1.8610873e6, 1.9812109e6), standard_error=2.0686737e4),
    NU_NAME: replace(NU, value=0.43754880, interval=(0.41234567, 0.46541666), standard_error=0.013132984),
    "front.slack": Estimate(1.4485133e-3, "m", False, 0.0, 6e-3, 4.6466352e-5, (1.3009702e-3, 1.5960559e-3)),
}
SHOWN = {E_NAME: (1e6, 3), NU_NAME: (1.0, 3), "front.slack": (1e-3, 2)}  # display unit and decimals


def too_long(text: str) -> list[str]:
    """Numbers of a text that are an estimate, its error or an end of its interval to more decimals than allowed."""
    found: list[str] = []
    for token in re.findall(r"(?<![\w.])\d+\.\d+(?![\w.])", text):
        decimals = len(token.partition(".")[2])
        for name, (factor, allowed) in SHOWN.items():
            one = LONG[name]
            numbers = [one.value, *(one.interval or ()), one.standard_error or 0.0]
            near = any(abs(float(token) - number / factor) <= 0.51 * 10.0**-decimals for number in numbers)
            if near and decimals > allowed:
                found.append(token)
    return found


def test_no_number_of_a_result_has_more_digits_than_its_interval_allows(capsys: pytest.CaptureFixture[str]) -> None:
    assert too_long("E = 1.9324 MPa, 1.861 to 1.981 MPa, ± 0.0207") == ["1.9324", "0.0207"]
    alone = {name: result(name, estimates=LONG) for name in ("a", "b")}
    own = {"a": 1.9e6, "b": 1.95e6}
    spread = Spread(own, 9.0, 1, 0.01, 2e4, (1.8610873e6, 1.9812109e6))
    results = {**alone, "joint": result("a", "b", estimates=LONG, spreads={E_NAME: spread})}
    study = MeshStudy(
        LONG, tuple(LONG), 0.1, "papers", ("P2P1",), "P2P1", Size(1, 0, 10),
        (Finer("h/2", "halved", Size(8, 0, 100), values={name: one.value for name, one in LONG.items()}),), "h/2",
    )  # fmt: skip
    report = content(results, mesh_study=study)
    page = re.sub(r"<[^>]*>", " ", re.sub(r"(?s)<style>.*?</style>", "", render(report)))
    assert "1.932" in page
    print_results(results, verbose=True)
    print_results(results)
    drawn = report_pictures(report, ("parameter", "loss", "mesh-study", "overview"))
    assert drawn
    figures = " ".join(re.sub(r"(?s)<defs>.*?</defs>", "", one.svg.decode()) for one in drawn)
    comments = " ".join(re.findall(r"<!-- (.*?) -->", figures))  # matplotlib's text, whose letters are drawn as paths
    assert "1.932" in comments
    captions = " ".join(one.caption for one in drawn)
    for text in (page, capsys.readouterr().out, comments, captions):
        assert too_long(text) == []


def test_every_source_of_error_has_a_colour() -> None:
    style = (Path(softcal.__file__).parent / "report" / "templates" / "report.css").read_text(encoding="utf-8")
    for source in SOURCES:
        assert f".of-{source.kind} {{ background" in style


def test_where_tests_contradict_one_value_the_cause_comes_before_the_largest_share() -> None:
    differ, alike = (Spread({"a": 2.7e6, "b": 3.6e6}, 20.0, 1, chance, 4e5, (1.7e6, 5.4e6)) for chance in (1e-3, 0.2))
    budget = replace(E, shares={"noise": 1.0})
    (_, source, *_) = sentences(fitted("a", "b", estimates={E_NAME: budget}, spreads={E_NAME: differ}))
    assert source.startswith("First find why the tests differ. All of the known variance of E comes from")
    (_, source, *_) = sentences(fitted("a", "b", estimates={E_NAME: budget}, spreads={E_NAME: alike}))
    assert source.startswith("All of")


@pytest.mark.parametrize(
    ("off", "tone", "words"), [(0.05, "good", "100 %"), (2.0, "warning", "contradicts the fitted")]
)
def test_a_predicted_test_is_judged_by_its_band(off: float, tone: str, words: str) -> None:
    measured = np.linspace(1.0, 8.0, 20)
    ahead = ExperimentFit(
        {"tension": off}, {}, {"tension": measured}, {"tension": measured + off}, {"tension": "N"},
        bands={"tension": np.full(20, 0.1)},
    )  # fmt: skip
    made = fitted("a", estimates={E_NAME: E}, held_out={"b": HeldOut(1.0, ahead, {})})
    found = prediction_sentence(made)
    assert found is not None
    assert found.tone == tone
    assert words in found.text
    bare = replace(made, held_out={"b": HeldOut(1.0, replace(ahead, bands={}), {})})
    found = prediction_sentence(bare)
    assert found is not None
    assert (found.tone, "band" in found.text) == ("note", False)
