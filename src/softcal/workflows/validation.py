"""Cross-validation of projects: each experiment is left out and predicted, for one or several models of the robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from softcal.analysis.validation import Prediction, Validation, folds_of, leave_out, with_split
from softcal.calibration.search.interrupts import stoppable
from softcal.calibration.search.search import Progress
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError, ParameterError
from softcal.executors.each import Workers
from softcal.project.project import ProjectSource, project_of
from softcal.workflows.calibration import make_problem
from softcal.workflows.output import require_free_file, write_new_file

# Called after every trial with the model, the left-out experiments, and the progress of the fit.
Observer = Callable[[str, str, Progress], None]


@checked_arguments
def validate(
    projects: ProjectSource | Mapping[str, ProjectSource],
    *,
    hold_out: Sequence[Sequence[str]] = (),
    split: Sequence[str] = (),
    workers: Workers = 1,
    progress: Observer | None = None,
) -> Validation:
    """Leave experiments out, fit the others jointly, and predict what was left out.

    Parameters
    ----------
    projects
        A project, or the path of a project file; or label -> each of several models of one robot, which must have the
        same experiments.
    hold_out
        Experiments to leave out together, fold by fold; names may be patterns. None: each by itself, in turn.
    split
        Tied parameters that further models leave untied: each is compared with the projects as they are.
    workers
        An executor, or a number of processes.
    progress
        Called after every trial.

    Raises
    ------
    InputError
        For a project that cannot be loaded.
    ParameterError
        For experiments or tied parameters that do not exist, or projects whose experiments differ.
    CalibrationError
        Where nothing could be simulated.
    """
    if isinstance(projects, Mapping):
        if not projects:
            raise InputError(Fault("there is no project to validate", "projects", "an empty mapping"))
        labelled = {label: project_of(source) for label, source in projects.items()}
    else:
        project = project_of(projects)
        labelled = {project.name: project}
    problems = {label: (make_problem(one), one.calibration.search) for label, one in labelled.items()}
    names = {label: ", ".join(e.name for e in problem.experiments) for label, (problem, _) in problems.items()}
    first, *others = names
    faults = [
        Fault("the projects have different experiments", other, names[other], names[first])
        for other in others
        if names[other] != names[first]
    ]
    if faults:
        raise ParameterError(faults)
    for label, (problem, settings) in list(problems.items()):
        for tied in split:
            problems[f"{label}, {tied} split"] = with_split(problem, tied), settings
    folds = folds_of(next(iter(problems.values()))[0], hold_out)
    models: dict[str, tuple[Prediction, ...]] = {}
    with stoppable() as stop:
        for label, (problem, settings) in problems.items():
            models[label] = leave_out(
                problem,
                folds,
                settings,
                workers=workers,
                progress=None if progress is None else partial(progress, label),
                stopped=lambda: stop.by is not None,
            )
    if stop.by is not None:
        raise stop.by
    return Validation(models)


def write_validation(found: Validation, path: str | Path) -> None:
    """Write the table of predictions as CSV: a row for every model, experiment left out, and marker or channel.

    Raises
    ------
    StorageError
        Where the file exists or cannot be written.
    """
    require_free_file(Path(path))
    write_new_file(Path(path), validation_csv(found))


def validation_csv(found: Validation) -> str:
    """The predictions as CSV text; errors in SI, an empty cell where one does not apply."""
    header = ["model", "left out", "experiment", "of", "unit", "RMSE", "mean", "largest", "RMSE [% of length]", "n [1]"]
    rows: list[list[object]] = []
    for model, predictions in found.models.items():
        for prediction in predictions:
            values = "; ".join(f"{name} = {e.value:.6g} {e.unit}" for name, e in prediction.result.parameters.items())
            for experiment, test in prediction.held_out.items():
                first = [model, ", ".join(prediction.left_out), experiment]
                for point, d in test.fit.distances.items():
                    share = "" if test.fit.length is None else 100 * d.rms / test.fit.length
                    rows.append([*first, point, "m", d.rms, d.mean, d.max, share, d.n, values])
                for channel in test.fit.alone:
                    n, rmse = len(test.fit.measured[channel]), test.fit.rmse[channel]
                    rows.append([*first, channel, test.fit.units[channel], rmse, "", "", "", n, values])
    return csv_text([*header, "parameters"], rows)
