"""The record of whole cycles of examples/neck-bench: its constants are found again, from loading and unloading at once.

The record is the calibrated twin's own, so without noise every constant has to come out as it was put in.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from example_script import example_script

from softcal.calibration.problem.parameters import SearchSpace
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import CalibrationResult
from softcal.calibration.run import calibrate
from softcal.experiments.steps.cycles import find_cycles
from softcal.project.project import Project, load
from softcal.twin.parameters import robot_parameters
from softcal.units import parse_quantity
from softcal.workflows.calibration import make_problem

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "neck-bench"
FRICTION = "pulleys.friction_coefficient"
E, SHARE = "neck.youngs_modulus", "neck.relaxing_share1"
MOST = 15  # trajectories


@pytest.fixture(scope="module")
def cycles() -> ModuleType:
    return example_script(EXAMPLE / "generate_cycles.py")


@pytest.fixture(scope="module")
def project() -> Project:
    return load(EXAMPLE / "cycles.yaml")


@pytest.fixture(scope="module")
def truth(cycles: ModuleType) -> dict[str, Any]:
    return cycles.read_truth()


@pytest.fixture(scope="module")
def record(cycles: ModuleType, truth: dict[str, Any], project: Project) -> Any:
    """Without noise."""
    return cycles.perform(truth, project)


def true_values(project: Project, truth: dict[str, Any]) -> dict[str, float]:
    known = robot_parameters(project.robot)
    values = {name: parse_quantity(text, known[f"neck.{name}"].unit) for name, text in truth["neck"].items()}
    found = {f"neck.{name}": value for name, value in values.items()}
    return {**found, FRICTION: truth["pulleys"]["friction_coefficient"]}


def problem_of(project: Project, record: Any) -> Problem:
    """The project's problem, of this record."""
    problem = make_problem(project)
    (experiment,) = problem.experiments
    channels = experiment.dataset.channels
    measured = {name: replace(one, values=getattr(record, name)) for name, one in channels.items()}
    data = find_cycles(replace(experiment.dataset, channels=measured, cycle=None, provenance=()))
    return replace(problem, experiments=(replace(experiment, dataset=data),))


@pytest.mark.long  # five minutes: nine trajectories of 217 samples with nine derivatives each
def test_without_noise_every_constant_is_found(project: Project, truth: dict[str, Any], record: Any) -> None:
    found = calibrate(problem_of(project, record), method="least-squares", starts=1)
    assert found.converged, found.status
    assert found.n_solves <= MOST
    for name, value in true_values(project, truth).items():
        if name in found.parameters:
            assert found.parameters[name].value == pytest.approx(value, rel=0.01), name


@pytest.mark.long  # as above
def test_with_noise_the_intervals_contain_the_constants(project: Project, truth: dict[str, Any]) -> None:
    """The record that is shipped: 1 % of either channel's peak, correlated over three rows."""
    found = calibrate(make_problem(project), method="least-squares", starts=1)
    assert found.converged, found.status
    assert found.n_solves <= MOST
    true = true_values(project, truth)
    for name, estimate in found.parameters.items():
        assert estimate.interval is not None
        low, high = estimate.interval
        assert low <= true[name] <= high, name
        assert high < 12 * low, name
    (fit,) = found.experiments.values()
    assert len(fit.cycles) == truth["machine"]["cycles"]
    for cycle in fit.cycles:
        assert cycle.simulated.lost_energy == pytest.approx(cycle.measured.lost_energy, rel=0.1)
        assert cycle.simulated.peak_effort == pytest.approx(cycle.measured.peak_effort, rel=0.04)
    first, last = fit.cycles[0].simulated, fit.cycles[3].simulated  # before the faster half
    assert 1.005 < first.peak_effort / last.peak_effort < 1.1


# --- friction of the pulleys, and memory of the material --------------------------------------------------------------


def relaxing(project: Project, cycles: ModuleType, truth: dict[str, Any], n_rows: int | None) -> CalibrationResult:
    """A neck that relaxes alone, fitted to the first rows of a slow and a fast cycle that it made itself."""
    time, shortening = cycles.rows({**truth["machine"], "cycles": 2, "rows": 6})
    problem = make_problem(project)
    (body,), (experiment,) = problem.robot.bodies, problem.experiments
    kept = {name: value for name, value in body.parameters.items() if not name.startswith(("softening", "flow"))}
    robot = replace(problem.robot, bodies=(replace(body, parameters=kept, history=("relaxation-2",)),))
    space = SearchSpace(tuple(one for one in problem.space.parameters if one.name in (E, SHARE, FRICTION)))

    def with_values(values: dict[str, np.ndarray]) -> Problem:
        channels = {name: replace(one, values=values[name]) for name, one in experiment.dataset.channels.items()}
        data = replace(experiment.dataset, channels=channels, cycle=None)
        return Problem(robot, (replace(experiment, dataset=data),), space, problem.loss)

    driven = {"time": time[:n_rows], "shortening": shortening[:n_rows]}
    empty = np.zeros(len(driven["time"]))
    (seen,) = with_values({**driven, "tension": empty, "pitch": empty}).evaluate(space.start).observations.values()
    noise = np.random.default_rng(3).standard_normal((2, len(empty)))
    measured = {
        "tension": seen.predicted["tension"] + 0.03 * noise[0],
        "pitch": seen.predicted["pitch"] + 1e-3 * noise[1],
    }
    return calibrate(with_values({**driven, **measured}), method="least-squares", starts=1)


def told(result: CalibrationResult) -> str:
    return " ".join(note.text for note in result.notes)


@pytest.mark.slow
def test_while_only_pulled_friction_of_pulleys_and_stiffness_are_said_to_be_inseparable(
    project: Project, cycles: ModuleType, truth: dict[str, Any]
) -> None:
    found = relaxing(project, cycles, truth, 7)
    assert f"The data cannot separate {E}" in told(found)
    assert FRICTION in told(found)
    assert found.parameters[FRICTION].standard_error is None


@pytest.mark.slow
def test_cycles_tell_them_apart(project: Project, cycles: ModuleType, truth: dict[str, Any]) -> None:
    found = relaxing(project, cycles, truth, None)
    assert "cannot separate" not in told(found)
    for name in (FRICTION, SHARE):
        assert found.parameters[name].standard_error < 0.3 * found.parameters[name].value


# --- the files ------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_the_generator_writes_the_record_that_is_kept(
    cycles: ModuleType, truth: dict[str, Any], record: Any, tmp_path: Path
) -> None:
    cycles.write_record(tmp_path / "cycles.csv", cycles.with_noise(record, truth["noise"], truth["noise"]["seed"]))
    written, kept = (np.loadtxt(folder / "cycles.csv", delimiter=",", skiprows=1) for folder in (tmp_path, EXAMPLE))
    np.testing.assert_allclose(written, kept, rtol=0.0, atol=1.01e-3)


def test_the_project_does_not_know_the_truth(truth: dict[str, Any]) -> None:
    text = (EXAMPLE / "cycles.yaml").read_text(encoding="utf-8")
    fitted = [name for name in truth["neck"] if f"neck.{name}: {{bounds" in text]
    assert len(fitted) == 8
    for name in fitted:
        assert f"{name}: {truth['neck'][name]}\n" not in text
