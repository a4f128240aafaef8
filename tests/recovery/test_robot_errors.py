"""Fits of robots whose description has an error: it is named with its size, and the interval contains the truth."""

from dataclasses import replace

import numpy as np
import pytest
from bore_case import drilled_robot
from mechanics_cases import column_robot, elastic, side_cable

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.calibration.search.robot_errors import DESCRIPTION, suspects, with_named_points, with_uncertain_errors
from softcal.calibration.statistics.misfit import robot_errors
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.build import build_twin
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

E, SLACK = "neck.youngs_modulus", "front.slack"
TRUE = {E: 2.3e6, SLACK: 1e-3}
NOISE = {"tension": 0.02, "pitch": 5e-4}  # [N], [rad]


def neck(lever: float = 0.05, mass: float = 0.02, nu: float = 0.43) -> Robot:
    down = {"gravity": (0.0, 0.0, -9.81), "mass": mass, "cables": [side_cable("front", (lever, 0.0))]}
    return column_robot(parameters=elastic(TRUE[E], nu), divisions=(1, 1, 4), **down)


def pull(truth: Robot, seed: int = 0, n: int = 150) -> Experiment:
    chance = np.random.default_rng(seed)
    shortening = np.linspace(2e-3, 0.03, n)
    seen = simulate(truth, Protocol({"front": Command("shortening", shortening - TRUE[SLACK])})).channels
    read = {"tension": (seen["front.tension"], "N"), "pitch": (seen["plate.pitch"], "rad")}
    channels = {
        kind: Channel(values + NOISE[kind] * chance.standard_normal(n), unit, NOISE[kind])
        for kind, (values, unit) in read.items()
    }
    data = Dataset("pull", {"shortening": Channel(shortening, "m"), **channels})
    return Experiment("pull", data, cable="front", plate="plate")


def fitted(truth: Robot, robot: Robot, seed: int = 0, **uncertain: float) -> CalibrationResult:
    free = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6),
        FreeParameter(SLACK, "m", 0.0, 6e-3, start=5e-4),
    ]
    stated = [UncertainParameter(f"plate.{name}", "kg", sd) for name, sd in uncertain.items()]
    return calibrate(make_problem(robot, [pull(truth, seed)], free, LikelihoodLoss(), uncertain=stated), starts=1)


def said(result: CalibrationResult) -> str:
    return next((note.text for note in result.notes if note.text.startswith(DESCRIPTION)), "")


def contains(result: CalibrationResult) -> bool:
    low, high = result.parameters[E].interval or (0.0, 0.0)
    return low <= TRUE[E] <= high


def test_a_cable_that_is_attached_beside_its_place():
    """The lever, at either end, and the modulus with it."""
    result = fitted(neck(lever=0.051), neck())
    assert abs(result.parameters[E].value / TRUE[E] - 1.0) > 0.02
    assert contains(result)
    text = said(result)
    assert "front.via1.x_offset off by about 2 mm explains 100 % (with it neck.youngs_modulus 2.3 MPa)" in text


@pytest.mark.parametrize("seed", range(3))
def test_a_plate_that_is_heavier(seed: int):
    result = fitted(neck(mass=0.2), neck(mass=0.02), seed)
    assert contains(result)
    assert "plate.mass off by" in said(result)


def test_an_uncertain_parameter_is_a_suspect_too():
    result = fitted(neck(mass=0.2), neck(mass=0.02), mass=0.001)
    assert contains(result)
    assert "plate.mass off by" in said(result)


def test_a_ratio_that_is_another():
    result = fitted(neck(nu=0.42), neck(nu=0.43))
    assert contains(result)
    assert "neck.poissons_ratio off by about -0.009 explains" in said(result)


def test_of_a_right_model_nothing_is_suspected():
    """Nor is its interval longer."""
    results = [fitted(neck(), neck(), seed) for seed in range(12)]
    assert not any(said(result) for result in results)
    lengths = [(high - low) / TRUE[E] for result in results for low, high in [result.parameters[E].interval or (0, 1)]]
    assert max(lengths) < 2.0 * min(lengths)


