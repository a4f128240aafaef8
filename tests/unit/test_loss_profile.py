"""The loss over one parameter, predicted by derivatives: against fits, and as it is stored and drawn."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from interval_cases import linear_problem, values
from report_example import bench_experiment, tpe_result
from scipy.optimize import minimize_scalar

from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result_files import write_result
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.local_model import loss_profiles
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.report.content import ReportContent
from softcal.report.figure import FIGURES


@pytest.mark.parametrize("loss", [LikelihoodLoss(), PapersLoss()], ids=["likelihood", "papers"])
@pytest.mark.parametrize("ratios", [(0.1, 0.49), (0.1, 0.398)], ids=["inside", "at a bound"])
def test_of_a_linear_twin_it_is_the_loss_least_over_the_others(loss: Loss, ratios: tuple[float, float]) -> None:
    problem = linear_problem(loss, ratios=ratios)
    theta, space = values(problem), problem.space
    evaluation = problem.evaluate(theta, jacobian=True)
    intervals = local_statistics(space, loss, theta, evaluation.blocks).intervals
    found = loss_profiles(space, loss, theta, evaluation.blocks, intervals)
    assert list(found) == list(space.labels)
    for j, (label, curve) in enumerate(found.items()):
        at, losses = np.array(curve).T
        assert np.all(np.diff(at) > 0)
        low, high = intervals[label] or (0.0, 0.0)
        parameter = space.parameters[j]
        assert at[0] < low or at[0] == pytest.approx(parameter.lower)
        assert at[-1] > high or at[-1] == pytest.approx(parameter.upper)
        assert losses.min() == pytest.approx(evaluation.loss, rel=1e-9)
        assert at[losses.argmin()] == pytest.approx(theta[label])
        (other,) = [p for p in space.parameters if p.label != label]
        for value, predicted in (curve[0], curve[-1]):
            best = minimize_scalar(
                partial(_loss, problem, {label: value}, other.label),
                bounds=(other.lower, other.upper),
                method="bounded",
                options={"xatol": 1e-9 * (other.upper - other.lower)},
            )
            # Its forces grow with E, as those of a robot do, and not linearly with its logarithm, as those here.
            assert predicted == pytest.approx(best.fun, rel=5e-3)


def _loss(problem: Problem, given: dict[str, float], label: str, value: float) -> float:
    loss = problem.evaluate({**given, label: value}).loss
    assert loss is not None
    return loss


def test_it_is_stored_with_the_result_and_of_searches_by_derivatives_alone(tmp_path: Path) -> None:
    problem = linear_problem(LikelihoodLoss())
    result = calibrate(problem)
    assert all(len(one.profile) > 8 for one in result.parameters.values())
    write_result(result, tmp_path)
    assert load_result(tmp_path).parameters == result.parameters
    random = calibrate(problem, method="tpe", trials=12)
    assert not any(one.profile for one in random.parameters.values())


def test_its_panels_have_names_units_scales_and_intervals() -> None:
    experiment = bench_experiment("20mm", 0.02, 2e6, pitch=False)
    result = tpe_result([experiment], 2e6, 0.45, n_trials=12)
    first, second = result.parameters.values()
    first = replace(first, scale="log", interval=(1.8e6, 2.4e6), profile=((1.6e6, 0.3), (2e6, 0.1), (2.7e6, 0.4)))
    second = replace(first, unit="m", scale="linear", interval=(1e-3, 2e-3), profile=((0.0, 0.2), (3e-3, 0.1)))
    parameters = {"arm.youngs_modulus": first, "arm.outer.youngs_modulus": first, "front.slack": second}
    derived = replace(result, method="least-squares", parameters=parameters)
    content = ReportContent("arm", {"20mm": derived}, {"20mm": experiment})
    (drawn,) = FIGURES["loss"].function(content)
    panels = [axes for axes in drawn.figure.axes if axes.get_visible()]
    labels = [axes.get_xlabel() for axes in panels]
    assert labels == ["E (arm) [MPa]", "E (arm.outer) [MPa]", "slack (front) [mm]"]
    assert [axes.get_xscale() for axes in panels] == ["log", "log", "linear"]
    left, right = panels[0].patches[0].get_extents().x0, panels[0].patches[0].get_extents().x1
    np.testing.assert_allclose(panels[0].transData.inverted().transform([(left, 0), (right, 0)])[:, 0], [1.8, 2.4])
    titles = [axes.get_title(loc="left") for one in FIGURES["parameter"].function(content) for axes in one.figure.axes]
    assert titles == ["E (arm)", "E (arm.outer)", "slack (front)"]
    bare = {name: replace(one, profile=()) for name, one in parameters.items()}
    assert not list(FIGURES["loss"].function(replace(content, results={"20mm": replace(derived, parameters=bare)})))


def test_a_map_has_the_scales_of_the_search() -> None:
    experiment = bench_experiment("20mm", 0.02, 2e6, pitch=False)
    result = tpe_result([experiment], 2e6, 0.45, n_trials=12)
    (x, first), (y, second) = result.parameters.items()
    for scales in (("log", "linear"), ("linear", "log")):
        parameters = {x: replace(first, lower=1e6, upper=9e6, scale=scales[0]), y: replace(second, scale=scales[1])}
        searched = replace(result, parameters=parameters)
        (drawn,) = FIGURES["loss"].function(ReportContent("arm", {"20mm": searched}, {"20mm": experiment}))
        axes = drawn.figure.axes[0]
        assert (axes.get_xscale(), axes.get_yscale()) == scales


@pytest.mark.parametrize(("upper", "scale"), [(10e6, "linear"), (20e6, "log")])
def test_a_modulus_over_more_than_a_decade_has_a_logarithmic_axis_however_it_was_searched(
    upper: float, scale: str
) -> None:
    experiment = bench_experiment("20mm", 0.02, 2e6, pitch=False)
    result = tpe_result([experiment], 2e6, 0.45, n_trials=12)
    (x, first), (y, second) = result.parameters.items()
    wide = replace(first, scale="linear", lower=1.5e6, upper=upper)
    slack = replace(second, unit="m", scale="linear", profile=((1e-5, 0.2), (3e-3, 0.1)))
    profiles = {x: replace(wide, profile=((1.5e6, 0.3), (2e6, 0.1), (upper, 0.4))), y: slack}
    for method, parameters in (("tpe", {x: wide, y: second}), ("tpe", {x: wide}), ("least-squares", profiles)):
        searched = replace(result, method=method, parameters=parameters)
        (drawn,) = FIGURES["loss"].function(ReportContent("arm", {"20mm": searched}, {"20mm": experiment}))
        assert drawn.figure.axes[0].get_xscale() == scale
        if method == "least-squares":
            assert drawn.figure.axes[1].get_xscale() == "linear"
