"""What every optimiser promises, whichever it is; a new one joins the list and inherits the tests."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import pytest
from fake_twin import NU, E, all_necks_fail, fake_experiment, fake_robot, fake_simulate, soft_necks_fail

from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Evaluation, Problem, Simulate, make_problem
from softcal.calibration.run import calibrate
from softcal.calibration.search.optimiser import OPTIMISERS, Optimiser, Proposal
from softcal.calibration.search.optimisers.grid import GridOptimiser
from softcal.calibration.search.settings import SearchSettings
from softcal.report.format import method_label

Make = Callable[[Problem], Optimiser]

COMMON = SearchSettings(trials=36, seed=5, options={"starts": 1})
# Values of optimisers' own options: cases of their own, for those that have them.
TOLD: Mapping[str, Mapping[str, object]] = {"starts": {"starts": 3}, "startup_trials": {"startup_trials": 4}}
AXES = {NU: (0.4999, 0.45, 0.4), E: (9e6, 6e6, 3e6, 2e6)}


def cases() -> dict[str, SearchSettings]:
    found: dict[str, SearchSettings] = {}
    for name, optimiser in OPTIMISERS.items():
        found[name] = COMMON.changed(method=name)
        found |= {
            f"{name}, {key}": COMMON.changed(method=name, **TOLD[key])
            for key in sorted(o.name for o in optimiser.options)
        }
        if optimiser.batch > 1:
            found[f"{name}, one by one"] = COMMON.changed(method=name, batch=1)
    return found


CASES = cases()


def problem_of(simulate: Simulate = fake_simulate) -> Problem:
    parameters = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log"), FreeParameter(NU, "1", 0.4, 0.4999)]
    return make_problem(fake_robot(), [fake_experiment(noise=0.02)], parameters, None, simulate)


def play(optimiser: Optimiser, problem: Problem, limit: int = 200) -> list[tuple[Proposal, Evaluation]]:
    told: list[tuple[Proposal, Evaluation]] = []
    while proposals := optimiser.ask():
        evaluations = [problem.evaluate(p.theta, jacobian=optimiser.needs_jacobian) for p in proposals]
        for proposal, evaluation in zip(proposals, evaluations, strict=True):
            optimiser.tell(proposal, evaluation)
            told.append((proposal, evaluation))
        assert len(told) <= limit, "the search does not end"
    return told


@pytest.fixture(params=[*CASES, "grid over values"])
def make(request: pytest.FixtureRequest) -> Make:
    if request.param not in CASES:
        return lambda problem: GridOptimiser.over(problem.space, AXES)
    settings = CASES[request.param]
    optimiser = OPTIMISERS[settings.method]
    return lambda problem: optimiser.begin(problem, optimiser.settled(settings))


def test_every_optimiser_is_registered() -> None:
    own = [one for one in Optimiser.__subclasses__() if one.__module__.startswith("softcal.")]
    assert {one.name for one in own} <= {settings.method for settings in CASES.values()}
    assert len(own) == 3


@pytest.mark.parametrize("name", OPTIMISERS)
def test_a_result_tells_what_the_optimiser_says_of_itself(name: str) -> None:
    optimiser = OPTIMISERS[name]
    result = calibrate(problem_of(), COMMON, method=name)
    assert result.extra["importance_kind"] == optimiser.statistics
    has_errors = any(e.standard_error is not None for e in result.parameters.values())
    if optimiser.statistics == "sensitivity":
        assert has_errors == result.converged
    assert has_errors != any(note.text.startswith("No standard errors and no intervals") for note in result.notes)
    assert method_label(name) == optimiser.title != name
    assert optimiser.default_trials > 0


def test_numbers_count_up_and_points_lie_within_the_bounds(make: Make) -> None:
    problem = problem_of()
    told = play(make(problem), problem)
    assert [proposal.number for proposal, _ in told] == list(range(len(told)))
    for proposal, _ in told:
        assert 0.1e6 <= proposal.theta[E] <= 40e6
        assert 0.4 <= proposal.theta[NU] <= 0.4999


def test_the_same_seed_and_answers_give_the_same_questions(make: Make) -> None:
    problem = problem_of()
    first, second = (play(make(problem), problem) for _ in range(2))
    assert [p for p, _ in first] == [p for p, _ in second]


def test_it_ends_within_the_total_it_names_and_stays_ended(make: Make) -> None:
    problem = problem_of()
    optimiser = make(problem)
    told = play(optimiser, problem)
    assert 0 < len(told) <= optimiser.total
    assert optimiser.ask() == ()
    assert optimiser.status.endswith(".")


def test_told_again_what_it_was_told_it_asks_on_where_it_stopped(make: Make) -> None:
    problem = problem_of()
    whole = play(make(problem), problem)
    known = {proposal.number: evaluation for proposal, evaluation in whole[: len(whole) // 2]}
    again = make(problem)
    numbers: list[Proposal] = []
    while proposals := again.ask():
        for proposal in proposals:
            evaluation = known.get(proposal.number) or problem.evaluate(proposal.theta, jacobian=again.needs_jacobian)
            again.tell(proposal, evaluation)
            numbers.append(proposal)
    assert numbers == [proposal for proposal, _ in whole]


def test_failed_trials_are_taken_like_any_other(make: Make) -> None:
    problem = problem_of(soft_necks_fail)
    told = play(make(problem), problem)
    losses = [evaluation.loss for _, evaluation in told if evaluation.loss is not None]
    assert losses


def test_it_ends_when_nothing_can_be_simulated(make: Make) -> None:
    problem = problem_of(all_necks_fail)
    optimiser = make(problem)
    told = play(optimiser, problem)
    assert told
    assert all(evaluation.loss is None for _, evaluation in told)
    assert optimiser.status.endswith(".")


def test_it_finds_a_loss_not_far_above_the_least(make: Make) -> None:
    problem = problem_of()
    best = min(evaluation.loss for _, evaluation in play(make(problem), problem) if evaluation.loss is not None)
    least = problem.evaluate({E: 2.246e6, NU: 0.4999}).loss
    assert least is not None
    assert best < 20 * least
