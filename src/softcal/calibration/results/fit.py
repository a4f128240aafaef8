"""Goodness of fit of one experiment: errors by channel, distances by marker, cycles, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.loss import rms, rms_detrended
from softcal.calibration.problem.observation import Observation
from softcal.calibration.results.result import CycleFit, Distance, ExperimentFit
from softcal.checks import Floats
from softcal.experiments.dataset import Dataset
from softcal.experiments.driven import driven_whole
from softcal.experiments.hysteresis import loops
from softcal.experiments.steps.branches import cycle_rows


def experiment_fit(
    experiment: Experiment,
    seen: Observation,
    bands: Mapping[str, Floats] | None = None,
    repeats: Mapping[str, Floats] | None = None,
) -> ExperimentFit:
    """The errors of the predicted measurements of an experiment.

    Parameters
    ----------
    experiment, seen
        The experiment, and what the twin predicts of it.
    bands, repeats
        Channel -> half-width (n,) [SI] at its measured samples.
    """
    channels = experiment.dataset.channels
    errors = {
        channel: (seen.predicted[channel] - channels[channel].values)[experiment.seen(channel)]
        for channel in experiment.compared
    }
    distances: dict[str, Distance] = {}
    for point in experiment.points:
        parts = experiment.parts_of(point)
        if len(parts) == 3:
            away = np.sqrt(sum(errors[part] ** 2 for part in parts))
            distances[point] = Distance(float(away.mean()), float(away.max()), rms(away), len(away))
    cycles: tuple[CycleFit, ...] = ()  # where their samples were looked for, and go both ways
    of = driven_whole(experiment.dataset) if has_cycles(experiment.dataset) else None
    if of is not None and seen.predicted.keys() & set(of.names):
        simulated = {name: replace(one, values=seen.predicted.get(name, one.values)) for name, one in channels.items()}
        both = zip(loops(experiment.dataset), loops(replace(experiment.dataset, channels=simulated)), strict=True)
        cycles = tuple(CycleFit(*pair) for pair in both)
    return ExperimentFit(
        rmse={channel: rms(error) for channel, error in errors.items()},
        rmse_detrended={channel: rms_detrended(error) for channel, error in errors.items()},
        measured={name: channel.values for name, channel in channels.items()},
        simulated=dict(seen.predicted),
        units={**seen.units, **{name: channel.unit for name, channel in channels.items()}},
        response=dict(seen.response),
        distances=distances,
        length=experiment.rig.length,
        missing={name: len(rows) for name, rows in missing_rows(experiment).items()},
        bands=_at_all(experiment, bands or {}),
        repeats=_at_all(experiment, repeats or {}),
        cycles=cycles,
        driven=of if cycles else None,
    )


def missing_rows(experiment: Experiment) -> dict[str, list[int]]:
    """Rows (from 0) in which a marker or a compared channel was not measured, by its name; only names with
    such rows.
    """
    rows: dict[str, list[int]] = {}
    for channel in experiment.compared:
        name = experiment.point_of(channel) or channel
        rows[name] = np.flatnonzero(~experiment.seen(channel)).tolist()
    return {name: held for name, held in rows.items() if held}


def _at_all(experiment: Experiment, widths: Mapping[str, Floats]) -> dict[str, Floats]:
    """Values of the measured samples at all samples, NaN at the others."""
    found: dict[str, Floats] = {}
    for channel, values in widths.items():
        seen = experiment.seen(channel)
        found[channel] = np.full(len(seen), np.nan)
        found[channel][seen] = values
    return found


def has_cycles(data: Dataset) -> bool:
    """Whether a dataset has cycles of an actuator's coordinate and effort that go both ways, every sample measured."""
    of = driven_whole(data)
    if of is None or data.cycle is None or not (data.cycle >= 0).any():
        return False
    known = np.isfinite(data.values(of.coordinate)) & np.isfinite(data.values(of.effort))
    both = all(min(len(one.loading), len(one.unloading)) > 1 for one in cycle_rows(data))
    return both and bool(known[data.cycle >= 0].all())
