"""Corrections, sampling, slack, noise and the list of steps that a project names."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from project_case import write_project

from softcal.errors import DatasetError, Fault
from softcal.experiments.dataset import Channel, Dataset, Step
from softcal.experiments.plausibility import check_plausible
from softcal.experiments.prepare import parse_steps, prepare
from softcal.experiments.step import STEPS
from softcal.experiments.steps.corrections import detrend, smooth, zero
from softcal.experiments.steps.noise import estimate_noise, set_noise
from softcal.experiments.steps.pulleys import correct_pulley_friction
from softcal.experiments.steps.sampling import resample, window
from softcal.experiments.steps.slack import find_slack, remove_slack
from softcal.project.project import load

UNITS = {"time": "s", "shortening": "m", "tension": "N", "pitch": "rad"}


def dataset(**values: np.ndarray) -> Dataset:
    return Dataset("bench", {key: Channel(np.asarray(v, dtype=float), UNITS[key]) for key, v in values.items()})


def ramp(n: int = 101, slack: float = 4e-3, floor: float = 1.3, noise: float = 0.0) -> Dataset:
    shortening = np.linspace(0.0, 20e-3, n)
    tension = floor + 430.0 * np.maximum(shortening - slack, 0.0)
    tension = tension + noise * np.random.default_rng(3).standard_normal(n)
    return dataset(time=shortening / 5e-3, shortening=shortening, tension=tension, pitch=20.0 * shortening)


@given(n=st.integers(0, 4), mu=st.floats(0, 0.5), theta=st.floats(0, np.pi))
def test_pulley_friction_is_the_capstan_formula(n: int, mu: float, theta: float) -> None:
    record = set_noise(ramp(11), "tension", 0.05)
    corrected = correct_pulley_friction(record, n, mu, theta)
    assert_allclose(corrected.values("tension") * np.exp(n * mu * theta), record.values("tension"), rtol=1e-12)
    assert_allclose(corrected.channels["tension"].sigma * np.exp(n * mu * theta), 0.05, rtol=1e-12)
    one_by_one = record
    for _ in range(n):
        one_by_one = correct_pulley_friction(one_by_one, 1, mu, theta)
    assert_allclose(one_by_one.values("tension"), corrected.values("tension"), rtol=1e-12)


def test_pulley_friction_of_the_paper() -> None:
    corrected = correct_pulley_friction(ramp(), 2, 0.1)
    assert_allclose(corrected.values("tension") / ramp().values("tension"), 0.53349, rtol=1e-5)
    assert "0.5335" in corrected.provenance[-1].outcome
    with pytest.raises(DatasetError, match="negative"):
        correct_pulley_friction(ramp(), 2, -0.1)


def test_zero() -> None:
    record = dataset(tension=np.array([2.0, 1.0, 3.0]))
    assert_allclose(zero(record, "tension").values("tension"), [0, -1, 1])
    assert_allclose(zero(record, "tension", "min").values("tension"), [1, 0, 2])
    assert_allclose(zero(record, "tension", 0.5).values("tension"), [1.5, 0.5, 2.5])
    assert_allclose(zero(record, "tension", "first", n_samples=2).values("tension"), [0.5, -0.5, 1.5])
    assert zero(record, "tension").provenance[-1].outcome == "2 N subtracted from tension"


def test_slack_is_found_under_noise() -> None:
    taut = find_slack(ramp(400, noise=0.03))
    assert_allclose(taut.coordinate, 4e-3, atol=1.5e-4)
    assert_allclose(taut.floor, 1.3, atol=0.02)
    assert_allclose(taut.stiffness, 430.0, rtol=0.05)


def test_remove_slack() -> None:
    removed = remove_slack(ramp(), subtract_floor=True)
    assert_allclose(removed.values("shortening")[0], 0.0, atol=2e-4)
    assert_allclose(removed.values("tension"), 430.0 * removed.values("shortening"), atol=0.02)
    assert len(removed.provenance) == 1
    kept = remove_slack(ramp(), 5e-3, keep_slack_samples=True)
    assert_allclose(kept.values("shortening"), ramp().values("shortening") - 5e-3)
    with pytest.raises(DatasetError, match="whole record is slack"):
        remove_slack(ramp(), 30e-3)


def test_no_slack_is_no_guess() -> None:
    with pytest.raises(DatasetError, match="no floor"):
        find_slack(ramp(slack=0.0))


@settings(deadline=None)
@given(n=st.integers(2, 300), seed=st.integers(0, 99))
def test_resampling_keeps_straight_lines_and_itself(n: int, seed: int) -> None:
    shortening = np.cumsum(np.random.default_rng(seed).uniform(1e-5, 1e-3, 50))
    record = dataset(shortening=shortening, tension=400 * shortening + 1, pitch=np.sin(100 * shortening))
    once = resample(record, n=n)
    assert once.n_samples == n
    assert_allclose(once.values("tension"), 400 * once.values("shortening") + 1)
    assert_allclose(once.values("shortening")[[0, -1]], shortening[[0, -1]])
    twice = resample(once, n=n)
    assert_allclose(twice.values("pitch"), once.values("pitch"), atol=1e-12)


def test_resampling_by_step_time_and_noisy_tension() -> None:
    stepped = resample(ramp(), "time", step=0.5)
    assert_allclose(stepped.values("time"), np.arange(0.0, 4.01, 0.5))
    assert_allclose(stepped.values("pitch"), 20 * 5e-3 * stepped.values("time"))
    noisy = resample(ramp(2000, slack=0.0, floor=0.0, noise=0.02), "tension", n=20)
    assert_allclose(noisy.values("tension"), 430 * noisy.values("shortening"), atol=0.03)
    there_and_back = dataset(shortening=np.array([0.0, 1.0, 0.0]), tension=np.zeros(3))
    with pytest.raises(DatasetError, match="take_branch"):
        resample(there_and_back, n=5)
    travel = np.r_[np.linspace(0.0, 1.0, 500), np.linspace(1.0, 0.0, 500)[1:]]
    with pytest.raises(DatasetError, match="take_branch"):  # however little it falls from sample to sample
        resample(dataset(shortening=travel, tension=travel), n=5)
    for wrong in ({}, {"n": 1}, {"n": 3, "step": 0.1}, {"step": 5.0}, {"step": -1.0}):
        with pytest.raises(DatasetError):
            resample(ramp(), **wrong)


def test_window() -> None:
    inside = window(ramp(), "shortening", lower=5e-3, upper=10e-3)
    assert inside.n_samples == 26
    assert inside.values("shortening").min() >= 5e-3
    with pytest.raises(DatasetError, match=r"50 mm to inf; allowed: 0 mm to 20 mm"):
        window(ramp(), "shortening", lower=50e-3)


def test_smoothing_keeps_a_parabola_and_lowers_noise() -> None:
    x = np.linspace(0, 1, 201)
    noisy = dataset(pitch=x**2 + 0.01 * np.random.default_rng(0).standard_normal(201))
    assert_allclose(smooth(dataset(pitch=x**2), "pitch", 21).values("pitch"), x**2, atol=1e-12)
    assert np.std(smooth(noisy, "pitch", 21).values("pitch") - x**2) < 0.006
    with pytest.raises(DatasetError, match="odd"):
        smooth(noisy, "pitch", 20)


def test_noise_is_estimated_on_top_of_a_slope() -> None:
    sigma = estimate_noise(ramp(4000, noise=0.03), "tension").channels["tension"].sigma
    assert_allclose(sigma, 0.03, rtol=0.08)
    assert set_noise(ramp(), "pitch", 1e-3).channels["pitch"].sigma == 1e-3


def test_detrend_needs_cycles_or_ends() -> None:
    drifting = dataset(time=np.arange(11.0), pitch=0.01 * np.arange(11.0) + 0.2)
    assert_allclose(detrend(drifting, "pitch", at="ends").values("pitch"), 0.2)
    with pytest.raises(DatasetError, match="find_cycles"):
        detrend(drifting, "pitch")


def test_plausible_and_not() -> None:
    record = ramp()
    assert check_plausible(record) == ()
    in_kilonewton = record.with_channels(Step("test"), tension=record.values("tension") * 1e3)
    assert "force in kN" in check_plausible(in_kilonewton)[0]
    in_metres = record.with_channels(Step("test"), shortening=record.values("shortening") * 1e3)
    told = " ".join(check_plausible(in_metres))
    assert "stiffness dT/dd" in told
    assert "mm read as m" in told
    negative = record.with_channels(Step("test"), tension=-record.values("tension"))
    assert "scale: -1" in check_plausible(negative)[0]
    degrees = record.with_channels(Step("test"), pitch=np.degrees(record.values("pitch")))
    assert "above 180 deg" in check_plausible(degrees)[0]
    tiny = record.with_channels(Step("test"), pitch=np.radians(record.values("pitch")) / 20)
    assert "wrong axis" in check_plausible(tiny)[0]
    assert check_plausible(ramp(slack=15e-3)) == ()
    minutes = record.with_channels(Step("test"), time=record.values("time") / 600)
    assert "time in min or ms" in check_plausible(minutes)[0]


def test_records_that_end_at_a_limit_never_get_taut_or_are_written_twice_are_suspected() -> None:
    def said(record: Dataset) -> str:
        return " ".join(check_plausible(record))

    noisy = ramp(noise=0.05)
    assert said(noisy) == ""
    force = noisy.values("tension")
    saturated = noisy.with_channels(Step("test"), tension=np.minimum(force, 6.0))
    assert "tension stays at 6 N over 25 rows while shortening changes" in said(saturated)
    assert said(noisy.with_channels(Step("test"), tension=np.round(force, 0))) == ""  # read in coarse steps
    assert said(noisy.with_channels(Step("test"), tension=np.maximum(np.round(force - 1.3, 1), 0.0))) == ""  # slack
    for n in (41, 400):
        assert "is the cable taut in this record?" in said(ramp(n, slack=30e-3, noise=0.05))
    unloaded = {key: np.maximum(values, 0.0)[::-1] for key, values in (("tension", force - 3.0),)}
    unloaded |= {key: noisy.values(key)[::-1] for key in ("shortening", "pitch")}
    assert said(dataset(**unloaded)) == ""  # slack at the end
    few = {"shortening": np.linspace(0.0, 12e-3, 5), "tension": [0.0, 0.1, 0.2, 0.5, 6.0]}
    assert "taut" not in said(dataset(**few))
    shuffled = np.random.default_rng(4).permutation(101)
    assert "taut" not in said(
        dataset(**{key: noisy.values(key)[shuffled] for key in ("shortening", "tension", "pitch")})
    )
    twice = {key: np.tile(channel.values, 2) for key, channel in noisy.channels.items() if key != "time"}
    assert "101 of 202 rows repeat earlier ones in every channel" in said(dataset(**twice))
    coarse = {key: np.tile(np.concatenate([noisy.values(key), noisy.values(key)[::-1]]), 2) for key in twice}
    coarse["tension"] = np.round(coarse["tension"] + 0.1 * np.random.default_rng(5).standard_normal(404), 1)
    assert "repeat earlier" not in said(dataset(**coarse))  # two cycles
    there = {key: np.concatenate([values[:101], values[100::-1]]) for key, values in twice.items()}
    assert "repeat earlier" not in said(dataset(**there))


def test_steps_with_units() -> None:
    steps = [
        {"correct_pulley_friction": {"n_pulleys": 2, "friction_coefficient": 0.1, "wrap_angle": "180 deg"}},
        {"window": {"channel": "shortening", "lower": "4 mm", "upper": "1.6 cm"}},
        {"zero": {"channel": "tension", "by": "0.25 N"}},
        {"zero": "pitch"},
        {"resample": {"step": "1 mm"}},
        {"set_noise": {"channel": "pitch", "sigma": "0.1 deg"}},
        "check_nothing",
    ]
    planned = parse_steps(steps[:-1])
    assert planned[0].settings["wrap_angle"] == pytest.approx(np.pi)
    assert planned[1].settings == {"channel": "shortening", "lower": pytest.approx(4e-3), "upper": pytest.approx(16e-3)}
    prepared = prepare(ramp(), steps[:-1])
    by_hand = resample(
        zero(window(correct_pulley_friction(ramp(), 2, 0.1), "shortening", lower=4e-3, upper=16e-3), "tension", 0.25),
        step=1e-3,
    )
    assert_allclose(prepared.values("tension"), by_hand.values("tension"))
    assert [step.name for step in prepared.provenance] == [next(iter(step)) for step in steps[:-1]]
    assert prepared.channels["pitch"].sigma == pytest.approx(np.radians(0.1))
    assert all(step.outcome for step in prepared.provenance)
    with pytest.raises(DatasetError, match="check_nothing"):
        prepare(ramp(), steps)


def test_all_faults_of_a_list_at_once() -> None:
    steps = [
        {"take_brunch": "loading"},
        {"window": {"channel": "shortening", "lowr": "4 mm"}},
        {"window": {"channel": "shortening", "lower": "4 N"}},
        {"window": {"lower": "4 mm"}},
        {"take_branch": "loadin"},
        {"zero": {"channel": "tension", "by": "fist"}},
        {"find_cycles": {"lower_force_limit": 0.1}},
        {"correct_pulley_friction": {"n_pulleys": 2.5, "friction_coefficient": 0.1}},
        {"correct_pulley_friction": {"n_pulleys": 200, "friction_coefficient": 0.1}},
        {"remove_slack": {"subtract_floor": "yes"}},
        {"select_cycles": ["two"]},
        {"zero": "tesnion"},
        {"zero": "tension", "detrend": "pitch"},
    ]
    with pytest.raises(DatasetError) as caught:
        parse_steps(steps, where="experiments.pull.prepare")
    told = str(caught.value)
    for part in (
        "prepare[0]: there is no such preparation step; got 'take_brunch'",
        "Try: 'take_branch'",
        "prepare[1].window: unknown setting; got 'lowr'",
        "Try: 'lower'",
        "prepare[2].window.lower: the unit does not fit; got 'N'",
        "prepare[3].window: a setting is missing; got no channel",
        "Try: 'loading'",
        "Try: 'first'",
        "prepare[6].find_cycles.lower_force_limit: the unit is missing",
        "n_pulleys: the setting does not fit; got 2.5; allowed: a whole number",
        "allowed: true or false",
        "or a list of cycle numbers",
        "Try: 'tension'",
        "n_pulleys: there are too many pulleys; got 200; allowed: 1 to 100 pulleys",
        "prepare[12]: a step is one name",
    ):
        assert part in told, part


def test_every_preparation_is_described() -> None:
    for name, preparation in STEPS.items():
        assert preparation.function.__name__ == name
        assert preparation.summary.endswith(".")
        assert set(preparation.settings) <= set(preparation.function.__annotations__)


def test_every_step_stands_in_the_docs() -> None:
    page = (Path(__file__).parents[2] / "docs" / "bench-data.md").read_text(encoding="utf-8")
    assert [name for name in STEPS if f"`{name}`" not in page] == []


def test_the_pull_of_the_docs_is_read(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "bench-data.md").read_text(encoding="utf-8")
    block = page[page.index("    experiments:\n      pull1:") : page.index("A unit that the table states")]
    section = textwrap.dedent(block).replace("neck.", "bar.")
    path = write_project(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.index("experiments:")] + section, encoding="utf-8")
    rows = [f"{k};{0.5 * k:.1f};{12.5 + 0.1 * k:.2f};{40.0 * k:.1f}".replace(".", ",") for k in range(60)]
    lines = ["Protokoll;;;", "Nr;Zeit;Weg;Kraft", ";s;mm;gf", *rows, "Ende der Messung;;;"]
    (tmp_path / "pull1.csv").write_text("\n".join(lines) + "\n", encoding="latin-1")
    data = load(path).experiments["pull1"].dataset
    assert data.n_samples == 60
    np.testing.assert_allclose(data.values("shortening"), 1e-4 * np.arange(60), atol=1e-12)
    np.testing.assert_allclose(data.values("tension"), 40.0 * 9.80665e-3 * np.arange(60), rtol=1e-9)


def test_a_tension_that_falls_is_not_said_never_to_change() -> None:
    d = np.linspace(0.0, 0.04, 50)

    def told(tension: np.ndarray) -> str:
        channels = {"shortening": Channel(d, "m"), "tension": Channel(tension, "N")}
        return " ".join(check_plausible(Dataset("pull", channels)))

    constant = "pull: tension never changes: is it the right column?"
    assert told(np.full(50, 0.1)) == constant
    assert told(np.where(d < 1e-3, 0.102, 0.0968)) == (
        "pull: tension does not rise with shortening (0.0968 to 0.102 N): is it the right column?"
    )
    assert "right column" not in told(100 * d)
    assert str(Fault(constant, "p.yaml:3")) == f"p.yaml:3: {constant}"
    assert str(Fault("all is wrong.", "p.yaml:3")) == "p.yaml:3: all is wrong."


def test_a_pitch_that_never_changes_does_not_swing() -> None:
    d = np.linspace(0.0, 0.04, 50)

    def told(pitch: np.ndarray) -> str:
        channels = {"shortening": Channel(d, "m"), "pitch": Channel(pitch, "rad")}
        return " ".join(check_plausible(Dataset("pull", channels)))

    assert told(np.full(50, 0.1)) == "pull: the pitch never changes: is it the right column?"
    assert "pitch swings by 0.0229 deg over 40 mm" in told(0.01 * d)
    assert told(5.0 * d) == ""


def test_a_record_of_one_sample_is_told_so() -> None:
    channels = {"shortening": Channel(np.array([0.01]), "m"), "tension": Channel(np.array([3.0]), "N")}
    (told,) = check_plausible(Dataset("pull", channels))
    assert told.startswith("pull: the record has one sample, and a stiffness needs two or more")
    assert "never changes" not in told


def test_a_window_at_the_end_is_no_longer_than_the_record() -> None:
    record = dataset(time=np.arange(5.0), tension=np.arange(5.0))
    assert prepare(record, [{"average": {"last": "5 s"}}]).values("tension").tolist() == [2.0]
    with pytest.raises(DatasetError, match=r"the window is longer than the record; got 3600 s; allowed: up to 4 s"):
        prepare(record, [{"average": {"last": "1 h"}}])


def test_a_step_that_is_too_long_is_shown_with_its_unit() -> None:
    record = dataset(time=np.arange(5.0), tension=np.arange(5.0))
    with pytest.raises(DatasetError, match="got a step of 3600 s"):
        prepare(record, [{"resample": {"by": "time", "step": "1 h"}}])
