"""Sobol indices: against closed forms, and over a search box against sums over a grid of the twin itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_twin import NU, E, fake_experiment, fake_robot, fake_simulate, soft_necks_fail
from project_case import write_project

from softcal.analysis.box_surrogate import ERROR, LOSS, kind_of, residuals
from softcal.analysis.importance import ImportanceStudy, OutputImportance, Range, importance_study
from softcal.analysis.importance_verdict import importance_sentences, index_text
from softcal.analysis.sobol import Index, box_points, sobol_indices
from softcal.calibration.problem.parameters import FreeParameter
from softcal.calibration.problem.problem import Problem, make_problem
from softcal.errors import CalibrationError, InputError, ParameterError, SimulationError
from softcal.project.project import load
from softcal.twin.parameters import parameter_values
from softcal.twin.protocol import Protocol
from softcal.twin.response import Response
from softcal.twin.robot import Robot
from softcal.workflows.calibration import make_problem as project_problem

WITHIN = 0.02


def check(index: Index, expected: float) -> None:
    assert index.value == pytest.approx(expected, abs=0.01)
    # 95 % intervals: a few of many do not contain the value, by little.
    assert abs(index.value - expected) < 2 * index.error + 1e-4


def test_ishigamis_function():
    a, b = 7.0, 0.1
    x = np.pi * (2 * box_points(3, 1) - 1)
    values = np.sin(x[:, 0]) + a * np.sin(x[:, 1]) ** 2 + b * x[:, 2] ** 4 * np.sin(x[:, 0])
    one, two = 0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8
    both = b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    whole = one + two + both
    found = sobol_indices(100.0 + values[:, None], 3)
    for index, expected in zip(found.first, (one, two, 0.0), strict=True):
        check(index, expected / whole)
    for index, expected in zip(found.total, (one + both, two, both), strict=True):
        check(index, expected / whole)
    for (i, j, index), expected in zip(found.pairs, (0.0, both, 0.0), strict=True):
        assert i < j
        check(index, expected / whole)
    assert [index.is_known for _, _, index in found.pairs] == [False, True, False]
    assert not found.first[2].is_known


def test_an_index_of_many_values_is_that_of_their_summed_variances():
    z = box_points(2, 3)
    # x has variance 1/12, x y - x/2 - y/2 + 1/4 has 1/144.
    x, y = z.T
    values = np.stack([3 * x, 4 * y, 12 * (x - 0.5) * (y - 0.5)], axis=1)
    whole = 9 / 12 + 16 / 12 + 1
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    for seen in (values, values @ turn):
        found = sobol_indices(seen, 2)
        for index, expected in zip(found.first, (9 / 12, 16 / 12), strict=True):
            check(index, expected / whole)
        check(found.pairs[0][2], 1 / whole)


def test_a_surrogates_error_is_in_the_error_of_the_index():
    values = box_points(2, 1) @ np.array([[1.0], [1.0]])
    exact, rough = (sobol_indices(values, 2, error).first[0] for error in (0.0, 0.1))
    # A half of the variance: the output turned by 6 degrees has 0.4 to 0.6.
    assert rough.error - exact.error == pytest.approx(0.1 + 0.01, abs=1e-3)


def by_grid(problem: Problem, n: int = 7) -> dict[str, tuple[list[float], list[float]]]:
    """Output -> first-order and total indices of two parameters, by Gauss's rule in each, with the twin itself."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    nodes, weights = (nodes + 1) / 2, weights / 2
    seen = [[problem.evaluate(problem.space.to_model([a, b])) for b in nodes] for a in nodes]
    kinds = dict.fromkeys(kind_of(block) for block in seen[0][0].blocks)
    values = {kind: np.array([[residuals(one.blocks, kind) for one in row] for row in seen]) for kind in kinds}
    values[LOSS] = np.array([[[one.loss] for one in row] for row in seen])
    found = {}
    for name, f in values.items():
        f = f - np.einsum("a,b,abk->k", weights, weights, f)
        whole = np.einsum("a,b,abk->", weights, weights, f**2)
        over_b, over_a = np.einsum("b,abk->ak", weights, f), np.einsum("a,abk->bk", weights, f)
        first = [float(np.einsum("a,ak->", weights, mean**2) / whole) for mean in (over_b, over_a)]
        found[name] = first, [1 - first[1], 1 - first[0]]
    return found


@pytest.mark.slow
def test_over_the_box_of_a_twin_they_are_those_of_a_sum_over_a_grid(tmp_path: Path):
    problem = project_problem(load(write_project(tmp_path, ("[0.1 MPa, 40 MPa]", "[0.5 MPa, 4 MPa]"))))
    found = importance_study(problem)
    expected = by_grid(problem)
    assert set(found.outputs) == set(expected) == {"loss", "tension", "pitch"}
    for name, (first, total) in expected.items():
        output = found.outputs[name]
        assert [one.value for one in output.first.values()] == pytest.approx(first, abs=WITHIN), name
        assert [one.value for one in output.total.values()] == pytest.approx(total, abs=WITHIN), name
        assert output.surrogate_error <= ERROR
        assert all(one.error < 0.05 for one in output.first.values())
    assert expected["tension"][0][0] > 0.5  # E decides the force
    assert expected["pitch"][0][1] > 0.5  # and the slack the pitch


