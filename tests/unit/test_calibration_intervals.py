"""95 % intervals: the usual ones away from bounds, within the bounds near them, and those of the profile in between."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_twin import NU, STEADY, E, fake_experiment, fake_robot, fake_simulate
from hypothesis import given
from hypothesis import strategies as st

from softcal.calibration.problem.loss import Block
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.parameters import FreeParameter, SearchSpace
from softcal.calibration.problem.problem import make_problem
from softcal.calibration.results.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.calibration.search.outcome import bound_note
from softcal.calibration.statistics.intervals import beyond_bounds, box_intervals
from softcal.calibration.statistics.sensitivity import local_statistics
from softcal.cli.calibration_table import print_results
from softcal.experiments.dataset import Step
from softcal.report.figures.parameter import draw_forest

T = 2.0484071417952445  # Student's, 28 degrees of freedom, 97.5 %
NORMAL = 1.959963984540054


def root(errors: list[float], correlation: float = 0.0) -> np.ndarray:
    matrix = np.eye(len(errors)) if len(errors) == 1 else np.array([[1.0, correlation], [correlation, 1.0]])
    return np.linalg.cholesky(matrix).T * np.array(errors)


def found(z: list[float], spread: np.ndarray, minimum: list[float] | None = None, dof: float = 28.0):
    size = len(z)
    return box_intervals(np.array(z), np.array(z if minimum is None else minimum), spread, np.full(size, dof))


def test_away_from_bounds_it_is_students_t_or_the_normal_one_where_the_noise_is_known() -> None:
    ends, errors = found([0.5, 0.4], root([0.01, 0.02], 0.9))
    assert ends == pytest.approx(np.array([[0.5 - T * 0.01, 0.5 + T * 0.01], [0.4 - T * 0.02, 0.4 + T * 0.02]]))
    assert errors == pytest.approx([0.01, 0.02])
    ends, errors = found([0.5], root([0.01]), dof=math.inf)
    assert ends[0] == pytest.approx([0.5 - NORMAL * 0.01, 0.5 + NORMAL * 0.01])
    assert errors == pytest.approx([0.01])


def test_an_interval_ends_at_a_bound_that_the_data_does_not_exclude() -> None:
    ends, errors = found([0.98], root([0.05]))
    assert ends[0] == pytest.approx([0.98 - T * 0.05, 1.0])
    assert errors == pytest.approx([0.05])


def test_where_the_data_is_met_exactly_it_is_the_value() -> None:
    ends, errors = found([0.5, 0.4], root([1e-12, 1e-12]))
    assert ends == pytest.approx(np.array([[0.5, 0.5], [0.4, 0.4]]), abs=1e-10)
    assert errors == pytest.approx([1e-12, 1e-12])


def test_what_another_cannot_follow_is_left_out() -> None:
    # The second goes up as the first goes down, and it is 0.8 standard errors from its upper bound.
    (one, other), errors = found([0.5, 0.96], root([0.02, 0.05], -0.95))
    assert other[1] == 1.0
    assert one[1] == pytest.approx(0.5 + T * 0.02)
    # By hand: the second stays 0.8 standard errors up; what is left of the t^2 the first has to itself.
    alone = math.sqrt(1 - 0.95**2)
    assert one[0] == pytest.approx(0.5 - 0.02 * (0.95 * 0.8 + alone * math.sqrt(T**2 - 0.8**2)))
    assert one[0] > 0.5 - T * 0.02
    assert errors[0] == pytest.approx((one[1] - one[0]) / (2 * T))


def test_a_parameter_at_its_bound_takes_the_others_with_it() -> None:
    # The second's minimum lies 0.5 standard errors beyond its bound; the first's then is on the way there.
    minimum = [0.5 + 0.9 * 0.5 * 0.02, 1.0 + 0.5 * 0.2]
    (one, other), errors = found([0.5, 1.0], root([0.02, 0.2], 0.9), minimum)
    fixed = T * 0.02 * math.sqrt(1 - 0.9**2)
    assert one[1] - 0.5 == pytest.approx(fixed, rel=0.2)
    # By hand: the best point of the box is 0.5 standard errors from the minimum, and the first takes the second down.
    assert one[0] == pytest.approx(0.5 + 0.02 * (0.9 * 0.5 - math.sqrt(T**2 + 0.5**2)))
    assert 0.5 - one[0] > 1.8 * fixed  # as far as it would go, were the second fixed
    assert other[1] == 1.0
    # Its own: distance t^2 above that of the bound itself.
    assert other[0] == pytest.approx(1.0 + 0.2 * (0.5 - math.sqrt(T**2 + 0.5**2)))
    assert errors[0] > fixed / T


def test_a_bound_far_from_the_minimum_holds_a_parameter() -> None:
    minimum = [0.5 + 0.9 * 500 * 0.02, 1.0 + 500 * 0.2]
    (one, other), _ = found([0.5, 1.0], root([0.02, 0.2], 0.9), minimum)
    fixed = T * 0.02 * math.sqrt(1 - 0.9**2)
    assert one == pytest.approx([0.5 - fixed, 0.5 + fixed], rel=0.02)
    assert 0.99 < other[0] < 1.0


@given(st.floats(-0.999, 0.999), st.floats(0.01, 0.99), st.floats(1e-4, 10.0), st.floats(1e-3, 1e2))
def test_it_is_the_profile_within_the_bounds_and_never_past_them(
    correlation: float, second: float, error: float, share: float
) -> None:
    ((low, high), (least, largest)), _ = found([0.5, second], root([share, error], correlation))
    assert 0.0 <= low <= 0.5 <= high <= 1.0
    assert 0.0 <= least <= second <= largest <= 1.0
    precision = np.linalg.inv([[1.0, correlation], [correlation, 1.0]])
    room = -second / error, (1.0 - second) / error
    for end, bound in ((low, 0.0), (high, 1.0)):
        # The best second for this first, as far as it may go.
        first = (end - 0.5) / share
        step = np.array([first, np.clip(correlation * first, *room)])
        distance = step @ precision @ step
        assert distance == pytest.approx(T**2, rel=1e-6) or (end == bound and distance < T**2)


def extreme(j: int, sign: float, matrix: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """The farthest that coordinate j goes in the ellipsoid x @ inv(matrix) @ x <= T^2 within a box, by every face."""
    precision = np.linalg.inv(matrix)
    best = 0.0
    for face in itertools.product((None, 0, 1), repeat=len(low)):
        free = [i for i, side in enumerate(face) if side is None]
        held = [i for i, side in enumerate(face) if side is not None]
        x = np.zeros(len(low))
        x[held] = np.where(np.array(face) == 1, high, low)[held]
        # The slice's own ellipsoid: its centre, its shape, and what the held coordinates leave of T^2.
        shape = np.linalg.inv(precision[np.ix_(free, free)])
        x[free] = -shape @ precision[np.ix_(free, held)] @ x[held]
        left = T**2 - float(x @ precision @ x)
        if left >= 0.0 and j in free:
            x[free] += sign * math.sqrt(left) * shape[:, free.index(j)] / math.sqrt(shape[free.index(j), free.index(j)])
        if left >= 0.0 and np.all(low - 1e-12 <= x) and np.all(x <= high + 1e-12):
            best = max(best, sign * float(x[j]))
    return sign * best


def test_three_parameters_agree_with_the_extremes_over_all_faces_of_the_bounds() -> None:
    matrix = np.array([[1.0, 0.8, 0.6], [0.8, 1.0, 0.7], [0.6, 0.7, 1.0]])
    centre = np.array([0.5, 0.05, 0.9])
    intervals, _ = found(list(centre), 0.1 * np.linalg.cholesky(matrix).T)
    low, high = -centre / 0.1, (1.0 - centre) / 0.1
    ends = [[extreme(j, sign, matrix, low, high) for sign in (-1.0, 1.0)] for j in range(3)]
    assert intervals == pytest.approx(centre[:, None] + 0.1 * np.array(ends), abs=1e-9)


def test_how_far_bounds_hold_a_parameter_is_what_the_distance_falls_by_without_them() -> None:
    assert beyond_bounds(np.array([1.6]), root([0.2])) == pytest.approx([3.0])
    assert beyond_bounds(np.array([-0.1]), root([0.2])) == pytest.approx([0.5])
    # The other is free to follow, and no bound of its own holds it.
    assert beyond_bounds(np.array([1.6, 0.5]), root([0.2, 0.01], 0.9)) == pytest.approx([3.0, 0.0], abs=1e-9)
    # By hand: the second's bound is 1 standard error from its minimum, the first's is 3 from its own; both correlate by
    # -0.5, so that neither bound spares the other. Without the first's, 1^2 is left of the least distance at (3, 1).
    whole = (3**2 + 2 * 0.5 * 3 * 1 + 1**2) / (1 - 0.5**2)
    found = beyond_bounds(np.array([1.6, 1.2]), root([0.2, 0.2], -0.5))
    assert found == pytest.approx([math.sqrt(whole - 1**2), math.sqrt(whole - 3**2)])


@pytest.mark.parametrize(("far", "held"), [(-3.0, False), (1.0, False), (3.0, True), (30.0, True)])
def test_data_that_want_a_value_beyond_a_bound_are_said_to(tmp_path: Path, far: float, held: bool) -> None:
    pull = fake_experiment(noise=0.01, settings=STEADY)

    def found(lower: float):
        modulus, loss = FreeParameter(E, "Pa", lower, 40e6, "log"), LikelihoodLoss({"tension": 0.3, "pitch": 0.01})
        problem = make_problem(fake_robot(), [pull], [modulus], loss, fake_simulate)
        return calibrate(problem, starts=1, store=tmp_path / f"{lower:.6g}").parameters[E]

    free = found(1e5)
    assert free.standard_error
    assert free.beyond is None
    assert free.scale == "log"
    lower = free.value + far * free.standard_error
    bounded = found(lower)
    assert bounded.at_bound == (far > 0)
    assert bounded.is_contradicted == held
    assert load_result(tmp_path / f"{lower:.6g}").parameters[E] == bounded
    if bounded.at_bound:
        # The residuals of a bound that is far off count as noise: it is then fewer of these, but still many.
        assert bounded.beyond == pytest.approx(far, rel=0.2) if far < 10 else bounded.beyond > 5
        note = bound_note(E, bounded).text
        assert ("best fit is beyond it, by about" in note) == ("contradict the data" in note) == held
        assert ("not by the data" in note) == (not held)


@pytest.mark.parametrize(("far", "said"), [(1.0, False), (2.9, False), (3.1, True), (6.0, True)])
def test_a_prior_that_contradicts_the_data_widens_the_errors(far: float, said: bool) -> None:
    """The data alone give a = 0.5 with the error s, the prior is `far` standard errors of the difference away."""
    n, sd = 50, 0.05
    wave = 0.08 * np.cos(np.pi * np.arange(n))  # no larger than stated, and without a part in a
    s = 0.1 / math.sqrt(n)
    away = far * math.hypot(s, sd)
    a = 0.5 + away * s**2 / (s**2 + sd**2)
    data = Block("pull", "tension", 1.0 - wave, a - 0.5 + wave, 0.1, np.ones((n, 1)))
    prior = Block("", "prior of a", np.array([0.5 + away]), np.array([a - 0.5 - away]), sd, np.ones((1, 1)))
    space = SearchSpace((FreeParameter("a", "m", -10.0, 10.0, prior_mean=0.5 + away, prior_sd=sd),))
    statistics = local_statistics(space, LikelihoodLoss(), {"a": a}, [data, prior])
    one = statistics.estimates(space, {"a": a})["a"]
    assert one.off_prior == pytest.approx(far, rel=0.01)
    assert one.contradicts_prior == said
    both = 1.0 / math.hypot(1.0 / s, 1.0 / sd)
    assert one.standard_error == pytest.approx(both * (far if said else 1.0), rel=0.03)


@pytest.mark.parametrize("method", ["least-squares", "grid"])
@pytest.mark.parametrize(("n_samples", "saturated"), [(1, True), (2, False)])
def test_as_many_parameters_as_values_leave_nothing_to_be_sure_of(
    capsys: pytest.CaptureFixture[str], method: str, n_samples: int, saturated: bool
) -> None:
    parameters = [FreeParameter(E, "Pa", 1e5, 40e6, "log"), FreeParameter(NU, "1", 0.4, 0.4999)]
    pull = fake_experiment(noise=0.01, n_samples=41)
    rows = np.linspace(20, 40, n_samples).astype(int)
    pull = replace(pull, dataset=pull.dataset.take(rows, Step("some", {}, "some")))
    problem = make_problem(
        fake_robot(), [pull], parameters, LikelihoodLoss({"tension": 0.3, "pitch": 0.01}), fake_simulate
    )
    result = calibrate(problem, starts=1, method=method, trials=30)
    assert result.is_saturated == saturated
    sentence = "2 parameters were fitted to 2 measured values, so a close fit is no evidence for these values"
    assert any(sentence in note.text for note in result.notes) == saturated
    print_results({"pull": result})
    assert (f"Warning: pull: {sentence}" in capsys.readouterr().err) == saturated
    if method == "least-squares":
        assert all((p.interval is None) == saturated for p in result.parameters.values())
        assert not (saturated and any(p.standard_error for p in result.parameters.values()))
        assert any("The intervals include the noise" in note.text for note in result.notes) == (not saturated)


@pytest.mark.slow
def test_a_ratio_at_its_bound_does_not_make_the_modulus_sure() -> None:
    # From pitch and tension with plenty of noise; the likeliest ratio is at a bound or not, by chance alone.
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log"), FreeParameter(NU, "1", 0.4, 0.4999)]
    widths: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(12):
        tests = [fake_experiment(noise=0.03, sigma=0.02, seed=seed)]
        problem = make_problem(fake_robot(), tests, free, LikelihoodLoss(), fake_simulate)
        estimates = calibrate(problem, starts=1).parameters
        low, high = estimates[E].interval
        widths[estimates[NU].at_bound].append(math.log(high / low))
        assert (estimates[NU].standard_error is None) == estimates[NU].at_bound
        assert estimates[NU].interval[1] > estimates[NU].interval[0]
    assert widths[True]
    assert widths[False]
    assert min(widths[True]) > 0.4 * max(widths[False])


def test_tables_files_and_charts_have_it_within_the_bounds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log"), FreeParameter(NU, "1", 0.3, 0.4999)]
    problem = make_problem(fake_robot(), [fake_experiment(noise=0.004, seed=0)], free, None, fake_simulate)
    result = calibrate(problem, store=tmp_path / "run")
    ratio = result.parameters[NU]
    assert not ratio.at_bound
    assert ratio.value + 1.96 * ratio.standard_error > 0.51
    low, high = ratio.interval
    assert low < ratio.value - 1.9 * ratio.standard_error
    assert high == 0.4999
    assert load_result(tmp_path / "run").parameters[NU].interval == (low, high)
    print_results({"joint": result})
    assert f"{low:.3g} to 0.4999 " in capsys.readouterr().out
    (axes,) = draw_forest(NU, "ν", {"joint": result}).axes
    assert axes.lines[0].get_xdata() == pytest.approx([low, high])


def test_logarithms_are_searched_and_their_intervals_stated_in_them() -> None:
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log")]
    problem = make_problem(fake_robot(), [fake_experiment(noise=0.05, seed=2)], free, None, fake_simulate)
    result = calibrate(problem, starts=1)
    best = problem.evaluate({E: result.parameters[E].value}, jacobian=True)
    told = local_statistics(problem.space, problem.loss, best.theta, best.blocks)
    low, high = told.intervals[E]
    assert math.sqrt(low * high) == pytest.approx(best.theta[E], rel=1e-4)
    assert math.log(high / low) == pytest.approx(2 * T * told.standard_errors[E] / best.theta[E], rel=0.05)


def test_parameters_that_move_together_are_named_with_what_the_other_would_tell() -> None:
    """By force alone E and nu trade off; the error with nu given is that of a fit in which nu is fixed."""
    one = replace(fake_experiment(noise=0.02, seed=3, settings=STEADY), compared=("tension",))
    free = [
        FreeParameter(E, "Pa", 0.1e6, 40e6, "log", start=2e6),
        FreeParameter(NU, "1", 0.30, 0.4999, start=0.43),
    ]
    both = calibrate(make_problem(fake_robot(), [one], free, None, fake_simulate))
    (note,) = [note.text for note in both.notes if "move together" in note.text]
    nu = both.parameters[NU].value
    alone = calibrate(make_problem(fake_robot(poissons_ratio=nu), [one], free[:1], None, fake_simulate))
    error = alone.parameters[E].standard_error
    assert error is not None
    stated = float(note.partition("would be ")[2].partition(" %")[0])
    assert stated == pytest.approx(100 * error / (both.parameters[E].standard_error or 0.0), rel=0.05)
    assert not any("move together" in note.text for note in alone.notes)
