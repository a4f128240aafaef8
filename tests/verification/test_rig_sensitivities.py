"""Derivatives of what the bench reads by the rig's parameters and the robot's, through the real twin."""

from dataclasses import replace

import numpy as np
import pytest
from drum_case import MU, robot_over_a_drum
from mechanics_cases import bent_box, column_robot, elastic

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import commands, observe
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.problem.rig import Pulleys, Rig
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.cables import CableLine
from softcal.twin.parameters import robot_parameters, with_parameters
from softcal.twin.protocol import Protocol
from softcal.twin.simulate import simulate

ROBOT = column_robot(
    "P2P1",
    parameters=elastic(0.4e6, 0.45),
    divisions=(1, 1, 4),
    gravity=(2.0, 0.0, -9.81),
    density=1100.0,
    mass=0.05,
)
OF_THE_ROBOT = ("neck.youngs_modulus", "neck.poissons_ratio", "neck.density", "plate.mass")
D = np.array([0.0, 0.008, 0.015, 0.03])
T = np.array([0.05, 0.3, 0.8, 1.6])
AT = {
    "front.slack": 0.002,
    "front.tension_offset": 0.1,
    "front.tension_gain": 1.04,
    "front.tension_drift": 0.05,
    "plate.pitch_drift": 0.03,
    "plate.pitch_offset": 0.02,
    "pulleys.friction_coefficient": 0.12,
}
STEP = {"front.slack": 1e-6, "front.tension_offset": 1e-4, "plate.pitch_offset": 1e-3}


def experiment(drive):
    channels = {"shortening": Channel(D, "m", 1e-4), "tension": Channel(T, "N", 0.02), "pitch": Channel(D, "rad", 0.01)}
    rig = Rig(
        slack=0.0,
        tension_offset=0.0,
        angle_offsets={"pitch": 0.0},
        pulleys=Pulleys(wrap=np.pi, friction_coefficient=0.1),
    )
    return Experiment("bench", Dataset("bench", channels), "front", "plate", drive, rig=rig)


def read(test, robot, values, names=()):
    """What the bench would read in a test with robot and rig at `values`."""
    own = robot_parameters(robot)
    robot = with_parameters(robot, {name: value for name, value in values.items() if name in own})
    rig = {name: value for name, value in values.items() if name not in own}
    of_the_robot = tuple(name for name in names if name in own)
    protocol = Protocol(commands(test, rig))
    response = simulate(robot, protocol, sensitivities=of_the_robot, curve_tolerance=0.0)
    assert response.succeeded, response.status
    return observe(test, rig, response, slice(None), names)


def require_readings(test, robot, values, steps, error):
    """The derivatives of all readings agree with central differences, but for these' rounding; each parameter changes
    one of them.
    """
    got = read(test, robot, values, tuple(values))
    for name, value in values.items():
        h = steps.get(name, 1e-4 * value)
        ends = [read(test, robot, {**values, name: value + s * h}).predicted for s in (1, -1)]
        for channel in got.predicted:
            want = (ends[0][channel] - ends[1][channel]) / (2 * h)
            rounding = 4e-16 * max(np.abs(ends[0][channel]).max(), channel.endswith("pitch")) / h
            np.testing.assert_allclose(
                got.derivatives[channel][name],
                want,
                rtol=error,
                atol=error * np.abs(want).max() + rounding,
                err_msg=f"{channel} by {name}",
            )
        assert any(np.any(got.derivatives[channel][name] != 0.0) for channel in got.predicted), name
    return got


@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_readings_have_exact_derivatives(drive, monkeypatch):
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    values = {**{name: robot_parameters(ROBOT)[name].value for name in OF_THE_ROBOT}, **AT}
    got = require_readings(experiment(drive), ROBOT, values, STEP, 1e-5)
    assert set(got.predicted) == {"pitch", "tension" if drive == "shortening" else "shortening"}


GAUGES = {
    "main.pressure_offset": 400.0,
    "main.pressure_gain": 1.03,
    "main.pressure_drift": -300.0,
    "main.volume_offset": 2e-7,
    "main.volume_gain": 0.97,
    "plate.pitch_offset": 0.02,
    "plate.pitch_drift": 0.03,
}


