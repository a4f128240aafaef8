"""Every search finds the same minimum whatever the bounds: shifted, scaled, of one sign or of both."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from fake_twin import NU, TRUE, E, fake_experiment, fake_robot, fake_simulate
from hypothesis import example, given, settings
from hypothesis import strategies as st

from softcal.calibration.problem.loss import Loss
from softcal.calibration.problem.losses.likelihood import LikelihoodLoss
from softcal.calibration.problem.losses.papers import PapersLoss
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate

TENSION, PITCH, SLACK = "front.tension_offset", "plate.pitch_offset", "front.slack"
OFFSETS = {TENSION: 0.25, PITCH: np.deg2rad(4.0)}  # [N], [rad]
UNITS = {E: "Pa", NU: "1", TENSION: "N", PITCH: "rad", SLACK: "m"}
WIDE = {E: (0.1e6, 40e6), NU: (0.4, 0.4999), TENSION: (-20.0, 20.0), PITCH: (-1.0, 1.0), SLACK: (-0.02, 0.02)}
LOSSES: tuple[Loss, ...] = (LikelihoodLoss({"tension": 0.3, "pitch": 0.02}), PapersLoss())
# What the loss's own kink and the rounding of a tenth of a standard error leave.
SAME = 0.25  # standard errors
NAMES = (E, TENSION, PITCH, SLACK)


def problem_of(
    loss: Loss, bounds: dict[str, tuple[float, float]], start: dict[str, float] | None = None, *, scale: str = "log"
) -> Problem:
    experiment = fake_experiment(
        noise=0.01, slack=0.002, tension_offset=OFFSETS[TENSION], pitch_offset=OFFSETS[PITCH], n_samples=61
    )
    free = [
        FreeParameter(n, UNITS[n], *b, scale if n == E else "linear", (start or {}).get(n))  # type: ignore[arg-type]
        for n, b in bounds.items()
    ]
    return make_problem(fake_robot(poissons_ratio=TRUE[NU]), [experiment], free, loss, fake_simulate)


@functools.cache
def least(loss_name: str) -> CalibrationResult:
    """The minimum between wide bounds, from near the truth."""
    loss = next(loss for loss in LOSSES if loss.name == loss_name)
    bounds = {name: WIDE[name] for name in NAMES}
    result = calibrate(problem_of(loss, bounds, {E: 2.3e6, TENSION: 0.25, PITCH: 0.07, SLACK: 0.002}), starts=1)
    assert result.status.startswith("Converged")
    return result


def bounds_about(value: float, shifts: tuple[float, float], width: float) -> tuple[float, float]:
    """An interval around a value that reaches the shares of a width below and above it."""
    return value - shifts[0] * width, value + shifts[1] * width


shares = st.tuples(st.floats(0.02, 1.0), st.floats(0.02, 1.0))


@pytest.mark.long
@settings(max_examples=40)
@given(
    loss=st.sampled_from(LOSSES),
    decades=st.tuples(st.floats(0.1, 2.0), st.floats(0.1, 2.0)),
    sides=st.tuples(shares, shares, shares),
    scale=st.sampled_from(["log", "linear"]),
    start=st.tuples(*[st.floats(0.0, 1.0)] * 4),
)
@example(  # the tension's offset from 0.001 N to 0.5 N, the angle's from 0.1 deg to 12 deg, as benches have them
    loss=LOSSES[0], decades=(1.0, 1.0), sides=((0.0125, 0.0125), (0.07, 0.14), (0.1, 0.1)), scale="log",
    start=(0.9, 0.9, 0.9, 0.9),
)  # fmt: skip
def test_least_squares_finds_the_same_minimum_between_any_bounds(
    loss: Loss,
    decades: tuple[float, float],
    sides: tuple[tuple[float, float], ...],
    scale: str,
    start: tuple[float, ...],
) -> None:
    reference = least(loss.name)
    e = reference.parameters[E].value
    bounds = {E: (e * 10 ** -decades[0], e * 10 ** decades[1])}
    for name, side, width in zip((TENSION, PITCH, SLACK), sides, (20.0, 1.0, 0.02), strict=True):
        bounds[name] = bounds_about(reference.parameters[name].value, side, width)
    begin = {n: min(low + s * (high - low), high) for (n, (low, high)), s in zip(bounds.items(), start, strict=True)}
    result = calibrate(problem_of(loss, bounds, begin, scale=scale), starts=1)
    assert result.status.startswith("Converged")
    assert len(result.trials) <= 20
    for name, one in reference.parameters.items():
        assert one.standard_error is not None
        assert abs(result.parameters[name].value - one.value) <= SAME * one.standard_error, name
    assert result.loss == pytest.approx(reference.loss, rel=1e-3)


@pytest.mark.parametrize("loss", LOSSES)
@pytest.mark.parametrize(
    "bounds",
    [{TENSION: (0.001, 0.5)}, {PITCH: (np.deg2rad(0.1), np.deg2rad(12.0))}, {TENSION: (3.0, 5.0)}],
    ids=["tension", "pitch", "tension-far-from-zero"],
)
def test_bounds_of_one_sign_do_not_end_the_search_where_it_begins(
    bounds: dict[str, tuple[float, float]], loss: Loss
) -> None:
    """An offset between positive bounds is no power law: taken for one, the search said "Converged" at its start."""
    middle = {name: sum(ends) / 2 for name, ends in bounds.items()}
    experiment = fake_experiment(
        noise=0.01, tension_offset=middle.get(TENSION, 0.0), pitch_offset=middle.get(PITCH, 0.0)
    )
    free = [FreeParameter(E, "Pa", 0.02e6, 40e6, "log", 1e6)]
    free += [FreeParameter(name, UNITS[name], *ends) for name, ends in bounds.items()]
    problem = make_problem(fake_robot(poissons_ratio=TRUE[NU]), [experiment], free, loss, fake_simulate)
    result = calibrate(problem, starts=1)
    assert result.converged
    assert result.parameters[E].value == pytest.approx(TRUE[E], rel=0.01)
    assert result.n_solves <= 4


@pytest.mark.slow
@pytest.mark.parametrize("shift", [-0.3, 0.0, 0.3])
@pytest.mark.parametrize("method", ["tpe", "grid"])
def test_tpe_and_grid_come_near_the_same_minimum_between_any_bounds(method: str, shift: float) -> None:
    loss = LOSSES[0]
    bounds = {E: (1e6, 5e6), TENSION: (0.25 - 2.0 + shift, 0.25 + 2.0 + shift)}
    experiment = fake_experiment(noise=0.01, tension_offset=OFFSETS[TENSION])
    free = [FreeParameter(n, UNITS[n], *b, "log" if n == E else "linear") for n, b in bounds.items()]
    problem = make_problem(fake_robot(poissons_ratio=TRUE[NU]), [experiment], free, loss, fake_simulate)
    result = calibrate(problem, method=method, trials=225, seed=1)  # type: ignore[arg-type]
    assert result.parameters[E].value == pytest.approx(TRUE[E], rel=0.06)
    assert result.parameters[TENSION].value == pytest.approx(0.25, abs=0.6)  # E makes up for some of it
