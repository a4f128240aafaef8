"""Do 95 % intervals hold the truth in 95 % of the studies? Synthetic studies with independent noise under each loss."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from dask_cluster import dask_cluster

from benchmarks import coverage
from benchmarks.neck_case import PITCH, TENSION, pull
from benchmarks.table_twins import NU, E, NeckTable
from softcal.calibration.run import calibrate
from softcal.executors.each import executor_on
from softcal.twin.parameters import with_parameters
from softcal.twin.simulate import simulate

CASES = {case.name: case for case in coverage.CASES}
AT_LENGTH = {"likelihood": 100, "papers": 100, "likelihood-understated": 100, "papers-1000": 100, "distance": 50}


@pytest.mark.slow
@pytest.mark.parametrize(  # the page has 200 studies of each
    ("name", "studies"),
    [
        ("likelihood", 25),
        pytest.param("papers", 40, marks=pytest.mark.long),
        *(pytest.param(name, studies, marks=pytest.mark.long) for name, studies in AT_LENGTH.items()),
    ],
)
def test_intervals_hold_the_truth(name: str, studies: int) -> None:
    found = coverage.coverage(replace(CASES[name], states_drift=True), studies)
    assert [one.parameter for one in found] == list(CASES[name].truth)
    assert all(one.studies == one.given == studies for one in found)
    shares = {one.parameter: one.share for one in found}
    # Of so many intervals of 95 % that hold or do not: three standard deviations of the count.
    three_sigma = 3 * math.sqrt(0.95 * 0.05 / studies)
    assert all(abs(share - 0.95) <= three_sigma for share in shares.values()), shares
    assert abs(np.mean(list(shares.values())) - 0.95) <= 0.3 / math.sqrt(studies), shares
    # They hold because they are right, not because they are long.
    assert all(one.ratio < 1.3 for one in found), {one.parameter: one.ratio for one in found}


@pytest.mark.long
@pytest.mark.parametrize("name", ["papers", "likelihood-steady"])
def test_a_drift_that_may_be_makes_intervals_longer_by_less_than_half(name: str) -> None:
    """Of right models, without a statement on drifts: nothing is called a misfit."""
    studies = 40
    unstated = coverage.coverage(CASES[name], studies)
    stated = coverage.coverage(replace(CASES[name], states_drift=True), studies)
    for one, other in zip(unstated, stated, strict=True):
        # A drift has no degrees of freedom to be estimated with: where those of the noise are few, Student's t is less.
        assert min(one.share, other.share) >= 0.85
        assert 1.0 - 1e-9 <= one.ratio / other.ratio <= 1.5
        assert one.misfits is not None
        assert one.misfits <= 0.05 * studies


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "papers-stiffer",
        "likelihood-outliers",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("likelihood-softer", "papers-loop")),
    ],
)
def test_misfits_are_said_with_their_cause(name: str) -> None:
    found = coverage.coverage(CASES[name], 8)
    assert all(one.misfits == one.named == 8 for one in found)


@pytest.mark.slow
def test_no_residual_shows_a_drift_of_load_cell_and_imu() -> None:
    """The standard errors of drifts over the noise, with the parameters free and the noise's correlation known: as
    docs/uncertainty.md states them.
    """
    case = CASES["likelihood-steady"]
    problem = coverage.study(case, 0)
    space = problem.space
    seen = problem.evaluate(case.truth, jacobian=True)
    at = np.arange(case.n)
    root = np.linalg.cholesky(case.correlation ** np.abs(at[:, None] - at))
    time = np.linspace(0.0, 1.0, case.n)
    rows = []
    for place, block in enumerate(block for block in seen.blocks if block.experiment):
        assert block.jacobian is not None
        answer = block.jacobian * space.jacobian(space.to_search(case.truth)) / coverage.NOISE[block.channel]
        rows.append(np.linalg.solve(root, np.column_stack([answer, time * (place == 0), time * (place == 1)])))
    columns = np.concatenate(rows)
    errors = np.sqrt(np.diag(np.linalg.inv(columns.T @ columns)))[-2:]
    assert errors == pytest.approx([4.6, 2.6], abs=0.05)


@pytest.mark.long
def test_studies_on_a_cluster_are_those_of_one_process(tmp_path: Path) -> None:
    """Of markers: each worker makes the table of the twin once."""
    pytest.importorskip("distributed")
    case = CASES["distance"]
    with dask_cluster(tmp_path) as cluster, executor_on(f"dask:{cluster.address}") as executor:
        there = coverage.coverage(case, 6, executor)
        assert sum(worker.done for worker in executor.workers) == 6
    assert there == coverage.coverage(case, 6)


@pytest.mark.slow
def test_the_necks_table_answers_as_the_twin_does() -> None:
    robot, table = coverage.neck()
    there = with_parameters(robot, {E: 2.7e6, NU: 0.3713})
    told = pull(np.linspace(1e-3, 34e-3, 7))
    twin = simulate(there, told, sensitivities=[E, NU], curve_tolerance=0.0)
    read = table(there, told, sensitivities=[E, NU])
    for channel in (TENSION, PITCH):
        size = np.abs(twin.channels[channel]).max()
        assert read.channels[channel] == pytest.approx(twin.channels[channel], abs=1e-7 * size)
        assert read.slopes[channel] == pytest.approx(twin.slopes[channel], rel=1e-6)
        for name in (E, NU):
            by = twin.sensitivities[channel][name]
            assert read.sensitivities[channel][name] == pytest.approx(by, abs=1e-5 * np.abs(by).max() + 1e-12)


def bent_table() -> NeckTable:
    """A table of low degree: tension over modulus d (1 + 20 d + nu), pitch 20 d."""
    # By Chebyshev polynomials on 0 to 0.04 m and 0.3 to 0.5: d = 0.02 (1 + x), nu = 0.4 + 0.1 y.
    tension = 1e-4 * np.array([[1 + 20 * 0.02 + 0.4, 0.1], [20 * 0.02, 0.0]])
    return NeckTable(tension, np.array([[20.0, 0.0], [0.0, 0.0]]), (0.0, 0.04), (0.3, 0.5))


def test_a_table_is_read_with_its_exact_derivatives() -> None:
    from fake_twin import fake_robot

    table, told = bent_table(), pull(np.array([-0.001, 0.0, 0.013, 0.04]))
    robot = with_parameters(fake_robot(), {E: 2e6, NU: 0.45})
    read = table(robot, told, sensitivities=[E, NU])
    d = np.maximum(told.commands["front"].values, 0.0)
    assert read.channels[TENSION] == pytest.approx(2e6 * 1e-4 * d * (1 + 20 * d + 0.45))
    assert read.sensitivities[TENSION][E] == pytest.approx(1e-4 * d * (1 + 20 * d + 0.45))
    assert read.sensitivities[TENSION][NU] == pytest.approx(2e6 * 1e-4 * d)
    assert read.slopes[TENSION] == pytest.approx(np.where(d > 0, 2e6 * 1e-4 * (1 + 40 * d + 0.45), 0.0))
    assert read.channels[PITCH] == pytest.approx(20 * d)
    assert not table(with_parameters(robot, {NU: 0.2}), told).succeeded


def test_a_study_goes_through_calibrate_and_is_the_same_again(monkeypatch: pytest.MonkeyPatch) -> None:
    from fake_twin import fake_robot

    monkeypatch.setattr(coverage, "neck", lambda: (fake_robot(), bent_table()))
    problem, again, other = (coverage.study(CASES["likelihood"], seed) for seed in (1, 1, 2))
    tension = [p.experiments[0].dataset.values("tension") for p in (problem, again, other)]
    assert np.array_equal(tension[0], tension[1])
    assert not np.array_equal(tension[0], tension[2])
    assert problem.space.parameters[-1].prior_mean != other.space.parameters[-1].prior_mean
    found = calibrate(problem, starts=1)
    for name, true in coverage.TRUE.items():
        assert abs(found.parameters[name].value - true) < 5 * found.parameters[name].standard_error
    rows = coverage.coverage(CASES["likelihood"], 2)
    assert [row.parameter for row in rows] == list(coverage.TRUE)
    assert all(row.given == 2 for row in rows)


def test_the_page_is_the_one_that_the_command_writes() -> None:
    rows = [coverage.Coverage(CASES["papers"], E, 200, 198, 190, 1.04)]
    told = coverage.page(rows)
    assert "| neck, `papers`, friction known | neck.youngs_modulus | 2.3 MPa | 198 of 200 | 96.0 % | 1.04 |" in told
    kept = coverage.PAGE.read_text(encoding="utf-8")
    stored = json.loads(coverage.STORED.read_text(encoding="utf-8"))
    rows = [coverage.Coverage(case, **row) for case in coverage.CASES for row in stored[case.name]]
    assert coverage.page(rows) == kept
    for case in coverage.CASES:
        alike = [one for one in coverage.CASES if one.words == case.words]
        # Of several pulls each has its own slack, and there is none in common.
        n_rows = sum(len(one.truth) - (len(one.reaches) > 1) for one in alike)
        assert kept.count(f"| {case.words} |") == n_rows