def fake_problem(simulate: object = fake_simulate, modulus: float = 1.2e6, ratio: float = 0.2) -> Problem:
    free = [FreeParameter(E, "Pa", modulus, 8e6, "log"), FreeParameter(NU, "1", ratio, 0.4999)]
    return make_problem(fake_robot(), [fake_experiment(noise=0.01)], free, None, simulate)


@pytest.mark.slow
def test_the_same_seed_gives_the_same_indices():
    first, again, other = (importance_study(fake_problem(), seed=seed) for seed in (1, 1, 2))
    assert first.outputs == again.outputs
    assert first.outputs != other.outputs


def test_points_that_cannot_be_simulated_are_said():
    study = importance_study(fake_problem(soft_necks_fail))  # beyond nu 0.49
    assert len(study.notes) == 1
    assert "cannot be simulated at" in study.notes[0]
    assert "No equilibrium beyond 12.0 mm." in study.notes[0]
    with pytest.raises(SimulationError, match=r"cannot be simulated at \d+ of \d+ points.* narrower bounds"):
        importance_study(fake_problem(soft_necks_fail, modulus=0.5e6))


def kinked(
    robot: Robot,
    protocol: Protocol,
    theta: Mapping[str, float] | None = None,
    *,
    sensitivities: Sequence[str] = (),
    snapshots: bool = False,
) -> Response:
    """As the fake twin, but the force jumps at a modulus."""
    found = fake_simulate(robot, protocol, theta, sensitivities=sensitivities)
    jump = 50.0 * (parameter_values(robot, theta)[E] > 3e6)
    return replace(found, channels={**found.channels, "front.tension": found.channels["front.tension"] + jump})


def test_a_surrogate_that_is_not_accurate_is_refused():
    with pytest.raises(CalibrationError, match=r"errs by .* standard deviations in the tension.* more simulations"):
        importance_study(fake_problem(kinked), simulations=120)
    with pytest.raises(CalibrationError, match=r"within 10 evaluations\. Try"):
        importance_study(fake_problem(), simulations=10)


def test_what_has_no_importance_is_refused():
    problem = fake_problem()
    one = make_problem(fake_robot(), problem.experiments, problem.space.parameters[:1])
    with pytest.raises(InputError, match="one parameter explains everything"):
        importance_study(one)
    with pytest.raises(ParameterError) as error:
        importance_study(problem, simulations=0, seed=-1)
    assert len(error.value.faults) == 2
    with pytest.raises(ParameterError, match="bound"):
        make_problem(fake_robot(), problem.experiments, [FreeParameter(NU, "1", 0.4, 0.4), problem.space.parameters[0]])


def test_an_output_that_nothing_changes_is_said():
    free = [FreeParameter(E, "Pa", 1e6, 8e6), FreeParameter("front.tension_offset", "N", -1.0, 1.0)]
    study = importance_study(make_problem(fake_robot(), [fake_experiment()], free, None, fake_simulate))
    assert set(study.outputs) == {"loss", "tension"}
    assert study.notes == ("The pitch does not change with any of the parameters.",)


def test_an_index_within_its_error_is_not_told_from_zero():
    assert index_text(Index(0.9644, 0.0043)) == "0.964 ± 0.005"
    assert index_text(Index(0.004, 0.012)) == "< 0.02"
    assert index_text(Index(-0.03, 0.012)) == "< 0.02"
    assert index_text(Index(2e-5, 1e-5)) == "< 0.001"


def study_of(first: dict[str, Index], total: dict[str, Index], pairs: tuple = ()) -> ImportanceStudy:
    ranges = {label: Range(0.0, 1.0, "1", "linear") for label in first}
    return ImportanceStudy({"tension": OutputImportance(first, total, pairs, 0.0)}, ranges, (), {}, 0.0)


def test_sentences_say_what_the_indices_show():
    sure, none = (lambda value: Index(value, 0.004)), Index(0.001, 0.002)
    alone = importance_sentences(
        study_of({"a": sure(0.7), "b": sure(0.3), "c": none}, {"a": sure(0.7), "b": sure(0.3), "c": none})
    )
    assert alone[0].endswith("these explain alone: a 70.0 ± 0.4 %, b 30.0 ± 0.4 %.")
    assert alone[1] == "Of no output does c explain 1 % over these bounds, alone or with others."
    from softcal.analysis.importance import Pair

    pair = (Pair(("a", "b"), sure(0.9)),)
    together = importance_sentences(study_of({"a": none, "b": none}, {"a": sure(0.9), "b": sure(0.9)}, pair))
    assert together[0].startswith("No parameter alone")
    assert "a and b act together: a further 90.0 ± 0.4 %." in together[1]
    assert "a acts on the tension only together with others" in together[2]
