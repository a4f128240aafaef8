"""Derivatives of what a camera sees of the manipulator: by every modulus, by the frame, by the rig of each cable."""

from __future__ import annotations

import numpy as np
import pytest
from manipulator_case import MARKERS, MODULI, manipulator

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.frame import FRAME
from softcal.calibration.problem.observation import Observation, commands, control_parameters, observe
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

PLACE = {"m4.y_offset": 0.003}
OF_ROBOT = (*MODULI, *PLACE)
FRAME_AT = dict(zip(FRAME, (0.01, -0.02, 0.03, 0.3, -0.2, 0.4), strict=True))


def test_of(tensions: dict[str, list[float]], **more: list[float]) -> Experiment:
    n = len(next(iter(tensions.values())))
    channels = {f"{cable}.tension": Channel(values, "N") for cable, values in tensions.items()}
    channels |= {name.replace("_", "."): Channel(values, "m") for name, values in more.items()}
    drives = tuple(channels)
    channels |= {f"{m}.{axis}": Channel(np.zeros(n), "m") for m in MARKERS for axis in "xyz"}
    channels |= {"S4.pitch": Channel(np.zeros(n), "rad"), "cable2.shortening": Channel(np.zeros(n), "m"), **channels}
    compared = tuple(name for name in channels if name not in drives)
    return Experiment("bench", Dataset("bench", channels), drive=drives, compared=compared)


test_of.__test__ = False


def read(test: Experiment, values: dict[str, float], names: tuple[str, ...] = ()) -> Observation:
    """What the bench would read with robot and rig at `values`."""
    robot = with_parameters(manipulator(), {name: value for name, value in values.items() if name in OF_ROBOT})
    rig = {**test.rig_values(), **{name: value for name, value in values.items() if name not in OF_ROBOT}}
    told = commands(test, rig)
    by = [name for name in names if name in OF_ROBOT]
    if names and len(told) > 1:
        by += [f"{cable}.{command.control}" for cable, command in told.items()]
    response = simulate(robot, Protocol(told), sensitivities=by, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return observe(test, rig, response, slice(0, test.dataset.n_samples), names)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tensions", "steps"),
    [
        ({"cable1": [4.0, 9.0]}, {"cable1.tension_offset": 1e-4}),
        ({"cable6": [12.0]}, {"cable6.tension_offset": 1e-4}),
        ({"cable1": [6.0], "cable6": [4.0]}, {"cable1.tension_offset": 1e-4, "cable6.tension_offset": 1e-4}),
    ],
)
def test_readings_have_exact_derivatives(tensions, steps, monkeypatch) -> None:
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    test = test_of(tensions)
    gains = {f"{cable}.tension_gain": 1.05 for cable in tensions}
    values = {**MODULI, **FRAME_AT, **dict.fromkeys(steps, 0.1), **gains, **PLACE}
    steps = {**steps, **dict.fromkeys([*gains, *PLACE], 1e-5)}
    check(test, values, {**dict.fromkeys(MODULI, 1e5), **dict.fromkeys(FRAME, 1e-5), **steps})


def test_slack_of_one_of_two_cables_has_its_exact_derivative_too(monkeypatch) -> None:
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    test = test_of({"cable1": [6.0]}, cable5_shortening=[0.012])
    assert control_parameters(test) == {
        "cable1.tension_offset",
        "cable1.tension_gain",
        "cable1.tension_drift",
        "cable5.slack",
    }
    values = {**MODULI, "cable5.slack": 0.002, "cable1.tension_offset": 0.1}
    check(test, values, {**dict.fromkeys(MODULI, 1e5), "cable5.slack": 1e-6, "cable1.tension_offset": 1e-4})


def test_a_commanded_tension_follows_its_own_command_alone() -> None:
    told = Protocol({"cable1": Command("tension", np.array([6.0])), "cable6": Command("tension", np.array([4.0]))})
    by = simulate(manipulator(), told, sensitivities=["cable1.tension"]).sensitivities
    assert by["cable1.tension"]["cable1.tension"] == 1.0
    assert by["cable6.tension"]["cable1.tension"] == 0.0
    still = Protocol({"cable1": Command("tension", np.array([6.0])), "cable6": Command("tension", np.array([0.0]))})
    with_slack = simulate(manipulator(), still, sensitivities=["cable1.tension", "cable6.tension"])
    by_slack = with_slack.sensitivities
    alone = simulate(manipulator(), still, sensitivities=["cable1.tension"])
    assert by_slack["m4.x"]["cable1.tension"] == pytest.approx(alone.slopes["m4.x"], rel=1e-6)
    assert alone.slopes["m4.x"] > 0.0
    # A tension of zero has the derivative of a pull.
    pulled = Protocol({"cable1": Command("tension", np.array([6.0])), "cable6": Command("tension", np.array([1e-3]))})
    change = simulate(manipulator(), pulled).channels["m4.x"] - with_slack.channels["m4.x"]
    assert by_slack["m4.x"]["cable6.tension"] == pytest.approx(change / 1e-3, rel=1e-3)


def check(test: Experiment, values: dict[str, float], steps: dict[str, float]) -> None:
    got = read(test, values, tuple(values))
    for name, h in steps.items():
        ends = [read(test, {**values, name: values[name] + s * h}).predicted for s in (1, -1)]
        largest = 0.0
        for channel in test.compared:
            want = (ends[0][channel] - ends[1][channel]) / (2 * h)
            largest = max(largest, float(np.abs(want).max()))
            scale = np.abs(np.concatenate([ends[0][channel], ends[0]["m4.x"]])).max() / abs(values[name])
            np.testing.assert_allclose(
                got.derivatives[channel][name], want, rtol=1e-5, atol=1e-6 * scale, err_msg=f"{channel} by {name}"
            )
        assert largest > 0.0, name
