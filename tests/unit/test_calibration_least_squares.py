"""The search by exact sensitivities: from every corner, in few trajectories, to the minimiser of the loss itself."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import fake_twin
import numpy as np
import pytest
from fake_twin import NU, STEADY, TRUE, E, fake_experiment, fake_robot, fake_simulate, soft_necks_fail
from scipy.optimize import minimize

from softcal.calibration.problem.experiment import PULLEY_FRICTION, Rig
from softcal.calibration.problem.loss import Block, Loss, total
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem, make_problem
from softcal.calibration.problem.rig import Pulleys
from softcal.calibration.search.descent import Descent, trusted_model
from softcal.calibration.search.optimisers import least_squares
from softcal.calibration.search.optimisers.least_squares import LeastSquaresOptimiser
from softcal.calibration.statistics.convergence import in_standard_errors
from softcal.calibration.statistics.local_model import LocalModel, Point
from softcal.calibration.statistics.sensitivity import local_statistics, overstated
from softcal.experiments.dataset import Channel

BOUNDS = {E: (0.1e6, 40e6), NU: (0.4, 0.4999)}
CORNERS = list(itertools.product(*BOUNDS.values()))
LIKELIHOOD = LikelihoodLoss({"tension": 0.1, "pitch": 0.01, "shortening": 1e-3})


def problem_of(
    loss: Loss,
    *,
    drive: str = "shortening",
    noise: float = 0.0,
    scale: str = "log",
    start: tuple[float, float] | None = None,
    true: dict[str, float] | None = None,
) -> Problem:
    e, nu = start or (None, None)
    parameters = [FreeParameter(E, "Pa", *BOUNDS[E], scale, e), FreeParameter(NU, "1", *BOUNDS[NU], start=nu)]  # type: ignore[arg-type]
    experiment = fake_experiment(drive=drive, noise=noise, true=true)
    return make_problem(fake_robot(), [experiment], parameters, loss, fake_simulate)


def search(problem: Problem, *, trials: int = 40, seed: int = 0, starts: int = 1) -> tuple[Evaluation, int, str]:
    """The best evaluation, the number of them, and the search's last word."""
    optimiser = LeastSquaresOptimiser(problem.space, problem.loss, trials=trials, seed=seed, starts=starts)
    seen = []
    while proposals := optimiser.ask():
        for proposal in proposals:
            seen.append(problem.evaluate(proposal.theta, jacobian=True))
            optimiser.tell(proposal, seen[-1])
    return min(seen, key=lambda e: np.inf if e.loss is None else e.loss), len(seen), optimiser.status


def descend(problem: Problem, start: tuple[float, float], budget: int = 40) -> Descent:
    z = problem.space.to_search(dict(zip((E, NU), start, strict=True)))
    descent = Descent(problem.space, problem.loss, z, budget)
    while descent.next is not None:
        descent.tell(problem.evaluate(problem.space.to_model(descent.next), jacobian=True))
    return descent


def test_a_rough_curve_far_from_the_data_does_not_hold_the_search_there() -> None:
    """Rescaled, the curve far away seems to fit better than any other: it is rough there."""
    problem = problem_of(PapersLoss(), noise=0.05)
    near = descend(problem, (TRUE[E], TRUE[NU]))
    assert near.best is not None
    assert near.best.loss is not None
    descent = Descent(problem.space, problem.loss, problem.space.to_search({E: 0.5 * TRUE[E], NU: 0.42}), 40)
    n_rough = 0
    while descent.next is not None:
        evaluation = problem.evaluate(problem.space.to_model(descent.next), jacobian=True)
        if evaluation.loss is not None and evaluation.loss > 3.0 * near.best.loss:
            n_rough += 1
            blocks = tuple(_proportional(block) if block.channel == "tension" else block for block in evaluation.blocks)
            evaluation = replace(evaluation, blocks=blocks, loss=total(problem.loss, blocks))
        descent.tell(evaluation)
    assert n_rough
    assert descent.converged
    assert descent.evaluations <= near.evaluations + 4
    assert descent.best is not None
    assert descent.best.theta == pytest.approx(near.best.theta, rel=1e-3)


