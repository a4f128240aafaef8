"""The error of the mesh in the intervals: by one more simulation on a finer mesh, or a sentence why not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from fake_twin import E as FAKE_E
from fake_twin import fake_experiment, fake_robot, fake_simulate
from project_case import bar_mesh, bar_robot

from softcal.analysis.mesh_study import mesh_study
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.mesh_error import with_mesh_error
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.finer import halved
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

E = "bar.youngs_modulus"
TRUE = 1.3e6


def robot(element: str) -> Robot:
    bar = bar_robot(TRUE)
    return replace(bar, bodies=(replace(bar.bodies[0], element=element),))


def measured_on(truth: Robot) -> Experiment:
    d = np.linspace(0.002, 0.012, 11)
    seen = simulate(truth, Protocol({"front": Command("shortening", d)}), curve_tolerance=1e-6)
    noise = 0.01 * np.random.default_rng(2).standard_normal(len(d))
    channels = {"shortening": Channel(d, "m"), "tension": Channel(seen.channels["front.tension"] + noise, "N", 0.01)}
    return Experiment(
        "pull", Dataset("pull", channels), "front", "plate", "shortening", settings={"front.tension_drift": 0.0}
    )


def problem_of(coarse: Robot, truth: Robot) -> Problem:
    free = (FreeParameter(E, "Pa", 0.1e6, 10e6, "log", start=TRUE),)
    return make_problem(coarse, (measured_on(truth),), free, LikelihoodLoss())


@pytest.mark.slow
@pytest.mark.parametrize("element", ["P1", "P2P1"])
def test_the_interval_reaches_the_finer_mesh(element: str) -> None:
    """On P1 the finer twin has P2P1 on the same tets; on P2P1 every element is halved."""
    coarse = robot(element)
    problem = problem_of(coarse, robot("P2P1") if element == "P1" else halved(coarse))
    without, found = calibrate(problem), calibrate(problem, mesh_error=True)
    one, other = found.parameters[E], without.parameters[E]
    assert one.value == pytest.approx(other.value, rel=1e-9)
    assert one.interval is not None
    assert other.interval is not None
    assert one.interval[0] < TRUE < one.interval[1]
    assert not other.interval[0] < TRUE < other.interval[1]
    assert found.n_solves == without.n_solves + 1
    assert any("the error of the mesh. Not included: errors of the material law" in str(note) for note in found.notes)
    assert any("errors of the mesh" in str(note) for note in without.notes)


@pytest.mark.slow
def test_its_share_is_what_a_mesh_study_foretells() -> None:
    coarse = robot("P2P1")
    problem = problem_of(coarse, halved(coarse))
    estimate = calibrate(problem, mesh_error=True).parameters[E]
    best = mesh_study(problem, {E: estimate.value}, halvings=1).best
    assert best is not None
    assert estimate.standard_error is not None
    stated = estimate.standard_error * np.sqrt(estimate.shares["mesh"])
    assert stated == pytest.approx(abs(best.values[E] - estimate.value), rel=0.1)


def test_it_is_said_why_the_error_of_the_mesh_is_not_known() -> None:
    problem = problem_of(robot("P2P1"), robot("P2P1"))
    best = problem.evaluate({E: TRUE}, jacobian=True)
    too_fine = with_mesh_error(problem, best, max_unknowns=1000)
    advice = r"have ([\d,]+) unknowns, more than the limit of 1,000\. Try .* softcal mesh-study RUN --unknowns (\d+)\.$"
    said = re.search(advice, too_fine.unknown)
    assert said is not None
    assert said[1].replace(",", "") == said[2]
    assert too_fine.best is best
    fake = make_problem(
        fake_robot(), [fake_experiment(noise=1e-3)], (FreeParameter(FAKE_E, "Pa", 1e5, 1e7),), simulate=fake_simulate
    )
    told = " ".join(map(str, calibrate(fake, mesh_error=True).notes))
    assert "The error of the mesh is not known: the twin is another engine's." in told
    assert "errors of the mesh" in told


def test_a_stop_ends_it_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(self: Robot) -> Robot:
        raise KeyboardInterrupt

    problem = problem_of(robot("P2P1"), robot("P2P1"))
    monkeypatch.setattr("softcal.calibration.statistics.mesh_error.halved", stopped)
    result = calibrate(problem, mesh_error=True)
    assert result.parameters[E].interval is not None
    assert any("stopped by the user" in str(note) for note in result.notes)


def test_the_bar_is_coarse() -> None:
    assert bar_mesh().n_tets < 400
