"""Each sentence of the report is printed where it is true, and absent where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from report_example import E_NAME, NU_NAME

from softcal.analysis.agreement import agreements
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.results.result import CalibrationResult, Distance, ExperimentFit
from softcal.calibration.search.outcome import bound_note, prior_note, saturated_note
from softcal.calibration.statistics.estimate import Estimate, Remark
from softcal.calibration.statistics.random_effects import Spread
from softcal.cli.calibration_table import print_results
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.materials.infill import PrintInfill
from softcal.report.agreement import agreement_sentences
from softcal.report.closeness import Miss, closeness_by_experiment
from softcal.report.conclusions import conclusions, verdict
from softcal.report.content import ExperimentContent, ReportContent
from softcal.report.figures.force_displacement import steps_between
from softcal.report.figures.parameter import forest_caption
from softcal.report.tables import all_parameters_table, errors_table, parameters_table

D = np.linspace(0.0, 0.02, 41)
DEG = np.pi / 180


def modulus(value: float, error: float | None = 0.01, *, at_bound: bool = False) -> Estimate:
    """E [MPa]."""
    return Estimate(1e6 * value, "Pa", at_bound, 1e5, 4e7, error and 1e6 * error)


def fit(force: float = 0.1, pitch: float | None = None, *, offset: float = 0.0) -> ExperimentFit:
    """Force off by so many newtons over a range of 8 N, pitch by so many degrees over 20."""
    errors = {"tension": force} | ({} if pitch is None else {"pitch": pitch * DEG})
    measured = {"tension": offset + 400.0 * D, "pitch": 1000 * D * DEG}
    return ExperimentFit(errors, {}, measured, measured, {"tension": "N", "pitch": "rad"})


def result(
    *fits: str, estimates: dict[str, Estimate] | None = None, made: ExperimentFit | None = None, **more: object
) -> CalibrationResult:
    defaults: dict[str, object] = {
        "parameters": {E_NAME: modulus(2.3)} if estimates is None else estimates,
        "loss": 0.12, "loss_name": "papers", "method": "least-squares", "seed": 1, "n_solves": 3, "n_factorisations": 9,
        "wall_s": 1.0, "status": "Converged in 3 trajectories.", "experiments": {name: made or fit() for name in fits},
        "importance": {}, "trials": (), "n_failed_trials": 0, "converged": True,
    }  # fmt: skip
    return CalibrationResult(**{**defaults, **more})  # type: ignore[arg-type]


def content(results: dict[str, CalibrationResult], sigma: float = 0.0, **more: object) -> ReportContent:
    channels = {"shortening": Channel(D, "m"), "tension": Channel(400 * D, "N", sigma), "pitch": Channel(D, "rad")}
    names = {name for one in results.values() for name in one.experiments}
    experiments = {name: ExperimentContent(name, *(2 * (Dataset(name, channels),))) for name in sorted(names)}
    return ReportContent("neck", results, experiments, **more)  # type: ignore[arg-type]


def told(of: ReportContent, tone: str | None = None) -> str:
    return " ".join(s.text for s in conclusions(of) if tone is None or s.tone == tone)


def separate(*values: tuple[float, float | None]) -> dict[str, CalibrationResult]:
    """One fit for each modulus with its error [MPa]."""
    return {f"test{i}": result(f"test{i}", estimates={E_NAME: modulus(*pair)}) for i, pair in enumerate(values, 1)}


# Agreement of separate fits.

SHIPPED = ((3.513, 0.0036), (3.313, 0.0055), (3.197, 0.012))


def test_cochrans_q_by_arithmetic() -> None:
    (one,) = agreements(separate((2.0, 0.02), (2.1, 0.042)))
    # ln 2.1 - ln 2.0, both with one per cent and two per cent: (ln 1.05)^2 / (0.01^2 + 0.02^2)
    assert one.q == pytest.approx(np.log(1.05) ** 2 / 5e-4)
    assert one.dof == 1
    assert one.chance == pytest.approx(0.0291, abs=2e-4)


def test_a_false_alarm_comes_as_often_as_it_says() -> None:
    chance = np.random.default_rng(0)
    alarms = [
        agreements(separate(*((2.0 + 0.03 * e, 0.03) for e in chance.standard_normal(4))))[0].differs
        for _ in range(400)
    ]
    assert 0.02 < np.mean(alarms) < 0.09


def test_moduli_of_the_shipped_neck_differ_far_beyond_noise() -> None:
    joint = result("test1", "test2", "test3", estimates={E_NAME: modulus(3.294, 0.0053)})
    report = content({**separate(*SHIPPED), "joint": joint})
    warning = told(report, "warning")
    assert "E differs between the separate fits by 9.4 %" in warning
    assert "from 3.197 MPa (test3) to 3.5130 MPa (test1)" in warning
    assert "more than their noise explains" in warning
    assert "(Cochran's Q = " in warning
    assert " without the errors that all fits share, 2 degrees of freedom, at the 5 % level)" in warning
    first = verdict(report)
    assert "E = 3.294 ± 0.005 MPa, from 3 tests." in first.text
    assert "E differs between the separate fits by 9.4 %" in first.text
    assert first.tone == "warning"
    assert "agree" not in told(report)


def test_fits_whose_ratio_is_at_a_bound_are_compared_at_one_ratio() -> None:
    """By the values of the tests in the joint fit, where these differ too; that none determines the ratio is said."""
    at = Estimate(0.4999, "1", True, 0.4, 0.4999, None, (0.4, 0.4999))
    spread = Spread({"test1": 3.53e6, "test2": 3.32e6, "test3": 3.2e6}, 60.0, 2, 1e-6, 1e5, None)
    fits = {
        label: replace(
            one, parameters={**one.parameters, NU_NAME: replace(at, value=0.4 if label == "test1" else 0.4999)}
        )
        for label, one in separate(*SHIPPED).items()
    }
    joint = result("test1", "test2", "test3", estimates={E_NAME: modulus(3.294, 0.0053), NU_NAME: at})
    jointly = replace(joint, spreads={E_NAME: spread})
    of_E, of_ratio = (remark.text for remark in agreement_sentences({**fits, "joint": jointly}))
    values = "3.530 (test1), 3.320 (test2) and 3.200 (test3) MPa"
    assert of_E.endswith(
        f" With ν = 0.4999 in all, it is {values}, estimated from the derivatives at the joint fit."
    ), of_E
    assert of_ratio == "No separate fit determines ν."
    free = replace(at, value=0.45, at_bound=False)
    apart = {label: replace(one, parameters={**one.parameters, NU_NAME: free}) for label, one in fits.items()}
    assert "in all, it is" not in agreement_sentences({**apart, "joint": jointly})[0].text
    alike = replace(jointly, spreads={E_NAME: replace(spread, chance=0.5)})
    assert "in all, it is" not in agreement_sentences({**fits, "joint": alike})[0].text


def test_moduli_within_their_errors_are_said_to_be_so() -> None:
    joint = result("test1", "test2", estimates={E_NAME: modulus(3.31, 0.1)})
    report = content({**separate((3.3, 0.15), (3.35, 0.12)), "joint": joint})
    assert "E differs between the separate fits by 2 %" in told(report, "good")
    assert "no more than their noise explains" in told(report, "good")
    first = verdict(report)
    assert "E = 3.31 ± 0.10 MPa" in first.text
    assert "differs" not in first.text
    assert first.tone == "good"


def test_units_and_symbols_keep_their_letters_at_the_beginning_of_the_summary() -> None:
    silent = replace(fit(), rmse={})
    report = content({"test1": result("test1", made=silent)})
    assert verdict(report).text.startswith("E = 2.300 ± 0.010 MPa, from one test.")


def test_without_standard_errors_nothing_is_said_of_agreement() -> None:
    report = content(separate((3.3, None), (3.31, None)))
    assert "The separate fits give E from 3.3 MPa (test1) to 3.31 MPa (test2)." in told(report, "note")
    assert "differs" not in told(report)
    at_bound = Estimate(0.4, "1", True, 0.4, 0.5, None, (0.4, 0.45))
    for other, words in (((0.42, 0.5), "; 0.420 to 0.450 lies in the"), ((0.46, 0.5), "; no value lies in the")):
        far = replace(at_bound, value=0.5, interval=other)
        fits = {"a": result("a", estimates={NU_NAME: at_bound}), "b": result("b", estimates={NU_NAME: far})}
        text = told(content(fits), "note")
        assert f"The separate fits give ν from 0.4 (a) to 0.5 (b){words} 95 % intervals of all." in text
    one = separate((3.3, 0.1), (3.9, 0.1), (40.0, None))
    assert "Excluded, having no standard error: test3." in told(content(one))


def test_slacks_and_tests_of_several_experiments_are_not_compared() -> None:
    slack = Estimate(2e-3, "m", False, 0.0, 6e-3, 1e-6)
    results = {
        f"test{i}": result(f"test{i}", estimates={"front.slack": replace(slack, value=i * 1e-3)}) for i in (1, 2)
    }
    assert agreements(results) == ()
    assert agreements({"joint": result("a", "b"), "test1": result("test1")}) == ()


def test_the_command_line_says_it_too(capsys: pytest.CaptureFixture[str]) -> None:
    print_results(separate(*SHIPPED), verbose=True)
    assert "E differs between the separate fits by 9.4 %" in capsys.readouterr().out
    print_results(separate((3.3, 0.15)), verbose=True)
    assert "differs" not in capsys.readouterr().out


# Fits of every experiment by itself.


def test_every_separate_fit_is_judged_and_the_worst_is_named() -> None:
    fits = {f"test{i}": result(f"test{i}", made=fit(0.1, 0.1)) for i in (1, 2, 3)}
    fits["test4"] = result("test4", made=fit(0.1, 2.2))
    report = content(fits)
    first = verdict(report)
    assert "the pitch with an RMS error of 2.2 deg at most (test4)" in first.text
    assert first.tone == "warning"
    sentence = "test4: the twin reproduces the force to 0.100 N RMS (1.2 % of its range) and the pitch to 2.20 deg RMS"
    assert sentence in told(report, "warning")
    assert "that is poor (the pitch above 10 % of its range)" in told(report, "warning")
    assert "E = 2.300 to 2.300 MPa test by test" in first.text
    good = verdict(content({name: fits[name] for name in ("test1", "test2")}))
    assert good.tone == "good"


def test_channels_of_named_parts_are_judged_as_those_of_short_names_are() -> None:
    made = fit(0.1, 2.2)
    names = {"tension": "left.tension", "pitch": "head.pitch"}
    parts = ("rmse", "measured", "simulated", "units")
    named = replace(made, **{part: {names[c]: of for c, of in getattr(made, part).items()} for part in parts})
    report = content({"test1": result("test1", made=named)})
    assert "the force of left to 0.100 N RMS (1.2 % of its range)" in told(report, "warning")
    assert "poor (the pitch of head above 10 % of its range)" in told(report, "warning")
    first = verdict(report)
    assert "the force with an RMS error of 1.2 % of its range and the pitch with an RMS error of 2.2 deg" in first.text
    assert first.tone == "warning"
    errors = errors_table(report)
    assert [column.label for column in errors.columns[3::2]] == ["left.tension RMSE", "head.pitch RMSE"]
    np.testing.assert_allclose([float(value or 0) for value in errors.rows[0][3::2]], [0.1, 2.2])


def test_findings_of_separate_fits_are_told_with_their_label() -> None:
    at_bound = result("test2", estimates={E_NAME: modulus(40.0, None, at_bound=True)}, notes=(Remark("A note."),))
    report = content({"test1": result("test1"), "test2": at_bound})
    assert "test2: E is at its upper bound of 40 MPa" in told(report, "warning")
    assert "test2: A note." in told(report, "note")
    assert "No parameter is at a bound" not in told(report)
    joint = content({"test1": result("test1"), "test2": at_bound, "joint": result("test1", "test2")})
    assert "No parameter is at a bound" in told(joint)


def test_every_separate_modulus_is_held_against_the_infill() -> None:
    infill = PrintInfill((8e6, 12e6), 0.3, (1.2, 1.6))
    fits = separate((2.3, 0.1), (5.0, 0.1), (2.92, 0.3), (0.5, 0.1))
    wide = replace(fits["test3"].parameters[E_NAME], interval=(2.4e6, 3.8e6))
    fits["test3"] = replace(fits["test3"], parameters={E_NAME: wide})
    report = content(fits, print_infill=infill)
    sentence = "E is {} the range that is plausible for the print's infill, 1.17 to 2.83 MPa (30 % infill)"
    assert f"test1: {sentence.format('inside')}." in told(report, "good")
    assert f"test2: {sentence.format('above')}." in told(report, "warning")
    assert f"test4: {sentence.format('below')}." in told(report, "warning")
    reached = f"test3: {sentence.format('above')}, which the 95 % interval of E reaches."
    assert reached in told(report, "note")


# How the search ended.


def test_a_search_that_did_not_converge_comes_first() -> None:
    report = content({"a": result("a", converged=False, status="Stopped after 40 trajectories.")})
    assert "The search did not converge" in conclusions(report)[0].text
    assert conclusions(report)[0].tone == "warning"
    assert "The search did not converge" in verdict(report).text
    assert "How the search ended" not in told(report)


@pytest.mark.parametrize("converged", [True, None])
def test_another_search_says_how_it_ended_in_a_note(converged: bool | None) -> None:
    report = content({"a": result("a", converged=converged)})
    assert "How the search ended: Converged in 3 trajectories." in told(report, "note")
    assert "did not converge" not in told(report) + verdict(report).text


# How close the fit is.


@pytest.mark.parametrize(("force", "word"), [(0.2, "close"), (0.5, "fair"), (1.0, "poor")])
def test_closeness_is_judged_by_the_range(force: float, word: str) -> None:
    report = content({"a": result("a", made=fit(force))})
    for other in ("close", "fair", "poor"):
        assert (f"that is {other}" in told(report)) == (other == word)
    # A load cell that shows 100 N more does not make the fit better.
    shifted = content({"a": result("a", made=fit(force, offset=100.0))})
    assert f"that is {word}" in told(shifted)


@pytest.mark.parametrize(
    ("factor", "of", "words"),
    [
        (np.pi / 180, "pitch of a", "The measured pitch changes 0.017 times as much as the twin's"),
        (-1.0, "pitch of a", "The measured pitch changes -1.0 times as much as the twin's"),
        (0.0, "pitch of a, which is constant in the record", ""),
        (0.7, "pitch of a off by", ""),
        (0.97, "", ""),
    ],
)
def test_a_channel_that_the_twin_does_not_fit_is_in_the_first_sentence(factor: float, of: str, words: str) -> None:
    simulated = {"tension": 400.0 * D, "pitch": 1000 * D * DEG}
    measured = {**simulated, "pitch": factor * simulated["pitch"] + 0.01}
    rmse = {"tension": 0.0, "pitch": float(np.sqrt(np.mean((measured["pitch"] - simulated["pitch"]) ** 2)))}
    made = ExperimentFit(rmse, {}, measured, simulated, {"tension": "N", "pitch": "rad"})
    shown = content({"a": result("a", made=made)})
    assert verdict(shown).sentences[0].startswith(f"The twin does not fit the measurements ({of}" if of else "E = ")
    two = content({"a": result("a"), "b": result("b", made=made)})
    assert ("the twin does not fit all measurements (pitch of b" in verdict(two).sentences[0]) == bool(of)
    asked = "is its sign, unit, axis or column wrong?"
    assert (asked in told(shown, "warning")) == bool(words)
    assert words in told(shown, "warning")


@pytest.mark.parametrize(("n", "moves", "fits"), [(1, 0.0, True), (4, 1e-9, True), (4, 1.0, False)])
def test_a_channel_without_a_range_is_poor_only_where_the_twin_has_one(n: int, moves: float, fits: bool) -> None:
    record, twin = {"tension": np.full(n, 5.0)}, {"tension": 5.01 + moves * np.arange(n)}
    made = ExperimentFit({"tension": 0.01}, {}, record, twin, {"tension": "N"})
    assert verdict(content({"joint": result("a", "b", made=made)})).sentences[0].startswith("E = ") == fits


def test_an_error_of_the_size_of_the_noise_is_as_close_as_can_be() -> None:
    report = content({"a": result("a", made=fit(1.0))}, sigma=1.0)
    assert "1.0 times the noise of its record); that is within the noise of the record" in told(report, "good")
    assert verdict(report).tone == "good"
    report = content({"a": result("a", made=fit(1.0))}, sigma=0.2)
    assert "5.0 times the noise of its record); that is poor" in told(report, "warning")


def test_missing_values_do_not_hide_how_close_it_is() -> None:
    made = fit(1.0)
    tension = np.where(np.arange(len(made.measured["tension"])) == 3, np.nan, made.measured["tension"])
    made = replace(made, measured={**made.measured, "tension": tension})
    assert "that is poor" in told(content({"a": result("a", made=made)}))


# Bounds and identification.


def test_why_a_parameter_is_at_its_bound_follows_its_interval() -> None:
    def at(interval: tuple[float, float] | None) -> str:
        ratio = Estimate(0.4, "1", True, 0.4, 0.5, None, interval)
        return told(content({"a": result("a", estimates={NU_NAME: ratio})}), "warning")

    assert "ν is at its lower bound of 0.4: the loss decreases beyond the bound." in at((0.4, 0.405))
    assert "the data hardly determine it; its 95 % interval covers 80 % of the allowed range" in at((0.4, 0.48))
    assert "covers all of the allowed range" in at((0.4, 0.5))
    assert "the loss decreases beyond the bound, or the data do not determine the parameter." in at(None)


def test_what_its_bound_keeps_from_the_data_is_said_in_the_first_line(capsys: pytest.CaptureFixture[str]) -> None:
    def at(beyond: float) -> dict[str, CalibrationResult]:
        ratio = Estimate(0.4, "1", True, 0.4, 0.5, None, (0.4, 0.401), beyond=beyond)
        estimates = {E_NAME: modulus(2.3), NU_NAME: ratio}
        return {"a": result("a", estimates=estimates, notes=(bound_note(NU_NAME, ratio),))}

    want = (
        "is at its lower bound of {}: the best fit is beyond it, by about 27 standard errors; model and bounds "
        "contradict the data: the errors of this fit are multiplied by the largest such number."
    )
    held = content(at(27.0))
    assert want.format("0.4") in verdict(held).text
    assert told(held, "warning").count("the best fit is beyond it") == 1
    assert "best fit is beyond" not in told(held, "note")
    print_results(at(27.0))
    assert f"Warning: a: {NU_NAME} {want.format('0.4')}" in capsys.readouterr().err
    whole = replace(at(0.7)["a"].parameters[NU_NAME], interval=(0.4, 0.5))
    assert "the data hardly determine it" in told(content({"a": result("a", estimates={NU_NAME: whole})}), "warning")
    assert "not by the data" in bound_note(NU_NAME, whole).text
    free = content(at(0.7))
    assert "best fit is beyond" not in told(free) + verdict(free).text
    assert "within the noise, the data exclude neither this value" in told(free, "warning")


def test_warnings_of_a_calibration_are_in_the_report() -> None:
    parameter = FreeParameter(E_NAME, "Pa", 1e5, 4e7, prior_mean=2e6, prior_sd=1e4)
    estimate = replace(modulus(1.5), off_prior=49.2)
    larger = Remark("The residuals of tension are 6.8 times the noise of the records.", "warning")
    notes = (larger, prior_note(parameter, estimate))
    of = content({"a": result("a", estimates={E_NAME: estimate}, notes=notes)})
    assert larger.text in told(of, "warning")
    assert f"{E_NAME} is about 49 standard errors from the mean of its prior, 2 MPa with" in told(of, "warning")
    assert verdict(of).tone == "warning"


def test_a_parameter_is_identified_or_not_by_its_interval() -> None:
    def of(high: float) -> ReportContent:
        ratio = Estimate(0.45, "1", False, 0.4, 0.5, 0.01, (0.44, high))
        return content({"a": result("a", estimates={NU_NAME: ratio})})

    assert "ν: 20 %" in told(of(0.46), "good")
    assert "not identified" not in told(of(0.46))
    assert "ν is not identified by these data: its 95 % interval covers 50 %" in told(of(0.49), "warning")


def test_a_fit_of_as_many_parameters_as_values_is_not_called_close_or_identified() -> None:
    def of(n: int) -> ReportContent:
        made = fit(0.01)
        made = replace(made, measured={k: v[:n] for k, v in made.measured.items()}, simulated={"tension": D[:n]})
        found = result("a", made=made)
        notes = (saturated_note(found),) if found.is_saturated else ()
        return content({"a": replace(found, notes=notes)}, sigma=1.0)

    one, two = of(1), of(2)
    assert "1 parameter was fitted to 1 measured value" in verdict(one).text
    assert "1 parameter was fitted to 1 measured value" in told(one, "warning")
    assert "fitted to" not in told(one, "note") + told(two) + verdict(two).text
    for words in ("within the noise of the record", "Identified"):
        assert words not in told(one)
        assert words in told(two, "good")


def test_a_chart_says_whether_its_bars_are_intervals() -> None:
    def caption(**more: object) -> str:
        found = result("a", estimates={E_NAME: replace(modulus(2.3, None), **more)})
        return forest_caption(E_NAME, "E", {"a": found}, "calibration")

    end = (2.2e6, 2.3e6)
    assert caption() == f"E ({E_NAME}) by calibration; no intervals are known."
    assert caption(standard_error=1e4).endswith("; bars are 95 % intervals.")
    assert caption(at_bound=True, interval=end).endswith("; bars are 95 % intervals; open marker: at a bound.")
    held = caption(at_bound=True, interval=end, beyond=9.0)
    assert held.endswith("; bars are 95 % intervals; open marker: at a bound.")


def test_what_decides_without_angles_or_positions() -> None:
    sentence = "Neither angles nor positions were compared in a; the fit uses force and travel only."
    assert sentence in told(content({"a": result("a")}), "note")
    for channel in ("pitch", "S4.pitch", "roll", "m4.x"):
        made = replace(fit(), rmse={"tension": 0.1, channel: 0.1})
        assert "Neither" not in told(content({"a": result("a", made=made)}))
    only = replace(fit(), rmse={}, distances={"m1": Distance(1e-3, 2e-3, 1e-3, 5)})
    assert "Neither" not in told(content({"a": result("a", made=only)}))


# What an importance is.


def test_the_importance_is_called_what_it_is() -> None:
    def note(kind: str) -> str:
        report = content({"a": result("a", importance={E_NAME: 1.0}, extra={"importance_kind": kind})})
        assert parameters_table(report).note.partition("fixed.")[2] in all_parameters_table(report).note
        return parameters_table(report).note

    assert "(fANOVA)" in note("fanova")
    assert "local" not in note("fanova")
    assert "a local measure, not fANOVA" in note("sensitivity")
    assert "variation over the search" not in note("sensitivity")
    assert "mportance" not in parameters_table(content({"a": result("a")})).note


# What lies between a record and the samples of the fit.


def test_only_steps_that_change_samples_are_said_to_lie_between() -> None:
    def steps(*names: str) -> list[str]:
        data = Dataset("a", {"tension": Channel(D, "N")}, provenance=tuple(Step(n, {}, "") for n in names))
        return steps_between(data, 1)

    assert steps("read_table", "set_noise", "set_noise", "estimate_noise") == []
    assert steps("read_table", "window", "set_noise", "average", "average") == ["window", "average"]


def test_of_many_tests_the_report_rates_the_ten_worst_and_all_others_together():
    misses = [Miss(f"t{i}", "force", 0.01 * i, "N", 0.001 * i, None) for i in range(200)]
    told = list(closeness_by_experiment(misses))
    assert [remark.text.partition(":")[0] for remark in told] == [*(f"t{i}" for i in range(190, 200)), "190 more"]
    assert told[-1].text.startswith(
        "190 more: the twin reproduces the force with an RMS error of 19 % of its range at most (t189)"
    )
    assert told[-1].tone == "warning"
    assert len(list(closeness_by_experiment(misses[:10]))) == 10
