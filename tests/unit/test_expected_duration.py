"""How long a calibration by another engine is expected to take: counted right, and said before it begins."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from project_case import write_project
from sofa_case import use_fake
from typer.testing import CliRunner

from softcal.cli import app
from softcal.errors import SimulationError
from softcal.project.project import load
from softcal.twin.response import Response
from softcal.twin.simulate import simulate
from softcal.workflows.calibration import plan
from softcal.workflows.expected_duration import Expected, expected_duration

SECOND = """\
  again:
    cable: front
    plate: plate
    files:
      - path: data/pull.csv
        columns:
          time: {name: Time}
          shortening: {name: Displacement, unit: mm}
          tension: {name: Force, unit: N}
          pitch: {name: Pitch, unit: deg}
    settings: {bar.poissons_ratio: 0.40}
parameters:
"""


class Counting:
    """An engine that counts what another one without derivatives would simulate."""

    def __init__(self) -> None:
        self.n = 0

    def __call__(self, robot, protocol, theta=None, *, sensitivities=(), snapshots=False) -> Response:
        self.n += 1 + len(sensitivities)
        return simulate(robot, protocol, theta, sensitivities=sensitivities, snapshots=snapshots)


def problems_of(path: Path, engine, **options):
    settings, problems = plan(load(path), **options)
    return settings, {label: replace(problem, simulate=engine) for label, problem in problems.items()}


def test_the_count_is_what_an_evaluation_asks_for(tmp_path: Path) -> None:
    engine = Counting()
    _, problems = problems_of(write_project(tmp_path, ("parameters:\n", SECOND)), engine)
    (problem,) = problems.values()
    for jacobian in (False, True):
        engine.n = 0
        problem.evaluate(problem.space.start, jacobian=jacobian)
        assert problem.n_simulations(jacobian=jacobian) == engine.n == (4 if jacobian else 2)


def test_searches_and_held_out_predictions_are_counted(tmp_path: Path) -> None:
    path = write_project(tmp_path, ("parameters:\n", SECOND))
    settings, problems = problems_of(path, Counting(), method="tpe", trials=50, fit="both")
    every = expected_duration(problems, settings.search, workers=2)
    assert every.simulations == (50 + 50 + 100, 50 + 50 + 100)
    assert every.held_out == (0, 0)
    assert every.duration[0] == pytest.approx(every.seconds * 100)
    settings, problems = problems_of(path, Counting(), hold_out=["again"])
    some = expected_duration(problems, settings.search)
    assert some.simulations == (4 * 2, 12 * 2)
    assert some.held_out == (2, 6)  # it has a slack of its own
    assert some.seconds > 0.0


def test_predictions_run_in_one_process() -> None:
    assert Expected(3.0, (10, 20), (1, 2), workers=2).duration == (18.0, 36.0)


def test_an_engine_that_fails_at_the_start_says_so_before_it_begins(tmp_path: Path) -> None:
    def failing(robot, protocol, theta=None, *, sensitivities=(), snapshots=False) -> Response:
        return Response({}, {}, "It folds.", succeeded=False, n_factorisations=0)

    settings, problems = problems_of(write_project(tmp_path), failing)
    with pytest.raises(SimulationError, match=r"The twin at the start values: It folds\."):
        expected_duration(problems, settings.search)


def test_the_command_says_it_before_the_search(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use_fake(monkeypatch)
    path = write_project(tmp_path)
    options = ["--engine", "sofa", "--method", "tpe", "--trials", "2", "--no-report", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(app, ["calibrate", str(path), *options])
    assert "One simulation by sofa takes" in done.output, done.output
    said = done.output.index("Expected:")
    assert "for 2 of the search, if all take as long." in done.output[said:].replace("\n", " ")
    own = CliRunner().invoke(app, ["calibrate", str(path), "--no-report", "--out", str(tmp_path / "own")])
    assert own.exit_code == 0, own.output
    assert "Expected:" not in own.output
