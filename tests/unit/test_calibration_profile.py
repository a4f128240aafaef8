"""Profile likelihoods: against the closed form of a linear twin, and against fits at every value of a curved one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fake_twin import NU, E, fake_simulate, soft_necks_fail
from interval_cases import STATED, curved, linear_problem, values
from scipy.optimize import brentq, least_squares

from softcal.calibration.interval_studies import adjusted_likelihood
from softcal.calibration.interval_studies.profile import profile
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.problem import Problem
from softcal.calibration.statistics import sensitivity
from softcal.calibration.statistics.estimator import estimator
from softcal.errors import InputError
from softcal.twin.protocol import Protocol

THREE = ("a", "b", "c", "d")
LINEAR = {
    "likelihood": linear_problem(LikelihoodLoss(), noise=0.9),
    "papers": linear_problem(PapersLoss()),
    "noise larger than stated": linear_problem(LikelihoodLoss(), noise=2.0),
    "a prior": linear_problem(LikelihoodLoss(), noise=2.0, prior=(2.2e6, 2e4)),
    "a bound": linear_problem(LikelihoodLoss(), ratios=(0.1, 0.398)),
    "a bound, papers": linear_problem(PapersLoss(), ratios=(0.402, 0.49)),
    "correlated noise": linear_problem(PapersLoss(), n=200, correlation=0.9),
    "experiments that differ": linear_problem(LikelihoodLoss(), names=THREE, spread=3e5),
}


@pytest.mark.parametrize("name", LINEAR)
def test_of_a_linear_twin_the_profile_is_the_quick_interval(name: str):
    found = profile(LINEAR[name], values(LINEAR[name]))
    assert {one.found is not None and one.quick is not None for one in found.intervals.values()} == {True}
    for label, one in found.intervals.items():
        assert one.difference == pytest.approx(0.0, abs=2e-6), label
    assert found.facts["trajectories"] <= 6 * len(LINEAR[name].experiments)
    assert found.sentences == ("No end differs from that of the quick interval by more than 10 % of its half-length.",)


def test_the_estimator_of_the_calibrated_values_is_made_once(monkeypatch: pytest.MonkeyPatch):
    problem = LINEAR["likelihood"]
    theta, made = values(problem), list[object]()
    for module in (sensitivity, adjusted_likelihood):
        if hasattr(module, "estimator"):
            monkeypatch.setattr(module, "estimator", lambda *of: made.append(of) or estimator(*of))
    found = adjusted_likelihood.calibrated(problem, theta)
    assert len(made) == 1
    assert all(one.interval is not None for one in found.estimates.values())


def by_fits(problem: Problem, theta: dict[str, float]) -> np.ndarray:
    """The ends (size, 2) in the unit box by a root search over complete fits."""
    space = problem.space

    def residual(z: np.ndarray) -> np.ndarray:
        blocks = problem.evaluate(space.to_model(np.clip(z, 0, 1))).blocks
        return np.concatenate([b.residual / STATED[b.channel] for b in blocks])

    start = space.to_search(theta)
    lowest = float(np.sum(least_squares(residual, start, bounds=(0, 1), xtol=1e-12).fun ** 2))
    ends = np.zeros((space.size, 2))
    for j in range(space.size):
        others = [i for i in range(space.size) if i != j]

        def excess(value: float, j: int = j, others: list[int] = others) -> float:
            def fixed(w: np.ndarray) -> np.ndarray:
                z = np.zeros(space.size)
                z[j], z[others] = value, w
                return residual(z)

            fits = [
                least_squares(fixed, np.clip(s, 1e-6, 1 - 1e-6), bounds=(0, 1), xtol=1e-12).cost
                for s in (start[others], np.full(len(others), 0.5))
            ]
            return 2 * min(fits) - lowest - 1.959964**2

        for side, bound in enumerate((0.0, 1.0)):
            ends[j, side] = bound if excess(bound) <= 0 else brentq(excess, start[j], bound, xtol=1e-7)
    return ends


@pytest.mark.slow
def test_of_a_curved_twin_it_is_what_fits_at_fixed_values_give():
    problem = curved()
    theta = values(problem)
    found = profile(problem, theta)
    expected = by_fits(problem, theta)
    for j, (label, one) in enumerate(found.intervals.items()):
        assert one.found is not None
        ends = [problem.space.to_search({**theta, label: end})[j] for end in one.found]
        length = expected[j, 1] - expected[j, 0]
        assert ends == pytest.approx(expected[j], abs=0.01 * length), label
    assert any(one.differs for one in found.intervals.values())
    assert any("the twin is not linear over it" in sentence for sentence in found.sentences)
    assert found.facts["trajectories"] <= 30
    assert min(found.excess) == 0.0
    assert len(found.excess) == len(found.points[E]) == found.facts["evaluations"]


def test_an_end_at_a_bound_is_said_to_be():
    problem = linear_problem(LikelihoodLoss(), ratios=(0.1, 0.398))
    one = profile(problem, values(problem)).intervals[NU]
    assert one.at_bounds == (False, True)
    assert one.found is not None
    assert one.found[1] == 0.398


def test_an_end_behind_points_that_cannot_be_simulated_is_unknown():
    problem = curved()
    theta = values(problem)
    edge = profile(problem, theta).intervals[E].found
    assert edge is not None
    assert edge[0] < 0.999 * theta[E]

    def fails(robot, protocol: Protocol, theta=None, *, sensitivities=(), snapshots=False):
        low = 0.5 * (edge[0] + values_at[E])
        if theta[E] < low:
            return soft_necks_fail(robot, protocol, {E: 1.0, NU: 0.4})
        return fake_simulate(robot, protocol, theta, sensitivities=sensitivities)

    values_at = theta
    found = profile(replace(problem, simulate=fails), theta)
    assert found.intervals[E].found is None
    note = next(note for note in found.notes if note.startswith(E))
    assert "the lower end is unknown, the profile is followed to" in note
    assert "No equilibrium beyond 12.0 mm." in note


@pytest.mark.slow
def test_two_workers_find_the_same():
    problem = curved()
    theta = values(problem)
    one, two = (profile(problem, theta, workers=n) for n in (1, 2))
    assert one.intervals == two.intervals


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"samples": 1}, "there are no more measured values than parameters"),
        ({"noise": 0.0, "loss": PapersLoss()}, "a channel is fitted exactly"),
        ({"away": True}, "only at a minimum of the loss"),
        ({"blind": True}, "the data do not identify every parameter"),
    ],
)
def test_what_does_not_show_the_noise_is_refused(change: dict, said: str):
    problem = linear_problem(change.get("loss", LikelihoodLoss()), noise=change.get("noise", 1.0))
    theta = {E: 2.3e6, NU: 0.4}
    if "away" in change:
        theta[E] = 2.6e6
    elif "samples" in change:
        problem = linear_problem(LikelihoodLoss(), n=1)
    elif "blind" in change:
        held = problem.experiments[0]
        channels = {c: v for c, v in held.dataset.channels.items() if c != "tension"}
        alone = replace(held, dataset=replace(held.dataset, channels=channels), compared=("pitch",))
        problem = replace(problem, experiments=(alone,))
        theta = values(problem)
    with pytest.raises(InputError, match=said):
        profile(problem, theta)
