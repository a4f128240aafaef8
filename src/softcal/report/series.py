"""Data of the charts: trajectories with residuals, best loss so far, grids. Nothing here draws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softcal.calibration.result import CalibrationResult, ExperimentFit, Trial
from softcal.checks import Floats, Ints
from softcal.experiments.dataset import Dataset
from softcal.report.content import ExperimentContent, Landscape
from softcal.report.format import SI_UNITS_OF, Scale, channel_label, find_parameter, scale_of


@dataclass(frozen=True)
class Abscissa:
    """The horizontal axis of a trajectory in display units; note: why it is not the expected one, or ""."""

    values: Floats
    label: str
    note: str = ""


@dataclass(frozen=True)
class TrajectoryPanel:
    """One channel over the trajectory in display units; measured and residual are None if not measured."""

    channel: str
    label: str
    scale: Scale
    measured: Floats | None
    simulated: Floats
    residual: Floats | None


@dataclass(frozen=True)
class TrajectoryPanels:
    """One experiment, measured and simulated. pieces: slices of consecutive samples that a line joins."""

    experiment: str
    abscissa: Abscissa
    panels: tuple[TrajectoryPanel, ...]
    pieces: tuple[slice, ...]


def trajectory_panels(experiment: ExperimentContent, fit: ExperimentFit) -> TrajectoryPanels:
    """Panels in order: force, pitch, shortening, other non-position channels."""
    order = ("tension", "pitch", "shortening")
    names = [name for name in order if name in fit.simulated]
    placed = {name for name in fit.simulated if name.rpartition(".")[0] in fit.distances}
    names += [name for name in fit.simulated if name not in {*order, *placed} and name in fit.measured]
    panels: list[TrajectoryPanel] = []
    for name in names:
        scale = scale_of(fit.units.get(name, SI_UNITS_OF.get(name, "1")))
        simulated = np.asarray(fit.simulated[name], dtype=np.float64) / scale.factor
        measured = fit.measured.get(name)
        shown = None if measured is None else np.asarray(measured, dtype=np.float64) / scale.factor
        residual = None if shown is None else simulated - shown
        panels.append(TrajectoryPanel(name, channel_label(name), scale, shown, simulated, residual))
    n_samples = len(panels[0].simulated) if panels else 0
    abscissa = _abscissa(experiment, n_samples)
    return TrajectoryPanels(experiment.name, abscissa, tuple(panels), _pieces(experiment.prepared, n_samples))


def _abscissa(experiment: ExperimentContent, n_samples: int) -> Abscissa:
    data = experiment.prepared
    if data.n_samples != n_samples:
        note = f"{n_samples} samples were compared, the prepared data has {data.n_samples}; the axis is their number."
        return Abscissa(np.arange(n_samples, dtype=np.float64), "Sample", note)
    for name in (experiment.drive, "time"):
        if name in data.channels and np.all(np.diff(data.values(name)) >= 0):
            scale = scale_of(data.channels[name].unit)
            return Abscissa(data.values(name) / scale.factor, scale.axis(channel_label(name)))
    return Abscissa(np.arange(n_samples, dtype=np.float64), "Sample")


def _pieces(data: Dataset, n_samples: int) -> tuple[slice, ...]:
    if data.cycle is None or data.n_samples != n_samples:
        return (slice(0, n_samples),)
    cuts = [0, *(np.flatnonzero(np.diff(data.cycle)) + 1).tolist(), n_samples]
    return tuple(slice(start, stop) for start, stop in pairwise(cuts))


@dataclass(frozen=True)
class SearchHistory:
    """Losses in the order of the trials: numbers (n,), losses (n,), best so far (n,), and numbers of failed trials."""

    numbers: Ints
    losses: Floats
    best: Floats
    failed: Ints


def search_history(trials: Sequence[Trial]) -> SearchHistory:
    """Best loss so far over the completed trials, and the failed trials."""
    done = [(trial.number, trial.loss) for trial in trials if trial.state == "COMPLETE" and trial.loss is not None]
    losses = np.array([loss for _, loss in done], dtype=np.float64)
    return SearchHistory(
        np.array([index for index, _ in done], dtype=np.int64),
        losses,
        np.minimum.accumulate(losses) if len(losses) else losses,
        np.array([trial.number for trial in trials if trial.state == "FAILED"], dtype=np.int64),
    )


def searched_pair(result: CalibrationResult) -> tuple[str, str] | None:
    """The modulus and Poisson's ratio of a result, or the first two parameters; None if there is only one."""
    modulus = find_parameter(result.parameters, "youngs_modulus")
    ratio = find_parameter(result.parameters, "poissons_ratio")
    rest = [name for name in result.parameters if name not in (modulus, ratio)]
    names = [name for name in (modulus, ratio) if name is not None] + rest
    return (names[0], names[1]) if len(names) >= 2 else None


def grid_of_trials(result: CalibrationResult) -> Landscape | None:
    """The trials as a grid over both parameters; None if they do not fill a grid."""
    pair = searched_pair(result)
    if pair is None or len(result.parameters) != 2:
        return None
    x_name, y_name = pair
    trials = [trial for trial in result.trials if x_name in trial.theta and y_name in trial.theta]
    x = np.unique([trial.theta[x_name] for trial in trials])
    y = np.unique([trial.theta[y_name] for trial in trials])
    if min(len(x), len(y)) < 3 or len(x) * len(y) != len(trials):
        return None
    loss = np.zeros((len(y), len(x)))
    failed = np.ones((len(y), len(x)), dtype=np.int64)
    for trial in trials:
        if trial.loss is not None and trial.state == "COMPLETE":
            at = np.searchsorted(y, trial.theta[y_name]), np.searchsorted(x, trial.theta[x_name])
            loss[at], failed[at] = trial.loss, 0
    return Landscape(x_name, y_name, x, y, loss, failed)
