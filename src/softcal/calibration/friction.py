"""Friction is modelled with the sign of a cable that is pulled: tests that release a cable are refused, with the
reason.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from softcal.calibration.experiment import Experiment
from softcal.errors import Fault
from softcal.experiments.steps.branches import PULLEY_STEP, branch_of
from softcal.sensing.sensors.cable import TENSION
from softcal.twin.protocol import let_go_fault, lets_go
from softcal.twin.robot import Robot


def friction_faults(robot: Robot, experiment: Experiment, free: Collection[str]) -> list[Fault]:
    """What in an experiment cannot be compared under the friction of its pulleys and cables. free: its parameters."""
    return [*pulley_faults(experiment), *_cable_faults(robot, experiment, free)]


def pulley_faults(experiment: Experiment) -> list[Fault]:
    """Tensions corrected for the pulleys as on one branch although the samples are of both branches."""
    corrected = any(s.name == PULLEY_STEP and s.settings["exponent"] > 0.0 for s in experiment.dataset.provenance)
    turning = experiment.rig.pulleys is not None and experiment.rig.pulleys.turning > 0.0
    tensions = [c for c in (*experiment.drives, *experiment.compared) if experiment.twin_channel(c).kind == TENSION]
    if not tensions or not (corrected or turning) or not _lets_go(experiment):
        return []
    return [
        Fault(
            "the pulleys' friction has opposite signs during loading and unloading",
            experiment.name,
            got=f"samples of both, one correction of {', '.join(tensions)}",
            allowed="one branch, or the mean of both",
            attempt="find_cycles and take_branch in its preparation",
        )
    ]


def _cable_faults(robot: Robot, experiment: Experiment, free: Collection[str]) -> list[Fault]:
    branch = branch_of(experiment.dataset) or "loading"
    if branch == "loading" and not _lets_go(experiment):
        return []
    faults: list[Fault] = []
    for cable in robot.cables:
        key = f"{cable.name}.friction_coefficient"
        friction = experiment.settings.get(key, cable.friction_coefficient)
        if cable.name in experiment.cables and (friction > 0.0 or key in free):
            got = "its samples do both" if branch == "loading" else f"take_branch: {branch}"
            faults.append(let_go_fault(experiment.name, cable.name, got))
    return faults


def _lets_go(experiment: Experiment) -> bool:
    """Whether the samples, one after the other, pull the one driven cable and release it again.

    Samples with labels, and those of several cables, are independent states.
    """
    dataset, drive = experiment.dataset, experiment.drive
    if dataset.labels or not isinstance(drive, str) or not experiment.cable:
        return False
    values = dataset.values(drive)
    return bool(np.all(np.isfinite(values))) and lets_go(values)
