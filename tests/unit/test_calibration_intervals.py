"""95 % intervals: the usual ones away from limits, within the limits near them, and those of the profile in between."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from fake_twin import NU, E, fake_experiment, fake_robot, fake_simulate
from hypothesis import given
from hypothesis import strategies as st

from softcal.calibration.intervals import intervals
from softcal.calibration.parameters import FreeParameter
from softcal.calibration.problem import make_problem
from softcal.calibration.result_reading import load_result
from softcal.calibration.run import calibrate
from softcal.cli.calibration_table import print_results
from softcal.report.chart_parameters import draw_forest

T = 2.0484071417952445  # Student's, 28 degrees of freedom, 97.5 %
MODULUS = FreeParameter(E, "Pa", 0.1e6, 40e6, "log", floor=-0.0)
RATIO = FreeParameter(NU, "1", 0.4, 0.4999, floor=-1.0, ceiling=0.5)


def root(correlation: float) -> np.ndarray:
    return np.linalg.cholesky([[1.0, correlation], [correlation, 1.0]]).T


def of(value: float, error: float, parameter: FreeParameter = RATIO) -> tuple[float, float]:
    (found,) = intervals([parameter], {parameter.label: value}, np.array([error]), np.eye(1), 28)
    return found


def test_away_from_limits_it_is_students_t_in_the_variable_of_the_search() -> None:
    assert of(0.45, 0.005) == pytest.approx((0.45 - T * 0.005, 0.45 + T * 0.005))
    assert of(2e6, 1e5, MODULUS) == pytest.approx((2e6 * math.exp(-T / 20), 2e6 * math.exp(T / 20)))


def test_an_interval_ends_at_a_limit_that_the_data_does_not_exclude() -> None:
    assert of(0.484, 0.0209) == pytest.approx((0.484 - T * 0.0209, 0.5))
    friction = FreeParameter("front.friction_coefficient", "1", 0.0, 0.5, floor=-1e-300)
    low, high = of(0.01, 0.02, friction)
    assert low == pytest.approx(0.0, abs=1e-290)
    assert high == pytest.approx(0.01 + T * 0.02)


def test_where_the_data_is_met_exactly_it_is_the_value() -> None:
    assert of(0.45, 0.0) == (0.45, 0.45)
    assert of(2e6, 0.0, MODULUS) == pytest.approx((2e6, 2e6))


def test_what_another_cannot_follow_is_left_out() -> None:
    # A higher ratio goes with a lower modulus, and it cannot go beyond a half.
    theta, errors = {E: 1.9e6, NU: 0.48}, np.array([3e4, 0.02])
    (low, high), (_, largest) = intervals([MODULUS, RATIO], theta, errors, root(-0.95), 28)
    assert largest == 0.5
    assert high == pytest.approx(1.9e6 * math.exp(T * 3e4 / 1.9e6))
    # By hand: the ratio stays one standard error up; what is left of the t^2 the modulus has to itself.
    alone = math.sqrt(1 - 0.95**2)
    assert low == pytest.approx(1.9e6 * math.exp(-3e4 / 1.9e6 * (0.95 + alone * math.sqrt(T**2 - 1))))
    assert low > 1.9e6 * math.exp(-T * 3e4 / 1.9e6)


@given(st.floats(-0.999, 0.999), st.floats(0.401, 0.4999), st.floats(1e-4, 1.0), st.floats(1e-3, 1e2))
def test_it_is_the_profile_within_the_limits_and_never_past_them(
    correlation: float, ratio: float, error: float, share: float
) -> None:
    theta = {E: 1e6, NU: ratio}
    (low, high), (least, largest) = intervals(
        [MODULUS, RATIO], theta, np.array([1e6 * share, error]), root(correlation), 28
    )
    assert 0.0 <= low <= 1e6 <= high
    assert -1.0 <= least <= ratio <= largest <= 0.5
    precision = np.linalg.inv([[1.0, correlation], [correlation, 1.0]])
    room = (-1.0 - ratio) / error, (0.5 - ratio) / error
    for end in (math.log(low / 1e6) / share, math.log(high / 1e6) / share):
        # The best ratio for this modulus, as far as it may go.
        follow = np.clip(correlation * end, *room)
        step = np.array([end, follow])
        assert step @ precision @ step == pytest.approx(T**2, rel=1e-6)


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


def test_three_parameters_agree_with_the_extremes_over_all_faces_of_the_limits() -> None:
    matrix = np.array([[1.0, 0.8, 0.6], [0.8, 1.0, 0.7], [0.6, 0.7, 1.0]])
    free = [FreeParameter(name, "1", 0.0, 1.0, floor=0.0, ceiling=1.0) for name in ("a", "b", "c")]
    theta, errors = {"a": 0.5, "b": 0.05, "c": 0.9}, np.array([0.1, 0.1, 0.1])
    found = intervals(free, theta, errors, np.linalg.cholesky(matrix).T, 28)
    centre = np.array(list(theta.values()))
    low, high = -centre / errors, (1.0 - centre) / errors
    ends = [[extreme(j, sign, matrix, low, high) for sign in (-1.0, 1.0)] for j in range(3)]
    assert np.array(found) == pytest.approx(centre[:, None] + errors[:, None] * np.array(ends), abs=1e-9)


def test_tables_files_and_charts_have_it_within_the_limits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    free = [FreeParameter(E, "Pa", 0.1e6, 40e6, "log"), FreeParameter(NU, "1", 0.3, 0.4999)]
    problem = make_problem(fake_robot(), [fake_experiment(noise=0.01, seed=1)], free, None, fake_simulate)
    result = calibrate(problem, store=tmp_path / "run")
    ratio = result.parameters[NU]
    assert not ratio.at_bound
    assert ratio.value + 1.96 * ratio.standard_error > 0.51
    low, high = ratio.interval
    assert low < ratio.value - 1.9 * ratio.standard_error
    assert high == 0.5
    assert load_result(tmp_path / "run").parameters[NU].interval == (low, high)
    print_results({"joint": result})
    assert f"{low:.3g} to 0.5 " in capsys.readouterr().out
    (axes,) = draw_forest(NU, {"joint": result}).axes
    assert axes.lines[0].get_xdata() == pytest.approx([low, high])
