"""What is said of experiments that differ and of residuals that are alike: where it is true, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_twin import E, fake_experiment, fake_robot, fake_simulate
from test_report_conclusions import content

from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.estimate import Remark
from softcal.cli.calibration_table import print_results
from softcal.report.agreement import (
    MISFIT,
    MORE_THAN_NOISE,
    OUTLIERS,
    STEPS,
    left_out_sentence,
    left_out_table,
    residual_sentences,
    spread_sentences,
)

MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6)
DIFFERENT = "differs between the tests by more than their noise explains"


def fitted(
    own: tuple[float, ...],
    noise: float = 0.02,
    folder: Path | None = None,
    set_ups: tuple[str, ...] = (),
    loss: Loss | None = None,
) -> CalibrationResult:
    """A joint fit of experiments, each with its own factor on the force."""
    experiments = []
    for i, factor in enumerate(own):
        one = fake_experiment(f"pull{i + 1}", noise=noise, seed=i)
        tension = one.dataset.channels["tension"]
        channels = {**one.dataset.channels, "tension": replace(tension, values=factor * tension.values)}
        set_up = set_ups[i] if set_ups else ""
        experiments.append(replace(one, dataset=replace(one.dataset, channels=channels), set_up=set_up))
    return calibrate(make_problem(fake_robot(), experiments, [MODULUS], loss, fake_simulate), store=folder)


def test_experiments_that_differ_are_named_with_their_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = fitted((0.95, 1.0, 1.08), folder=tmp_path / "run")
    (remark,) = spread_sentences(result)
    one = result.spreads[E]
    assert remark.tone == "warning"
    assert DIFFERENT in remark.text
    assert "The 95 % interval is for the mean of many such tests" in remark.text
    values = np.array(list(one.values.values()))
    np.testing.assert_allclose(values / values[1], (0.95, 1.0, 1.08), rtol=0.01)
    estimate = result.parameters[E]
    assert estimate.interval is not None
    assert estimate.interval[0] < values.min() * 1.01
    assert estimate.interval[1] > values.max() * 0.99
    assert one.next_interval is not None
    assert one.next_interval[0] < estimate.interval[0]
    assert one.next_interval[1] > estimate.interval[1]
    assert estimate.shares["experiments"] > 0.9
    assert sum(estimate.shares.values()) == pytest.approx(1.0)
    again = load_result(tmp_path / "run")
    assert again.spreads == result.spreads
    assert again.residuals == result.residuals
    assert again.parameters[E].shares == estimate.shares
    print_results({"joint": result})
    assert f"Warning: joint: E {DIFFERENT}" in capsys.readouterr().err.replace("\n", " ")


def test_residuals_are_measured_without_the_differences_that_are_stated() -> None:
    """The RMSE of the table has the differences in it, and is far larger than the residuals of which this is said."""
    loss = LikelihoodLoss({"tension": 0.01, "pitch": 0.001})  # less than the noise
    told = " ".join(map(str, fitted((0.95, 1.0, 1.08), loss=loss).notes))
    assert "Apart from the differences between the tests, the residuals of tension are" in told
    alike = " ".join(map(str, fitted((1.0, 1.0, 1.0), loss=loss).notes))
    assert "The residuals of tension are" in alike
    assert "Apart from" not in alike


def test_the_mean_of_experiments_is_stated_where_the_value_is_not_near_it() -> None:
    """An experiment of many samples decides the value of the loss, and not the mean."""
    result = fitted((0.95, 1.0, 1.08))
    (near,) = spread_sentences(result)
    assert "the mean of the tests is" not in near.text
    own = np.array(list(result.spreads[E].values.values()))
    far = replace(result.parameters[E], value=float(own[2]))
    (remark,) = spread_sentences(replace(result, parameters={E: far}))
    assert f"the mean of the tests is {own.mean() / 1e6:.1f}" in remark.text


@pytest.mark.slow
def test_set_ups_that_differ_are_compared_in_the_place_of_their_experiments(tmp_path: Path) -> None:
    own = (0.95, 0.95, 1.0, 1.0, 1.08, 1.08)
    result = fitted(own, folder=tmp_path / "run", set_ups=("a", "a", "b", "b", "c", "c"))
    (remark,) = spread_sentences(result)
    one = result.spreads[E]
    assert DIFFERENT.replace("tests", "set-ups") in remark.text
    assert "The 95 % interval is for the mean of many such set-ups" in remark.text
    assert list(one.values) == ["a", "b", "c"]
    by_experiment, estimate = fitted(own).parameters[E], result.parameters[E]
    assert by_experiment.interval is not None
    assert estimate.interval is not None
    assert estimate.shares["set-ups"] > 0.9
    assert np.ptp(estimate.interval) > 1.5 * np.ptp(by_experiment.interval)
    assert load_result(tmp_path / "run").spreads == result.spreads


def test_two_experiments_have_no_interval_of_their_mean() -> None:
    result = fitted((0.95, 1.05))
    (remark,) = spread_sentences(result)
    assert DIFFERENT in remark.text
    assert result.spreads[E].next_interval is None
    assert "Two tests are too few for a reliable interval of their mean." in remark.text


def test_the_interval_of_a_further_test_is_printed_where_it_differs_from_that_of_the_mean() -> None:
    result = fitted((0.95, 1.0, 1.08))
    one, estimate = result.spreads[E], result.parameters[E]
    assert "of many such tests; that of a single further test is " in spread_sentences(result)[0].text
    same = replace(result, spreads={E: replace(one, next_interval=estimate.interval)})
    assert "of many such tests, and also holds for a single further test." in spread_sentences(same)[0].text


def test_alike_experiments_are_said_to_agree_within_their_noise() -> None:
    result = fitted((1.0, 1.0, 1.0))
    (remark,) = spread_sentences(result)
    assert remark.tone == "good"
    assert "does not differ between the tests by more than their noise explains" in remark.text
    assert set(result.parameters[E].shares) == {"noise", "drift"}


def test_what_is_alike_is_one_sentence_with_its_correction() -> None:
    result = fitted((1.0, 1.0, 1.0))
    assert "Holm" not in spread_sentences(result)[0].text  # one comparison
    one, other = replace(result.spreads[E], chance=1.0), "pulleys.friction_coefficient"
    parameters = {**result.parameters, other: result.parameters[E]}
    (remark,) = spread_sentences(
        replace(result, parameters=parameters, spreads={E: one, other: replace(one, chance=0.21)})
    )
    assert remark.tone == "good"
    assert remark.text == (
        "E and μ do not differ between the tests by more than their noise explains (at the 5 % level, "
        "Holm's correction for 2 comparisons)."
    )
    many = replace(one, values={f"test{i}": 1e6 for i in range(5)}, dof=4)
    (remark,) = spread_sentences(
        replace(result, parameters=parameters, spreads={E: many, other: replace(many, chance=0.21)})
    )
    assert "explains (p = 0.21 or more, Holm's correction for 2 comparisons)." in remark.text
    found = spread_sentences(replace(result, parameters=parameters, spreads={E: one, other: replace(one, chance=0.01)}))
    assert [remark.tone for remark in found] == ["warning", "good"]
    assert all("Holm's correction for 2 comparisons)" in remark.text for remark in found)


def test_one_experiment_says_that_its_spread_is_not_known() -> None:
    one, three = fitted((1.0,)), fitted((1.0, 1.0, 1.0))
    assert not spread_sentences(one)
    assert any("There is one test" in note.text for note in one.notes)
    assert not any("There is one test" in note.text for note in three.notes)


def test_alike_residuals_are_told_and_independent_ones_are_not() -> None:
    result = fitted((1.0,))
    assert residual_sentences(result) == []

    def said(**how: Any) -> Remark:
        held = {
            name: {channel: replace(one, **how) for channel, one in channels.items()}
            for name, channels in result.residuals.items()
        }
        (found,) = residual_sentences(replace(result, residuals=held))
        return found

    remark = said(correlation=0.6)
    assert remark.text.startswith("Neighbouring residuals are alike")
    assert "pull1, tension: 41 samples are worth about 10" in remark.text
    assert remark.tone == "note"
    causes = {"a slack": 0.4, "another material law or friction in bends": 0.82, "a drift": 0.3}
    remark = said(correlation=0.95, size=0.013, largest=0.95, explained=causes)
    assert remark.text.startswith(f"{MISFIT}: tension of pull1 by 0.013 N (RMS), most at the end (")
    assert (
        "(another material law or friction in bends alone would explain 82 %, a slack alone would explain 40 %)"
        in remark.text
    )
    assert "drift" not in remark.text
    assert remark.tone == "warning"
    remark = said(correlation=0.95, size=0.013, largest=0.4, explained={"a drift": 0.1})
    assert "most 40 % along the record;" in remark.text
    assert "explain" not in remark.text
    remark = said(significance=7.3, size=0.013, explained=causes)
    sure = f"{MORE_THAN_NOISE}: in tension of pull1 (0.013 N RMS) the shape of a usual cause is 7.3 standard errors"
    sure = f"{sure} from zero"
    by = "of the squares relative to the noise a slack alone would explain 40 %"
    more = "another material law or friction in bends alone would explain 82 %"
    assert remark.text.startswith(f"{sure}; {by}, {more};")
    assert said(significance=7.3, size=0.013).text.startswith(
        f"{sure}; no cause that explains it is within the record;"
    )
    assert remark.tone == "warning"
    remark = said(outliers=(3, 17, 40))
    assert remark.text == f"{OUTLIERS}: 3, 17 and 40 of tension of pull1; 3, 17 and 40 of pitch of pull1."
    assert remark.tone == "warning"
    remark = said(outliers=tuple(range(1, 24)))
    assert "19, 20 and 3 more of tension of pull1" in remark.text
    remark = said(step=0.1)
    assert remark.text.startswith(f"{STEPS}: tension of pull1, by 0.1 N; pitch of pull1, by ")
    assert remark.tone == "warning"


def test_outliers_and_coarse_readings_are_said_after_a_calibration() -> None:
    one = fake_experiment("pull1", noise=0.01, seed=4)
    tension = one.dataset.channels["tension"].values.copy()
    tension[[9, 30]] += tension.max() * np.array([0.2, -0.3])
    pitch = one.dataset.channels["pitch"].values

    def said(**values: np.ndarray) -> list[str]:
        channels = {name: replace(held, values=values.get(name, held.values)) for name, held in channels_of.items()}
        tests = [replace(one, dataset=replace(one.dataset, channels=channels))]
        found = calibrate(make_problem(fake_robot(), tests, [MODULUS], None, fake_simulate))
        return [remark.text for remark in residual_sentences(found) if remark.tone == "warning"]

    channels_of = one.dataset.channels
    assert said() == []
    assert said(tension=tension) == [f"{OUTLIERS}: 10 and 31 of tension of pull1."]
    coarse = 0.1 * np.round(pitch / 0.1)
    assert f"{STEPS}: pitch of pull1, by 5.7 deg." in said(pitch=coarse)


@pytest.mark.slow
def test_how_the_experiments_predict_each_other_is_told_and_kept(tmp_path: Path) -> None:
    result = fitted((1.0, 1.0, 1.0), folder=tmp_path / "run")
    text = left_out_sentence(result)
    shares = [100 * np.mean(list(one.within.values())) for one in result.left_out.values()]  # of as many samples each
    assert text.startswith("Predicted by the others, each of the 3 tests has ")
    assert f"{min(shares):.3g} to {max(shares):.3g} % of its measured values" in text
    assert min(shares) > 80
    assert load_result(tmp_path / "run").left_out == result.left_out
    assert left_out_sentence(fitted((1.0, 1.1))) == ""
    table = left_out_table(content({"joint": result}))
    assert [row[:3] for row in table.rows][:2] == [
        ("All jointly", "pull1", "tension"),
        ("All jointly", "pull1", "pitch"),
    ]
    assert table.rows[0][-1] == pytest.approx(100 * result.left_out["pull1"].within["tension"])
    assert not left_out_table(content({"joint": fitted((1.0, 1.1))})).rows
