"""The whole corrected record of an experiment, and its comparison with the calibrated twin."""

from __future__ import annotations

import numpy as np

from softcal.analysis.record import RecordFit, record_fit
from softcal.calibration.problem.experiment import PULLEY_FRICTION
from softcal.calibration.results.result import CalibrationResult
from softcal.declare import checked_arguments
from softcal.errors import Fault, InputError
from softcal.experiments.dataset import Dataset
from softcal.project.project import Project, ProjectSource, project_of
from softcal.workflows.calibration import calibrated
from softcal.workflows.simulation import robot_in

TIME = "time"
# Steps that change a channel's values. A record that lacks one of them is not comparable with the fitted samples.
CORRECTIONS = ("zero", "detrend", "remove_slack", "correct_pulley_friction")


def whole_record(project: Project, name: str) -> Dataset | None:
    """Every sample of an experiment after the corrections, before the selection of cycles, a branch or a window.

    Returns
    -------
    Dataset or None
        With ascending `time` [s]; None if the experiment has no such record, or every sample of it is compared.

    Raises
    ------
    InputError
        If the compared samples have a correction that the record lacks.
    """
    samples, record = project.experiments[name].dataset, project.corrected[name]
    if record is None or not ascends(record):
        return None
    if TIME in samples.channels and np.array_equal(samples.values(TIME), record.values(TIME)):
        return None
    later = [step.name for step in samples.provenance[len(record.provenance) :] if step.name in CORRECTIONS]
    if later:
        raise InputError(
            Fault(
                "the whole record lacks a correction that the compared samples have",
                f"{name}, prepare",
                ", ".join(later),
                attempt="that step before select_cycles and take_branch",
            )
        )
    return record


@checked_arguments
def compare_records(project: ProjectSource, result: CalibrationResult) -> dict[str, RecordFit]:
    """Experiment -> comparison of the calibrated twin with its whole record, if it has one.

    Quasi-static, driven by every sample; paper A's Fig. 6 and Table II. A failed comparison gives its reason.
    project: a project, or the path of a project file.

    Raises
    ------
    InputError
        If the project cannot be loaded.
    ParameterError
        If the result belongs to another project.
    """
    project = project_of(project)
    found: dict[str, RecordFit] = {}
    at_values = calibrated(project, result)
    for name in result.experiments:
        experiment = at_values.experiments[name]
        if not experiment.drives:
            continue
        try:
            record = whole_record(at_values, name)
        except InputError as error:
            found[name] = RecordFit(None, project.records[name], experiment.drives, failure=str(error))
            continue
        if record is None:
            continue
        rig = dict(experiment.rig_values())
        friction = result.parameters.get(PULLEY_FRICTION)
        if friction is not None:
            rig[PULLEY_FRICTION] = friction.value
        found[name] = record_fit(robot_in(at_values, name), experiment, rig, record)
    return found


def ascends(data: Dataset) -> bool:
    """Whether a dataset's times never descend and are not all equal."""
    if TIME not in data.channels:
        return False
    steps = np.diff(data.values(TIME))
    return bool((steps >= 0.0).all() and (steps > 0.0).any())
