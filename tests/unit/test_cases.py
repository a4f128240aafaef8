"""What the commands simulate: pulls, or experiments with the robot as each of them sets it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from project_case import write_project

from softcal.cli import main
from softcal.errors import ParameterError
from softcal.project.project import load
from softcal.workflows.cases import cases
from softcal.workflows.simulation import simulate

SOFTER = ("    noise: {tension", "    settings: {bar.poissons_ratio: 0.2}\n    noise: {tension")


@pytest.mark.slow
def test_an_experiment_is_simulated_as_it_sets_the_robot(tmp_path: Path):
    path, out = write_project(tmp_path, SOFTER), tmp_path / "out"
    project = load(path)
    case = cases(project)["pull"]
    assert case.robot.bodies[0].parameters["poissons_ratio"] == 0.2
    with pytest.raises(SystemExit) as left:
        main(["simulate", str(path), "--out", str(out)])
    assert left.value.code in (0, None)
    tension = np.loadtxt(out / "response-pull.csv", delimiter=",", skiprows=1)[:, 1]
    expected = simulate(project, experiment="pull").channels["front.tension"]
    np.testing.assert_allclose(tension, expected, rtol=1e-6)
    nominal = simulate(project, case.protocol).channels["front.tension"]
    assert abs(nominal[-1] - tension[-1]) > 1e-3 * tension[-1]
    record = json.loads((out / "simulation.json").read_text())
    assert record["responses"]["pull"]["settings"] == {"bar.poissons_ratio": 0.2}


def test_a_pull_has_the_robot_of_the_project(tmp_path: Path):
    project = load(write_project(tmp_path, SOFTER))
    case = cases(project, ["front=2mm"])["pull"]
    assert case.robot is project.robot
    assert case.experiment == ""
    with pytest.raises(ParameterError, match="there is no such experiment"):
        cases(project, experiment="push")