def _proportional(block: Block) -> Block:
    """A block whose prediction is proportional to the measurement."""
    assert block.jacobian is not None
    part = float(np.mean((block.residual + block.measured) / block.measured))
    jacobian = block.jacobian.copy()
    jacobian[:, 0] *= part * block.measured / np.maximum(block.residual + block.measured, 1e-12)
    return replace(block, residual=(part - 1.0) * block.measured, jacobian=jacobian)


@pytest.mark.parametrize("loss", [PapersLoss(), LIKELIHOOD])
@pytest.mark.parametrize("drive", ["shortening", "tension"])
@pytest.mark.parametrize("scale", ["log", "linear"])
@pytest.mark.parametrize("corner", CORNERS)
def test_noise_free_data_give_the_truth_back_from_every_corner(
    loss: Loss, drive: str, scale: str, corner: tuple[float, float]
) -> None:
    descent = descend(problem_of(loss, drive=drive, scale=scale), corner)
    assert descent.best is not None
    assert descent.converged
    assert descent.best.theta == pytest.approx(TRUE, rel=1e-5)
    assert descent.evaluations <= 8


def _locking_curve(d: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A neck whose elements lock: its stiffness grows thirteenfold towards nu = 0.4999, as that of linear tets does."""
    f, f_nu = 1 + 0.05 * (0.5 - nu) ** -0.6, 0.03 * (0.5 - nu) ** -1.6
    line, cube = 1.6e-4 * d, 0.02 * (1 + 2 * nu) * d**3
    slope = 1.6e-4 * f + 0.06 * (1 + 2 * nu) * f**1.2 * d**2
    return line * f + cube * f**1.2, slope, line * f_nu + 0.04 * d**3 * f**1.2 + cube * 1.2 * f**0.2 * f_nu


def _thin_layer_curve(d: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A neck of few linear tets: ten times as stiff at nu = 0.4999 as at 0.49, hardly any stiffer there than at 0.4."""
    f, f_nu = 1 + 2e-3 / (0.5 - nu), 2e-3 / (0.5 - nu) ** 2
    line, cube = 1.6e-4 * d, 0.02 * (1 + 2 * nu) * d**3
    slope = 1.6e-4 * f + 0.06 * (1 + 2 * nu) * f**0.5 * d**2
    return line * f + cube * f**0.5, slope, line * f_nu + 0.04 * d**3 * f**0.5 + cube * 0.5 * f**-0.5 * f_nu


@pytest.mark.parametrize("curve", [_locking_curve, _thin_layer_curve])
@pytest.mark.parametrize("corner", CORNERS)
def test_a_locking_neck_is_found_from_every_corner(
    corner: tuple[float, float], curve: Callable[..., object], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(fake_twin, "_curve", curve)
    for starts in (1, 3):
        best, n, status = search(problem_of(PapersLoss(), start=corner), starts=starts)
        assert best.theta == pytest.approx(TRUE, rel=1e-5)
        assert n <= 6
        assert "Converged" in status


def test_a_start_in_a_layer_is_gone_on_from_where_the_minimum_lies_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fake_twin, "_curve", _thin_layer_curve)
    true = {E: 2.3e6, NU: 0.4996}
    for corner in ((0.1e6, 0.4999), (40e6, 0.4999)):
        best, n, status = search(problem_of(PapersLoss(), start=corner, true=true, noise=1e-4))
        assert best.theta == pytest.approx(true, rel=0.01)
        assert n <= 14
        assert "Converged" in status


def test_the_budget_covers_the_way_round_a_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fake_twin, "_curve", _thin_layer_curve)
    problem = problem_of(PapersLoss(), start=(0.1e6, 0.4999), true={E: 2.3e6, NU: 0.4996}, noise=1e-4)
    for budget in (1, 2, 5):
        assert search(problem, trials=budget)[1] == budget


