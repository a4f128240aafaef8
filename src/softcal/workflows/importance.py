"""Importance of the parameters of a calibrated run, or of a project before any calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from softcal.analysis.importance import SIMULATIONS, ImportanceStudy, Range, importance_study
from softcal.analysis.importance_verdict import importance_sentences
from softcal.calibration.interval_studies.likelihood_points import Observer
from softcal.csv_text import csv_text
from softcal.declare import checked_arguments
from softcal.executors.each import Workers
from softcal.extras import require_extra
from softcal.limits import LIMITS
from softcal.project.project import ProjectSource
from softcal.workflows.output import require_free_folder
from softcal.workflows.study_files import StudyKind
from softcal.workflows.study_source import StudySource, study_source


def study_importance(
    source: StudySource,
    *,
    seed: int = 1,
    simulations: int = SIMULATIONS,
    workers: Workers = 1,
    progress: Observer | None = None,
) -> ImportanceStudy:
    """The importance study of a source, with fANOVA's importances of the run's trials.

    Parameters
    ----------
    source
        The problem, and the run's result.
    seed
        Seed of the points.
    simulations
        Evaluations of the twin, at most.
    workers
        An executor, or a number of processes.
    progress
        Called after every evaluation of the twin with their number.

    Raises
    ------
    InputError
        See `importance`.
    SoftcalError
        See `importance`.
    """
    require_extra("importance", "SALib", where="importance")
    study = importance_study(source.problem, seed=seed, simulations=simulations, workers=workers, progress=progress)
    result = source.result
    by_trials = result is not None and result.extra.get("importance_kind") == "fanova"
    fanova = dict(result.importance) if result is not None and by_trials else {}
    return replace(study, fanova=fanova, notes=(*source.notes, *study.notes))


@checked_arguments
def importance(
    path: ProjectSource,
    *,
    calibration: str = "",
    values: Mapping[str, str] | None = None,
    seed: Annotated[int, LIMITS["seeds"]] = 1,
    simulations: Annotated[int, LIMITS["trials"]] = SIMULATIONS,
    workers: Workers = 1,
    out: str | Path | None = None,
    progress: Observer | None = None,
) -> ImportanceStudy:
    """Sobol indices of the loss and of every kind of compared channel, over the bounds of the search.

    Parameters
    ----------
    path
        A run folder, a project file, or a project.
    calibration
        Label of a run's calibration; by default the joint one, else the first.
    values
        Parameters of a project to fix, such as `{"neck.poissons_ratio": "0.45"}`.
    seed
        Seed of the points.
    simulations
        Evaluations of the twin, at most.
    workers
        An executor, or a number of processes.
    out
        A new folder for the study as JSON and CSV; a run's report shows the one in its `importance`.
    progress
        Called after every evaluation of the twin with their number.

    Raises
    ------
    InputError
        For an invalid source or option, a single free parameter, or a folder that holds files.
    SoftcalError
        Where the twin cannot be simulated within the bounds, or its surrogate does not become accurate.
    """
    if out is not None:
        require_free_folder(Path(out))
    source = study_source(path, values, calibration)
    study = study_importance(source, seed=seed, simulations=simulations, workers=workers, progress=progress)
    if out is not None:
        IMPORTANCE.write(study, source.project, source.calibration, Path(out))
    return study


def indices_csv(found: ImportanceStudy) -> str:
    """A row per output and parameter, or pair of them: its index with its error [-]."""
    rows: list[list[object]] = []
    for name, output in found.outputs.items():
        for order, indices in (("first", output.first), ("total", output.total)):
            for label, one in indices.items():
                rows.append([name, order, label, "", one.value, one.error])
        for pair in output.pairs:
            rows.append([name, "pair", *pair.labels, pair.index.value, pair.index.error])
    return csv_text(["output", "order", "parameter", "with", "index [1]", "error [1]"], rows)


INDICES = "indices.csv"
IMPORTANCE = StudyKind(
    what="the importance study",
    study=ImportanceStudy,
    file="importance.json",
    folder="importance",
    sentences=importance_sentences,
    tables={INDICES: indices_csv},
    is_of=lambda study, result: (  # whether a run searched within the studied bounds
        study.ranges == {label: Range(e.lower, e.upper, e.unit, e.scale) for label, e in result.parameters.items()}
    ),
)
