"""Preparation of records of any actuator: a pump's and a motor's are prepared as a cable's."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import bench_record
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from softcal.analysis.record import RecordFit
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import Observation
from softcal.calibration.results.fit import experiment_fit
from softcal.errors import DatasetError
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.hysteresis import loops
from softcal.experiments.plausibility import check_plausible, suspected_zeros
from softcal.experiments.prepare import parse_steps, prepare
from softcal.experiments.steps.branches import take_branch
from softcal.experiments.steps.cycles import find_cycles
from softcal.experiments.steps.flow import integrate_flow
from softcal.experiments.steps.slack import find_slack
from softcal.report.cycles import cycle_sentence, cycles_tables
from softcal.report.figures.loops import draw_loops
from softcal.twin.response import Derivatives
from softcal.units import parse_quantity

if TYPE_CHECKING:
    from softcal.report.content import ReportContent

CABLE = ("shortening", "tension")
# Coordinate and effort of an actuator, and what stands for 1 m and 1 N of a cable: powers of two, which round nothing.
ACTUATORS = {
    ("cable1.shortening", "cable1.tension"): (1.0, 1.0),
    ("main.volume", "main.pressure"): (2.0**-12, 2.0**12),
    ("servo.angle", "servo.torque"): (2.0**6, 2.0**-7),
}
UNITS = {
    "shortening": "m",
    "tension": "N",
    "volume": "m^3",
    "pressure": "Pa",
    "angle": "rad",
    "torque": "N*m",
    "time": "s",
    "pitch": "rad",
    "flow": "m^3/s",
}
STEPS = ["classify_cycles", {"take_branch": {"n_samples": 60}}, {"remove_slack": {"subtract_floor": True}}]


def dataset(**values: np.ndarray) -> Dataset:
    named = {name.replace("__", "."): np.asarray(one, dtype=float) for name, one in values.items()}
    return Dataset("test", {name: Channel(one, UNITS[name.rpartition(".")[2]]) for name, one in named.items()})


def record(names: tuple[str, str], scales: tuple[float, float] = (1.0, 1.0), n: int = 4, seed: int = 1) -> Dataset:
    """Cycles of a soft neck with slack and hysteresis, in the channels of an actuator."""
    moved = bench_record.motion(n)
    of = [moved.shortening * scales[0], bench_record.force(moved, 0.02, 5e-4, seed) * scales[1]]
    channels = {"time": moved.time, **dict(zip(names, of, strict=True)), "pitch": 10.0 * moved.shortening}
    return dataset(**{name.replace(".", "__"): values for name, values in channels.items()})


@settings(max_examples=8, deadline=None)
@given(
    names=st.sampled_from(sorted(ACTUATORS)),
    powers=st.tuples(st.integers(-3, 3), st.integers(-3, 3)),
    is_vacuum=st.booleans(),
    seed=st.integers(0, 99),
)
def test_every_actuator_is_prepared_as_a_cable(
    names: tuple[str, str], powers: tuple[int, int], is_vacuum: bool, seed: int
) -> None:
    sign = -1.0 if is_vacuum and names[1] != "cable1.tension" else 1.0
    own = ACTUATORS[names]
    scales = sign * 2.0 ** powers[0] * own[0], sign * 2.0 ** powers[1] * own[1]
    reference = find_cycles(record(CABLE, seed=seed), 0.1)
    found = find_cycles(record(names, scales, seed=seed), 0.1 * scales[1])
    assert found.cycle is not None
    assert reference.cycle is not None
    assert np.array_equal(found.cycle, reference.cycle)
    for loop, known in zip(loops(found), loops(reference), strict=True):
        assert loop.peak_effort == known.peak_effort * scales[1]
        assert loop.travel == known.travel * abs(scales[0])
        assert_allclose(loop.lost_energy, known.lost_energy * scales[0] * scales[1], rtol=1e-9)
        # The cable's work counts the noise about zero too.
        assert_allclose(loop.loading_energy, known.loading_energy * scales[0] * scales[1], rtol=1e-2)
        assert known.vanishes_at is not None
        assert loop.vanishes_at == pytest.approx(known.vanishes_at * scales[0])
    taken, known = prepare(found, STEPS), prepare(reference, STEPS)
    assert [step.name for step in taken.provenance] == [step.name for step in known.provenance]
    assert taken.provenance[-3].settings["classes"] == known.provenance[-3].settings["classes"]
    for channel, of_cable, scale in zip(names, CABLE, scales, strict=True):
        size = abs(known.values(of_cable) * scale).max()  # the taut point is found to 5e-8 of the travel
        assert_allclose(taken.values(channel), known.values(of_cable) * scale, atol=1e-6 * size)
    assert np.array_equal(taken.values("pitch"), known.values("pitch"))


def test_messages_are_in_the_words_of_the_actuator() -> None:
    pumped = prepare(record(("main.volume", "main.pressure"), (2e-4, 4e3)), ["find_cycles", *STEPS])
    found, classified, taken, freed = (step.outcome for step in pumped.provenance)
    assert "4 whole cycle(s), peaks " in found
    assert "kPa, the pressure returns to " in found
    assert re.search(r"first cycle: number 0, peak [\d.]+ kPa", classified)
    assert re.search(r"on 60 points, main\.volume [\d.]+ ml to [\d.]+ ml", taken)
    assert "main.volume measured from the taut point at " in freed
    assert "pressure floor " in freed
    assert "kPa/ml, two lines fit to " in freed
    assert "floor subtracted from the main.pressure" in freed
    rising = dataset(servo__angle=np.linspace(0.0, 1.0, 50), servo__torque=np.linspace(0.1, 0.2, 50))
    with pytest.raises(DatasetError, match=r"got servo\.torque 0\.1 N\*m to 0\.2 N\*m; .*the lower torque limit 0 "):
        find_cycles(rising)
    with pytest.raises(DatasetError, match=r"no floor of the torque before it rises.*make the angle_offset a"):
        find_slack(rising)


def test_a_regulator_without_a_volume_is_prepared_along_its_pressure() -> None:
    whole = record(("main.volume", "main.pressure"), (2e-4, 4e3))
    alone = Dataset("regulator", {name: one for name, one in whole.channels.items() if name != "main.volume"})
    steps = ["find_cycles", "classify_cycles", {"take_branch": {"n_samples": 50}}, {"resample": {"step": "2 kPa"}}]
    prepared = prepare(alone, steps)
    assert_allclose(np.diff(prepared.values("main.pressure")), 2e3)
    assert np.all(np.diff(prepared.values("pitch")) >= -1e-3)
    sucked = alone.with_channels(Step("sucked out"), **{"main.pressure": -alone.values("main.pressure")})
    assert_allclose(prepare(sucked, steps).values("main.pressure"), -prepared.values("main.pressure"))
    assert np.all(np.diff(take_branch(whole, by="main.pressure").values("main.pressure")) > 0.0)
    assert prepare(whole, ["find_cycles", {"thin": "0.5 ml"}]).n_samples < whole.n_samples / 4


def test_a_motor_that_turns_to_and_fro_works_on_both_sides() -> None:
    phase = np.linspace(-0.5 * np.pi, 8.5 * np.pi, 1800)
    angle = 0.5 * np.sin(phase)
    torque = 0.3 * angle + 0.01 * np.sign(np.cos(phase))
    found = find_cycles(dataset(servo__angle=angle, servo__torque=torque))
    each = loops(found)
    assert len(each) == 4
    for loop in each[1:-1]:
        assert_allclose(loop.lost_energy, 0.01 * 2.0, rtol=0.02)  # twice the friction over the range of 1 rad
        assert_allclose(loop.loading_energy, 2 * (0.5 * 0.3 * 0.5**2 + 0.01 * 0.5), rtol=0.02)


def test_one_actuator_of_several_is_named_or_driven() -> None:
    moved = bench_record.motion(2)
    pressure = 4e3 * bench_record.force(moved, 0.0, 0.0, 1)
    both = dataset(time=moved.time, left__pressure=pressure, right__pressure=0.1 * pressure[::-1])
    with pytest.raises(DatasetError, match=r"several actuators; got left\.pressure, right.*'by: left\.pressure'"):
        find_cycles(both)
    named = prepare(both, [{"find_cycles": {"by": "left.pressure"}}, "take_branch"])
    assert named.provenance[-1].outcome.count("left.pressure")
    (told,) = parse_steps([{"find_cycles": "2 kPa"}], channels=[*both.channels], drives=["right.pressure"])
    assert told.settings == {"lower_limit": 2e3, "by": "right.pressure"}
    with pytest.raises(DatasetError, match=r"prepare\[0\]\.find_cycles\.lower_limit: the record has several actuators"):
        parse_steps([{"find_cycles": "2 kPa"}], channels=[*both.channels])
    with pytest.raises(DatasetError, match=r"not of an actuator; got time; allowed: left\.pressure, right\.pressure"):
        find_cycles(both, by="time")
    # Where one of them is measured whole, it is meant.
    whole = dataset(left__pressure=pressure, left__volume=1e-4 * moved.shortening, right__pressure=0.1 * pressure)
    assert find_cycles(whole).provenance[-1].settings["by"] == "left.pressure"


def test_settings_have_the_units_of_the_actuator() -> None:
    names = ("servo.angle", "servo.torque")
    (found, freed, thinned) = parse_steps(
        [
            {"find_cycles": {"lower_force_limit": "2 N*mm"}},
            {"remove_slack": {"slack": "3 deg", "threshold": "5 N*mm"}},
            {"thin": "1 deg"},
        ],
        channels=names,
    )
    assert found.settings == {"lower_limit": pytest.approx(2e-3)}
    assert freed.settings == {"slack": pytest.approx(np.radians(3.0)), "threshold": pytest.approx(5e-3)}
    assert thinned.settings == {"step": pytest.approx(np.radians(1.0))}
    with pytest.raises(DatasetError, match=r"remove_slack\.slack: the unit does not fit; got 'mm'.*converts to rad"):
        parse_steps([{"remove_slack": "3 mm"}], channels=names)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        (("1 ml", "10 kPa"), ""),
        (("1 l", "10 Pa"), "main.pressure rises by 0.01 Pa/ml of main.volume"),
        (("1 mm^3", "900 GPa"), "a wrong unit of one of the two (kPa read as MPa, or ml read as l, or the reverse)"),
        (("1 ml", "-10 kPa"), "test: main.pressure falls as main.volume rises, by -10 kPa/ml"),
        (("-1 ml", "-10 kPa"), ""),
        (("0 ml", "10 kPa"), "test: main.volume never changes: is it the right column?"),
    ],
)
def test_a_stiffness_is_plausible_of_any_actuator(values: tuple[str, str], told: str) -> None:
    share = np.linspace(0.0, 1.0, 100)
    most = [parse_quantity(value, unit) for value, unit in zip(values, ("m^3", "Pa"), strict=True)]
    warnings = check_plausible(dataset(main__volume=most[0] * share, main__pressure=most[1] * share))
    assert told in " ".join(warnings)


@pytest.mark.parametrize(("first", "told"), [("1013 mbar", "is it absolute?"), ("0 kPa", ""), ("150 kPa", "")])
def test_an_absolute_pressure_is_suspected(first: str, told: str) -> None:
    values = parse_quantity(first, "Pa") + np.linspace(0.0, 5e3, 10)
    warnings = " ".join(suspected_zeros(dataset(main__pressure=values)))
    assert told in warnings
    assert bool(warnings) == bool(told)
    assert bool(told) == bool(warnings)


@pytest.mark.parametrize(
    ("first", "tension", "told"),
    [(12.4e-3, 0.0, True), (-12.4e-3, 0.0, True), (12.4e-3, 5.0, False), (2e-3, 0.0, False), (0.0, 0.0, False)],
)
def test_a_travel_that_counts_from_elsewhere_is_suspected(first: float, tension: float, told: bool) -> None:
    """Where the cable does not pull yet: one that does was pulled before the record."""
    travel = np.linspace(0.0, 6e-3, 20)
    warnings = " ".join(suspected_zeros(dataset(shortening=first + travel, tension=tension + 1e3 * travel)))
    assert ("zero: {channel: shortening, by: first}" in warnings) is told
    assert bool(warnings) is told


def pump(n: int = 200, **more: np.ndarray) -> Dataset:
    """Flow [m^3/s] of a pump that fills a chamber by 8 ml and empties it."""
    time = np.linspace(0.0, 60.0, n)
    return dataset(time=time, main__flow=8e-6 * np.pi / 60.0 * np.sin(2.0 * np.pi * time / 60.0), **more)


@settings(max_examples=20, deadline=None)
@given(
    steps=st.lists(st.floats(0.01, 3.0), min_size=2, max_size=30),
    ends=st.tuples(st.floats(-1e-6, 1e-6), st.floats(-1e-6, 1e-6)),
    start=st.floats(-1e-5, 1e-5),
    gain=st.sampled_from([0.5, 2.0]),
)
def test_a_volume_is_the_integral_of_a_flow_that_changes_linearly(
    steps: list[float], ends: tuple[float, float], start: float, gain: float
) -> None:
    time = np.concatenate([[0.0], np.cumsum(steps)])
    slope = (ends[1] - ends[0]) / time[-1]
    record = dataset(time=5.0 + time, main__flow=ends[0] + slope * time)
    pumped = integrate_flow(record, start)
    assert [*pumped.channels] == ["time", "main.volume"]
    volume = pumped.values("main.volume")
    assert volume[0] == start
    assert_allclose(volume - start, ends[0] * time + 0.5 * slope * time**2, atol=1e-12)
    # The gain of the flow sensor is that of the volume.
    doubled = integrate_flow(record.with_channels(Step("gain"), **{"main.flow": gain * record.values("main.flow")}))
    assert_allclose(doubled.values("main.volume"), gain * (volume - start), rtol=1e-12, atol=1e-20)


def test_a_flow_is_prepared_to_cycles_of_the_volume() -> None:
    right = pump()
    offset = right.with_channels(Step("offset"), **{"main.flow": right.values("main.flow") + 1e-9})
    steps = [{"zero": {"channel": "main.flow", "by": "0.06 ml/min"}}, {"integrate_flow": {"start": "2 ml"}}]
    pumped = prepare(offset, steps)
    assert_allclose(pumped.values("main.volume")[[0, 100, -1]], [2e-6, 10e-6, 2e-6], atol=2e-9)
    assert pumped.provenance[-1].outcome.startswith("main.volume from 2 ml to 2 ml, at most 25.1")
    phase = 2.0 * np.pi * np.linspace(0.0, 1.0, 200)
    whole = prepare(pump(main__pressure=1e4 * (1.0 - np.cos(phase))), ["integrate_flow", "find_cycles"])
    (loop,) = loops(whole)
    assert_allclose(loop.travel, 8e-6, rtol=5e-3)
    assert_allclose(loop.loading_energy, 0.5 * 2e4 * 8e-6, rtol=1e-2)


def test_a_flow_without_a_time_or_with_a_volume_is_refused() -> None:
    whole = pump(main__volume=np.zeros(200))
    no_time = Dataset("pumped", {name: one for name, one in whole.channels.items() if name != "time"})
    with pytest.raises(DatasetError) as caught:
        integrate_flow(no_time)
    told = str(caught.value)
    assert "pumped: a flow is integrated over time, and the record has none; got main.flow, main.volume" in told
    assert "the volume was recorded beside the flow; got main.volume. Try: leave main.flow out of the columns" in told
    holes = pump()
    holes = holes.with_channels(Step("hole"), **{"main.flow": np.where(np.arange(200) == 7, np.nan, 1e-8)})
    with pytest.raises(DatasetError, match=r"a flow with missing values has no integral; got 1 of them"):
        prepare(holes, ["integrate_flow"])
    with pytest.raises(DatasetError, match=r"the record has no flow; got time"):
        integrate_flow(dataset(time=np.arange(3.0)))
    with pytest.raises(DatasetError, match=r"the record has several flows; got main\.flow, tip\.flow.*channel: main"):
        integrate_flow(pump(tip__flow=np.zeros(200)))
    with pytest.raises(DatasetError, match=r"this channel is no flow; got time; allowed: main\.flow"):
        integrate_flow(pump(), channel="time")
    assert "main.flow reaches 0.05 m^3/s, above 0.01 m^3/s: ml/min read as l/s?" in " ".join(
        check_plausible(dataset(time=np.arange(3.0), main__flow=np.array([0.0, 0.05, 0.01])))
    )


def test_cycles_of_a_pressure_are_told_and_drawn_as_such() -> None:
    whole = prepare(record(("main.volume", "main.pressure"), (2e-4, 4e3), n=2), ["find_cycles"])
    test = Experiment("blown", whole, drive=("main.volume",), compared=("main.pressure",))
    seen = Observation({"main.pressure": 1.02 * whole.values("main.pressure")}, Derivatives(), {}, {})
    fit = experiment_fit(test, seen)
    told = cycle_sentence("blown", fit)
    assert re.search(r"In the last cycle the pressure vanishes at 0\.5\d+ ml; the twin's, at 0\.5\d+ ml\.", told), told
    assert fit.driven is not None
    figure = draw_loops("blown", whole, fit, fit.driven)
    labels = [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]
    assert labels[0] == ("Pumped volume [ml]", "Pressure [kPa]")
    corrected = RecordFit(fit, whole, test.drives)
    (table,) = cycles_tables(cast("ReportContent", SimpleNamespace(records={"fit": {"blown": corrected}})))
    assert (table.columns[2].label, table.columns[2].unit) == ("Peak pressure", "kPa")
    assert table.rows[0][2] == pytest.approx(fit.cycles[0].measured.peak_effort / 1e3)
