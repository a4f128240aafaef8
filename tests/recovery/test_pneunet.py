"""Modulus and dead volume of a small pneunet from noisy records of pressure, volume and a marker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mechanics_cases import hanging_finger

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.parameters import with_parameters
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Marker
from softcal.twin.simulate import simulate

TRUTH = {"finger.youngs_modulus": 2.6e5, "main.dead_volume": 7e-6}
NOISE = {"main.pressure": 100.0, "main.volume": 2e-8, "tip.x": 1e-4, "tip.z": 1e-4}
UNITS = {"main.pressure": "Pa", "main.volume": "m^3", "tip.x": "m", "tip.z": "m"}
FREE = (
    FreeParameter("finger.youngs_modulus", "Pa", 1e5, 1e6, "log"),
    FreeParameter("main.dead_volume", "m^3", 0.0, 3e-5),
)


@pytest.mark.slow
def test_the_intervals_of_modulus_and_dead_volume_contain_the_truth():
    """By a regulator and by a syringe, up to a vacuum on one side."""
    robot = replace(hanging_finger("P1", is_open=True), markers=(Marker("tip", "finger", [0.008, 0.008, 0.06]),))
    tests = {"pressure": np.linspace(-1e4, 3e4, 5), "volume": np.linspace(-1e-6, 4e-6, 5)}
    seen = {
        control: simulate(
            with_parameters(robot, TRUTH), Protocol({"main": Command(control, values)}), curve_tolerance=0.0
        )
        for control, values in tests.items()
    }
    random = np.random.default_rng(7)
    experiments: list[Experiment] = []
    for control, values in tests.items():
        channels = {f"main.{control}": Channel(values, UNITS[f"main.{control}"])}
        for name, sigma in NOISE.items():
            if name not in channels:
                read = seen[control].channels[name] + sigma * random.standard_normal(len(values))
                channels[name] = Channel(read, UNITS[name], sigma)
        experiments.append(Experiment(control, Dataset(control, channels), drive=(f"main.{control}",)))
    result = calibrate(make_problem(robot, experiments, FREE, LikelihoodLoss()), starts=1)
    assert "Converged" in result.status, result.status
    for name, value in TRUTH.items():
        low, high = result.parameters[name].interval
        assert low < value < high, name
        assert high - low < 0.1 * value, name
