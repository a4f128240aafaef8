"""sweep(problem, axes): every cell of a grid over given values, then its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from softcal.calibration.problem.fingerprint import fingerprints
from softcal.calibration.problem.problem import Problem
from softcal.calibration.results.result import SweepResult
from softcal.calibration.results.result_files import write_result
from softcal.calibration.search.optimisers.grid import GridOptimiser
from softcal.calibration.search.outcome import conclude
from softcal.calibration.search.search import Observer, Search, searched
from softcal.calibration.search.settings import SearchSettings
from softcal.executors.executor import Executor


def sweep(
    problem: Problem,
    axes: Mapping[str, Sequence[float]],
    *,
    seed: int = SearchSettings.seed,
    workers: int | Executor = 1,
    store: Path | None = None,
    resume: bool = False,
    progress: Observer | None = None,
) -> SweepResult:
    """Evaluate a problem in every cell of a grid.

    Parameters
    ----------
    problem
        The robot, the experiments, the parameters that are varied and the loss.
    axes
        Label of every free parameter -> its values [SI]; the last parameter changes fastest.
    seed
        Seed of the importances (fANOVA).
    workers, store, resume, progress
        As for `softcal.calibration.run.calibrate`.

    Raises
    ------
    ParameterError
        Where the axes are not the free parameters, or a value lies outside its bounds.
    StorageError
        Where the folder cannot be used, or holds a run of something else.
    CalibrationError
        Where no cell could be simulated, or there are no workers any more. The cells are stored.
    """
    given = {label: tuple(values) for label, values in axes.items()}
    grid = GridOptimiser.over(problem.space, given)
    settings = SearchSettings(GridOptimiser.name, grid.total, seed)
    search = Search(
        problem,
        GridOptimiser,
        lambda batch: grid,
        {**GridOptimiser.settled(settings).record(), "axes": {label: list(values) for label, values in given.items()}},
        fingerprints(problem),
        derives=True,
    )
    with searched(search, workers=workers, store=store, resume=resume, progress=progress) as found:
        result = conclude(SweepResult, problem, found.best, found.trials, found.account, axes=given)
        if found.folder is not None:
            write_result(result, found.folder)
        return result