@pytest.mark.parametrize("drive", ["pressure", "volume"])
def test_readings_of_a_chamber_have_exact_derivatives(drive, monkeypatch):
    """By its gauge's and its pump's parameters, and by the modulus of its walls; under vacuum too."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    p, v, pitch = np.array([-1.5e4, 2e4]), np.array([-1e-6, 3e-6]), np.array([0.0, 0.01])
    channels = {"main.pressure": Channel(p, "Pa", 100.0), "main.volume": Channel(v, "m^3", 1e-8)}
    data = Dataset("bench", {**channels, "plate.pitch": Channel(pitch, "rad", 0.01)})
    test = Experiment("bench", data, drive=(f"main.{drive}",))
    robot = bent_box("P1")
    values = {"box.youngs_modulus": robot_parameters(robot)["box.youngs_modulus"].value, **GAUGES}
    got = require_readings(test, robot, values, {}, 1e-6)
    assert set(got.predicted) == {"main.pressure", "main.volume", "plate.pitch"} - {f"main.{drive}"}


CYCLE = 1e-3 * np.array([1.0, 4.0, 9.0, 8.9, 6.0, 3.0, 3.1, 5.0, 8.0])
REVERSING = {
    "neck.youngs_modulus": (0.5e6, 1e5, 1e6),
    "front.friction_coefficient": (MU, 0.01, 0.5),
    "front.stiffness": (2e3, 1e2, 1e5),
    "front.slack": (0.4e-3, 0.0, 2e-3),
    "front.backlash": (3e-4, 0.0, 1e-3),
    "front.tension_offset": (0.02, -0.1, 0.1),
    "front.tension_gain": (1.05, 0.9, 1.1),
    "front.tension_drift": (0.01, -0.1, 0.1),
    "pulleys.friction_coefficient": (0.08, 0.0, 0.3),
    "pulleys.presliding": (2e-4, 1e-5, 1e-3),
}


@pytest.mark.slow
@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_readings_of_cables_and_pulleys_that_reverse_have_exact_derivatives(drive, monkeypatch):
    """Of two tests, each of which begins anew: by its slack too, which changes the commands of all samples before."""
    monkeypatch.setattr("softcal.mechanics.statics.TOLERANCE", 1e-11)
    robot = robot_over_a_drum(MU, 5)
    line = CableLine(2e3, friction_memory=True, presliding=1e-4)
    robot = replace(robot, cables=(replace(robot.cables[0], line=line),))
    pulleys = Pulleys(wrap=np.pi, friction_coefficient=0.08, friction_memory=True, presliding=2e-4)
    rig = Rig(backlash=3e-4 if drive == "shortening" else None, pulleys=pulleys)

    def test_of(name, d):
        channels = {"shortening": Channel(d, "m", 1e-4), "tension": Channel(250.0 * d, "N", 0.02)}
        data = Dataset(name, {**channels, "pitch": Channel(d, "rad", 0.01)})
        return Experiment(name, data, "front", "plate", drive, rig=rig)

    units = {name: known.unit for name, known in robot_parameters(robot).items()}
    units |= {
        "front.slack": "m",
        "front.backlash": "m",
        "front.tension_offset": "N",
        "front.tension_gain": "1",
        "front.tension_drift": "N",
        "pulleys.presliding": "m",
    }
    ways = {name: values for name, values in REVERSING.items() if drive == "shortening" or name != "front.backlash"}
    free = [FreeParameter(name, units.get(name, "1"), *ends) for name, (_, *ends) in ways.items()]
    problem = make_problem(robot, [test_of("one", CYCLE), test_of("two", CYCLE[::-1])], free)
    theta = {name: value for name, (value, *_) in ways.items()}

    def residuals(values):
        found = problem.evaluate(values)
        assert not found.failure, found.failure
        return np.concatenate([block.residual for block in found.blocks])

    exact = np.concatenate([block.jacobian for block in problem.evaluate(theta, jacobian=True).blocks])
    assert problem.n_simulations() == 2
    for k, (name, value) in enumerate(theta.items()):
        h = 1e-4 * value
        want = (residuals({**theta, name: value + h}) - residuals({**theta, name: value - h})) / (2 * h)
        assert np.abs(want).max() > 0.0
        np.testing.assert_allclose(exact[:, k], want, rtol=1e-5, atol=1e-5 * np.abs(want).max(), err_msg=name)
