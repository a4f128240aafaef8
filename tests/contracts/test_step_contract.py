"""What every preparation step keeps, and a step in one file of the user's own."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from own_module import brought, imported
from project_case import write_project

import softcal
from softcal import load
from softcal.errors import ParameterError, ProjectFileError
from softcal.experiments.dataset import Channel, Dataset
from softcal.experiments.prepare import parse_steps, prepare
from softcal.experiments.step import STEPS, PreparationStep, Setting, register_step

GAIN = '''
import math
from dataclasses import replace

from softcal import Channel, Setting, register_step
from softcal.experiments.dataset import Step


@register_step(keeps_gaps=True, channel=Setting("channel"), factor=Setting("positive ratio"))
def gain(dataset, channel, factor=1.0):
    """Multiplies a channel, as an amplifier that was set wrongly asks for."""
    old = dataset.channels[channel]
    new = Channel(factor * old.values, old.unit, None if old.sigma is None else factor * old.sigma)
    step = Step("gain", {"channel": channel, "factor": factor}, f"{channel} times {factor:g}")
    return replace(dataset, channels={**dataset.channels, channel: new}, provenance=(*dataset.provenance, step))
'''
# A sensible value of each kind of setting, as a project would write it.
VALUES: dict[str, Any] = {
    "slack": "1 mm",
    "force": "0.2 N",
    "time": "3 s",
    "angle": "90 deg",
    "share": 0.3,
    "positive ratio": 0.05,
    "friction coefficient": 0.1,
    "of channel": "20 mm",
    "count": 5,
    "flag": True,
    "channel": "shortening",
}


def cycles() -> Dataset:
    """Three cycles of a spring behind 2 mm of slack."""
    d = np.abs(np.concatenate([np.r_[0:40e-3:60j, 40e-3:0:60j]] * 3))
    force = 100.0 * np.maximum(d - 2e-3, 0.0) + 0.05
    channels = {
        "time": Channel(np.arange(len(d)) * 0.1, "s"),
        "shortening": Channel(d, "m"),
        "tension": Channel(force, "N"),
        "main.flow": Channel(np.full(len(d), 1e-7), "m^3/s"),
    }
    found = prepare(Dataset("pull", channels), ["find_cycles", "classify_cycles"])
    return found


# Along whole cycles nothing rises, and slack is taken off one branch.
BEFORE = {"resample": ["take_branch"], "smooth": ["take_branch"], "remove_slack": ["take_branch"]}
OWN = {
    "resample": {"n": 20},
    "smooth": {"channel": "tension", "n_samples": 5},
    "zero": {"channel": "tension"},
    "remove_slack": {"slack": "2 mm"},
}


@pytest.fixture(scope="module")
def record() -> Dataset:
    return cycles()


@pytest.mark.parametrize("name", sorted(STEPS))
def test_a_step_leaves_its_dataset_as_it_was_and_is_recorded(name: str, record: Dataset) -> None:
    step = STEPS[name]
    before = prepare(record, BEFORE.get(name, []))
    values = {channel: before.values(channel).copy() for channel in before.channels}
    given = OWN.get(name, {key: VALUES[step.settings[key].kind] for key in step.required})
    (planned,) = parse_steps([{name: given}])
    after = planned.apply(before)
    assert all(np.array_equal(before.values(channel), old) for channel, old in values.items())
    *earlier, last = after.provenance
    assert earlier == list(before.provenance)
    assert last.name == name
    assert last.outcome
    assert set(step.settings) <= set(last.settings)
    if step.leaves_out == "":
        assert after.n_samples >= before.n_samples or name == "remove_slack"


@pytest.mark.parametrize("name", sorted(STEPS))
def test_missing_values_are_kept_or_refused(name: str, record: Dataset) -> None:
    """A step of one channel leaves the gaps of others."""
    step = STEPS[name]
    given = OWN.get(name, {key: VALUES[step.settings[key].kind] for key in step.required})
    of = str(given.get("channel", "tension"))
    (planned,) = parse_steps([{name: given}])

    def without(channel: str) -> Dataset:
        values, unit = record.values(channel).copy(), record.channels[channel].unit
        values[3] = np.nan
        return replace(record, channels={**record.channels, channel: Channel(values, unit)})

    if step.keeps_gaps:
        assert planned.apply(without(of)).provenance[-1].name == name
    else:
        if "channel" in given:
            assert planned.apply(without("tension" if of == "main.flow" else "main.flow")).provenance[-1].name == name
        with pytest.raises(softcal.DatasetError, match=f"{name} cannot be applied to missing values"):
            planned.apply(without(of))


@pytest.fixture
def own(tmp_path: Path) -> Generator[ModuleType]:
    """The step, as a module of the user's registers it."""
    yield imported(tmp_path / "gain_step.py", GAIN)
    STEPS.remove("gain")


def test_a_step_of_ones_own_works_from_a_project_file(own: ModuleType, tmp_path: Path) -> None:
    told = ("    noise:", "    prepare: [{gain: {channel: tension, factor: 2}}]\n    noise:")
    (plain,) = load(write_project(tmp_path / "plain")).experiments.values()
    (doubled,) = load(write_project(tmp_path / "doubled", told)).experiments.values()
    np.testing.assert_array_equal(doubled.dataset.values("tension"), 2.0 * plain.dataset.values("tension"))
    assert "tension times 2" in [step.outcome for step in doubled.dataset.provenance]
    with pytest.raises(ProjectFileError, match=r"prepare\[0\]\.gain\.factor: .*got -2"):
        load(write_project(tmp_path / "negative", (told[0], told[1].replace("2}", "-2}"))))


def test_a_package_brings_it_by_an_entry_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "brought_step.py").write_text(GAIN.replace("def gain", "def brought"), encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with brought(STEPS, "brought_step:brought", "softcal.steps", "brought", monkeypatch) as step:
        assert step.keeps_gaps


def test_a_step_that_nobody_registered_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ProjectFileError, match=r"prepare\[0\]: there is no such preparation step; got 'gain'"):
        load(write_project(tmp_path, ("    noise:", "    prepare: [gain]\n    noise:")))


def test_what_is_no_step_is_refused() -> None:
    def unexplained(dataset: Dataset, by: float) -> Dataset:
        return dataset

    with pytest.raises(ParameterError) as error:
        register_step(by=Setting("distance"), from_=Setting("time"))(unexplained)
    told = str(error.value)
    assert "step unexplained, from_: the function has no such parameter; allowed: by" in told
    assert "step unexplained, by: there is no such kind of setting; got distance" in told
    assert "has no description" in told
    with pytest.raises(ParameterError, match="there is another preparation step of this name"):
        STEPS.add(PreparationStep("zero", prepare))
    with pytest.raises(ParameterError, match="this is not a preparation step"):
        STEPS.add(cycles)  # type: ignore[arg-type]
    assert "unexplained" not in STEPS
