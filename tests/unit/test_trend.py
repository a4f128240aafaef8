"""Whether what differs between experiments follows how they were made: told where it does, not where it does not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from report_example import E_NAME
from test_report_conclusions import result

from softcal.analysis.trend import slope, trends
from softcal.calibration.results.result import CalibrationResult, ExperimentFit
from softcal.calibration.statistics.estimate import Estimate
from softcal.calibration.statistics.random_effects import Spread, random_effects
from softcal.checks import Floats
from softcal.experiments.dataset import Channel, Dataset
from softcal.report.agreement import spread_sentences

NECK = {20e-3: 3.525e6, 40e-3: 3.318e6, 60e-3: 3.204e6}  # amplitude [m] -> E [Pa], of examples/neck
RISES, FALLS = "rises with the", "falls with the"


def pulled(amplitude: float, drive: str = "shortening") -> ExperimentFit:
    other = "tension" if drive == "shortening" else "shortening"
    ramp = np.linspace(0.0, amplitude, 9)
    return ExperimentFit({other: 0.1}, {}, {drive: ramp, other: ramp}, {other: ramp}, {drive: "m", other: "m"})


def joint(
    values: Floats, amplitudes: Floats, *, name: str = E_NAME, chance: float = 1e-6, unit: str = "Pa",
    weights: Mapping[str, float] | None = None, drive: str = "shortening",
) -> CalibrationResult:  # fmt: skip
    labels = [f"test{i}" for i in range(len(values))]
    own = dict(zip(labels, np.asarray(values, dtype=float).tolist(), strict=True))
    spread = Spread(own, 50.0, len(values) - 1, chance, float(np.std(values)), None, weights or {})
    made = result(*labels, estimates={name: Estimate(float(np.mean(values)), unit, False, 0.0, 1e9, 0.1)})
    fits = {label: pulled(float(a), drive) for label, a in zip(labels, amplitudes, strict=True)}
    return replace(made, experiments=fits, spreads={name: spread})


def at_speeds(of: CalibrationResult, *speeds: float) -> dict[str, Dataset]:
    """The record of each experiment, moved to its amplitude and back at a speed [m/s]."""
    found: dict[str, Dataset] = {}
    for (name, fit), speed in zip(of.experiments.items(), speeds, strict=True):
        amplitude = float(fit.measured["shortening"].max())
        time = np.linspace(0.0, 2.0 * amplitude / speed, 101)
        position = amplitude - np.abs(speed * time - amplitude)
        found[name] = Dataset(name, {"time": Channel(time, "s"), "shortening": Channel(position, "m")})
    return found


def test_a_slope_and_its_chance_by_arithmetic() -> None:
    from scipy.stats import linregress

    x, y = np.array([0.0, 1.0, 2.0, 4.0]), np.array([0.3, 0.9, 2.4, 3.9])
    steep, chance = slope(x, y, np.ones(4))
    theirs: Any = linregress(x, y)
    assert (steep, chance) == (pytest.approx(theirs.slope), pytest.approx(theirs.pvalue))
    twice: Any = linregress([0.0, *x], [0.3, *y])
    assert slope(x, y, np.array([2.0, 1.0, 1.0, 1.0]))[0] == pytest.approx(twice.slope)
    assert slope(x, 2.0 * x, np.ones(4)) == (2.0, 0.0)
    assert slope(x, np.ones(4), np.ones(4)) == (0.0, 1.0)


def test_the_modulus_of_the_shipped_neck_falls_with_amplitude() -> None:
    made = joint(np.array(list(NECK.values())), np.array(list(NECK)))
    (found,) = trends(made)
    assert found.condition == "amplitude"
    assert found.power == pytest.approx(-0.087, abs=2e-3)
    assert found.chance < 0.02
    (remark,) = spread_sentences(made)
    ending = (
        " E falls with the amplitude of the tests (3 tests: a hint): softening of the material, or an error of the "
        "slack or the mesh."
    )
    assert remark.text.endswith(ending)


@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_what_rises_is_said_to_rise_whatever_drives(drive: str) -> None:
    made = joint(np.array([2.0e6, 2.2e6, 2.36e6, 2.5e6]), np.array([1.0, 2.0, 3.0, 4.0]), drive=drive)
    (remark,) = spread_sentences(made)
    assert "E rises with the amplitude of the tests" in remark.text
    assert "stiffening of the material, or an error of the slack" in remark.text
    other = joint(
        np.array([0.1, 0.12, 0.134, 0.144]), np.arange(1.0, 5.0), name="pulleys.friction_coefficient", unit="1"
    )
    assert spread_sentences(other)[0].text.endswith(": the model lacks an effect of the amplitude.")


def test_a_modulus_that_rises_with_speed() -> None:
    made = joint(np.array([2.0e6, 2.1e6, 2.2e6, 2.29e6]), np.full(4, 0.03))
    assert not trends(made)  # of speeds nothing is known
    fast = at_speeds(made, 0.002, 0.004, 0.008, 0.016)
    (found,) = trends(made, fast)
    assert (found.condition, found.power > 0) == ("speed", True)
    assert "rises with the speed of the tests" in spread_sentences(made, fast)[0].text
    assert "rate dependence of the material, or an error of the clocks" in spread_sentences(made, fast)[0].text
    falling = joint(np.array([2.29e6, 2.2e6, 2.1e6, 2.0e6]), np.full(4, 0.03))
    assert "which rate dependence does not explain" in spread_sentences(falling, fast)[0].text


def test_two_conditions_count_twice() -> None:
    made = joint(np.array(list(NECK.values())), np.array(list(NECK)))
    (alone,), (with_speeds,) = trends(made), trends(made, at_speeds(made, 0.004, 0.010, 0.0045))
    assert with_speeds.chance == pytest.approx(2.0 * alone.chance)
    assert (alone.tested, with_speeds.tested) == (1, 2)
    assert "(3 tests: a hint): softening" in spread_sentences(made, at_speeds(made, 0.004, 0.010, 0.0045))[0].text


def test_the_chance_of_a_trend_is_said_from_five_tests_on() -> None:
    values, reaches = np.array([2.0e6, 2.2e6, 2.36e6, 2.47e6, 2.6e6]), np.arange(1.0, 6.0)
    five, four = joint(values, reaches), joint(values[:4], reaches[:4])
    (found,) = trends(five, at_speeds(five, 0.004, 0.010, 0.0045, 0.005, 0.006))
    assert found.tested == 2
    text = spread_sentences(five, at_speeds(five, 0.004, 0.010, 0.0045, 0.005, 0.006))[0].text
    assert "of the tests (p = " in text
    assert ", corrected for 2 conditions): stiffening" in text
    assert "corrected" not in spread_sentences(five)[0].text
    assert "of the tests (4 tests: a hint): stiffening" in spread_sentences(four)[0].text


@pytest.mark.parametrize("speeds", [(0.002, 0.004, 0.006), (0.006, 0.003, 0.002)])
def test_no_cause_is_named_where_amplitude_and_speed_vary_together(speeds: tuple[float, ...]) -> None:
    made = joint(np.array(list(NECK.values())), np.array(list(NECK)))
    records = at_speeds(made, *speeds)
    (found,) = trends(made, records)
    assert len(found.along) == 1
    (remark,) = spread_sentences(made, records)
    assert (
        f"Their {found.along[0]} varies with it, so these tests do not show which of them is the cause." in remark.text
    )
    assert "softening" not in remark.text
    assert "rate dependence" not in remark.text


@pytest.mark.parametrize(
    ("values", "amplitudes", "chance"),
    [
        ((3.5e6, 3.3e6, 3.2e6), (0.02, 0.04, 0.06), 0.06),  # they do not differ
        ((3.5e6, 3.2e6), (0.02, 0.04), 1e-9),  # two tests
        ((3.5e6, 3.3e6, 3.2e6), (0.02, 0.0201, 0.0202), 1e-9),  # alike amplitudes
        ((3.5e6, 3.45e6, 2.9e6), (0.02, 0.04, 0.06), 1e-9),  # in order, and yet no line
        ((1.928e6, 1.9225e6, 1.9378e6, 1.9327e6), (0.0199, 0.0200, 0.0299, 0.0299), 1e-9),  # examples/neck-bench
    ],
)
def test_no_trend_where_there_is_none(values: tuple[float, ...], amplitudes: tuple[float, ...], chance: float) -> None:
    made = joint(np.array(values), np.array(amplitudes), chance=chance)
    assert not trends(made)
    text = spread_sentences(made)[0].text
    assert RISES not in text
    assert FALLS not in text


def test_experiments_that_are_driven_differently_have_no_amplitude_in_common() -> None:
    made = joint(np.array(list(NECK.values())), np.array(list(NECK)))
    mixed = {**made.experiments, "test2": pulled(0.06, "tension")}
    assert trends(made)
    assert not trends(replace(made, experiments=mixed))
    hung = replace(made.experiments["test2"], measured={})  # what it was pulled by is not in its record
    assert not trends(replace(made, experiments={**made.experiments, "test2": hung}))


@pytest.mark.parametrize("k", [3, 4, 6])
def test_experiments_that_differ_at_random_show_a_trend_one_time_in_twenty(k: int) -> None:
    chance = np.random.default_rng(5)
    amplitudes = np.linspace(0.02, 0.06, k)
    found = [bool(trends(joint(2e6 * np.exp(0.05 * chance.standard_normal(k)), amplitudes))) for _ in range(400)]
    assert 0.02 < np.mean(found) < 0.09


def test_alike_experiments_show_one_far_less_often() -> None:
    """The difference is tested first."""
    chance = np.random.default_rng(6)
    alarms = 0
    for _ in range(400):
        logs = 0.01 * chance.standard_normal(4)
        p = random_effects(logs, np.full(4, 1e-4), np.full(4, np.inf)).chance
        alarms += bool(trends(joint(2e6 * np.exp(logs), np.linspace(0.02, 0.05, 4), chance=p)))
    assert alarms <= 6


def test_a_vague_experiment_weighs_little() -> None:
    values, amplitudes = np.array([3.5e6, 3.32e6, 3.2e6, 3.6e6]), np.array([0.02, 0.04, 0.06, 0.05])
    assert not trends(joint(values, amplitudes))
    weights = {"test0": 0.33, "test1": 0.33, "test2": 0.33, "test3": 1e-4}
    assert trends(joint(values, amplitudes, weights=weights))


def test_values_of_either_sign_are_compared_as_they_are() -> None:
    made = joint(np.array([-0.01, 0.0, 0.0101]), np.array([1.0, 2.0, 4.0]), name="frame.offset", unit="m")
    (found,) = trends(made)
    assert found.power > 0