@pytest.mark.parametrize("start", [(1e6, 0.41), (1e6, 0.49)])
def test_a_loss_with_a_kink_at_its_minimum_ends_the_search_there_and_says_so(
    start: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, smooth = problem_of(LIKELIHOOD, noise=0.02), fake_twin._curve
    assert "promises" not in descend(problem, start).status

    def kinked(d: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        line, slope, by_nu = smooth(d, nu)
        bent = 1e-2 * d * np.linspace(-1.0, 1.0, len(d))  # never zero, and no modulus makes up for it
        return line + bent * (abs(nu - 0.45) + 0.02), slope, by_nu + bent * np.sign(nu - 0.45)

    monkeypatch.setattr(fake_twin, "_curve", kinked)
    descent = descend(problem, start)
    assert descent.converged
    short = "a step of less than 0.1 standard errors no longer lowers the loss as its slope promises."
    assert descent.status == f"Converged in {descent.evaluations} trials: {short}"
    assert descent.evaluations <= 25
    z = descent.z
    assert problem.space.to_model(z)[NU] == pytest.approx(0.45, abs=1e-3)
    for nu in (0.449, 0.451):
        there = problem.evaluate({**problem.space.to_model(z), NU: nu}).loss
        assert descent.best is not None
        assert there is not None
        assert descent.best.loss is not None
        assert there > descent.best.loss


@pytest.mark.parametrize("loss", [PapersLoss(), LIKELIHOOD])
@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_with_noise_it_ends_where_no_general_minimiser_gets_lower(loss: Loss, drive: str) -> None:
    problem = problem_of(loss, drive=drive, noise=0.02)
    descent = descend(problem, (0.1e6, 0.4))
    assert descent.best is not None
    assert descent.best.loss is not None

    def value(z: np.ndarray) -> float:
        loss = problem.evaluate(problem.space.to_model(np.clip(z, 0, 1))).loss
        assert loss is not None
        return loss

    polished = minimize(value, descent.z, method="Nelder-Mead", bounds=[(0, 1)] * 2, options={"xatol": 1e-9})
    assert polished.fun >= descent.best.loss * (1 - 2e-5)


def test_the_papers_minimiser_is_not_that_of_a_sum_of_squares() -> None:
    papers = descend(problem_of(PapersLoss(), noise=0.02, drive="tension"), (1e6, 0.45))
    squares = descend(problem_of(LIKELIHOOD, noise=0.02, drive="tension"), (1e6, 0.45))
    assert papers.best is not None
    assert squares.best is not None
    assert papers.best.theta[E] != pytest.approx(squares.best.theta[E], rel=1e-3)


def test_steps_that_cannot_be_simulated_are_shortened() -> None:
    problem = problem_of(PapersLoss(), drive="tension")
    descent = Descent(problem.space, problem.loss, np.array([0.9, 0.1]), 40)
    failing = replace(problem.evaluate({E: 1e6, NU: 0.45}), loss=None, failure="No equilibrium.", blocks=())
    lengths = []
    while descent.next is not None:
        lengths.append(float(np.abs(descent.next - descent.z).max()))
        evaluation = problem.evaluate(problem.space.to_model(descent.next), jacobian=True)
        descent.tell(failing if descent.evaluations in (1, 2) else evaluation)
    assert lengths[2] <= 0.26 * lengths[1]
    assert lengths[3] <= 0.26 * lengths[2]
    assert descent.best is not None
    assert descent.best.theta == pytest.approx(TRUE, rel=1e-5)


def test_a_minimum_that_cannot_be_simulated_is_sought_up_to_the_edge_and_said_to_lie_beyond() -> None:
    parameters = [FreeParameter(E, "Pa", *BOUNDS[E], "log"), FreeParameter(NU, "1", *BOUNDS[NU])]
    experiment = fake_experiment(true={E: 0.9e6, NU: 0.45})
    problem = make_problem(fake_robot(), [experiment], parameters, None, soft_necks_fail)
    descent = descend(problem, (2e6, 0.45))
    assert not descent.converged
    assert "Not converged" in descent.status
    assert "decreases towards values at which the twin cannot be simulated" in descent.status
    assert "No equilibrium beyond 12.0 mm." in descent.status
    assert descent.best is not None
    assert descent.best.theta[E] == pytest.approx(1.0e6, rel=0.01)
    assert descent.evaluations <= 30


def test_a_start_that_cannot_be_simulated_is_left_towards_the_middle() -> None:
    parameters = [FreeParameter(E, "Pa", *BOUNDS[E], "log"), FreeParameter(NU, "1", *BOUNDS[NU])]
    problem = make_problem(fake_robot(), [fake_experiment()], parameters, None, soft_necks_fail)
    descent = descend(problem, (0.1e6, 0.4999))
    assert descent.best is not None
    assert descent.best.theta == pytest.approx(TRUE, rel=1e-5)


def test_the_budget_is_kept_and_said_to_be_spent() -> None:
    descent = descend(problem_of(PapersLoss(), drive="tension"), (0.1e6, 0.4), budget=2)
    assert descent.evaluations == 2
    assert not descent.converged
    assert "Not converged after 2 trials, the largest number allowed" in descent.status


@pytest.mark.slow
def test_other_starts_that_see_no_better_minimum_cost_one_trajectory_each() -> None:
    for seed in range(5):
        problem = problem_of(PapersLoss(), noise=0.02)
        n_first = search(problem, seed=seed)[1]
        _, n, status = search(problem, seed=seed, starts=4)
        assert n == n_first + 3
        assert f" {n} trials in all. 3 of 4 starts were abandoned" in status


@pytest.mark.parametrize(("n", "has_errors"), [(2, False), (41, True)])
def test_standard_errors_are_named_only_where_they_exist(n: int, has_errors: bool) -> None:
    experiment = fake_experiment(n_samples=n + 1, noise=0.02)
    taut = {name: replace(channel, values=channel.values[1:]) for name, channel in experiment.dataset.channels.items()}
    experiment = replace(experiment, dataset=replace(experiment.dataset, channels=taut), compared=("tension",))
    parameters = [FreeParameter(name, unit, *BOUNDS[name]) for name, unit in ((E, "Pa"), (NU, "1"))]
    problem = make_problem(fake_robot(), [experiment], parameters, PapersLoss({"tension": 1.0}), fake_simulate)
    status = search(problem)[2]
    assert status.startswith("Converged in")
    assert ("standard errors away from the minimum" in status) == has_errors


def test_where_the_first_start_meets_the_measurements_exactly_no_other_is_begun() -> None:
    problem = problem_of(PapersLoss())
    assert search(problem, starts=4)[1] == search(problem, starts=1)[1]


def test_a_parameter_starts_at_the_same_values_in_separate_and_joint_fits() -> None:
    """So that the load paths there are solved once."""
    joint = in_a_thin_valley(0).space
    alone = SearchSpace(tuple(reversed(joint.parameters[:3])))
    for seed in range(3):
        own, of_joint = (
            [space.to_model(z) for z in least_squares._starts(space, 5, seed)[1:]] for space in (alone, joint)
        )
        assert len({theta[NU] for theta in own}) == 4
        for theta, other in zip(own, of_joint, strict=True):
            assert all(other[label] == value for label, value in theta.items())


def test_long_steps_end_at_round_values_of_the_parameters_of_load_paths() -> None:
    """Of the shortest descents from two starts: with other numbers of the same modulus, the same load path."""
    problem = problem_of(PapersLoss(), noise=0.02)
    assert problem.path_parameters == (NU,)

    def first_step(e: float, of_paths: tuple[int, ...]) -> np.ndarray:
        z = problem.space.to_search({E: e, NU: 0.41})
        descent = Descent(problem.space, problem.loss, z, 40, of_paths)
        descent.tell(problem.evaluate(problem.space.to_model(z), jacobian=True))
        assert descent.next is not None
        return descent.next

    places = [first_step(e, (1,)) for e in (0.5e6, 10e6)]
    assert places[0][1] == places[1][1]
    assert 64 * places[0][1] == int(64 * places[0][1])
    exact = [first_step(e, ()) for e in (0.5e6, 10e6)]
    assert exact[0][1] != exact[1][1]
    for rounded, other in zip(places, exact, strict=True):
        assert rounded[1] == pytest.approx(other[1], abs=0.15)


def _wavy_curve(d: np.ndarray, nu: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Three minima between nu 0.4 and 0.4999; only the pitch tells which one is true."""
    turn, rate = 24 * np.pi * (nu - 0.4), 24 * np.pi
    stiffening, line, cube = 1 + 0.6 * np.sin(turn), 1.6e-4 * d, 0.08 * d**3
    return line + cube * stiffening, 1.6e-4 + 0.24 * stiffening * d**2, 0.6 * rate * np.cos(turn) * cube


def test_other_starts_find_the_minimum_that_the_first_has_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fake_twin, "_curve", _wavy_curve)
    problem = problem_of(PapersLoss(), start=(2e6, 0.47))
    assert search(problem)[0].theta[NU] == pytest.approx(0.495, abs=1e-3)
    best, n, status = search(problem, starts=3)
    assert best.theta == pytest.approx(TRUE, rel=1e-3)
    assert n <= 12
    assert "Converged" in status


def in_a_thin_valley(seed: int) -> Problem:
    """Friction and modulus scale the same force: only the prior separates them. The misfit is ten times the noise."""
    experiment = fake_experiment(slack=1e-3, rig=Rig(pulleys=Pulleys(wrap=np.pi, friction_coefficient=0.1)))
    chance, turn = np.random.default_rng(seed), np.linspace(0, 2 * np.pi, 41)
    held = dict(experiment.dataset.channels)
    for name, share in (("tension", 0.03), ("pitch", 0.01)):
        values = held[name].values
        size = np.sqrt(np.mean(values**2))
        wave = np.cos(turn) * chance.standard_normal() + np.sin(turn) * chance.standard_normal()
        noise = float(0.1 * share * size)
        held[name] = Channel(values + share * size * wave, held[name].unit, noise)
    parameters = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", TRUE[E]),
        FreeParameter(NU, "1", 0.3, 0.4999, start=TRUE[NU]),
        FreeParameter("front.slack", "m", 0.0, 6e-3, start=1e-3),
        FreeParameter(PULLEY_FRICTION, "1", 0.0, 0.3, start=0.1, prior_mean=chance.normal(0.1, 0.02), prior_sd=0.02),
    ]
    experiment = replace(experiment, dataset=replace(experiment.dataset, channels=held))
    return make_problem(fake_robot(), [experiment], parameters, LikelihoodLoss(), fake_simulate)


@pytest.mark.parametrize("seed", range(6))
def test_a_thin_valley_under_a_prior_is_walked_in_few_steps_whatever_the_misfit(seed: int) -> None:
    problem = in_a_thin_valley(seed)
    best, n, status = search(problem)
    assert "Converged" in status
    assert n <= 12
    prior = next(p for p in problem.space.parameters if p.prior_sd)
    # The data cannot tell the friction from the modulus, so it is the prior's.
    assert best.theta[PULLEY_FRICTION] == pytest.approx(prior.prior_mean, abs=0.11 * prior.prior_sd)


def test_the_model_that_predicted_the_other_points_is_trusted() -> None:
    problem = in_a_thin_valley(0)
    z = problem.space.to_search(problem.space.start)
    along_factors = np.array([-0.55 / np.log(400), 0.0, 0.0, 0.3])  # E down as exp(2 pi friction) goes up

    def simulated(step: np.ndarray) -> Point:
        return Point(z + step, problem.evaluate(problem.space.to_model(z + step), jacobian=True).blocks)

    def model(others: list[Point]) -> LocalModel:
        return trusted_model(problem.space, problem.loss, simulated(np.zeros(4)), others)

    assert model([simulated(along_factors)])._plain
    for others in ([], [simulated(np.array([0.1, 0.0, 0.0, 0.0]))]):
        assert not model(others)._plain
    plain = LocalModel(problem.space, problem.loss, simulated(np.zeros(4)), plain=True)
    assert plain.missed(simulated(np.array([-0.45, 0.0, 0.0, 0.0]))) == 1.0  # it is no better than no model there
    assert plain.missed(simulated(1e-4 * along_factors)) < 1e-3


def test_a_prior_counts_by_its_standard_deviation_wherever_its_mean_is() -> None:
    space = SearchSpace((FreeParameter("a", "m", 0.0, 1.0), FreeParameter("b", "m", 0.0, 1.0)))
    data = Block("pull", "tension", np.ones(50), 1e-3 * np.ones(50), 1e-3, np.outer(np.ones(50), [1.0, 0.0]))
    for off in (0.0, 1e-9, 0.2):
        prior = Block("", "b", np.zeros(1), np.array([off]), 0.05, np.array([[0.0, 1.0]]))
        here = Point(np.array([0.5, 0.5]), (data, prior))
        assert in_standard_errors(space, LikelihoodLoss(), here, np.array([0.0, 0.01])) == pytest.approx(0.2)


@pytest.mark.parametrize("reciprocal", [False, True])
@pytest.mark.parametrize("drive", ["shortening", "tension"])
def test_the_local_model_has_the_value_and_the_slope_of_the_twin(reciprocal: bool, drive: str) -> None:
    problem = problem_of(PapersLoss(), noise=0.02, drive=drive)
    z = np.array([0.5, 0.3])
    evaluation = problem.evaluate(problem.space.to_model(z), jacobian=True)
    for plain in (False, True):
        model = LocalModel(problem.space, problem.loss, Point(z, evaluation.blocks), plain=plain, reciprocal=reciprocal)
        assert model.reproduces()
        assert model.loss(z) == pytest.approx(evaluation.loss, rel=1e-12)
        slopes = [
            (model.loss(z + s) - model.loss(z - s)) / (2 * s.max()) for s in (1e-6 * np.eye(2)[j] for j in (0, 1))
        ]
        assert evaluation.gradient is not None
        assert slopes == pytest.approx(list(evaluation.gradient * problem.space.jacobian(z)), rel=1e-5)
    other = np.array([0.499, 0.5])
    there = problem.evaluate(problem.space.to_model(other), jacobian=True)
    bent = LocalModel(problem.space, problem.loss, Point(z, evaluation.blocks), reciprocal=reciprocal)
    assert bent.loss(other) != pytest.approx(there.loss, rel=1e-6)
    bent.bend(Point(other, there.blocks))
    assert bent.reproduces()
    assert bent.loss(other) == pytest.approx(there.loss, rel=1e-9)


def test_a_model_that_does_not_reproduce_the_twin_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    exact = LocalModel._coordinates

    def wrong(self: LocalModel, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        w, slopes = exact(self, x)
        # Another slope when it is asked for the second time, as if digits had cancelled.
        again = getattr(self, "asked", False)
        self.asked = True  # type: ignore[attr-defined]
        return w, slopes * (1.01 if again and not self._plain else 1.0)

    monkeypatch.setattr(LocalModel, "_coordinates", wrong)
    descent = descend(problem_of(PapersLoss()), (1e6, 0.45))
    assert not LocalModel(descent.space, descent.loss, descent._here()).reproduces()
    assert descent._model(descent.loss)._plain
    assert descent.converged
    assert descent.best is not None
    assert descent.best.theta == pytest.approx(TRUE, rel=1e-5)


@pytest.mark.slow
def test_standard_errors_are_those_of_repeated_noise() -> None:
    sigma = 0.02
    found, stated = [], []
    for seed in range(40):
        experiment = fake_experiment(noise=sigma, seed=seed, settings=STEADY)
        tops = {c: float(fake_experiment().dataset.values(c).max()) for c in ("tension", "pitch")}
        loss = LikelihoodLoss({channel: sigma * top for channel, top in tops.items()})
        problem = make_problem(
            fake_robot(), [experiment], [FreeParameter(E, "Pa", *BOUNDS[E], "log")], loss, fake_simulate
        )
        optimiser = LeastSquaresOptimiser(problem.space, loss, trials=20, seed=0)
        best = None
        while proposals := optimiser.ask():
            best = problem.evaluate(proposals[0].theta, jacobian=True)
            optimiser.tell(proposals[0], best)
        assert best is not None
        found.append(best.theta[E])
        stated.append(local_statistics(problem.space, loss, best.theta, best.blocks).standard_errors[E])
    assert np.std(found) == pytest.approx(np.mean(stated), rel=0.3)


def test_what_the_data_cannot_tell_apart_is_named() -> None:
    from softcal.calibration.problem.rig import Pulleys, Rig

    experiment = fake_experiment(rig=Rig(pulleys=Pulleys(wrap=np.pi, friction_coefficient=0.1)))
    parameters = [
        FreeParameter(E, "Pa", *BOUNDS[E], "log"),
        FreeParameter("pulleys.friction_coefficient", "1", 0.0, 0.3),
    ]
    problem = make_problem(fake_robot(), [experiment], parameters, None, fake_simulate)
    evaluation = problem.evaluate({E: 2e6, "pulleys.friction_coefficient": 0.12}, jacobian=True)
    statistics = local_statistics(problem.space, problem.loss, evaluation.theta, evaluation.blocks)
    assert statistics.standard_errors == {E: None, "pulleys.friction_coefficient": None}
    assert f"cannot separate {E} and pulleys.friction_coefficient" in statistics.notes[0].text
    assert sum(statistics.importance.values()) == pytest.approx(1.0)


def test_several_that_cannot_be_told_apart_are_listed() -> None:
    parameters = [FreeParameter(name, "m", 0.0, 1.0) for name in ("a", "b", "c")]
    block = Block("pull", "tension", np.ones(9), np.linspace(-1, 1, 9), 0.1, np.ones((9, 3)))
    space = SearchSpace(tuple(parameters))
    told = local_statistics(space, LikelihoodLoss(), dict.fromkeys("abc", 0.5), [block])
    assert "cannot separate a, b and c" in told.notes[0].text


def test_the_status_counts_every_trajectory_and_names_the_start_that_was_not_asked_for() -> None:
    sentence = f"of an additional first start with {NU} in the middle of the range, where elements do not lock."
    _, n, status = search(problem_of(PapersLoss(), start=(1e6, 0.4999)))
    assert status.endswith(f" {n} trials in all, including those {sentence}")
    _, n, status = search(problem_of(PapersLoss(), start=(1e6, 0.45)))
    assert status.startswith(f"Converged in {n} trials, ")
    assert "in all" not in status
    _, n, status = search(problem_of(PapersLoss(), start=tuple(TRUE.values())))
    assert n == 1
    assert status.startswith("Converged in 1 trial, ")


@pytest.mark.parametrize(("stated", "correlation", "least", "most"), [(1, 0, 0, 1), (1, 0.5, 0, 1), (10, 0, 200, 200)])
def test_noise_stated_far_too_large_is_told(stated: float, correlation: float, least: int, most: int) -> None:
    """In 200 calibrations, by two channels of which the first alone may have a wrong statement."""
    count, n = 0, 40
    jacobian = np.column_stack([np.ones(n), np.linspace(-1, 1, n)])
    space = SearchSpace(tuple(FreeParameter(name, "m", 0.0, 1.0) for name in "ab"))
    for seed in range(200):
        noise = np.random.default_rng(seed).standard_normal((n, 2))
        for i in range(1, n):
            noise[i] = correlation * noise[i - 1] + np.sqrt(1.0 - correlation**2) * noise[i]
        left = noise - jacobian @ np.linalg.lstsq(jacobian, noise, rcond=None)[0]
        blocks = [Block("pull", "tension", np.ones(n), 0.1 * left[:, 0], 0.1 * stated, jacobian)]
        blocks += [Block("pull", "pitch", np.ones(n), 0.1 * left[:, 1], 0.1, jacobian)]
        notes = overstated(LikelihoodLoss(), blocks, space.size)
        count += bool(notes)
        assert all("The residuals of tension show a noise of" in one.text for one in notes[:stated])
        assert len(notes) < 2
    assert least <= count <= most
    if stated > 1:
        told = [one.text for one in local_statistics(space, LikelihoodLoss(), {"a": 0.5, "b": 0.5}, blocks).notes]
        assert sum("far below the stated 1 N: " in one and "The intervals use the stated" in one for one in told) == 1
    assert not overstated(PapersLoss(), blocks, space.size)


@pytest.mark.parametrize(("factor", "prior"), [(1.0, False), (5.0, False), (5.0, True), (2e4, False)])
def test_what_larger_residuals_widen_is_told(factor: float, prior: bool) -> None:
    noise = 0.1 * factor * np.random.default_rng(0).standard_normal(50)
    jacobian = np.column_stack([np.ones(50), np.linspace(-1, 1, 50)])
    blocks = [Block("pull", "tension", np.ones(50), noise, 0.1, jacobian)]
    blocks += [Block("", "a", np.zeros(1), np.zeros(1), 0.05, np.array([[1.0, 0.0]]))] * prior
    space = SearchSpace(tuple(FreeParameter(name, "m", 0.0, 1.0) for name in "ab"))
    told = " ".join(map(str, local_statistics(space, LikelihoodLoss(), {"a": 0.5, "b": 0.5}, blocks).notes))
    assert ("standard errors are increased accordingly" in told) == (factor > 1)
    assert "e+" not in told
    assert ("accordingly, except for the share of the priors." in told) == ("prior" in told) == prior
    assert ("that noise is stated too small, or a prior is wrong." in told) == prior
    blind = [replace(block, jacobian=np.zeros_like(jacobian)) for block in blocks[:1]]
    told = " ".join(map(str, local_statistics(space, LikelihoodLoss(), {"a": 0.5, "b": 0.5}, blind).notes))
    assert ("times the noise of the records" in told) == (factor > 1)
    assert "increased" not in told  # there are none
