"""theta in, residuals out: trajectories shared, failures kept as values, faults told."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate, soft_necks_fail
from project_case import bar_robot, bench_values

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.fingerprint import fingerprint, fingerprints
from softcal.calibration.problem.loss import rms
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import Evaluation, Problem, make_problem
from softcal.calibration.problem.trajectory import Member, shared_out
from softcal.calibration.search.evaluator import Evaluator
from softcal.calibration.search.optimiser import Proposal
from softcal.errors import InputError, ParameterError, SimulationError
from softcal.executors.executor import Executor, ExecutorLost
from softcal.experiments.dataset import Channel, Dataset
from softcal.twin.protocol import Command, Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot

MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log")
RATIO = FreeParameter(NU, "1", 0.4, 0.4999)
SLACK = FreeParameter("front.slack", "m", -0.001, 0.01, per_experiment=True)
THETA = {E: 2.0e6, NU: 0.45, "front.slack[a]": 0.001, "front.slack[b]": 0.003, "front.slack[c]": 0.002}


def three(drive_of_c: str = "shortening") -> Problem:
    experiments = [
        fake_experiment("a"),
        fake_experiment("b", reach=0.02, n_samples=17),
        fake_experiment("c", reach=0.03, n_samples=9, drive=drive_of_c),
    ]
    return make_problem(fake_robot(), experiments, (MODULUS, RATIO, SLACK), None, fake_simulate)


def test_tests_of_one_cable_share_one_trajectory_in_spite_of_their_own_slacks() -> None:
    assert three().evaluate(THETA).n_solves == 1
    assert three("tension").evaluate(THETA).n_solves == 2


def test_a_shared_trajectory_gives_each_test_what_it_would_get_alone() -> None:
    problem = three()
    jointly = problem.evaluate(THETA, jacobian=True)
    for name in ("a", "b", "c"):
        alone = problem.alone(name)
        theta = {label: THETA[label] for label in alone.space.labels}
        one = alone.evaluate(theta, jacobian=True)
        assert one.loss == pytest.approx(jointly.experiment_losses[name], rel=1e-14)
        for mine, block in zip(one.blocks, [b for b in jointly.blocks if b.experiment == name], strict=True):
            np.testing.assert_array_equal(mine.residual, block.residual)
            assert block.jacobian is not None
            columns = [problem.space.labels.index(label) for label in alone.space.labels]
            np.testing.assert_array_equal(mine.jacobian, block.jacobian[:, columns])


@pytest.mark.parametrize(("slack", "tolerances"), [(0.0002, [1e-2, None]), (0.006, [1e-2, 0.02]), (-0.09, [1e-2])])
def test_the_further_from_the_measurements_the_less_closely_a_curve_is_interpolated(
    slack: float, tolerances: list[float | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a search: as closely as for any other use, within a fiftieth of the misfit, as in the first look."""
    asked = list[float | None]()

    def simulate(
        *args: Any, curve_tolerance: float | None = None, shared: bool, crossings: bool, **options: Any
    ) -> Response:
        assert (shared, crossings) == (True, False)
        asked.append(curve_tolerance)
        return fake_simulate(*args, **options)

    monkeypatch.setattr("softcal.twin.simulate.simulate", simulate)
    problem = make_problem(fake_robot(), [fake_experiment("a")], (MODULUS, RATIO, SLACK))
    found = problem.evaluate({E: TRUE[E], NU: TRUE[NU], "front.slack[a]": slack}, jacobian=True)
    misfit = min(rms(b.residual) / np.abs(b.residual + b.measured).max() for b in found.blocks)
    assert asked == [t if t != 0.02 else pytest.approx(0.02 * misfit) for t in tolerances], misfit


