"""Cross-validation: experiments are left out of the fit in turn, and predicted.

It compares models of one robot (one modulus for all springs, or one for each) by their predictions; by the fit alone,
the model with more parameters is always better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial

import numpy as np

from softcal.calibration.problem.parameters import split
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import CalibrationResult, ExperimentFit, HeldOut
from softcal.calibration.run import calibrate
from softcal.calibration.search.search import Progress
from softcal.calibration.search.settings import SearchSettings
from softcal.display import displayed
from softcal.errors import Fault, ParameterError, unknown
from softcal.executors.executor import Executor
from softcal.html_text import summary
from softcal.units import format_quantity


@displayed
@dataclass(frozen=True)
class Prediction:
    """One fold: the experiments left out, the fit without them, and its predictions of them by experiment."""

    left_out: tuple[str, ...]
    result: CalibrationResult

    @property
    def held_out(self) -> Mapping[str, HeldOut]:
        return self.result.held_out


@displayed
@dataclass(frozen=True)
class Validation:
    """Result of a cross-validation.

    Attributes
    ----------
    models
        Label of a model -> its predictions (n_folds).
    """

    models: Mapping[str, tuple[Prediction, ...]]

    def _repr_html_(self) -> str:
        rows = [
            [model, ", ".join(one.left_out), experiment, *cells]
            for model, predictions in self.models.items()
            for one in predictions
            for experiment, held in one.held_out.items()
            for cells in [
                (name, format_quantity(error, "m" if name == "distance" else held.fit.units[name], digits=3))
                for name, error in pooled_errors([held.fit]).items()
            ]
        ]
        return summary("Predictions of what was left out", ["model", "left out", "experiment", "of", "RMS error"], rows)

    def errors(self, model: str) -> dict[str, float]:
        """Error of a model over all its predictions: RMS of all distances [m], or of each channel [SI].

        Empty if it has no prediction.
        """
        fits = [held.fit for prediction in self.models[model] for held in prediction.held_out.values()]
        return pooled_errors(fits)


def pooled_errors(fits: Sequence[ExperimentFit]) -> dict[str, float]:
    """RMS errors over several experiments [SI]: `distance` of all markers, and each other channel by name."""
    squares: dict[str, float] = {}
    counts: dict[str, int] = {}
    for fit in fits:
        for point in fit.distances.values():
            squares["distance"] = squares.get("distance", 0.0) + point.n * point.rms**2
            counts["distance"] = counts.get("distance", 0) + point.n
        for channel in fit.alone:
            n = int(np.isfinite(fit.measured[channel]).sum())
            squares[channel] = squares.get(channel, 0.0) + n * fit.rmse[channel] ** 2
            counts[channel] = counts.get(channel, 0) + n
    return {name: math.sqrt(squares[name] / counts[name]) for name in squares}


def folds_of(problem: Problem, wanted: Sequence[Sequence[str]] = ()) -> list[tuple[str, ...]]:
    """The folds: experiments to leave out together; by default each experiment by itself. Names may be patterns.

    Raises
    ------
    ParameterError
        For a name that matches no experiment, a fold that leaves nothing to fit, or a single experiment.
    """
    names = [experiment.name for experiment in problem.experiments]
    folds = [tuple(n for n in names if any(fnmatchcase(n, w) for w in fold)) for fold in wanted]
    faults = [
        unknown("there is no such experiment to leave out", "", w, names)
        for fold in wanted
        for w in fold
        if not any(fnmatchcase(n, w) for n in names)
    ]
    faults += [Fault("no experiment is left to fit", got=", ".join(fold)) for fold in folds if set(fold) == set(names)]
    faults += [
        Fault("nothing is left out", got="a fold of no experiments", allowed=", ".join(names))
        for fold in wanted
        if not fold
    ]
    if not wanted:
        if len(names) < 2:
            faults.append(Fault("one experiment cannot be left out", got=", ".join(names), allowed="two or more"))
        folds = [(name,) for name in names]
    if faults:
        raise ParameterError(faults)
    return folds


def leave_out(
    problem: Problem,
    folds: Sequence[Sequence[str]],
    settings: SearchSettings | None = None,
    *,
    workers: int | Executor = 1,
    progress: Callable[[str, Progress], None] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> tuple[Prediction, ...]:
    """Fit without each fold in turn, and predict it; ends before the first fold for which `stopped` is true.

    Parameters
    ----------
    problem
        The calibration's problem.
    folds
        Names of the experiments to leave out, fold by fold.
    settings
        Settings of the search, as for `softcal.calibration.run.calibrate`.
    workers
        Executor, or number of processes, which share the trajectories.
    progress
        Called with the fold's names and the state of its search.
    stopped
        Returns true to end.

    Raises
    ------
    SoftcalError
        See `calibrate`.
    """
    predictions: list[Prediction] = []
    for fold in folds:
        if stopped():
            break
        observer = None if progress is None else partial(progress, ", ".join(fold))
        result = calibrate(problem, settings, workers=workers, progress=observer, hold_out=tuple(fold))
        predictions.append(Prediction(tuple(fold), result))
    return tuple(predictions)


def with_split(problem: Problem, label: str) -> Problem:
    """The problem with the parameters tied under a label freed individually.

    Raises
    ------
    ParameterError
        If nothing is tied under that label.
    """
    return replace(problem, space=split(problem.space, label, problem.known))
