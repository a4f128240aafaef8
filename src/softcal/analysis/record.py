"""Errors of the calibrated twin over a whole record, loading and unloading, as in paper A (Fig. 6, Table II).

The fit uses selected samples: a branch, some cycles, a window. Here the twin is driven by every sample of the
corrected record. Where the twin is elastic, hysteresis and changes from cycle to cycle remain as errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.problem.experiment import Experiment
from softcal.calibration.problem.observation import observe, protocol_told
from softcal.calibration.results.fit import experiment_fit
from softcal.calibration.results.result import ExperimentFit
from softcal.display import displayed
from softcal.errors import ParameterError
from softcal.experiments.dataset import Dataset
from softcal.twin.protocol import command_faults, let_go_faults
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

# With several driven actuators every sample is a separate solve.
MAX_SOLVED_SAMPLES = 200


@displayed
@dataclass(frozen=True)
class RecordFit:
    """Comparison of the twin with a whole record, or why it failed.

    Attributes
    ----------
    fit
        Errors and values of the compared channels over the samples [SI]; None if the simulation failed.
    record
        The samples that were compared, with `time` [s].
    drives
        The channels of the record that drove the twin.
    every
        Stride: 1 if every sample was compared; k if only every k-th, as with several driven actuators.
    failure
        Why there is no fit, or "".
    remembers
        True if the twin has a memory: its material, its cables or their pulleys; else it is elastic, without loops.
    """

    fit: ExperimentFit | None
    record: Dataset
    drives: tuple[str, ...]
    every: int = 1
    failure: str = ""
    remembers: bool = False


def record_fit(robot: Robot, experiment: Experiment, rig: Mapping[str, float], record: Dataset) -> RecordFit:
    """Compare the twin with every sample of a record.

    Parameters
    ----------
    robot
        The robot at the calibrated values.
    experiment
        Defines the driving and the compared channels; its own samples are not used.
    rig
        Name -> calibrated parameter of the rig [SI].
    record
        The record, corrected as the experiment's samples were, with `time` [s] and the channels that drive the twin.
        Samples without a value of a driving channel are omitted.

    Raises
    ------
    DatasetError
        Where the record has no time, or lacks a channel that drives the twin or is compared.
    """
    driven = np.all([np.isfinite(record.values(channel)) for channel in experiment.drives], axis=0)
    rows = np.flatnonzero(driven & np.isfinite(record.values("time")))
    in_order = robot.remembers or experiment.rig.backlash is not None  # every reversal counts
    every = 1 if in_order or len(experiment.drives) < 2 else max(1, -(-len(rows) // MAX_SOLVED_SAMPLES))
    channels = {name: replace(c, values=c.values[rows[::every]]) for name, c in record.channels.items()}
    compared = replace(record, channels=channels, cycle=None, labels=())
    whole = replace(experiment, dataset=compared)
    protocol = protocol_told(robot, whole, rig)
    if faults := [*command_faults(robot, protocol), *let_go_faults(robot, protocol)]:
        return RecordFit(None, compared, experiment.drives, every, str(ParameterError(faults)))
    response = simulate(robot, protocol)
    if not response.succeeded:
        return RecordFit(None, compared, experiment.drives, every, response.status)
    pulleys = experiment.rig.pulleys
    remembers = robot.remembers or (pulleys is not None and pulleys.friction_memory)
    fit = experiment_fit(whole, observe(whole, rig, response, slice(None)))
    return RecordFit(fit, compared, experiment.drives, every, remembers=remembers)
