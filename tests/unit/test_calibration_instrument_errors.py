"""Which systematic error of an instrument moves an estimate by its interval: against calibrations with that error."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block, Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.sensitivity import moving_errors
from softcal.report.first_screen import FirstScreen, three_sentences

FREE = (
    FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=TRUE[E]),
    FreeParameter(NU, "1", 0.1, 0.499, start=TRUE[NU]),
    FreeParameter("front.slack", "m", 0.0, 6e-3, start=1e-3),
)
LOSSES = {"papers": PapersLoss(), "likelihood": LikelihoodLoss()}
SIZES, COMPLIANCE = ("front.tension", "plate.pitch"), "front.compliance"


def measured(seed: int, errors: Mapping[str, float]) -> Experiment:
    """A test whose instruments err: tension_gain [1], tension_offset, tension_drift [N] and pitch's [rad]; and whose
    machine yields, by its compliance [m/N].
    """
    one = fake_experiment(f"pull{seed}", noise=2e-3, sigma=2e-3, slack=1e-3, seed=seed)
    channels = dict(one.dataset.channels)
    time = np.linspace(0.0, 1.0, one.dataset.n_samples)
    yielding = channels["shortening"].values + errors.get(COMPLIANCE, 0.0) * channels["tension"].values
    channels["shortening"] = replace(channels["shortening"], values=yielding)
    for instrument in SIZES:
        kind = instrument.partition(".")[2]
        values = channels[kind].values * (1.0 + errors.get(f"{instrument}_gain", 0.0))
        values = values + errors.get(f"{instrument}_offset", 0.0) + errors.get(f"{instrument}_drift", 0.0) * time
        channels[kind] = replace(channels[kind], values=values)
    return replace(one, dataset=replace(one.dataset, channels=channels))


def calibrated(
    loss: Loss, errors: Mapping[str, float] | None = None, free: tuple[FreeParameter, ...] = FREE, **how: object
) -> CalibrationResult:
    tests = [measured(seed, errors or {}) for seed in (1, 2)]
    return calibrate(make_problem(fake_robot(), tests, free, loss, fake_simulate, **how))  # type: ignore[arg-type]


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_data_with_such_an_error_move_the_estimate_by_half_its_interval(loss: Loss) -> None:
    best = calibrated(loss)
    for name in (E, NU):
        one = best.parameters[name]
        assert one.interval is not None
        assert {error.rpartition("_")[0] or error for error in one.moved_by} == {*SIZES, COMPLIANCE}
        for error, size in one.moved_by.items():
            # A third of it, so that the twin is nearly linear.
            moved = calibrated(loss, {error: size / 3.0}).parameters[name].value - one.value
            assert abs(moved) == pytest.approx((one.interval[1] - one.interval[0]) / 6.0, rel=0.1), error
    assert best.parameters["front.slack"].moved_by == {}


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_a_parameter_at_its_bound_stays_there(loss: Loss) -> None:
    """Where nu is at a bound far from its best value, an error moves E as if nu were known."""
    bounded = (FREE[0], replace(FREE[1], upper=0.6 * TRUE[NU], start=0.5 * TRUE[NU]), FREE[2])
    best = calibrated(loss, free=bounded)
    one = best.parameters[E]
    assert best.parameters[NU].at_bound
    assert one.interval is not None
    assert one.moved_by
    half = 0.5 * np.log(one.interval[1] / one.interval[0])
    for error, size in one.moved_by.items():
        # A fiftieth of it: larger ones of one sign take nu off its bound.
        moved = calibrated(loss, {error: size / 50.0}, bounded).parameters[E].value
        assert abs(np.log(moved / one.value)) == pytest.approx(half / 50.0, rel=0.1), error


@pytest.mark.slow
def test_what_is_stated_is_not_named() -> None:
    def named(*stated: UncertainParameter) -> set[str]:
        found = calibrated(LOSSES["papers"], uncertain=stated).parameters
        return {error for name in (E, NU) for error in found[name].moved_by}

    offsets = (
        UncertainParameter("front.tension_offset", "N", 0.01),
        UncertainParameter("plate.pitch_offset", "rad", 0.01),
    )
    assert named() == {COMPLIANCE, *(one.name for one in offsets)}
    assert named(*offsets) <= {COMPLIANCE, "front.tension_gain", "front.tension_drift", "plate.pitch_drift"}
    assert len(named(*offsets)) > 1


def test_the_closing_sentences_name_them_and_files_keep_them(tmp_path: Path) -> None:
    def sentences(result: CalibrationResult) -> str:
        return " ".join(three_sentences(FirstScreen({"joint": result}, "joint")))

    tests = [measured(seed, {}) for seed in (1, 2)]
    problem = make_problem(fake_robot(), tests, FREE, LOSSES["papers"], fake_simulate)
    best = calibrate(problem, store=tmp_path / "run")
    text = sentences(best)
    one = best.parameters[NU if "ν shifts by half" in text else E]
    assert " shifts by half the length of its interval where front.tension_offset is off by " in text
    assert all(f"{error} is off by " in text for error in one.moved_by)
    assert load_result(tmp_path / "run").parameters == best.parameters
    by_gain = {name: replace(held, moved_by={"front.tension_gain": 0.015}) for name, held in best.parameters.items()}
    assert "where front.tension_gain is off by 1.5 %." in sentences(replace(best, parameters=by_gain))
    quiet = {name: replace(held, moved_by={}) for name, held in best.parameters.items()}
    assert "shifts by half" not in sentences(replace(best, parameters=quiet))


@pytest.mark.parametrize(("offset", "named"), [(0.5, "front.tension_gain"), (1.0, "front.tension_offset")])
def test_the_error_of_a_load_cell_that_is_smallest_over_its_largest_reading_is_named(offset: float, named: str) -> None:
    """One unit of the offset changes all readings, of up to 10 N, by 0.5 N or by 1 N."""
    predicted = np.linspace(1.0, 10.0, 30)
    shapes = {"front.tension_gain": (predicted, 1.0), "front.tension_offset": (np.full(30, offset), 10.0)}
    block = Block("pull", "tension", predicted, np.zeros(30), 0.1, predicted[:, None], unstated=shapes)
    (found,) = moving_errors(LikelihoodLoss(), np.ones(1), [block], np.full(1, 0.01))
    assert list(found) == [named]
    if named == "front.tension_gain":
        assert found[named] == pytest.approx(0.01)
