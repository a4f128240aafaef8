"""Drifts of instruments that nothing is stated on: what the noise conceals of them is in the intervals."""

from __future__ import annotations

import numpy as np
import pytest
from fake_twin import STEADY, E
from hypothesis import given, settings
from hypothesis import strategies as st
from interval_cases import TRUE, linear_problem

from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.problem.uncertain import UncertainParameter
from softcal.calibration.run import calibrate
from softcal.calibration.statistics.estimator import Estimator, estimator

LOSSES = {"likelihood": LikelihoodLoss(), "papers": PapersLoss()}
TENSION, PITCH = STEADY


def found(problem: Problem) -> Estimator:
    """The estimator at the values that the data are made of."""
    seen = problem.evaluate(TRUE, jacobian=True)
    z = problem.space.to_search(TRUE)
    serves = {one.name: np.ones(2, dtype=bool) for one in problem.experiments}
    return estimator(problem.loss, z, problem.space.jacobian(z), seen.blocks, serves, problem.uncertain)


def drifting(one: Estimator) -> set[str]:
    return {source.name for source in one.sources if source.kind == "drift"}


@pytest.mark.slow
@pytest.mark.parametrize("loss", LOSSES.values(), ids=LOSSES)
def test_it_makes_no_standard_error_longer_than_by_half_and_moves_nothing(loss: Loss) -> None:
    @settings(max_examples=25, deadline=None)
    @given(
        seed=st.integers(0, 1000),
        n=st.integers(12, 150),
        names=st.sampled_from([("pull",), ("a", "b", "c")]),
        correlation=st.sampled_from([0.0, 0.9]),
    )
    def check(seed: int, n: int, names: tuple[str, ...], correlation: float) -> None:
        of = {"seed": seed, "n": n, "names": names, "correlation": correlation}
        steady, unstated = found(linear_problem(loss, **of)), found(linear_problem(loss, **of, settings={}))
        ratio = np.linalg.norm(unstated.root, axis=0) / np.linalg.norm(steady.root, axis=0)
        assert np.all(ratio >= (1.0 - 1e-9) * unstated.contradiction / steady.contradiction)
        assert np.all(ratio <= (1.5 + 1e-9) * max(unstated.contradiction / steady.contradiction, 1.0))
        assert unstated.minimum == pytest.approx(steady.minimum, rel=1e-12)
        assert not drifting(steady)
        assert len(drifting(unstated)) == (2 if loss is LOSSES["likelihood"] else 2 * len(names))

    check()


def test_its_size_is_two_standard_errors_of_a_drift_each_size_as_likely() -> None:
    """Of white noise, the standard error of a line's slope in closed form."""
    problem = linear_problem(LikelihoodLoss(), noise=0.5, settings={PITCH: 0.0})
    (drift,) = (one for one in found(problem).sources if one.kind == "drift")
    n, sigma = 40, 1.0  # the stated noise is larger than what the residuals show
    time = np.linspace(0.0, 1.0, n)
    error = sigma / np.sqrt(np.sum((time - time.mean()) ** 2))
    seen = problem.evaluate(TRUE, jacobian=True)
    block = next(one for one in seen.blocks if one.channel == "tension")
    assert block.jacobian is not None
    weights = LikelihoodLoss().square_weights(block, block.residual)
    slopes = problem.space.jacobian(problem.space.to_search(TRUE))
    pull = (weights * block.sigma * time) @ (block.jacobian * slopes)
    assert drift.records[0].pull[0] == pytest.approx(2.0 / np.sqrt(3.0) * error * pull, rel=1e-9)


def test_what_is_stated_on_an_instrument_takes_its_place() -> None:
    """A setting, an uncertain and a free parameter, of the load cell; the IMU's drift remains."""
    unstated = linear_problem(LikelihoodLoss(), settings={})
    assert drifting(found(unstated)) == {"tension", "pitch"}
    assert drifting(found(linear_problem(LikelihoodLoss(), settings={TENSION: 0.0}))) == {"pitch"}
    blocks = stated(unstated, UncertainParameter(TENSION, "N", 0.02)).evaluate(TRUE, jacobian=True).blocks
    assert {one.channel: one.drift is None for one in blocks} == {"tension": True, "pitch": False}


def stated(problem: Problem, *uncertain: UncertainParameter) -> Problem:
    of = problem.space.parameters, problem.loss, problem.simulate
    return make_problem(problem.robot, problem.experiments, *of, uncertain=uncertain)


@pytest.mark.long
@pytest.mark.parametrize(
    "loss", [LOSSES["likelihood"], pytest.param(LOSSES["papers"], marks=pytest.mark.long)], ids=LOSSES
)
def test_the_intervals_contain_the_truth_where_instruments_drift_by_what_the_noise_conceals(loss: Loss) -> None:
    def coverage(given: dict[str, float], n: int) -> float:
        contained = 0
        for seed in range(n):
            problem = linear_problem(loss, n=200, seed=seed, settings=given, drift=0.49 * (-1) ** seed)
            one = calibrate(problem, starts=1).parameters[E]  # of a linear twin, which has one minimum
            assert one.interval is not None
            contained += one.interval[0] <= TRUE[E] <= one.interval[1]
        return contained / n

    assert coverage({}, 40) >= 0.9
    assert coverage(STEADY, 20) < 0.9


def test_the_notes_name_it_where_it_counts() -> None:
    words = "drifts too small to be seen in the noise"
    for settings_, counts in (({}, True), (STEADY, False)):
        notes = " ".join(map(str, calibrate(linear_problem(LikelihoodLoss(), settings=settings_)).notes))
        assert (words in notes) == counts


def test_a_record_without_noise_conceals_none_and_has_no_intervals() -> None:
    problem = linear_problem(PapersLoss(), noise=0.0, settings={})
    assert np.all(np.linalg.norm(found(problem).root, axis=0) < 1e-6)
    result = calibrate(problem)
    assert any("fits tension of pull and pitch of pull exactly" in note.text for note in result.notes)
    assert all(one.interval is None and one.standard_error is None for one in result.parameters.values())
    noisy = calibrate(linear_problem(PapersLoss(), noise=1e-3, settings={}))
    assert not any("exactly" in note.text for note in noisy.notes)
    assert all(one.interval is not None for one in noisy.parameters.values())
