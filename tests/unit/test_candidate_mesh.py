"""What is expected of candidates where the mesh errs, or where parameters are uncertain in each test by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_twin import NU, TRUE, fake_experiment, fake_robot, fake_simulate
from fake_twin import E as FAKE_E
from project_case import bar_robot

from softcal.analysis.candidate import Candidate
from softcal.analysis.candidate_bench import joined, planned
from softcal.analysis.candidate_mesh import mesh_change, step_of_parameters
from softcal.analysis.next_test import next_tests
from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Evaluation, Problem, make_problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.statistics.mesh_error import on_finer_mesh
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.protocol import Command, Protocol
from softcal.twin.simulate import simulate

E = "bar.youngs_modulus"
THETA = {E: 1.3e6, "front.slack[pull]": 1e-3}
SHORT = ("again", "short")
CANDIDATES = (
    Candidate(name="again", like="pull"),
    Candidate(name="short", like="pull", reach=0.006),
    Candidate(name="by tension", like="pull", control="tension", measured=("shortening",)),
    Candidate(name="softer", like="pull", settings={"bar.poissons_ratio": 0.3}),
)


@pytest.fixture(scope="module")
def problem() -> Problem:
    robot = bar_robot(THETA[E])
    d = np.linspace(0.0015, 0.012, 12)
    seen = simulate(robot, Protocol({"front": Command("shortening", d - 0.001)}))
    channels = {
        "shortening": Channel(d, "m"),
        "tension": Channel(seen.channels["front.tension"], "N", 0.01),
        "pitch": Channel(seen.channels["plate.pitch"], "rad", 1e-3),
    }
    pull = Experiment("pull", Dataset("pull", channels), "front", "plate")
    free = (
        FreeParameter(E, "Pa", 0.1e6, 10e6, "log"),
        FreeParameter("front.slack", "m", -5e-3, 5e-3, per_experiment=True),
    )
    return make_problem(robot, [pull], free, LikelihoodLoss())


@pytest.fixture(scope="module")
def found(problem: Problem) -> tuple[Problem, dict[str, float], Evaluation]:
    whole, theta = joined(problem, THETA, [planned(problem, THETA, one) for one in CANDIDATES])
    return whole, theta, whole.evaluate(theta, jacobian=True)


def test_one_finer_trajectory_serves_every_pull_of_the_cable(
    found: tuple[Problem, dict[str, float], Evaluation],
) -> None:
    whole, theta, seen = found
    quick = mesh_change(whole, theta, seen, [one.name for one in CANDIDATES])
    finer = on_finer_mesh(whole, theta)
    assert not isinstance(finer, str)
    assert quick.n_solves == 1 < finer.n_solves == 3
    changes = {
        (own.experiment, own.channel): other.residual - own.residual
        for own, other in zip(seen.blocks, finer.blocks, strict=True)
        if own.experiment
    }
    assert set(quick.changes) == {key for key in changes if key[0] != "softer"}
    for key, change in quick.changes.items():
        assert np.abs(change - changes[key]).max() < 0.02 * np.abs(changes[key]).max(), key


def test_the_error_of_the_mesh_elsewhere_is_that_of_the_parameters(
    problem: Problem, found: tuple[Problem, dict[str, float], Evaluation]
) -> None:
    _, _, seen = found
    blocks = [replace(b, jacobian=b.jacobian[:, :2]) for b in seen.blocks if b.experiment == "pull"]
    slopes = problem.space.jacobian(problem.space.to_search(THETA))
    weights = [np.full(len(b.residual), 1.0 / b.sigma[0] ** 2) for b in blocks]
    softer = np.array([0.1 * THETA[E], 0.0])
    step = step_of_parameters(blocks, weights, [b.jacobian @ softer for b in blocks], slopes)
    np.testing.assert_allclose(step, softer, rtol=0.05, atol=1e-4)


def test_the_ranking_says_where_it_is(problem: Problem) -> None:
    ranked = next_tests(problem, THETA, CANDIDATES)
    assert ranked.n_solves == 4
    assert any("For softer the error of the mesh is estimated" in note for note in ranked.notes)
    alone = next_tests(problem, THETA, CANDIDATES, mesh_error=False)
    assert "The error of the mesh is not included, as in the calibration." in alone.notes
    assert np.ptp(alone.interval) < 0.5 * np.ptp(ranked.interval)


def test_a_stop_during_the_finer_simulation_is_a_stop(problem: Problem, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("softcal.calibration.statistics.mesh_error.elevated", stopped)
    with pytest.raises(KeyboardInterrupt):
        next_tests(problem, THETA, CANDIDATES[:1])


@pytest.mark.parametrize("per_experiment", [True, False])
def test_what_errs_in_each_test_by_itself_errs_anew_in_the_candidate(*, per_experiment: bool) -> None:
    """A gain of 3 % in each of two tests: E is known to 3 % over the root of their number; in common, to 3 %."""
    tests = [fake_experiment(f"pull{i}", reach=0.008, noise=1e-6, sigma=1e-6, seed=i) for i in range(2)]
    gain = UncertainParameter("front.tension_gain", "1", sd=0.03, per_experiment=per_experiment)
    free = [FreeParameter(FAKE_E, "Pa", 0.1e6, 40e6, "log")]
    robot = fake_robot(poissons_ratio=TRUE[NU])
    problem = make_problem(robot, tests, free, LikelihoodLoss(), fake_simulate, [gain])
    candidates = [Candidate(name="again", like="pull0"), Candidate(name="twice", like="pull0", repeats=2)]
    ranked = next_tests(problem, {FAKE_E: TRUE[FAKE_E]}, candidates)
    shares = {one.candidate.name: one.share for one in ranked.outlooks}
    expected = {"again": np.sqrt(2 / 3), "twice": np.sqrt(2 / 4)} if per_experiment else {"again": 1.0, "twice": 1.0}
    assert shares == pytest.approx(expected, rel=0.01)