def test_an_impossible_error_is_not_named():
    """Another law is like gravity of 80 m/s^2 sideways, or a cable 2 cm off."""
    law = {"C10": 0.4e6, "C20": 1.6e6, "C30": 0.0, "bulk_modulus": 5.5e6}
    truth = replace(neck(), bodies=(replace(neck().bodies[0], law="yeoh", parameters=law),))
    result = fitted(truth, neck())
    assert any(record.is_misfit for record in result.residuals["pull"].values())
    assert "gravity" not in said(result)


def test_the_size_of_an_error_is_that_of_least_squares():
    """In two channels of unlike noise, beside a parameter that takes up most of it."""
    chance, x = np.random.default_rng(3), np.linspace(0.0, 1.0, 200)
    answer, shape = (x, 2.0 * x), (x + 0.3 * x**2, 2.0 * x - 0.4 * np.sin(3.0 * x))
    blocks = [
        Block("pull", channel, 5.0 * x, 0.775 * J - 0.8 * c + s * chance.standard_normal(200), s, J[:, None])
        for channel, J, c, s in zip(("front.tension", "plate.pitch"), answer, shape, (0.01, 0.03), strict=True)
    ]
    changes, endless = [np.column_stack([c, np.zeros(200)]) for c in shape], (np.array([-np.inf]), np.array([np.inf]))
    (error, none) = robot_errors(blocks, changes, endless)
    assert none is None
    assert error is not None
    rows, columns = zip(*((b.residual / s, np.column_stack([J, c]) / s) for b, J, c, s in
                          zip(blocks, answer, shape, (0.01, 0.03), strict=True)), strict=True)  # fmt: skip
    moved, size = np.linalg.lstsq(np.concatenate(columns), -np.concatenate(rows), rcond=None)[0]
    assert error.size == pytest.approx(size, rel=0.02)
    assert error.size == pytest.approx(0.8, rel=0.05)
    assert error.moved == pytest.approx([moved], rel=0.05)
    assert error.share > 0.95


def test_via_points_in_a_bore_stay():
    """They cannot move there, and a twin without them has no derivatives by anything."""
    assert build_twin(with_named_points(drilled_robot()))
    assert all(via.name for cable in with_named_points(neck()).cables for via in cable.via_points)


def test_another_engine_has_no_suspects():
    robot = neck()
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6)]
    problem = make_problem(robot, [pull(neck(lever=0.052))], free, LikelihoodLoss())
    best = problem.evaluate({E: 2.3e6}, jacobian=True)
    assert suspects(problem, best, ())
    assert not suspects(replace(problem, simulate=simulate), best, ())


def test_studies_of_a_run_include_the_errors_of_its_fit():
    """The covariance of a problem with them is that of the fit, whatever is suspected."""
    robot, free = neck(), [FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6)]
    for stated in ([], [UncertainParameter("plate.mass", "kg", 0.001)]):
        problem = make_problem(robot, [pull(neck(mass=0.2))], free, LikelihoodLoss(), uncertain=stated)
        result = calibrate(problem, starts=1)
        assert "plate.mass" in result.robot_errors
        theta = {name: one.value for name, one in result.parameters.items()}
        studied = with_uncertain_errors(problem, result.robot_errors)
        best = studied.evaluate(theta, jacobian=True)
        again = local_statistics(studied.space, studied.loss, theta, best.blocks, studied.uncertain)
        low, high = result.parameters[E].interval or (0.0, 0.0)
        assert again.intervals[E] == pytest.approx((low, high), rel=1e-4)
        without = local_statistics(problem.space, problem.loss, theta, problem.evaluate(theta, jacobian=True).blocks)
        assert (without.intervals[E] or (0.0, 0.0))[1] < high
