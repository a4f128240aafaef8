"""What the mesh study says of a calibration on a coarse mesh is what a calibration on the finer one finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softcal.analysis.mesh_study import MeshStudy, mesh_study
from softcal.analysis.mesh_verdict import mesh_verdicts
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.experiments.dataset import Channel, Dataset
from softcal.geometry.neck import Neck
from softcal.geometry.quadratic import to_linear
from softcal.twin.finer import elevated, halved
from softcal.twin.protocol import Command, Protocol
from softcal.twin.robot import Body, Cable, Plate, Robot, ViaPoint
from softcal.twin.simulate import simulate

E, NU, SLACK = "neck.youngs_modulus", "neck.poissons_ratio", "front.slack[pull]"
TRUE = {E: 2.3e6, NU: 0.43, SLACK: 0.002}
SIGMAS = {"tension": 0.02, "pitch": 1e-3}


def neck() -> Robot:
    """Two thousand linear tets with straight edges, so that all finer meshes fill the same."""
    pytest.importorskip("gmsh")
    mesh = to_linear(Neck(dome="ellipse", tets=1700).mesh())
    parameters = {"youngs_modulus": TRUE[E], "poissons_ratio": TRUE[NU]}
    body = Body("neck", mesh, mesh.node_sets["socket"], parameters, element="P1")
    plate = Plate("plate", {"neck": mesh.node_sets["collar"]}, np.array([0.0, 0.0, 0.106704]))
    via = (ViaPoint(np.array([0.05, 0.0, 0.106704]), "plate"), ViaPoint(np.array([0.05, 0.0, 0.01406])))
    return Robot((body,), (plate,), (Cable("front", via),))


def measured_on(truth: Robot, noise: float) -> Experiment:
    """Tension and pitch of a robot, seen through a slack, with noise [standard deviations]."""
    chance = np.random.default_rng(3)
    d = np.linspace(0.004, 0.034, 31)
    seen = simulate(truth, Protocol({"front": Command("shortening", d - TRUE[SLACK])}), curve_tolerance=1e-6)
    channels = {"shortening": Channel(d, "m")}
    for name, unit in (("tension", "N"), ("pitch", "rad")):
        values = seen.channels[("front." if name == "tension" else "plate.") + name]
        noisy = values + noise * SIGMAS[name] * chance.standard_normal(len(d))
        channels[name] = Channel(noisy, unit, SIGMAS[name])
    return Experiment("pull", Dataset("pull", channels), "front", "plate", "shortening")


def coarse_problem(robot: Robot, experiment: Experiment, loss: Loss, free: tuple[str, ...]) -> Problem:
    every = {
        E: FreeParameter(E, "Pa", 0.1e6, 40e6, scale="log", start=3e6),
        NU: FreeParameter(NU, "1", 0.2, 0.4999, start=0.4),
        SLACK: FreeParameter("front.slack", "m", -0.003, 0.01, start=0.001, per_experiment=True),
    }
    return make_problem(robot, (experiment,), [every[name] for name in free], loss)


def studied(problem: Problem) -> tuple[CalibrationResult, MeshStudy]:
    result = calibrate(problem, method="least-squares", starts=1)
    theta = {name: e.value for name, e in result.parameters.items()}
    return result, mesh_study(problem, theta, halvings=1, max_unknowns=12_000)


def values_on(study: MeshStudy, name: str) -> dict[str, float]:
    return dict(next(one for one in study.finer if one.name == name).values)


@pytest.mark.slow
def test_the_bias_of_linear_tets_is_foretold():
    problem = coarse_problem(neck(), measured_on(halved(neck()), 0.0), PapersLoss(), (E, SLACK))
    result, study = studied(problem)
    actual = {name: TRUE[name] - e.value for name, e in result.parameters.items()}
    foretold = {name: values_on(study, "h/2")[name] - e.value for name, e in result.parameters.items()}
    assert actual[E] > 0.3 * TRUE[E]  # the coarse mesh is much too stiff
    assert foretold[E] == pytest.approx(actual[E], rel=0.02)
    assert foretold[SLACK] == pytest.approx(actual[SLACK], rel=0.25)


@pytest.mark.long
def test_two_parameters_that_trade_off_are_foretold_as_a_refit_with_noise_finds_them():
    fine = halved(neck())
    problem = coarse_problem(neck(), measured_on(fine, 1.0), LikelihoodLoss(), (E, NU, SLACK))
    result, study = studied(problem)
    refit = calibrate(replace(problem, robot=fine), method="least-squares", starts=1)
    for name, e in result.parameters.items():
        actual, foretold = refit.parameters[name].value - e.value, values_on(study, "h/2")[name] - e.value
        assert foretold == pytest.approx(actual, rel=0.25), name
    on_finer = next(one for one in study.finer if one.name == "h/2")
    assert on_finer.reachable == pytest.approx(refit.loss, rel=0.02)
    assert on_finer.loss is not None
    assert on_finer.loss > 20 * refit.loss


@pytest.mark.slow
def test_higher_elements_on_the_same_tets_are_foretold_too():
    experiment = measured_on(elevated(neck(), "P2P1"), 1.0)
    problem = coarse_problem(neck(), experiment, LikelihoodLoss(), (E, SLACK))
    result, study = studied(problem)
    assert study.reference == "P2P1"
    actual = TRUE[E] - result.parameters[E].value
    assert values_on(study, "P2P1")[E] - result.parameters[E].value == pytest.approx(actual, rel=0.02)
    verdict, advice = mesh_verdicts(study)
    share = 100 * actual / TRUE[E]
    assert f"The mesh makes {E} too low by {share:.2g} %" in verdict.text
    assert verdict.tone == "warning"
    assert "use P2P1 elements or a finer mesh" in advice.text
