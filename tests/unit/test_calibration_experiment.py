"""The rig between the twin and the instruments: what is read, and its exact derivatives."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate

from softcal.calibration.problem.experiment import Experiment, rig_parameters
from softcal.calibration.problem.observation import Observation, commands, observe
from softcal.calibration.problem.rig import Pulleys, Rig
from softcal.errors import DatasetError, InputError
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Protocol

PULLEYS = Pulleys(wrap=np.pi, friction_coefficient=0.1)
AT = {
    E: 2.0e6,
    NU: 0.44,
    "front.slack": 1.7e-3,
    "front.tension_offset": 0.3,
    "front.tension_gain": 1.05,
    "front.tension_drift": 0.2,
    "plate.pitch_drift": 0.03,
    "plate.pitch_offset": 0.02,
    "pulleys.friction_coefficient": 0.13,
}
NAMES = tuple(AT)


def read(experiment: Experiment, values: dict[str, float], names: tuple[str, ...] = ()) -> Observation:
    rig = {name: value for name, value in values.items() if name not in TRUE}
    robot = with_parameters(fake_robot(), {name: values[name] for name in TRUE})
    told = commands(experiment, rig)["front"]
    response = fake_simulate(robot, Protocol({"front": told}), sensitivities=(E, NU))
    return observe(experiment, rig, response, slice(0, len(told.values)), names)


@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_central_differences(drive: str, name: str) -> None:
    experiment = fake_experiment(drive=drive, tension_offset=0.35, rig=Rig(pulleys=PULLEYS))
    exact = read(experiment, AT, NAMES).derivatives
    step = 1e-6 * AT[name]
    above, below = (read(experiment, {**AT, name: AT[name] + s}).predicted for s in (step, -step))
    for channel in experiment.compared:
        estimated = (above[channel] - below[channel]) / (2 * step)
        np.testing.assert_allclose(
            exact[channel][name], estimated, rtol=2e-6, atol=2e-6 * np.abs(estimated).max() + 1e-12
        )


def test_a_drift_grows_with_the_time_of_the_record() -> None:
    """From none at the first sample, to all of it at the last; by the numbers of samples where there are no times."""
    experiment = fake_experiment(n_samples=5)
    drift = {**AT, "front.tension_drift": 0.4, "plate.pitch_drift": 0.0}
    none = {**AT, "front.tension_drift": 0.0, "plate.pitch_drift": 0.0}

    def drifted(test: Experiment) -> np.ndarray:
        return read(test, drift).predicted["tension"] - read(test, none).predicted["tension"]

    np.testing.assert_allclose(drifted(experiment), [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-12)
    channels = {**experiment.dataset.channels, "time": Channel(np.array([3.0, 4.0, 5.0, 6.0, 13.0]), "s")}
    timed = replace(experiment, dataset=Dataset("timed", channels))
    np.testing.assert_allclose(drifted(timed), [0.0, 0.04, 0.08, 0.12, 0.4], atol=1e-12)


def test_driven_by_shortening_tension_and_pitch_are_compared_and_the_other_way_round() -> None:
    assert fake_experiment(drive="shortening").compared == ("tension", "pitch")
    assert fake_experiment(drive="tension").compared == ("shortening", "pitch")


def test_a_channel_that_is_named_twice_counts_once() -> None:
    assert replace(fake_experiment(), compared=("pitch", "tension", "pitch")).compared == ("pitch", "tension")


def test_slack_is_taken_off_and_leaves_a_cable_longer_than_at_rest() -> None:
    experiment = fake_experiment(reach=0.04, n_samples=5)
    told = commands(experiment, {**experiment.rig_values(), "front.slack": 0.015})["front"]
    np.testing.assert_allclose(told.values, [-0.015, -0.005, 0.005, 0.015, 0.025])


def test_a_tension_below_the_offset_leaves_the_cable_slack() -> None:
    experiment = fake_experiment(drive="tension")
    told = commands(experiment, {**experiment.rig_values(), "front.tension_offset": 1.0})["front"]
    assert told.values.min() == 0.0
    assert told.values.max() == pytest.approx(experiment.dataset.values("tension").max() - 1.0)


def test_shortening_of_the_bench_is_the_cables_and_the_slack() -> None:
    experiment = fake_experiment(drive="tension", slack=0.004)
    values = {**experiment.rig_values(), **TRUE, "front.slack": 0.004}
    seen = read(experiment, values).predicted["shortening"]
    taut = experiment.dataset.values("shortening") > 0.004
    np.testing.assert_allclose(seen[taut], experiment.dataset.values("shortening")[taut], atol=1e-12)


def test_free_friction_changes_the_twins_side_and_never_the_data() -> None:
    experiment = fake_experiment(rig=Rig(pulleys=PULLEYS))
    nominal = {**experiment.rig_values(), **TRUE}
    more = {**nominal, "pulleys.friction_coefficient": 0.2}
    ratio = read(experiment, more).predicted["tension"][1:] / read(experiment, nominal).predicted["tension"][1:]
    np.testing.assert_allclose(ratio, np.exp(2 * np.pi * 0.1))
    np.testing.assert_array_equal(
        read(experiment, more).predicted["pitch"], read(experiment, nominal).predicted["pitch"]
    )


def test_without_pulleys_there_is_no_friction_to_free() -> None:
    assert "pulleys.friction_coefficient" not in rig_parameters([fake_experiment()])
    assert "pulleys.friction_coefficient" in rig_parameters([fake_experiment(rig=Rig(pulleys=PULLEYS))])


def test_faults_of_an_experiment_are_told_together() -> None:
    whole = fake_experiment()
    with pytest.raises(DatasetError) as caught:
        Experiment("pull", whole.dataset, "front", "plate", "shortening", compared=("yaw", "shortening"))
    assert "no channel 'yaw'" in str(caught.value)
    assert "cannot be compared" in str(caught.value)


def test_a_rig_out_of_range_is_refused_in_python_as_in_a_file() -> None:
    with pytest.raises(InputError) as caught:
        Rig(slack=math.nan, tension_offset=1e9, length=0.0, pulleys=2)
    assert {fault.where for fault in caught.value.faults} == {"slack", "tension_offset", "length", "pulleys"}
