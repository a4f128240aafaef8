"""Intervals of a calibrated run by other methods than the quick one."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from softcal.calibration.interval_studies.bootstrap import DRAWS, bootstrap
from softcal.calibration.interval_studies.checked_interval import IntervalStudy
from softcal.calibration.interval_studies.likelihood_points import Observer
from softcal.calibration.interval_studies.posterior import SAMPLES, posterior
from softcal.calibration.interval_studies.profile import profile
from softcal.calibration.interval_studies.resampling import jackknife
from softcal.calibration.results.stored import contradiction, read_rows
from softcal.calibration.statistics.groups import KINDS
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, unknown
from softcal.executors.each import Workers, executor_of
from softcal.limits import LIMITS
from softcal.workflows.output import require_free_folder
from softcal.workflows.study_files import StudyKind, has_values
from softcal.workflows.study_source import StudySource, run_source

WITHOUT_MESH = (
    "The error of the mesh is in the intervals of the calibration, but in neither of those compared here: it is the "
    "same in both."
)
METHODS = ("profile", "posterior", "jackknife", "bootstrap")
GROUPED = ("jackknife", "bootstrap")
"""Methods that take groups of measurements."""


def study_intervals(
    source: StudySource,
    by: str = "profile",
    *,
    over: str = "",
    samples: int | None = None,
    seed: int = 1,
    workers: Workers = 1,
    progress: Observer | None = None,
) -> IntervalStudy:
    """The intervals of a source by a method.

    Parameters
    ----------
    source
        A calibration of a run.
    by
        The method, one of `METHODS`.
    over
        Kind of group of a jackknife or a bootstrap; see `intervals`.
    samples, seed
        Draws of a posterior or a bootstrap, and the seed of its random numbers.
    workers
        An executor, or a number of processes.
    progress
        Called after every trajectory with their number.

    Raises
    ------
    InputError
        See `intervals`.
    SoftcalError
        Where the twin cannot be simulated, or the likelihood has no minimum near the values.
    """
    check_method(by, over)
    problem, theta = source.problem, source.theta
    with executor_of(workers) as executor:
        if by == "profile":
            study = profile(problem, theta, workers=executor, progress=progress)
        elif by == "jackknife":
            study = jackknife(problem, theta, over=over)
        else:
            draws = {"posterior": SAMPLES, "bootstrap": DRAWS}[by] if samples is None else samples
            options: dict[str, Any] = {"samples": draws, "seed": seed, "workers": executor}
            if by == "posterior":
                study = posterior(problem, theta, **options, progress=progress)
            else:
                study = bootstrap(problem, theta, over=over, **options, progress=progress)
    mesh = (WITHOUT_MESH,) if source.includes_mesh else ()
    return replace(study, notes=(*source.notes, *mesh, *study.notes))


def check_method(by: str, over: str = "") -> None:
    """Check that there is a method of this name, and that it takes such groups.

    Raises
    ------
    InputError
        Where there is no such method, or it takes no such groups.
    """
    if by not in METHODS:
        raise InputError(unknown("this is no method for intervals", "--by", by, METHODS))
    if over and by not in GROUPED:
        raise InputError(Fault(f"'{by}' takes no groups", "--over", f"'{over}'", f"--by {' or '.join(GROUPED)}"))
    if over and over not in KINDS:
        raise InputError(unknown("this is no kind of group", "--over", over, KINDS))


@checked_arguments
def intervals(  # noqa: PLR0913 (one keyword for each option)
    path: str | Path,
    *,
    by: str = "profile",
    over: str = "",
    calibration: str = "",
    samples: Annotated[int, LIMITS["samples"]] | None = None,
    seed: Annotated[int, LIMITS["seeds"]] = 1,
    workers: Workers = 1,
    out: str | Path | None = None,
    progress: Observer | None = None,
) -> IntervalStudy:
    """95 % intervals of a calibrated run where the quadratic model may not do, beside the quick ones.

    Parameters
    ----------
    path
        A run folder.
    by
        "profile": fits with one parameter fixed; "posterior": draws by emcee with a surrogate of the twin;
        "jackknife": one group of measurements left out at a time; "bootstrap": groups with random weights.
    over
        Of a jackknife or a bootstrap, the kind of group: "experiments", "actuators", "weights", "markers", "cycles", or
        pieces of the "records". By default experiments, of three or more, else records.
    calibration
        Label of a run's calibration; by default the joint one, else the first.
    samples, seed
        Of a posterior or a bootstrap: the number of draws, by default 10,000 or 2000, and the seed of its
        random numbers.
    workers
        An executor, or a number of processes.
    out
        A new folder for the study as JSON and CSV.
    progress
        Called after every trajectory with their number.

    Raises
    ------
    InputError
        For an invalid run or option, a calibration that has not converged, or a folder that holds files.
    SoftcalError
        Where the twin cannot be simulated, or the likelihood has no minimum near the values.
    """
    check_method(by, over)
    if out is not None:
        require_free_folder(Path(out))
    source = run_source(Path(path), calibration)
    study = study_intervals(source, by, over=over, samples=samples, seed=seed, workers=workers, progress=progress)
    if out is not None:
        INTERVALS.write(study, source.project, source.calibration, Path(out))
    return study


def default_folder(run: Path, by: str, over: str = "") -> Path:
    """Default folder of a study: in the run.

    Parameters
    ----------
    run
        The run folder.
    by
        The method.
    over
        Kind of group.
    """
    return run / "-".join(["intervals", by, *([over] if over else [])])


def points_csv(found: IntervalStudy) -> str:
    """A row per point: the parameters [SI], and where there is a likelihood its excess over the least."""
    header = [f"{label} [{found.intervals[label].unit}]" for label in found.points]
    columns = list(found.points.values())
    if found.excess:
        header, columns = [*header, EXCESS], [*columns, found.excess]
    return csv_text(header, zip(*columns, strict=True))


def _with_points(study: IntervalStudy, folder: Path) -> IntervalStudy:
    """A study with the points of its table."""
    path = folder / POINTS
    header, rows = read_rows(path, INTERVALS.what)
    columns: dict[str, tuple[float, ...]] = {}
    for title, cells in zip(header, zip(*rows, strict=True) if rows else [()] * len(header), strict=True):
        columns[title.rpartition(" [")[0] or title] = tuple(_number(path, cell) for cell in cells)
    excess = columns.pop(EXCESS, ())
    if columns and set(columns) != set(study.intervals):
        raise contradiction(path, INTERVALS.what, f"its columns are not the parameters of {INTERVALS.file}")
    return replace(study, points=columns, excess=excess)


def _number(path: Path, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise contradiction(path, INTERVALS.what, f"'{cell[:40]}' stands in the place of a number")
    return value


POINTS, EXCESS = "points.csv", "excess"
INTERVALS = StudyKind(
    what="the interval study",
    study=IntervalStudy,
    file="intervals.json",
    sentences=lambda study: study.sentences,
    tables={POINTS: points_csv},
    is_of=lambda study, result: has_values(result, {label: one.value for label, one in study.intervals.items()}),
    slim=lambda study: replace(study, points={}, excess=()),
    complete=_with_points,
)
