"""The next test after a calibrated run: candidates of the project and of softcal, ranked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from softcal.analysis.candidate import Candidate
from softcal.analysis.default_candidates import default_candidates, like_by_default
from softcal.analysis.next_test import NextTests, next_tests, verdict
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, StorageError
from softcal.executors.each import Workers
from softcal.workflows.output import require_free_folder
from softcal.workflows.study_files import StudyKind
from softcal.workflows.study_source import StudySource, study_source


@checked_arguments
def next_test(
    run: str | Path,
    *,
    candidates: Sequence[Candidate] = (),
    parameter: str = "",
    calibration: str = "",
    out: str | Path | None = None,
    workers: Workers = 1,
) -> NextTests:
    """Rank tests that could be made after a run by the interval that one parameter is expected to have then.

    Those of the project, and changes of its experiments.

    Parameters
    ----------
    run
        A run folder.
    candidates
        Further ones.
    parameter
        Label of the parameter whose interval counts; by default the first of the robot.
    calibration
        Label of the run's calibration; by default the joint one, else the first.
    out
        A new folder for the ranking as JSON and CSV.
    workers
        An executor, or a number of processes, which share the trajectories.

    Raises
    ------
    InputError
        For an unknown parameter or calibration, or a calibration without intervals.
    StorageError
        For a folder that is no run, or an `out` that holds files.
    CalibrationError
        Where the noise cannot be estimated from the experiments.
    SimulationError
        Where the twin cannot be simulated at the calibrated values.
    """
    if out is not None:
        require_free_folder(Path(out))
    source = run_source(Path(run), calibration)
    ranking = rank(source, parameter, candidates, workers)
    if out is not None:
        NEXT_TEST.write(ranking, source.project, source.calibration, Path(out))
    return ranking


def run_source(run: Path, calibration: str = "") -> StudySource:
    """A calibration of a run that has intervals.

    Raises
    ------
    InputError
        For an unknown calibration, a sweep, or a search that did not converge.
    StorageError
        For a path that is no run.
    """
    if not run.is_dir():
        allowed = "a folder that softcal calibrate wrote"
        raise StorageError(
            Fault("there is no run here", str(run), allowed=allowed, attempt="softcal calibrate PROJECT")
        )
    source = study_source(run, None, calibration)
    if source.result is not None and source.result.missed_minimum:
        raise InputError(
            Fault("the calibration has no intervals to shorten", source.calibration, "a search that did not converge")
        )
    return source


def rank(
    source: StudySource, parameter: str = "", candidates: Sequence[Candidate] = (), workers: Workers = 1
) -> NextTests:
    """The candidates, those of a run's project and those of softcal, ranked; see `next_test`.

    Parameters
    ----------
    source
        A calibration of a run.
    parameter
        Label of the parameter whose interval counts; by default the first of the robot.
    candidates
        Further ones.
    workers
        An executor, or a number of processes, which share the trajectories.
    """
    problem = source.problem
    controls = {part.name: part.controls for part in problem.robot.commandable}
    tests = [*candidates, *source.project.candidates]
    like = [like_by_default(problem.experiments, controls.get(one.actuator, ()), [one.control]) for one in tests]
    stated = [replace(test, like=test.like or default.name) for test, default in zip(tests, like, strict=True)]
    names = {test.name for test in stated}
    ranking = next_tests(
        problem,
        source.theta,
        [*stated, *(test for test in default_candidates(problem) if test.name not in names)],
        parameter,
        mesh_error=source.includes_mesh,
        workers=workers,
    )
    return replace(ranking, notes=(*source.notes, *ranking.notes))


def candidates_csv(found: NextTests) -> str:
    """A row for each candidate, in the order of the ranking; the interval in SI."""
    header = ["candidate", "like", "parameter", "unit", "lower", "upper", "of present length [1]"]
    rows = [
        [one.candidate.name, one.candidate.like, found.parameter, found.unit, *(one.interval or (None, None))]
        + [one.share, one.joint, one.failure]
        for one in found.outlooks
    ]
    return csv_text([*header, "all parameters, of present standard errors [1]", "not possible because"], rows)


NEXT_TEST = StudyKind(
    what="the ranking",
    study=NextTests,
    file="next-test.json",
    sentences=lambda study: [verdict(study)],
    tables={"candidates.csv": candidates_csv},
)
