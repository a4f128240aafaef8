"""Runs: the outcome of a run that has just ended, and the calibrations or the sweep stored in a run's folder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path

from softcal.calibration.results.result import CalibrationResult, SearchResult, SweepResult, result_html
from softcal.calibration.results.result_plots import ResultPlots
from softcal.calibration.statistics.estimate import Estimate
from softcal.display import displayed
from softcal.errors import Fault, StorageError
from softcal.html_text import paragraph
from softcal.project.calibration_schema import CalibrationSection
from softcal.project.project import Project
from softcal.twin.robot import Robot
from softcal.workflows.watching import WatchedPage, watch_run

SWEEP = "sweep"
"""The label of a sweep, in the place of a calibration's."""


@dataclass(frozen=True)
class Run(ABC):
    """A stored run.

    Attributes
    ----------
    folder
        The run's folder.
    project
        The project at the time of the run.
    settings
        The settings of its calibrations, or of its sweep.
    versions, hashes
        Package -> version; name of an input -> hash.
    created
        Start of the run (ISO 8601).
    """

    folder: Path
    project: Project
    settings: CalibrationSection
    versions: Mapping[str, str]
    hashes: Mapping[str, str]
    created: str

    def _repr_html_(self) -> str:
        return result_html(self.headline) + paragraph(f"Kept in {self.folder}.")

    @property
    @abstractmethod
    def headline(self) -> SearchResult:
        """The result that the values of the run come from."""

    @property
    def robot(self) -> Robot:
        """The robot at the values of `headline`."""
        from softcal.workflows.calibration import calibrated

        return calibrated(self.project, self.headline).robot

    def watch(self) -> WatchedPage:
        """The page of the run, without waiting; see `watch_run`.

        Raises
        ------
        InputError
            See `watch_run`.
        """
        return watch_run(self.folder)


@dataclass(frozen=True)
class Outcome(ABC):
    """A search of a project, done or stopped.

    Attributes
    ----------
    folder
        The folder of its run, or None.
    stopped_by
        The interrupt that stopped it before its end, Ctrl-C or another signal; results so far are in the folder.
    """

    _: KW_ONLY
    folder: Path | None
    stopped_by: KeyboardInterrupt | None = None

    @property
    def interrupted(self) -> bool:
        """Whether the search was stopped before its end."""
        return self.stopped_by is not None

    def watch(self) -> WatchedPage:
        """The page of the run, without waiting; see `watch_run`.

        Raises
        ------
        StorageError
            Where the search has no folder.
        InputError
            See `watch_run`.
        """
        if self.folder is None:
            raise StorageError(Fault("there is no run folder to show", "watch", attempt="out, a folder of the run"))
        return watch_run(self.folder)


@displayed
@dataclass(frozen=True)
class CalibrationRun(Run, ResultPlots):
    """The stored run of one or several calibrations.

    Attributes
    ----------
    results
        Label -> result of every finished calibration.
    """

    results: Mapping[str, CalibrationResult]

    @property
    def headline(self) -> CalibrationResult:
        return headline_of(self.results)[1]


@displayed
@dataclass(frozen=True)
class SweepRun(Run):
    """The stored run of a sweep.

    Attributes
    ----------
    result
        Its result, with every cell.
    """

    result: SweepResult

    @property
    def headline(self) -> SweepResult:
        return self.result


def headline_of(results: Mapping[str, CalibrationResult]) -> tuple[str, CalibrationResult]:
    """Label and result to show first: the joint one, the only one, or "" and all combined by `side_by_side`."""
    if "joint" in results:
        return "joint", results["joint"]
    if len(results) == 1:
        return next(iter(results.items()))
    return "", side_by_side(results)


def side_by_side(results: Mapping[str, CalibrationResult]) -> CalibrationResult:
    """Separate results combined: each parameter with its experiment in brackets, losses averaged, counts added."""
    parameters: dict[str, Estimate] = {}
    importance: dict[str, float] = {}
    for label, result in results.items():
        for name, estimate in result.parameters.items():
            own = name if name.endswith("]") else f"{name}[{label}]"
            parameters[own] = estimate
            if name in result.importance:
                importance[own] = result.importance[name]
    first = next(iter(results.values()))
    return replace(
        first,
        parameters=parameters,
        importance=importance,
        loss=sum(result.loss for result in results.values()) / len(results),
        n_solves=sum(result.n_solves for result in results.values()),
        n_factorisations=sum(result.n_factorisations for result in results.values()),
        wall_s=sum(result.wall_s for result in results.values()),
        n_failed_trials=sum(result.n_failed_trials for result in results.values()),
        status=" ".join(f"{label}: {result.status}" for label, result in results.items()),
        converged=None if first.converged is None else all(result.converged for result in results.values()),
        experiments={name: fit for result in results.values() for name, fit in result.experiments.items()},
        held_out={},  # each calibration has its own prediction
        trials=(),
        notes=tuple(
            replace(note, text=f"{label}: {note.text}") for label, result in results.items() for note in result.notes
        ),
    )
