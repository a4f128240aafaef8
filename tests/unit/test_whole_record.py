"""The calibrated twin over the whole corrected record: what is compared, and what the report says of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import MODULUS, SLACK, bar_robot, write_project
from report_example import example_content

from softcal.analysis import record as record_module
from softcal.analysis.record import RecordFit, record_fit
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.rig import Pulleys, Rig
from softcal.errors import ParameterError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.steps.cycles import find_cycles
from softcal.project.project import load
from softcal.report.conclusions import conclusions
from softcal.report.figures.record import record as record_figure
from softcal.report.html import render_page
from softcal.report.section import all_tables
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import calibrate
from softcal.workflows.whole_record import compare_records, whole_record

LOOP = 0.04  # of the force: above the elastic curve while pulled, as much below while let go
TRAVEL = 8e-3  # [m]


def cycles(n_cycles: int = 3, *, loop: float = LOOP) -> dict[str, np.ndarray]:
    """Triangles of travel with slack, what the elastic twin answers, and a loop in the force alone. SI."""
    time = np.arange(0.0, 2.0 * n_cycles + 0.01, 0.05)
    travel = TRAVEL * (1.0 - np.abs(time % 2.0 - 1.0))
    response = simulate(bar_robot(), Protocol({"front": Command("shortening", travel - SLACK)}))
    side = np.where(time % 2.0 <= 1.0, 1.0, -1.0)
    return {
        "time": time,
        "shortening": travel,
        "tension": response.channels["front.tension"] * (1.0 + loop * side),
        "pitch": response.channels["plate.pitch"].copy(),
    }


def table(n_cycles: int = 3) -> str:
    found = cycles(n_cycles)
    columns = [found["time"], 1e3 * found["shortening"], found["tension"], np.rad2deg(found["pitch"])]
    rows = [",".join(f"{value:.9f}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(["Time [s],Displacement [mm],Force [N],Pitch [deg]", *rows]) + "\n"


def with_steps(*steps: str) -> tuple[str, str]:
    noise = "    noise: {tension: 0.05 N, pitch: 0.2 deg}\n"
    return noise, noise + "    prepare:\n" + "".join(f"      - {step}\n" for step in steps)


def experiment(data: Dataset, **settings) -> Experiment:
    return Experiment("pull", data, cable="front", plate="plate", **settings)


def dataset(found: dict[str, np.ndarray]) -> Dataset:
    units = {"time": "s", "shortening": "m", "tension": "N", "pitch": "rad"}
    return Dataset("pull", {name: Channel(values, units[name]) for name, values in found.items()})


def test_an_elastic_record_is_met_and_a_loop_remains() -> None:
    robot = bar_robot()
    elastic, looped = dataset(cycles(loop=0.0)), dataset(cycles())
    one = experiment(elastic, rig=Rig(slack=SLACK))
    met = record_fit(robot, one, one.rig_values(), elastic)
    off = record_fit(robot, one, one.rig_values(), looped)
    assert met.fit is not None
    assert off.fit is not None
    assert met.fit.rmse["tension"] < 2e-4 * elastic.values("tension").max()
    assert met.fit.rmse["pitch"] < 2e-4 * elastic.values("pitch").max()
    loop = LOOP * np.sqrt(np.mean(elastic.values("tension") ** 2))
    assert off.fit.rmse["tension"] == pytest.approx(loop, rel=0.01)
    assert off.fit.rmse["pitch"] == met.fit.rmse["pitch"]
    assert off.fit.rmse_detrended["tension"] <= off.fit.rmse["tension"]


def test_the_rig_is_the_one_that_was_found() -> None:
    """Under a friction that is not the nominal one, the twin's tension is read on the dataset's side."""
    data = dataset(cycles(loop=0.0))
    one = experiment(data, rig=Rig(slack=SLACK, pulleys=Pulleys(wrap=np.pi, friction_coefficient=0.1)))
    rig = dict(one.rig_values())
    nominal = record_fit(bar_robot(), one, rig, data).fit
    found = record_fit(bar_robot(), one, {**rig, "pulleys.friction_coefficient": 0.12}, data).fit
    assert nominal is not None
    assert found is not None
    gain = np.exp(2 * np.pi * 0.02)
    np.testing.assert_allclose(found.simulated["tension"], gain * nominal.simulated["tension"], rtol=1e-12)


def test_samples_without_a_travel_are_left_out_and_missing_values_are_not_compared() -> None:
    found = cycles(loop=0.0)
    found["shortening"][5:9] = np.nan
    found["pitch"][20:30] = np.nan
    data = dataset(found)
    one = experiment(dataset(cycles()), rig=Rig(slack=SLACK))
    whole = record_fit(bar_robot(), one, one.rig_values(), data)
    assert whole.fit is not None
    assert whole.record.n_samples == data.n_samples - 4
    assert whole.fit.rmse["pitch"] < 2e-4 * np.nanmax(found["pitch"])
    assert whole.fit.missing == {"pitch": 10}


def test_of_several_driven_cables_one_sample_in_k_is_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(record_module, "MAX_SOLVED_SAMPLES", 4)
    time = np.linspace(0.0, 1.0, 10)
    channels = {
        "time": Channel(time, "s"),
        "front.shortening": Channel(1e-3 * time, "m"),
        "back.shortening": Channel(0.0 * time, "m"),
        "plate.pitch": Channel(0.0 * time, "rad"),
    }
    data = Dataset("pull", channels)
    one = Experiment("pull", data, drive=("front.shortening", "back.shortening"), compared=("plate.pitch",))
    robot = bar_robot()
    front = robot.cables[0]
    via = tuple(replace(point, at=point.at * np.array([-1.0, 1.0, 1.0])) for point in front.via_points)
    robot = replace(robot, cables=(front, replace(front, name="back", via_points=via)))
    whole = record_fit(robot, one, one.rig_values(), data)
    assert whole.fit is not None
    assert whole.every == 3
    np.testing.assert_array_equal(whole.record.values("time"), time[::3])


def test_a_record_that_the_twin_cannot_follow_says_why() -> None:
    found = cycles(1)
    found["shortening"] = found["shortening"] * 40.0  # more than the cable's length
    data = dataset(found)
    one = experiment(data, rig=Rig(slack=SLACK))
    whole = record_fit(bar_robot(), one, one.rig_values(), data)
    assert whole.fit is None
    assert "pulled in by more than its length" in whole.failure


def test_a_cable_with_friction_is_not_followed_where_it_is_let_go() -> None:
    robot = bar_robot()
    rough = replace(robot, cables=(replace(robot.cables[0], friction_coefficient=0.2),))
    data = dataset(cycles(1))
    one = experiment(data, rig=Rig(slack=SLACK))
    whole = record_fit(rough, one, one.rig_values(), data)
    assert whole.fit is None
    assert "it reverses where the cable is released" in whole.failure
    pulled = dataset({name: values[:20] for name, values in cycles(1).items()})
    assert record_fit(rough, one, one.rig_values(), pulled).failure == ""


@pytest.mark.parametrize(
    ("steps", "n_samples", "n_cycles"),
    [
        (("find_cycles", "take_branch: loading"), 121, 3),
        (("take_branch: loading",), 121, None),
        (("window: {channel: time, upper: 1 s}",), 121, None),
        (("window: {channel: time, upper: 4 s}", "find_cycles", "take_branch: loading"), 81, 2),
    ],
)
def test_the_whole_record_is_what_no_sample_was_taken_from(tmp_path: Path, steps, n_samples, n_cycles) -> None:
    project = load(write_project(tmp_path, with_steps(*steps), data=table()))
    record = whole_record(project, "pull")
    assert record is not None
    assert record.n_samples == n_samples
    assert (None if record.cycle is None else len(np.unique(record.cycle[record.cycle >= 0]))) == n_cycles


@pytest.mark.parametrize("steps", [(), (with_steps("find_cycles"),)])
def test_there_is_no_whole_record_where_every_sample_is_compared(tmp_path: Path, steps) -> None:
    project = load(write_project(tmp_path, *steps, data=table()))
    assert whole_record(project, "pull") is None


def test_only_an_elastic_twin_is_said_to_leave_the_loop(tmp_path: Path) -> None:
    """Pulleys that reverse have a loop; the caption of the figure knows."""
    robot, data = bar_robot(), dataset(cycles(loop=0.0))
    for memory in (False, True):
        pulleys = Pulleys(wrap=np.pi, friction_coefficient=0.0, friction_memory=memory)
        one = experiment(data, rig=Rig(slack=SLACK, pulleys=pulleys))
        found = record_fit(robot, one, one.rig_values(), data)
        assert found.remembers is memory
        given = example_content()
        name = next(iter(given.headline_result.experiments))
        shown = replace(given, records={given.headline: {name: found}})
        (drawing,) = record_figure(shown)
        assert ("It is elastic" in drawing.caption) is not memory


def test_a_calibration_of_a_branch_is_compared_with_the_record(tmp_path: Path) -> None:
    """The branch is met; over the record the loop remains, and the report tells the two apart."""
    project = load(write_project(tmp_path, with_steps("find_cycles", "take_branch: loading"), data=table()))
    result = calibrate(project, out=None).headline
    assert result.parameters["bar.youngs_modulus"].value == pytest.approx((1 + LOOP) * MODULUS, rel=2e-3)
    with pytest.raises(ParameterError, match="the result is of another project; got push; allowed: pull"):
        compare_records(project, replace(result, experiments={"push": result.experiments["pull"]}))
    found = compare_records(project, result)["pull"]
    assert found.fit is not None
    # The twin has the loading branch: it is off by twice the loop while the cable is let go, half of the time.
    letting_go = found.fit.measured["tension"] / (1 - LOOP) * 2 * LOOP
    time = found.record.values("time") % 2.0
    expected = np.sqrt(np.mean(np.where(time > 1.0, letting_go, 0.0) ** 2))
    assert found.fit.rmse["tension"] == pytest.approx(expected, rel=0.03)
    assert result.experiments["pull"].rmse["tension"] < 0.05 * expected


def test_a_record_without_a_correction_of_the_samples_is_not_compared(tmp_path: Path) -> None:
    steps = with_steps("find_cycles", "take_branch: loading", "zero: {channel: tension, by: 0.1 N}")
    project = load(write_project(tmp_path, steps, data=table()))
    found = compare_records(project, calibrate(project, out=None).headline)["pull"]
    assert found.fit is None
    assert "lacks a correction that the compared samples have; got zero" in found.failure


def test_the_report_has_peak_and_energy_of_every_cycle() -> None:
    import bench_record

    given = example_content()
    label = given.headline
    moved = bench_record.motion()
    values = {"time": moved.time, "shortening": moved.shortening, "tension": bench_record.force(moved, 0.0, 0.0, 1)}
    record = find_cycles(dataset(values))
    shown = replace(given, records={label: {"pull": RecordFit(None, record, ("shortening",))}})
    table = all_tables(shown)["cycles"]
    assert len(table.rows) == len(bench_record.SOFTENING)
    by_column = dict(zip((column.label for column in table.columns), zip(*table.rows, strict=True), strict=True))
    peaks = np.array(by_column["Peak force"])
    np.testing.assert_allclose(by_column["Peak below the first cycle's"], 100 * (1 - peaks / peaks[0]))
    assert peaks[0] / peaks[-1] == pytest.approx(bench_record.SOFTENING[0], abs=0.02)
    lost = np.array(by_column["Lost in the loop"]) / np.array(by_column["Work of loading"])
    np.testing.assert_allclose(by_column["Lost"], 100 * lost)
    assert np.all(lost > 0.5 * bench_record.HYSTERESIS)
    assert table.title in render_page(shown, [])
    assert "cycles" not in all_tables(given)
    assert table.title not in render_page(given, [])


def test_the_report_holds_record_and_fit_apart() -> None:
    given = example_content()
    label, name = given.headline, next(iter(given.headline_result.experiments))
    fit = given.headline_result.experiments[name]
    record = given.experiments[name].raw
    time = record.values("time")
    other = {channel: np.zeros(len(time)) for channel in fit.simulated}
    values = {
        channel: record.values(channel) for channel in ("shortening", *fit.simulated) if channel in record.channels
    }
    whole = replace(fit, rmse={"tension": 0.123}, rmse_detrended={"tension": 0.045}, measured=values, simulated=other)
    shown = replace(given, records={label: {name: RecordFit(whole, record, ("shortening",))}})
    rows = [row for row in all_tables(shown)["table-2-errors"].rows if row[1] == name and row[2] == "whole record"]
    assert [row[3:5] for row in rows] == [(0.123, 0.045)]
    assert "whole record" not in all_tables(given)["table-2-errors"].as_csv()
    page = render_page(shown, [])
    assert "every sample after the corrections" in page
    assert "every sample after the corrections" not in render_page(given, [])
    failed = replace(given, records={label: {name: RecordFit(None, record, ("shortening",), failure="It folds.")}})
    assert f"{name}: comparison with the whole record failed: It folds." in render_page(failed, [])


def test_one_sentence_compares_the_record_with_the_fitted_samples() -> None:
    """Of the worst experiment; only where there is a record, and of letting go only where the record does."""
    given = example_content()
    label, fits = given.headline, given.headline_result.experiments

    def told(every: int = 1, rows: slice = slice(None), **errors: float) -> str:
        records: dict[str, RecordFit] = {}
        for name, (channel, error) in zip(fits, errors.items(), strict=False):
            raw = given.experiments[name].raw
            kept = {one: replace(c, values=c.values[rows]) for one, c in raw.channels.items()}
            record = replace(raw, channels=kept, cycle=None)
            measured = {channel: record.values(channel)}
            whole = replace(fits[name], rmse={channel: error}, measured=measured)
            records[name] = RecordFit(whole, record, ("shortening",), every)
        shown = replace(given, records={label: records} if records else {})
        return " ".join(one.text for one in conclusions(shown))

    name = next(iter(fits))
    peak = np.abs(given.experiments[name].raw.values("tension")).max()
    share, ratio = f"{100 * 0.5 / peak:.2g}", f"{0.5 / fits[name].rmse['tension']:.2g}"
    assert (
        f"Over the whole record, loading and unloading, the force differs by 0.500 N RMS ({share} % of its peak), "
        f"{ratio} times that of the fitted samples."
    ) in told(tension=0.5)
    assert "whole record" not in told()
    assert "Over one in 3 samples of the whole record, loading and unloading, the force" in told(3, tension=0.5)
    # The record's first cycle up to its peak.
    loading = told(rows=slice(200, 300), tension=0.5)
    assert "Over the whole record, the force differs by 0.500 N RMS" in loading
    assert "Over the whole record, loading and unloading, the pitch differs by 5.73 deg RMS" in told(pitch=0.1)
    failed = replace(
        given,
        records={label: {name: RecordFit(None, given.experiments[name].raw, ("shortening",), failure="It folds.")}},
    )
    assert not any("whole record" in one.text for one in conclusions(failed))
