"""The numbers behind the charts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from report_example import E_NAME, NU_NAME, bench_experiment, example_content, fit_of, tpe_result

from softcal.calibration.results.result import Trial
from softcal.experiments.dataset import Channel, Dataset
from softcal.report.figures.force_displacement import draw_record
from softcal.report.figures.history import draw_history, search_history
from softcal.report.figures.loss import grid_of_trials
from softcal.report.figures.parameter import forest_rows
from softcal.report.figures.trajectory import draw_trajectory, trajectory, trajectory_panels


def test_residual_is_simulated_minus_measured_in_shown_units() -> None:
    experiment = bench_experiment("a", 0.02, 2e6)
    fit = fit_of(experiment)
    force, pitch = trajectory_panels(experiment, fit).panels
    assert (force.channel, pitch.channel, pitch.scale.unit) == ("tension", "pitch", "deg")
    np.testing.assert_allclose(force.residual, fit.simulated["tension"] - fit.measured["tension"])
    np.testing.assert_allclose(pitch.residual, np.rad2deg(fit.simulated["pitch"] - fit.measured["pitch"]))


def test_the_band_of_a_further_test_is_drawn_and_told_where_it_is_known() -> None:
    content = example_content(n_trials=3)
    label, result = next(iter(content.results.items()))
    name, fit = next(iter(result.experiments.items()))
    without = next(trajectory(content))
    assert "95 %" not in without.caption
    assert not any(axes.collections for axes in without.figure.axes)
    half = np.full(50, np.deg2rad(0.5))
    known = replace(fit, bands={"pitch": half}, repeats={"pitch": half / 2})
    results = {**content.results, label: replace(result, experiments={**result.experiments, name: known})}
    drawing = next(trajectory(replace(content, results=results)))
    assert "The darker band holds 95 % of further samples of the same set-up." in drawing.caption
    assert "The lighter band holds 95 % of the samples of a further test on a new set-up" in drawing.caption
    force, pitch = trajectory_panels(content.experiments[name], known).panels
    assert force.band is None
    assert force.repeat is None
    np.testing.assert_allclose(pitch.band, 0.5)
    np.testing.assert_allclose(pitch.repeat, 0.25)
    assert [len(axes.collections) for axes in drawing.figure.axes] == [0, 0, 2, 2]
    assert drawing.figure.axes[2].get_legend_handles_labels()[1][:2] == ["95 %, new set-up", "95 %, same set-up"]


def test_unmeasured_pitch_is_shown_alone() -> None:
    experiment = bench_experiment("a", 0.02, 2e6, pitch=False)
    pitch = trajectory_panels(experiment, fit_of(experiment)).panels[1]
    assert pitch.measured is None
    assert pitch.residual is None
    assert len(pitch.simulated) == 50


def test_the_axis_is_the_drive_then_time_then_the_sample() -> None:
    experiment = bench_experiment("a", 0.02, 2e6)
    path = trajectory_panels(experiment, fit_of(experiment))
    assert path.abscissa.label == "Cable shortening [mm]"
    assert path.abscissa.values[-1] == pytest.approx(20.0)
    whole = replace(experiment, prepared=experiment.raw)
    path = trajectory_panels(whole, fit_of(whole))
    assert path.abscissa.label == "Time [s]"
    assert len(path.pieces) == 9
    assert path.pieces[-1].stop == whole.raw.n_samples


def test_a_mismatch_of_samples_is_said() -> None:
    experiment = bench_experiment("a", 0.02, 2e6)
    path = trajectory_panels(replace(experiment, prepared=experiment.raw), fit_of(experiment))
    assert "50 samples were compared, the prepared data has 1800" in path.abscissa.note


@given(st.lists(st.one_of(st.none(), st.floats(0.01, 100)), min_size=1, max_size=30))
def test_best_so_far_never_rises_and_failures_are_apart(losses: list[float | None]) -> None:
    trials = [
        Trial(i, {}, "FAILED", None, "why") if loss is None else Trial(i, {}, "COMPLETE", loss)
        for i, loss in enumerate(losses)
    ]
    history = search_history(trials)
    assert np.all(np.diff(history.best) <= 0)
    assert len(history.numbers) + len(history.failed) == len(losses)
    if len(history.best):
        assert history.best[-1] == min(loss for loss in losses if loss is not None)


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_few_trials_have_whole_numbers(n: int) -> None:
    trials = [Trial(i, {}, "COMPLETE", 10.0**-i) for i in range(n)]
    assert whole(draw_history("pull", search_history(trials)))


def test_few_samples_have_whole_numbers() -> None:
    data = Dataset("states", {"m1.x": Channel(np.array([0.0, 0.1, 0.3]), "m"), "m1.y": Channel(np.zeros(3), "m")})
    assert whole(draw_record(data))
    experiment = bench_experiment("a", 0.02, 2e6)
    seen = fit_of(experiment)
    few = replace(seen, **{kind: {name: values[:3] for name, values in getattr(seen, kind).items()} for kind in SERIES})
    assert whole(draw_trajectory(trajectory_panels(experiment, few)))


SERIES = ("measured", "simulated")


def whole(figure: Figure) -> bool:
    """Whether the ticks in sight of the lowest x axis are whole numbers, and there is one."""
    axes = figure.axes[-1]
    low, high = axes.get_xlim()
    ticks = [tick for tick in axes.get_xticks() if low <= tick <= high]
    return bool(ticks) and all(float(tick).is_integer() for tick in ticks)


def test_a_grid_of_trials_is_found_with_its_holes() -> None:
    experiment = bench_experiment("a", 0.02, 2e6)
    result = tpe_result([experiment], 2e6, 0.45, n_trials=3)
    assert grid_of_trials(result) is None
    trials = [
        Trial(i, {E_NAME: e, NU_NAME: nu}, "COMPLETE", e * nu)
        for i, (e, nu) in enumerate((e, nu) for e in (1e6, 2e6, 3e6, 4e6) for nu in (0.40, 0.45, 0.49))
    ]
    trials[4] = replace(trials[4], state="FAILED", loss=None, reason="why")
    grid = grid_of_trials(replace(result, trials=tuple(trials)))
    assert grid is not None
    assert grid.loss.shape == (3, 4)
    assert grid.loss[2, 3] == pytest.approx(4e6 * 0.49)
    assert grid.failed is not None
    assert np.argwhere(grid.failed).tolist() == [[1, 1]]


def test_the_forest_has_a_row_per_calibration_and_experiment() -> None:
    content = example_content(n_trials=4)
    assert list(forest_rows(E_NAME, content.results)) == ["20 mm, 2 mm/s", "20 mm, 5 mm/s", "35 mm, 2 mm/s", "joint"]
    assert next(iter(forest_rows("front.slack", content.results))) == "20 mm, 2 mm/s, all jointly"
