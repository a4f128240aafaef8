"""The calibrated twin over a whole record, loading and unloading, as paper A judges its own (Fig. 6, Table II).

The fit compares chosen samples: a branch, some cycles, a window. Here the twin is driven by every sample of the
corrected record. It is elastic: one value of force and pitch for each travel. So what differs between loading and
unloading, and from cycle to cycle, remains as error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from softcal.calibration.experiment import Experiment
from softcal.calibration.fit import experiment_fit
from softcal.calibration.observation import commands, observe
from softcal.calibration.result import ExperimentFit
from softcal.errors import ParameterError
from softcal.experiments.dataset import Dataset
from softcal.twin.protocol import Protocol, command_faults, let_go_faults
from softcal.twin.robot import Robot
from softcal.twin.simulate import simulate

# Every sample is a solve of its own where several cables are driven.
MAX_SOLVED_SAMPLES = 200


@dataclass(frozen=True)
class RecordFit:
    """The twin over a whole record, or why it could not be computed.

    Attributes
    ----------
    fit
        Errors and values of the compared channels over the samples [SI]; None where the twin could not follow.
    record
        The samples that were compared, with `time` [s].
    drives
        The channels of the record that drove the twin.
    every
        1 where each sample of the record was compared; k where only every k-th was, as several cables are driven.
    failure
        Why there is no fit; "" where there is one.
    """

    fit: ExperimentFit | None
    record: Dataset
    drives: tuple[str, ...]
    every: int = 1
    failure: str = ""


def record_fit(robot: Robot, experiment: Experiment, rig: Mapping[str, float], record: Dataset) -> RecordFit:
    """Compare the twin with every sample of a record.

    Parameters
    ----------
    robot
        The twin, with the values that were found.
    experiment
        What drives the twin and what is compared. Its own samples are not used.
    rig
        The rig's parameters as they were found [SI], by name.
    record
        The record, corrected as the experiment's samples were, with `time` [s] and the channels that drive the twin.
        Samples at which a driving channel has no value are left out.

    Raises
    ------
    DatasetError
        Where the record has no time, or lacks a channel that drives the twin or is compared.
    """
    driven = np.all([np.isfinite(record.values(channel)) for channel in experiment.drives], axis=0)
    rows = np.flatnonzero(driven & np.isfinite(record.values("time")))
    every = 1 if len(experiment.drives) < 2 else max(1, -(-len(rows) // MAX_SOLVED_SAMPLES))
    channels = {name: replace(c, values=c.values[rows[::every]]) for name, c in record.channels.items()}
    compared = replace(record, channels=channels, cycle=None, labels=())
    whole = replace(experiment, dataset=compared)
    protocol = Protocol(commands(whole, rig))
    if faults := [*command_faults(robot, protocol), *let_go_faults(robot, protocol)]:
        return RecordFit(None, compared, experiment.drives, every, str(ParameterError(faults)))
    response = simulate(robot, protocol)
    if not response.succeeded:
        return RecordFit(None, compared, experiment.drives, every, response.status)
    return RecordFit(
        experiment_fit(whole, observe(whole, rig, response, slice(None))), compared, experiment.drives, every
    )