def test_a_prediction_of_zeros_is_far_from_the_measurements(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a cable that stays slack."""

    def slack(
        *args: Any, curve_tolerance: float | None = None, shared: bool, crossings: bool, **options: Any
    ) -> Response:
        response = fake_simulate(*args, **options)
        return replace(response, channels={name: 0.0 * values for name, values in response.channels.items()})

    monkeypatch.setattr("softcal.twin.simulate.simulate", slack)
    problem = make_problem(fake_robot(), [fake_experiment("a")], (MODULUS, RATIO, SLACK))
    found = problem.evaluate({E: TRUE[E], NU: TRUE[NU], "front.slack[a]": 0.0}, jacobian=True)
    assert all(np.all(block.residual == -block.measured) for block in found.blocks)
    assert np.isfinite(found.loss)


def test_long_tests_of_several_cables_are_trajectories_of_their_own_and_short_ones_share() -> None:
    def driven(name: str, n: int, cables: str) -> Member:
        experiment = fake_experiment(name, n_samples=n)
        return experiment, {cable: Command("shortening", np.zeros(n)) for cable in cables}

    def names(members: Sequence[Member]) -> list[list[str]]:
        return [[experiment.name for experiment, _ in part] for part in shared_out(members)]

    two = [driven(name, n, "fb") for name, n in (("a", 60), ("b", 60), ("c", 130), ("d", 5), ("e", 5))]
    assert names(two) == [["a", "b"], ["c"], ["d", "e"]]
    one = [driven(name, n, "f") for name, n in (("a", 160), ("b", 160))]
    assert names(one) == [["a", "b"]]


def test_workers_share_the_trajectories_of_one_evaluation(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = three("tension")
    here = problem.evaluate(THETA, jacobian=True)
    monkeypatch.setattr("softcal.calibration.search.evaluator._WORTH", 0.0)
    with Evaluator(problem, workers=2, jacobian=True) as evaluator:
        (_, shared), (_, again) = (one for _ in range(2) for one in evaluator.evaluate([Proposal(0, THETA)]))
    for one in (shared, again):
        assert one.n_solves == 2
        assert one.loss == here.loss
        assert list(one.observations) == list(here.observations)
        for mine, block in zip(one.blocks, here.blocks, strict=True):
            np.testing.assert_array_equal(mine.residual, block.residual)
            np.testing.assert_array_equal(mine.jacobian, block.jacobian)


def test_a_modulus_per_experiment_takes_a_trajectory_each() -> None:
    own = replace(MODULUS, per_experiment=True)
    problem = make_problem(
        fake_robot(), [fake_experiment("a"), fake_experiment("b")], (own,), PapersLoss(), fake_simulate
    )
    evaluation = problem.evaluate({f"{E}[a]": 1e6, f"{E}[b]": 2e6}, jacobian=True)
    assert evaluation.n_solves == 2
    assert evaluation.n_factorisations == 40
    jacobians = {b.experiment: b.jacobian for b in evaluation.blocks if b.channel == "tension"}
    assert np.all(jacobians["a"][:, 1] == 0)
    assert np.all(jacobians["b"][:, 0] == 0)
    assert jacobians["b"][-1, 1] > 0


def test_a_failed_solve_is_a_value_with_its_reason_and_no_loss() -> None:
    problem = make_problem(fake_robot(), [fake_experiment("pull")], (MODULUS,), None, soft_necks_fail)
    evaluation = problem.evaluate({E: 0.2e6})
    assert evaluation.loss is None
    assert evaluation.failure == "pull: No equilibrium beyond 12.0 mm."
    assert evaluation.n_solves == 1
    assert evaluation.n_factorisations == 7


def test_states_that_are_solved_are_compared_where_others_are_not() -> None:
    """No loss, as fewer states would compare too well; but the residuals of those there are, and whole experiments."""

    def short(
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ):
        response = fake_simulate(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)
        (command,) = protocol.commands.values()
        rows = np.flatnonzero((command.values < 0.016) | (command.values > 0.03) | (command.control == "tension"))
        if len(rows) == len(command.values):
            return response
        return replace(
            response,
            channels={name: values[rows] for name, values in response.channels.items()},
            sensitivities={
                c: {p: values[rows] for p, values in by.items()} for c, by in response.sensitivities.items()
            },
            slopes={name: values[rows] for name, values in response.slopes.items()},
            succeeded=False,
            status="Some samples were not reached.",
            samples=tuple(rows.tolist()),
        )

    theta = {label: value for label, value in THETA.items()}
    whole = three("tension").evaluate(theta, jacobian=True)
    partly = replace(three("tension"), simulate=short).evaluate(theta, jacobian=True)
    assert partly.loss is None
    assert partly.gradient is None
    assert partly.failure == "a, b: Some samples were not reached."
    assert partly.n_solves == 2  # the tension test after it too
    assert set(partly.errors) == set(partly.observations) == {"c"}
    assert partly.errors["c"] == pytest.approx(whole.errors["c"])
    for block, full in zip(partly.blocks, whole.blocks, strict=True):
        assert (len(block.residual) == len(full.residual)) == (block.experiment == "c")
        assert 3 < len(block.residual)
        found = np.isin(full.residual, block.residual)
        np.testing.assert_array_equal(full.residual[found], block.residual)
        np.testing.assert_array_equal(full.jacobian[found], block.jacobian)


def test_a_response_that_is_not_finite_or_an_error_of_the_twin_is_a_failure_too() -> None:
    def odd(
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        response = fake_simulate(robot, protocol, theta, sensitivities=sensitivities)
        channels = {**response.channels, "plate.pitch": np.full(41, np.nan)}
        return replace(response, channels=channels)

    def raising(
        robot: Robot,
        protocol: Protocol,
        theta: Mapping[str, float] | None = None,
        *,
        sensitivities: Sequence[str] = (),
        snapshots: bool = False,
    ) -> Response:
        raise SimulationError("The twin gave up.")

    for simulate, words in ((odd, "plate.pitch is not finite"), (raising, "The twin gave up.")):
        evaluation = make_problem(fake_robot(), [fake_experiment()], (MODULUS,), None, simulate).evaluate({E: 2e6})
        assert evaluation.loss is None
        assert words in evaluation.failure


def test_faults_of_a_problem_are_told_together() -> None:
    experiments = (replace(fake_experiment("a"), cable="fron"), fake_experiment("a"), fake_experiment("a/b"))
    with pytest.raises(InputError) as caught:
        Problem(fake_robot(), experiments, SearchSpace((FreeParameter(NU, "1", 0.4, 0.5),)), PapersLoss())
    text = str(caught.value)
    for words in ("no such cable; got 'fron'; allowed: front, back", "share a name", "cannot name a file", "0.4999"):
        assert words in text


def test_an_unknown_parameter_is_refused_with_the_nearest() -> None:
    with pytest.raises(ParameterError, match=r"Try: 'front\.slack'"):
        make_problem(fake_robot(), [fake_experiment()], (FreeParameter("front.slak", "m", 0.0, 0.01),))


def test_the_fingerprint_sees_every_number_and_no_order() -> None:
    one, other = three(), three()
    assert fingerprints(one) == fingerprints(other)
    changed = make_problem(fake_robot(1.1e6), one.experiments, (MODULUS,), None, fake_simulate)
    differing = {k for k, v in fingerprints(changed).items() if fingerprints(one)[k] != v}
    assert differing == {"robot", "free parameters"}
    assert fingerprint({"a": 1, "b": 2}) == fingerprint({"b": 2, "a": 1})
    assert fingerprint([1, 2]) != fingerprint([2, 1])
    assert fingerprint(["ab", "c"]) != fingerprint(["a", "bc"])
    with pytest.raises(TypeError):
        fingerprint(object())


def test_the_truth_has_no_residual() -> None:
    problem = make_problem(fake_robot(), [fake_experiment()], (MODULUS, RATIO), None, fake_simulate)
    assert problem.evaluate(TRUE).loss == 0.0


def bar_problem() -> Problem:
    """The twin of a bar of 100 mm, pulled by 20 mm, with a slack from -150 to 50 mm."""
    _, shortening, tension, pitch = (np.array(values) for values in bench_values())
    channels = {
        "shortening": Channel(1e-3 * shortening, "m"),
        "tension": Channel(tension, "N"),
        "pitch": Channel(np.deg2rad(pitch), "rad"),
    }
    slack = FreeParameter("front.slack", "m", -0.15, 0.05, per_experiment=True)
    pull = Experiment("pull", Dataset("pull", channels), "front", "plate")
    return make_problem(bar_robot(), [pull], (slack,), PapersLoss())


def test_a_slack_that_takes_up_the_whole_pull_is_a_trial_like_others() -> None:
    """All predictions are zero: no error is a share of them."""
    slack_only = bar_problem().evaluate({"front.slack[pull]": 0.04}, jacobian=True)
    assert slack_only.failure == ""
    assert slack_only.loss is not None
    assert all(np.all(block.residual == -block.measured) for block in slack_only.blocks)


def test_a_robot_that_its_own_weight_crushes_is_a_failed_trial_with_derivatives_too() -> None:
    """Its response has channels, and no derivatives of them."""
    problem = bar_problem()
    body = replace(problem.robot.bodies[0], density=2e4)
    heavy = replace(problem, robot=replace(problem.robot, bodies=(body,), gravity=np.array([0.0, 0.0, -1e3])))
    crushed = heavy.evaluate({"front.slack[pull]": 0.0}, jacobian=True)
    assert crushed.loss is None
    assert "Under the dead loads" in crushed.failure


def test_a_slack_by_which_a_cable_is_pulled_in_beyond_its_length_is_a_failed_trial() -> None:
    problem = bar_problem()
    beyond = problem.evaluate({"front.slack[pull]": -0.1}, jacobian=True)
    assert beyond.loss is None
    assert "pulled in by more than its length; got 120 mm" in beyond.failure
    fixed = replace(problem.experiments[0], rig=replace(problem.experiments[0].rig, slack=-0.1))
    stiff = FreeParameter("bar.youngs_modulus", "Pa", 0.1e6, 40e6, "log")
    with pytest.raises(ParameterError, match="more than its length"):  # at any value
        make_problem(problem.robot, [fixed], (stiff,)).evaluate({"bar.youngs_modulus": 1e6})


class Other(Executor):
    """Workers whose answers are changed on the way."""

    name, summary, count, workers, told = "other", "", 1, (), "Another cluster"

    def __init__(self, change: Callable[[Any], object]) -> None:
        self.change = change

    @classmethod
    def at(cls, address: str, workers: int | None) -> Executor:
        raise NotImplementedError

    def sent(self, what: object) -> object:
        return what

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        shared, function, *rest = args
        outcome: Future[Any] = Future()
        outcome.set_result(self.change(function(shared, *rest)))
        return outcome


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda one: None, "it is a NoneType"),
        (lambda one: {"loss": one.loss}, "it is a dict"),
        (lambda one: replace(one, theta={**one.theta, E: 2e6}), "it is that of other parameters"),
        (lambda one: replace(one, theta={}), "it is that of other parameters"),
        (lambda one: replace(one, loss=float("nan")), "its loss is not a number"),
        (lambda one: replace(one, gradient=one.gradient[:1]), "its gradient is not by 2 parameters"),
        (lambda one: replace(one, gradient=None), "its gradient is not by 2 parameters"),
    ],
)
def test_what_is_no_evaluation_of_a_trial_is_refused(change: Callable[[Any], object], told: str) -> None:
    problem = make_problem(fake_robot(), [fake_experiment("pull")], (MODULUS, RATIO), None, fake_simulate)
    with Evaluator(problem, workers=Other(lambda one: one), jacobian=True) as evaluator:
        ((_, evaluation),) = evaluator.evaluate([Proposal(0, {E: 1e6, NU: 0.45})])
        assert isinstance(evaluation, Evaluation)
    with Evaluator(problem, workers=Other(change), jacobian=True) as evaluator:
        with pytest.raises(ExecutorLost, match=f"Another cluster gave for trial 0 .* no evaluation of it: {told}"):
            list(evaluator.evaluate([Proposal(0, {E: 1e6, NU: 0.45})]))
