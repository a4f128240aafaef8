"""The loss over two parameters: scaling by the modulus gives what solving every point gives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from project_case import bar_robot, write_project

from softcal.analysis.landscape import ProportionalTwin, loss_over, scales_with_modulus
from softcal.calibration.problem.problem import Problem
from softcal.errors import ParameterError
from softcal.project.project import load
from softcal.twin.barrier import Contact
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import make_problem
from softcal.workflows.simulation import pull

MODULUS, RATIO = "bar.youngs_modulus", "bar.poissons_ratio"


@pytest.fixture
def problem(tmp_path: Path) -> Problem:
    free = "  bar.poissons_ratio: {bounds: [0.3, 0.45]}\n  front.slack:"
    return make_problem(load(write_project(tmp_path, ("  front.slack:", free))))


def test_scaled_is_solved(problem: Problem):
    theta = {MODULUS: 1e6, RATIO: 0.4, "front.slack[pull]": 0.001}
    solved = loss_over(problem, theta, MODULUS, RATIO, (3, 2))
    twin = ProportionalTwin(0.021)
    scaled = loss_over(replace(problem, simulate=twin), theta, MODULUS, RATIO, (3, 2))
    assert len(twin.solved) == 2
    np.testing.assert_allclose(scaled.loss, solved.loss, rtol=2e-4)
    np.testing.assert_allclose(solved.x, [1e5, 2e6, 4e7])
    np.testing.assert_allclose(solved.y, [0.3, 0.45])


def test_when_the_tension_is_proportional(problem: Problem):
    assert scales_with_modulus(problem)
    heavy = replace(problem.robot, gravity=np.array([0, 0, -9.81]))
    assert scales_with_modulus(replace(problem, robot=heavy))
    body = replace(heavy.bodies[0], density=1000.0)
    assert not scales_with_modulus(replace(problem, robot=replace(heavy, bodies=(body,))))
    touching = replace(problem.robot, contact=Contact(gap=1e-4, stiffness=1e5))  # whose barrier keeps its stiffness
    assert not scales_with_modulus(replace(problem, robot=touching))
    driven = replace(problem.experiments[0], drive="tension", compared=("pitch",))
    assert not scales_with_modulus(replace(problem, experiments=(driven,)))


def test_what_cannot_be_scaled_is_refused():
    robot = bar_robot()
    with pytest.raises(ParameterError, match="can be scaled"):
        ProportionalTwin(0.01)(robot, pull(robot, "front", "tension", 1.0))


def test_a_shape_that_ends_short_has_no_loss(problem: Problem):
    """Whatever number of samples it was solved for: the failed response is none of the protocol's."""

    def short(robot, protocol, theta=None, *, sensitivities=(), snapshots=False):
        response = simulate(robot, protocol)
        channels = {name: values[:-1] for name, values in response.channels.items()}
        return replace(response, succeeded=False, status="It folds.", channels=channels)

    theta = {MODULUS: 1e6, RATIO: 0.4, "front.slack[pull]": 0.001}
    found = loss_over(replace(problem, simulate=ProportionalTwin(0.021, short)), theta, MODULUS, RATIO, (2, 2))
    assert np.isnan(found.loss).all()
